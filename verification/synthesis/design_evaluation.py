"""What a search asks of a design: stable corners, margins, linear flights through commands, turbulence and gusts."""

from __future__ import annotations

import math

import numpy as np

from controller.design.design import Actuator, Design, Feedforward
from controller.design.design_file import design_of
from controller.design.design_model import DesignModel, design_model
from controller.design.scheduled_controller import ScheduledController
from controller.flight.envelope import flight_envelope
from hfa_model.aircraft import Aircraft
from hfa_model.support.errors import NoSolutionError
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize
from trim.point.condition import level_flight
from trim.point.solve import find_operating_point
from verification.riccati.gare_schur import quick_solution
from verification.riccati.output_feedback import central_controller
from verification.synthesis.command_flight import fly_commands
from verification.synthesis.command_path import with_commands
from verification.synthesis.controllers import controller_table, from_estimator, problem_of
from verification.synthesis.corners import corner_loops
from verification.synthesis.moving_air import gust_stood, turbulence_rms
from verification.synthesis.servo_loop import ServoLoop, servo_loop, servo_plant
from verification.synthesis.tuning import Evaluation, Tuning

#: Cost of a constraint that is missed by its own size, and of a design without a stable loop.
PENALTY, LOST = 1e3, 1e6


class DesignEvaluation:
    """Evaluates values of the variables of a search; the linear models are made once."""

    def __init__(self, aircraft: Aircraft, tuning: Tuning) -> None:
        self._aircraft, self._tuning = aircraft, tuning
        angles = dict.fromkeys([*tuning.angles, *(angle for angle, _ in tuning.places)])
        self._models = {
            angle: linearize(aircraft, find_operating_point(aircraft, level_flight(angle))) for angle in angles
        }

    def at(self, values: np.ndarray) -> Evaluation:
        """The cost; `LOST` and more for a design that has no controller or no stable loop."""
        tuning = self._tuning
        design = design_of(tuning.name, tuning.entries_at(values))
        try:
            tables = {angle: quick_controller(self._aircraft, model, design) for angle, model in self._models.items()}
        except (NoSolutionError, np.linalg.LinAlgError):
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
        stood = [self._stood(*closed[gust.dihedral, gust.actuator], gust.length) for gust in tuning.gusts]
        margin = min(_margin(loop) for _, loop in closed.values()) if tuning.margin else 0.0
        fastest = max(float(np.abs(np.linalg.eigvals(table.A)).max()) for table in tables.values())
        cost = sum(size * flight.errors[name] for flight in flights for name, size in tuning.objective.items())
        cost += sum(
            size * found[name]
            for air, found in zip(tuning.turbulence, rms, strict=True)
            for name, size in air.objective.items()
        )
        missed = [
            (abscissa - tuning.abscissa) / abs(tuning.abscissa),
            *(flight.rate / tuning.rate - 1.0 for flight in flights),
            *(gust.peak / max(peak, 1e-3) - 1.0 for gust, peak in zip(tuning.gusts, stood, strict=True)),
            1.0 - margin / tuning.margin if tuning.margin else 0.0,
            fastest / tuning.fastest - 1.0,
        ]
        cost += PENALTY * sum(max(0.0, each) for each in missed)
        errors, rates = tuple(flight.errors for flight in flights), tuple(flight.rate for flight in flights)
        return Evaluation(float(cost), abscissa, errors, rates, tuple(rms), tuple(stood), margin, fastest)

    def _closed(
        self, angle: float, actuator: Actuator, tables: dict[float, ScheduledController]
    ) -> tuple[DesignModel, ServoLoop]:
        """The plant with this actuator at every input, and its loop."""
        table = tables[angle]
        plant = servo_plant(self._aircraft, self._models[angle], table, dict.fromkeys(table.inputs, actuator))
        return plant, servo_loop(plant, table)

    def _stood(self, plant: DesignModel, loop: ServoLoop, length: float) -> float:
        return gust_stood(plant, loop, flight_envelope(self._aircraft.parameters, plant.model.point), length)


def _margin(loop: ServoLoop) -> float:
    return min(loop.margin_at_inputs().disk, loop.margin_at_sensors().disk)


def quick_controller(aircraft: Aircraft, model: LinearModel, design: Design) -> ScheduledController:
    """The output-feedback controller of one angle without its certificate; NoSolutionError when there is none."""
    built = design_model(aircraft, model, design)
    problem = problem_of(built)
    X, Y = quick_solution(problem.game), quick_solution(problem.dual)
    found = with_commands(aircraft, built, from_estimator(built, central_controller(problem, X, Y)))
    return controller_table(aircraft, design, "output", [model], [found])
