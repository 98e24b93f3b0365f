"""What a search asks of a design: stable corners, margins, linear flights through commands, turbulence and gusts."""

from __future__ import annotations

import math
from collections.abc import Mapping
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
        self._models = {angle: level_model(aircraft, angle) for angle in (*tuning.angles, *dict(tuning.places))}
        self._in_gusts = []
        for gust in tuning.gusts:
            flown = Aircraft(aircraft.parameters, gust.dynamics or aircraft.variant)
            self._in_gusts.append((flown, level_model(flown, gust.dihedral), gust))

    def at(self, values: np.ndarray) -> Evaluation:
        """Of values of the variables."""
        return self.of(self._tuning.entries_at(values))

    def held(self, entries: Mapping[str, Any]) -> tuple[float, ...]:
        """Of the entries of a design file, the largest peak stood in each gust of the search, ft/s, as `gust_held`."""
        still = replace(design_of(self._tuning.name, entries), feedforward=None)
        return tuple(
            gust_held(flown, model, quick_controller(flown, model, still), gust)
            for flown, model, gust in self._in_gusts
        )

    def of(self, entries: Mapping[str, Any]) -> Evaluation:
        """The cost; `LOST` and more for a design that has no controller or no stable loop."""
        tuning = self._tuning
        try:
            design = design_of(tuning.name, entries)
            still, commanded = replace(design, feedforward=None), {case.dihedral for case in tuning.cases}
            tables = {
                angle: quick_controller(self._aircraft, model, design if angle in commanded else still)
                for angle, model in self._models.items()
            }
            in_gusts = [quick_controller(flown, model, still) for flown, model, _ in self._in_gusts]
        except (BadInputError, NoSolutionError, np.linalg.LinAlgError):
            return Evaluation(2.0 * LOST, math.inf)
        corners = (
            loop.abscissa
            for angle in tuning.angles
            for _, loop in corner_loops(self._aircraft, self._models[angle], tables[angle])
        )
        abscissa = max(corners)
        closed = {place: self._closed(*place, tables) for place in tuning.places}
        worst = max(abscissa, *(loop.abscissa for _, loop in closed.values()))
        if worst >= 0.0:
            return Evaluation(LOST * (1.0 + worst), abscissa)
        flights = [
            fly_commands(
                closed[case.dihedral, case.actuator][0],
                tables[case.dihedral],
                case.ends,
                case.each,
                design.feedforward or Feedforward(),
            )
            for case in tuning.cases
        ]
        rms = []
        for air in tuning.turbulence:
            found = turbulence_rms(*closed[air.dihedral, air.actuator], air.intensity, air.scale)
            rms.append({name: found[name] for name in air.objective})
        gusts = [
            gust_share(flown, model, table, gust)
            for table, (flown, model, gust) in zip(in_gusts, self._in_gusts, strict=True)
        ]
        margin = min(_margin(loop) for _, loop in closed.values()) if tuning.margin else 0.0
        fastest = max(float(np.abs(np.linalg.eigvals(loop.closed)).max()) for _, loop in closed.values())
        cost = sum(size * flight.errors[name] for flight in flights for name, size in tuning.objective.items())
        cost += sum(
            size * found[name]
            for air, found in zip(tuning.turbulence, rms, strict=True)
            for name, size in air.objective.items()
        )
        missed = [
            (abscissa - tuning.abscissa) / abs(tuning.abscissa),
            *(flight.rate / tuning.rate - 1.0 for flight in flights),
            *(share - 1.0 for share in gusts),
            1.0 - margin / tuning.margin if tuning.margin else 0.0,
            fastest / tuning.fastest - 1.0,
        ]
        cost += PENALTY * sum(max(0.0, each) for each in missed)
        errors, rates = tuple(flight.errors for flight in flights), tuple(flight.rate for flight in flights)
        return Evaluation(float(cost), abscissa, errors, rates, tuple(rms), tuple(gusts), margin, fastest)

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
