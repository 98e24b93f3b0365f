"""What a search asks of a design: stable corners, margins, linear flights through commands, turbulence and gusts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from controller.design.design import Actuator, Design, Feedforward
from controller.design.design_file import design_of
from controller.design.design_model import DesignModel
from controller.design.scheduled_controller import ScheduledController
from hfa_model.aircraft import Aircraft
from hfa_model.support.errors import BadInputError, NoSolutionError
from trim.linear.linear_model import LinearModel, level_model
from verification.riccati.gare_schur import quick_solution
from verification.synthesis.command_flight import fly_commands
from verification.synthesis.controllers import controller_at, controller_table
from verification.synthesis.corners import corner_loops
from verification.synthesis.moving_air import gust_held, gust_share, turbulence_rms
from verification.synthesis.servo_loop import ServoLoop, servo_loop, servo_plant
from verification.synthesis.tuning import Evaluation, Tuning

#: Cost of a constraint that is missed by its own size, and of a design without a stable loop.
PENALTY, LOST = 1e3, 1e6


class DesignEvaluation:
    """Evaluates values of the variables of a search; the linear models are made once."""

    def __init__(self, aircraft: Aircraft, tuning: Tuning) -> None:
        self._aircraft, self._tuning = aircraft, tuning
        self._models = {angle: level_model(aircraft, angle) for angle in dict(tuning.places)}
        cornered = [Aircraft(aircraft.parameters, name) for name in tuning.dynamics or (aircraft.variant,)]
        self._at_corners = [(each, level_model(each, angle)) for each in cornered for angle in tuning.angles]
        self._in_gusts = []
        for gust in tuning.gusts:
            flown = Aircraft(aircraft.parameters, gust.dynamics or aircraft.variant)
            self._in_gusts.append((flown, level_model(flown, gust.dihedral), gust))

    def at(self, values: np.ndarray, below: float = math.inf) -> Evaluation:
        """Of values of the variables, as `of`."""
        return self.of(self._tuning.entries_at(values), below)

    def held(self, entries: Mapping[str, Any]) -> tuple[float, ...]:
        """Of the entries of a design file, the largest peak stood in each gust of the search, ft/s, as `gust_held`."""
        still = replace(design_of(self._tuning.name, entries), feedforward=None)
        return tuple(
            gust_held(flown, model, quick_controller(flown, model, still), gust)
            for flown, model, gust in self._in_gusts
        )

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

    def _parts(self, design: Design) -> Iterator[Evaluation]:
        """The evaluation with ever more in it, by what it takes; no part makes the cost smaller."""
        tuning, still = self._tuning, replace(design, feedforward=None)
        tables = {angle: quick_controller(self._aircraft, model, still) for angle, model in self._models.items()}
        closed = {place: self._closed(*place, tables) for place in tuning.places}
        worst = max(loop.abscissa for _, loop in closed.values())
        fastest = max(float(np.abs(np.linalg.eigvals(loop.closed)).max()) for _, loop in closed.values())
        missed, rms, sizes = [fastest / tuning.fastest - 1.0], [], []
        for air in tuning.turbulence if worst < 0.0 else ():
            states = turbulence_rms(*closed[air.dihedral, air.actuator], air.intensity, air.scale)
            rms.append({name: states[name] for name in air.objective})
            sizes += [size * states[name] for name, size in air.objective.items()]
        found = Evaluation(self._cost(sizes, missed), math.inf, rms=tuple(rms), fastest=fastest)
        if worst < 0.0:
            yield found._replace(cost=min(found.cost, LOST))  # a corner may be unstable yet
        abscissa = -math.inf
        for flown, model in self._at_corners:
            table = quick_controller(flown, model, still)
            abscissa = max(abscissa, *(loop.abscissa for _, loop in corner_loops(flown, model, table)))
            worst = max(worst, abscissa)
            if worst >= 0.0:
                yield Evaluation(LOST * (1.0 + worst), worst)
        if worst >= 0.0:
            return
        missed.append((abscissa - tuning.abscissa) / abs(tuning.abscissa))
        found = found._replace(cost=self._cost(sizes, missed), abscissa=abscissa)
        yield found
        commanded = {case.dihedral for case in tuning.cases}
        if design.feedforward:
            tables = {angle: quick_controller(self._aircraft, self._models[angle], design) for angle in commanded}
        shaping, flights = design.feedforward or Feedforward(), []
        for case in tuning.cases:
            plant = closed[case.dihedral, case.actuator][0]
            flights.append(fly_commands(plant, tables[case.dihedral], case.ends, case.each, shaping))
            sizes += [size * flights[-1].errors[name] for name, size in tuning.objective.items()]
            missed.append(flights[-1].rate / tuning.rate - 1.0)
        errors, rates = tuple(flight.errors for flight in flights), tuple(flight.rate for flight in flights)
        found = found._replace(cost=self._cost(sizes, missed), errors=errors, rates=rates)
        yield found
        if tuning.margin:
            margin = min(_margin(loop) for _, loop in closed.values())
            missed.append(1.0 - margin / tuning.margin)
            found = found._replace(cost=self._cost(sizes, missed), margin=margin)
            yield found
        for flown, model, gust in self._in_gusts:
            share = gust_share(flown, model, quick_controller(flown, model, still), gust)
            missed.append(share - 1.0)
            found = found._replace(cost=self._cost(sizes, missed), gusts=(*found.gusts, share))
            yield found

    def _cost(self, sizes: Sequence[float], missed: Sequence[float]) -> float:
        """The norm of the sizes, and what is missed."""
        with np.errstate(over="ignore"):
            norm = np.linalg.norm(sizes, self._tuning.power) if sizes else 0.0
        return float(norm + PENALTY * sum(max(0.0, each) for each in missed))

    def _closed(
        self, angle: float, actuator: Actuator, tables: dict[float, ScheduledController]
    ) -> tuple[DesignModel, ServoLoop]:
        """The plant with this actuator at every input, and its loop."""
        table = tables[angle]
        plant = servo_plant(self._aircraft, self._models[angle], table, dict.fromkeys(table.inputs, actuator))
        return plant, servo_loop(plant, table)


def _margin(loop: ServoLoop) -> float:
    return min(loop.margin_at_inputs().disk, loop.margin_at_sensors().disk)


def quick_controller(aircraft: Aircraft, model: LinearModel, design: Design) -> ScheduledController:
    """The controller of one angle without its certificate; NoSolutionError when there is none."""
    feedback = "output" if design.sensors else "state"
    found = controller_at(aircraft, model, design, feedback, quick_solution)
    return controller_table(aircraft, design, feedback, [model], [found])
