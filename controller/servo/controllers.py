"""From a design to its controller: the exact gain or the central controller at every angle,
certified."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from controller.riccati.gare import solve_game
from controller.riccati.smallest_delta import minimum_delta
from controller.servo.design import Actuator, Design, Shaping
from controller.servo.design_model import DesignModel, design_model
from controller.servo.generalized_plant import GeneralizedPlant, solve_plant
from controller.servo.loop_shaping import (
    following_model,
    output_weights,
    robust_check,
    robust_controller,
)
from controller.servo.scheduled_controller import COMMAND_SIGNALS, ScheduledController, identity
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.jsonable import finite_or_none
from hfa_support.progress import Progress, told
from hfa_support.reporting.checks import Check
from trim.linear.linear_model import LinearModel, level_model


@dataclass(frozen=True, eq=False)
class LinearController:
    """x' = A x + B [y; w], u = C x + D [y; w] at one angle, W its anti-windup input, what certifies
    it, and its limit: the smallest delta of the game or, of a shaped loop, the smallest gamma."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    W: np.ndarray
    limit: float = math.nan
    checks: tuple[Check, ...] = ()


def design_controller(
    aircraft: Model,
    design: Design,
    breakpoints: np.ndarray,
    *,
    progress: Progress | None = None,
) -> ScheduledController:
    """The controllers of a design at `breakpoints` (N,), increasing values of the scheduling variable,
    in one table.

    They measure the sensors of the design; without any the states. BadInputError for a model that
    is not scheduled over one of its linear states. Raises NoSolutionError that names the place at
    which there is no trim or no certified controller."""
    own = aircraft
    if own.schedule not in own.linear:
        choices = f"one of {', '.join(own.linear)}"
        raise BadInputError(
            f"a controller is scheduled over a linear state; declare in {own.name} schedule=NAME, {choices}"
        )
    design = design.of(own)
    found, models = [], []
    for place in told(breakpoints.tolist(), progress):
        try:
            models.append(level_model(aircraft, place))
            found.append(controller_at(aircraft, models[-1], design))
        except NoSolutionError as error:
            where = f"{own.schedule} {own.describe(own.schedule, place)}"
            raise NoSolutionError(f"design {design.name} at {where}: {error}") from error
    states, commands, command_filter = _names(design)
    at, limit = (
        [model.point.values[own.schedule] for model in models],
        "gamma_min" if design.shaping else "delta_min",
    )
    rows = [
        {
            own.schedule: value,
            limit: each.limit,
            "checks": [check.to_dict() for check in each.checks],
        }
        for value, each in zip(at, found, strict=True)
    ]
    return ScheduledController(
        name=design.name,
        feedback="output" if design.sensors else "state",
        breakpoints=np.array(at),
        **{part: np.array([getattr(each, part) for each in found]) for part in "ABCDW"},
        states=states,
        measurements=_measurements(design),
        commands=commands,
        inputs=design.inputs,
        trim_states=np.array([model.point.states for model in models]),
        trim_inputs=np.array([model.point.inputs for model in models]),
        dynamics=own.name,
        parameters=identity(own),
        command_filter=command_filter,
        about={"delta": finite_or_none(design.delta), "angles": rows},
        model=own,
    )


def controller_at(aircraft: Model, model: LinearModel, design: Design) -> LinearController:
    """The exact controller of one linear model; NoSolutionError when it is not certified.

    The gain u = -K z, or the central controller of the game from the sensors; the integrals, which
    either sees, are states of the controller behind its own: e' = y - r."""
    built = design_model(aircraft, model, design)
    if built.design.shaping is not None:
        return _shaped(aircraft, built, built.design.shaping)
    design, n, m = built.design, len(built.A), len(built.inputs)
    problem: Any = built.game()
    if design.sensors:
        problem = GeneralizedPlant.measured(problem, built.C, built.V, built.D)
        exact: Any = solve_plant(problem, design.delta)
        smallest = problem.minimum_delta()
        seen, checks = built.sensors, exact.checks
        Ak, Bk, Ck, Dk, wound = exact.Ak, exact.Bk, exact.Ck, exact.Dk, built.B - exact.Bk @ built.D
    else:
        exact = solve_game(problem)
        smallest = minimum_delta(problem)
        seen, checks = design.states, exact.certificate.checks
        Ak, Bk, Ck, Dk, wound = (
            np.zeros((0, 0)),
            np.zeros((0, n)),
            np.zeros((m, 0)),
            -exact.K,
            np.zeros((0, m)),
        )
    names, own = _measurements(design), design.integral_states
    of_y, of_e = (
        np.array([[float(one == name) for one in each] for name in seen]) for each in (names, own)
    )
    of_e, k, q = of_e.reshape(len(seen), len(own)), len(Ak), len(own)
    integrated = np.array(
        [[float(one == name) for one in names] for name in design.integrals]
    ).reshape(q, len(names))
    return LinearController(
        A=np.block([[Ak, Bk @ of_e], [np.zeros((q, k + q))]]),
        B=np.block([[Bk @ of_y, np.zeros((k, q))], [integrated, -np.eye(q)]]),
        C=np.hstack([Ck, Dk @ of_e]),
        D=np.hstack([Dk @ of_y, np.zeros((m, q))]),
        W=np.vstack([wound, np.zeros((q, m))]),
        limit=smallest.value,
        checks=checks,
    )


def _shaped(aircraft: Model, built: DesignModel, shaping: Shaping) -> LinearController:
    """x = [x_m; the weights' own; x̂]: u = u_m - W1 F x̂, x̂ observes the shaped plant from y_s =
    W2 (y - y_m).

    x_m, u_m, y_m: of the model that the commands go through. The observer receives the inputs that
    are applied."""
    design, following, z = built.design, shaping.following, np.zeros
    slow = dict.fromkeys(design.inputs, Actuator(bandwidth=following.bandwidth))
    answer = design_model(aircraft, built.model, replace(design, actuators=slow))
    A_m, B_m = following_model(
        answer.A,
        answer.B,
        answer.C[[answer.sensors.index(name) for name in following.outputs]],
        following,
        paid=np.array([following.states.get(name, 0.0) for name in answer.states]),
        rates=np.array([following.rates[name] for name in design.inputs]),
    )
    gains = np.array([shaping.inputs[name] for name in design.inputs])
    weights = output_weights(shaping.outputs_at(built.model.point.values[design.model.schedule]))
    (n, m), (k, p), (size, commands) = built.B.shape, weights.B.shape, B_m.shape
    h = n + k
    A_s = np.block([[built.A, z((n, k))], [weights.B @ built.C, weights.A]])
    B_s, C_s = np.vstack([built.B * gains, z((k, m))]), np.hstack([weights.D @ built.C, weights.C])
    found = robust_controller(A_s, B_s, C_s, shaping.factor)
    sensed, seen = np.hstack([answer.C, z((p, m))]), found.H @ weights.D
    observer = A_s - B_s @ found.F - found.H @ C_s
    return LinearController(
        A=np.block(
            [
                [A_m, z((size, k + h))],
                [-weights.B @ sensed, weights.A, z((k, h))],
                [-seen @ sensed, found.H @ weights.C, observer],
            ]
        ),
        B=np.block([[z((size, p)), B_m], [weights.B, z((k, commands))], [seen, z((h, commands))]]),
        C=np.hstack([np.eye(m, size, k=size - m), z((m, k)), -gains[:, None] * found.F]),
        D=z((m, p + commands)),
        W=np.vstack([z((size + k, m)), built.B, z((k, m))]),
        limit=found.gamma_min,
        checks=(robust_check(A_s, B_s, C_s, found),),
    )


def _names(design: Design) -> tuple[tuple[str, ...], tuple[str, ...], tuple[float, ...]]:
    """States, commands and command filter of the controller."""
    if design.shaping is None:
        estimates = tuple(f"{name}_estimate" for name in design.states if design.sensors)
        commands = tuple(f"{name}{COMMAND_SIGNALS[0]}" for name in design.integrals)
        return estimates + design.integral_states, commands, ()
    following, own = design.shaping.following, output_weights(design.shaping.outputs).states
    positions = tuple(f"model_{name}_position" for name in design.inputs)
    model = (
        *(f"model_{name}" for name in design.model.linear),
        *positions,
        *(f"{name}_command" for name in design.inputs),
    )
    estimates = tuple(f"{name}_estimate" for name in (*design.plant_states, *own))
    commands = tuple(f"{name}{signal}" for signal in COMMAND_SIGNALS for name in following.outputs)
    return (*model, *own, *estimates), commands, tuple(following.filter)


def _measurements(design: Design) -> tuple[str, ...]:
    """What must be measured: the sensors, or all states, the integrated outputs in place of their
    integrals."""
    plain = [
        name for name in design.sensors or design.plant_states if not name.endswith("_integral")
    ]
    return tuple(dict.fromkeys([*plain, *design.integrals]))
