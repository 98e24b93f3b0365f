"""From a design to its controller: the exact gain or the central controller at every angle, certified."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from controller.design.design import Actuator, Design, Shaping
from controller.design.design_model import DesignModel, design_model
from controller.design.loop_shaping import following_model, output_weights, shaped_controller
from controller.design.scheduled_controller import COMMAND_SIGNALS, ScheduledController, identity
from controller.riccati.gare import solve_game
from controller.riccati.generalized_plant import OutputFeedback, solve_plant
from controller.riccati.smallest_delta import minimum_delta
from hfa_model.aircraft import Aircraft
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.jsonable import finite_or_none
from hfa_support.model import Model
from hfa_support.progress import Progress, told
from hfa_support.reporting.checks import Check
from trim.linear.linear_model import LinearModel, level_model


@dataclass(frozen=True, eq=False)
class LinearController:
    """x' = A x + B [y; w], u = C x + D [y; w] at one angle, W its anti-windup input, what certifies it, and its
    limit: the smallest delta of the game or, of a shaped loop, the smallest gamma."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    W: np.ndarray
    limit: float = math.nan
    checks: tuple[Check, ...] = ()


def design_controller(
    aircraft: Aircraft | Model,
    design: Design,
    places: np.ndarray,
    feedback: str = "",
    *,
    progress: Progress | None = None,
) -> ScheduledController:
    """The controllers of a design at `places` (N,), increasing values of the scheduling variable, in one table.

    feedback: "state", "output", or "" for output where the design has sensors. BadInputError for a model that is not
    scheduled over one of its linear states. Raises NoSolutionError that names the place at which there is no trim or no
    certified controller.
    """
    own = aircraft.model
    if own.schedule not in own.linear:
        raise BadInputError(
            f"{own.name} declares the schedule {own.schedule!r}; a controller is scheduled over a linear state, one of "
            f"{', '.join(own.linear)}"
        )
    design = design.of(own)
    feedback = feedback or ("output" if design.sensors else "state")
    found, models = [], []
    for place in told(places.tolist(), progress):
        try:
            models.append(level_model(aircraft, place))
            found.append(controller_at(aircraft, models[-1], design, feedback))
        except NoSolutionError as error:
            where = f"{own.schedule} {own.describe(own.schedule, place)}"
            raise NoSolutionError(f"design {design.name} at {where}: {error}") from error
    states, commands, command_filter = _names(design, feedback)
    at, limit = [model.point.values[own.schedule] for model in models], "gamma_min" if design.shaping else "delta_min"
    rows = [
        {own.schedule: value, limit: each.limit, "checks": [check.to_dict() for check in each.checks]}
        for value, each in zip(at, found, strict=True)
    ]
    return ScheduledController(
        name=design.name,
        feedback=feedback,
        places=np.array(at),
        **{part: np.array([getattr(each, part) for each in found]) for part in "ABCDW"},
        states=states,
        measurements=measurements(design, feedback),
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


def controller_at(aircraft: Aircraft | Model, model: LinearModel, design: Design, feedback: str) -> LinearController:
    """The exact controller of one linear model; NoSolutionError when it is not certified."""
    built = design_model(aircraft, model, design)
    if built.design.shaping is not None:
        return _shaped(aircraft, built, built.design.shaping)
    if feedback == "state":
        found = _state_feedback(built)
    elif not design.sensors:
        raise BadInputError(f"design {design.name} has no sensors; name some in [sensors], or use state feedback")
    else:
        found = _output_feedback(built)
    return _with_commands(design, measurements(design, feedback), found)


def _shaped(aircraft: Aircraft | Model, built: DesignModel, shaping: Shaping) -> LinearController:
    """The robust controller of the shaped plant, and the model that the commands go through."""
    design, following = built.design, shaping.following
    slow = dict.fromkeys(design.inputs, Actuator(bandwidth=following.bandwidth))
    answer = design_model(aircraft, built.model, replace(design, actuators=slow))
    model = following_model(
        answer.A,
        answer.B,
        answer.C[[answer.sensors.index(name) for name in following.outputs]],
        following,
        paid=np.array([following.states.get(name, 0.0) for name in answer.states]),
        rates=np.array([following.rates[name] for name in design.inputs]),
    )
    gains = np.array([shaping.inputs[name] for name in design.inputs])
    sensed = np.hstack([answer.C, np.zeros((len(answer.C), len(gains)))])
    plant = built.A, built.B, built.C
    found = shaped_controller(
        plant,
        gains,
        output_weights(shaping.outputs_at(built.model.point.values[design.model.schedule])),
        shaping.factor,
        model,
        sensed,
    )
    return LinearController(found.A, found.B, found.C, found.D, found.W, found.gamma_min, found.checks)


def _names(design: Design, feedback: str) -> tuple[tuple[str, ...], tuple[str, ...], tuple[float, ...]]:
    """States, commands and command filter of the controller."""
    if design.shaping is None:
        estimates = tuple(f"{name}_estimate" for name in design.states if feedback == "output")
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
    return (*model, *own, *estimates), commands, following.filter


def _state_feedback(built: DesignModel) -> LinearController:
    """u = -K [measured; integrals]."""
    game = built.game()
    exact = solve_game(game)
    names, q = measurements(built.design, "state"), len(built.design.integrals)
    plant = len(built.design.plant_states)
    D = np.zeros((len(built.inputs), len(names)))
    for column, state in enumerate(built.design.plant_states):
        D[:, names.index(state)] -= exact.K[:, column]
    return LinearController(
        A=np.zeros((q, q)),
        B=np.zeros((q, len(names))),
        C=-exact.K[:, plant:],
        D=D,
        W=np.zeros((q, len(built.inputs))),
        limit=minimum_delta(game).value,
        checks=exact.certificate.checks,
    )


def _output_feedback(built: DesignModel) -> LinearController:
    """The central controller of both equations, control and filter; the integrals among the sensors are its own."""
    plant = built.measured_plant()
    exact = solve_plant(plant, built.design.delta)
    assert isinstance(exact, OutputFeedback)
    names, own = measurements(built.design, "output"), built.design.integral_states
    B, from_own = np.zeros((len(exact.Ak), len(names))), np.zeros((len(exact.Ak), len(own)))
    for column, sensor in enumerate(built.sensors):
        if sensor in own:
            from_own[:, own.index(sensor)] = exact.Bk[:, column]
        else:
            B[:, names.index(sensor)] = exact.Bk[:, column]
    q, m = len(own), len(built.inputs)
    return LinearController(
        A=np.block([[exact.Ak, from_own], [np.zeros((q, len(exact.Ak) + q))]]),
        B=np.vstack([B, np.zeros((q, len(names)))]),
        C=np.hstack([exact.Ck, np.zeros((m, q))]),
        D=np.zeros((m, len(names))),
        W=np.vstack([built.B - exact.Bk @ built.D, np.zeros((q, m))]),
        limit=minimum_delta(plant).value,
        checks=exact.checks,
    )


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
