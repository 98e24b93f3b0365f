"""What a search asks of a design: stable corners, margins, linear flights through commands, turbulence and gusts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from controller.design.controllers import controller_at, controller_table
from controller.design.corners import corner_loops
from controller.design.design import Actuator, Design, Feedforward
from controller.design.design_file import design_of
from controller.design.design_model import DesignModel
from controller.design.scheduled_controller import ScheduledController
from controller.design.servo_loop import ServoLoop, servo_loop, servo_plant
from controller.riccati.gare_schur import quick_solution
from hfa_model.aircraft import Aircraft
from hfa_support.errors import BadInputError, NoSolutionError
from trim.linear.linear_model import LinearModel, level_model
from verification.synthesis.command_flight import fly_commands
from verification.synthesis.moving_air import gust_held, gust_share, turbulence_rms
from verification.synthesis.tuning import Evaluation, Tuning

#: Cost of a constraint that is missed by its own size, and of a design without a stable loop.
PENALTY, LOST = 1e3, 1e6

#: Dynamics and dihedral, rad, of a linear model.
Place = tuple[str, float]
Tables = Callable[[Place], ScheduledController]
#: Dihedral, rad, and actuator of a linear flight -> its plant and its loop.
Loops = Mapping[tuple[float, Actuator], tuple[DesignModel, ServoLoop]]


class DesignEvaluation:
    """Evaluates values of the variables of a search; the linear models are made once."""

    def __init__(self, aircraft: Aircraft, tuning: Tuning) -> None:
        self._tuning, self._own = tuning, aircraft.variant.name
        self._corners = [(name, angle) for name in tuning.dynamics or (self._own,) for angle in tuning.angles]
        self._in_gusts = [((gust.dynamics or self._own, gust.dihedral), gust) for gust in tuning.gusts]
        self._models: dict[Place, tuple[Aircraft, LinearModel]] = {}
        for name, angle in [*((self._own, angle) for angle, _ in tuning.places), *self._corners, *dict(self._in_gusts)]:
            if (name, angle) not in self._models:
                flown = aircraft if name == self._own else Aircraft(aircraft.parameters, name)
                self._models[name, angle] = flown, level_model(flown, angle)

    def at(self, values: np.ndarray, below: float = math.inf) -> Evaluation:
        """Of values of the variables, as `of`."""
        return self.of(self._tuning.entries_at(values), below)

    def held(self, entries: Mapping[str, Any]) -> tuple[float, ...]:
        """Of the entries of a design file, the largest peak stood in each gust of the search, ft/s, as `gust_held`."""
        table_at = self._tables(replace(design_of(self._tuning.name, entries), feedforward=None))
        return tuple(gust_held(*self._models[place], table_at(place), gust) for place, gust in self._in_gusts)

    def of(self, entries: Mapping[str, Any], below: float = math.inf) -> Evaluation:
        """The cost; `LOST` and more for a design that has no controller or no stable loop.

        below: what the cost must not exceed to be of interest. Once it does, what takes longer is left out: the cost is
        then a lower bound, above `below`.
        """
        found = Evaluation(2.0 * LOST, math.inf)
        try:
            for found in self._parts(design_of(self._tuning.name, entries)):
                if found.cost > below:
                    break
        except (BadInputError, NoSolutionError, np.linalg.LinAlgError):
            return Evaluation(2.0 * LOST, math.inf)
        return found

    def _tables(self, design: Design) -> Tables:
        """The controllers of a design, each made when it is first asked for."""
        return cache(lambda place: quick_controller(*self._models[place], design))

    def _parts(self, design: Design) -> Iterator[Evaluation]:
        """The evaluation with ever more in it, by what it takes; no part makes the cost smaller."""
        tuning, account = self._tuning, _Account(self._tuning.power)
        table_at = self._tables(replace(design, feedforward=None))
        loops = {(angle, actuator): self._loop(angle, actuator, table_at) for angle, actuator in tuning.places}
        worst, abscissa = max(loop.abscissa for _, loop in loops.values()), -math.inf
        if worst < 0.0:
            found = self._add_turbulence(account, loops)
            yield found._replace(cost=min(found.cost, LOST))  # a corner may be unstable yet
        for place in self._corners:
            corners = corner_loops(*self._models[place], table_at(place))
            abscissa = max(abscissa, *(loop.abscissa for _, loop in corners))
            worst = max(worst, abscissa)
            if worst >= 0.0:
                yield Evaluation(LOST * (1.0 + worst), worst)
        if worst >= 0.0:
            return
        yield account.add(missed=[(abscissa - tuning.abscissa) / abs(tuning.abscissa)], abscissa=abscissa)
        told_at = self._tables(design) if design.feedforward else table_at
        yield self._add_commands(account, loops, told_at, design.feedforward or Feedforward())
        if tuning.margin:
            margin = min(_margin(loop) for _, loop in loops.values())
            yield account.add(missed=[1.0 - margin / tuning.margin], margin=margin)
        for place, gust in self._in_gusts:
            share = gust_share(*self._models[place], table_at(place), gust)
            yield account.add(missed=[share - 1.0], gusts=(*account.found.gusts, share))

    def _loop(self, angle: float, actuator: Actuator, table_at: Tables) -> tuple[DesignModel, ServoLoop]:
        """The plant with this actuator at every input, and its loop."""
        table = table_at((self._own, angle))
        plant = servo_plant(*self._models[self._own, angle], table, dict.fromkeys(table.inputs, actuator))
        return plant, servo_loop(plant, table)

    def _add_turbulence(self, account: _Account, loops: Loops) -> Evaluation:
        """What turbulence costs, of stable loops, and their fastest pole."""
        sizes, rms = [], []
        for air in self._tuning.turbulence:
            states = turbulence_rms(*loops[air.dihedral, air.actuator], air.intensity, air.scale)
            rms.append({name: states[name] for name in air.objective})
            sizes += [size * states[name] for name, size in air.objective.items()]
        fastest = max(float(np.abs(np.linalg.eigvals(loop.closed)).max()) for _, loop in loops.values())
        return account.add(sizes, [fastest / self._tuning.fastest - 1.0], rms=tuple(rms), fastest=fastest)

    def _add_commands(self, account: _Account, loops: Loops, table_at: Tables, shaping: Feedforward) -> Evaluation:
        """What the commands of the cases cost."""
        flights = []
        for case in self._tuning.cases:
            plant, table = loops[case.dihedral, case.actuator][0], table_at((self._own, case.dihedral))
            flights.append(fly_commands(plant, table, case.ends, case.each, shaping))
        errors, rates = tuple(flight.errors for flight in flights), tuple(flight.rate for flight in flights)
        sizes = [size * each[name] for each in errors for name, size in self._tuning.objective.items()]
        return account.add(sizes, [rate / self._tuning.rate - 1.0 for rate in rates], errors=errors, rates=rates)


class _Account:
    """An evaluation with ever more in it."""

    def __init__(self, power: float) -> None:
        self._power = power
        self._sizes: list[float] = []
        self._missed: list[float] = []
        self.found = Evaluation(0.0, math.inf)

    def add(self, sizes: Sequence[float] = (), missed: Sequence[float] = (), **figures: Any) -> Evaluation:
        """sizes: of errors, weighted. missed: of constraints, as shares of their limits. figures: of the evaluation."""
        self._sizes += sizes
        self._missed += missed
        with np.errstate(over="ignore"):
            norm = np.linalg.norm(self._sizes, self._power) if self._sizes else 0.0
        cost = float(norm + PENALTY * sum(max(0.0, each) for each in self._missed))
        self.found = self.found._replace(cost=cost, **figures)
        return self.found


def _margin(loop: ServoLoop) -> float:
    return min(loop.margin_at_inputs().disk, loop.margin_at_sensors().disk)


def quick_controller(aircraft: Aircraft, model: LinearModel, design: Design) -> ScheduledController:
    """The controller of one angle without its certificate; NoSolutionError when there is none."""
    feedback = "output" if design.sensors else "state"
    found = controller_at(aircraft, model, design, feedback, quick_solution)
    return controller_table(aircraft, design, feedback, [model], [found])
