"""From a design to its controller: the exact gain or the central controller at every angle, certified."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from controller.design.design import Design
from controller.design.design_model import DesignModel, design_model
from controller.design.scheduled_controller import COMMAND_SIGNALS, ScheduledController
from controller.design.servo_loop import servo_loop, servo_plant
from controller.game.zero_sum import Game
from controller.riccati.gare import solve_game
from controller.riccati.output_feedback import (
    OutputGame,
    central_controller,
    minimum_output_delta,
    solve_output_feedback,
)
from controller.riccati.smallest_delta import minimum_delta
from hfa_model.aircraft import Aircraft
from hfa_model.provenance import parameter_hash
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.jsonable import finite_or_none
from hfa_support.progress import Progress, told
from hfa_support.reporting.checks import Check
from trim.linear.linear_model import LinearModel, level_model

#: The solution of a game's Riccati equation, exact, quick or learned.
Value = Callable[[Game], np.ndarray]


@dataclass(frozen=True, eq=False)
class LinearController:
    """x' = A x + B [y; w], u = C x + D [y; w] at one angle, W its anti-windup input, and what certifies it."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    W: np.ndarray
    delta_min: float = math.nan
    checks: tuple[Check, ...] = ()


def design_controller(
    aircraft: Aircraft,
    design: Design,
    dihedrals: np.ndarray,
    feedback: str = "",
    *,
    value: Value | None = None,
    progress: Progress | None = None,
) -> ScheduledController:
    """The controllers of a design at `dihedrals` (N,), rad, increasing, in one table.

    feedback: "state", "output", or "" for output where the design has sensors. value: as `controller_at`.
    Raises NoSolutionError that names the angle at which there is no trim or no certified controller.
    """
    feedback = feedback or ("output" if design.sensors else "state")
    found, models = [], []
    for dihedral in told(dihedrals.tolist(), progress):
        try:
            model = level_model(aircraft, dihedral)
            models.append(model)
            found.append(controller_at(aircraft, model, design, feedback, value))
        except NoSolutionError as error:
            raise NoSolutionError(
                f"design {design.name} at dihedral {math.degrees(dihedral):g} deg: {error}"
            ) from error
    table = controller_table(aircraft, design, feedback, models, found)
    rows = [_row(aircraft, model, design, each, table) for model, each in zip(models, found, strict=True)]
    return replace(table, about={"delta": finite_or_none(design.delta), "angles": rows})


def controller_table(
    aircraft: Aircraft, design: Design, feedback: str, models: list[LinearModel], found: list[LinearController]
) -> ScheduledController:
    """Controllers of one design, and the linear models that they are for, in one value."""
    return ScheduledController(
        name=design.name,
        feedback=feedback,
        dihedrals=np.array([model.point.states.dihedral for model in models]),
        **{part: np.array([getattr(each, part) for each in found]) for part in "ABCDW"},  # type: ignore[arg-type]
        states=tuple(f"{name}_estimate" for name in design.states if feedback == "output") + design.integral_states,
        measurements=measurements(design, feedback),
        commands=tuple(f"{name}{COMMAND_SIGNALS[0]}" for name in design.integrals),
        inputs=design.inputs,
        trim_states=np.array([model.point.states for model in models]),
        trim_inputs=np.array([model.point.inputs for model in models]),
        dynamics=aircraft.variant.name,
        parameters=parameter_hash(aircraft.parameters),
    )


def controller_at(
    aircraft: Aircraft, model: LinearModel, design: Design, feedback: str, value: Value | None = None
) -> LinearController:
    """The controller of one linear model; NoSolutionError when it is not certified.

    value: where the solutions of its Riccati equations come from; None: exact, with certificate and delta_min, which
    are left out otherwise.
    """
    built = design_model(aircraft, model, design)
    if feedback == "state":
        found = _state_feedback(built, value)
    elif not design.sensors:
        raise BadInputError(f"design {design.name} has no sensors; name some in [sensors], or use state feedback")
    else:
        found = _output_feedback(built, value)
    return _with_commands(design, measurements(design, feedback), found)


def _state_feedback(built: DesignModel, value: Value | None) -> LinearController:
    """u = -K [measured; integrals]."""
    game = built.game()
    if value is not None:
        return _from_gain(built, game.gain(value(game)))
    exact = solve_game(game)
    found = _from_gain(built, exact.K)
    return replace(found, delta_min=minimum_delta(game).value, checks=exact.certificate.checks)


def _from_gain(built: DesignModel, K: np.ndarray) -> LinearController:
    names, q = measurements(built.design, "state"), len(built.design.integrals)
    plant = len(built.design.plant_states)
    D = np.zeros((len(built.inputs), len(names)))
    for column, state in enumerate(built.design.plant_states):
        D[:, names.index(state)] -= K[:, column]
    nothing = np.zeros((q, len(built.inputs)))
    return LinearController(np.zeros((q, q)), np.zeros((q, len(names))), -K[:, plant:], D, nothing)


def _output_feedback(built: DesignModel, value: Value | None) -> LinearController:
    """The central controller of both equations, control and filter."""
    problem = problem_of(built)
    if value is not None:
        return from_estimator(built, central_controller(problem, value(problem.game), value(problem.dual)))
    exact = solve_output_feedback(problem)
    found = from_estimator(built, (exact.Ak, exact.Bk, exact.Ck))
    return replace(found, delta_min=minimum_output_delta(problem)[0], checks=exact.checks)


def problem_of(built: DesignModel) -> OutputGame:
    """The game of a design from its sensors."""
    return OutputGame(built.game(), built.C, built.D, built.V)


def from_estimator(built: DesignModel, estimator: tuple[np.ndarray, np.ndarray, np.ndarray]) -> LinearController:
    """x̂' = Ak x̂ + Bk y_s, u = Ck x̂, where the integrals among the sensors y_s are the controller's own."""
    Ak, Bk, Ck = estimator
    names, own = measurements(built.design, "output"), built.design.integral_states
    B, from_own = np.zeros((len(Ak), len(names))), np.zeros((len(Ak), len(own)))
    for column, sensor in enumerate(built.sensors):
        if sensor in own:
            from_own[:, own.index(sensor)] = Bk[:, column]
        else:
            B[:, names.index(sensor)] = Bk[:, column]
    q, m = len(own), len(built.inputs)
    return LinearController(
        A=np.block([[Ak, from_own], [np.zeros((q, len(Ak) + q))]]),
        B=np.vstack([B, np.zeros((q, len(names)))]),
        C=np.hstack([Ck, np.zeros((m, q))]),
        D=np.zeros((m, len(names))),
        W=np.vstack([built.B - Bk @ built.D, np.zeros((q, m))]),
    )


def _row(
    aircraft: Aircraft, model: LinearModel, design: Design, found: LinearController, table: ScheduledController
) -> dict[str, Any]:
    """What the table of the design says of one angle; margins with the actuators of the design."""
    loop = servo_loop(servo_plant(aircraft, model, table, design.actuators), table)
    return {
        "dihedral": model.point.states.dihedral,
        "delta_min": found.delta_min,
        "abscissa": loop.abscissa,
        "margin_at_inputs": loop.margin_at_inputs()._asdict(),
        "margin_at_sensors": loop.margin_at_sensors()._asdict(),
        "checks": [check.to_dict() for check in found.checks],
    }


def measurements(design: Design, feedback: str) -> tuple[str, ...]:
    """What must be measured: the sensors, or all states, the integrated outputs in place of their integrals."""
    seen = design.sensors if feedback == "output" else design.plant_states
    plain = [name for name in seen if not name.endswith("_integral")]
    return tuple(dict.fromkeys([*plain, *design.integrals]))


def _with_commands(design: Design, names: tuple[str, ...], found: LinearController) -> LinearController:
    """e' = y - r for the integrals, which are the last states of `found`.

    names: measured. found.B, found.D: of the measurements; the result's of [measurements; commands].
    """
    n, q = len(found.A), len(design.integrals)
    B, D = (np.pad(part, ((0, 0), (0, q))) for part in (found.B, found.D))
    for k, output in enumerate(design.integrals):
        B[n - q + k, names.index(output)], B[n - q + k, len(names) + k] = 1.0, -1.0
    return replace(found, B=B, D=D)
