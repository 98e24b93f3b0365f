"""Computation of the controllers of a design: one certified controller at each value of the
scheduling variable.

The controller is a gain, a central controller or, for loop shaping, a robust controller.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from controller.riccati.gare import unconfirmed_solution
from controller.riccati.smallest_delta import minimum_delta
from hfa_aircraft.model import Model
from hfa_design.design import Design, Following, Shaping
from hfa_design.design_models import DesignModel, design_model, selection
from hfa_design.loop_shaping import following_model, output_weights, robust_check, robust_controller
from hfa_design.plant.generalized_plant import GeneralizedPlant, solve_plant
from hfa_flight.actuators import Actuator
from hfa_flight.schedule.scheduled_controller import COMMAND_SIGNALS, ScheduledController, identity
from hfa_support.arguments import checks_arguments
from hfa_support.attributes import Advised
from hfa_support.errors import BadInputError, NoSolutionError, warn
from hfa_support.progress import Progress, with_progress
from hfa_support.reporting.checks import Check
from hfa_support.reporting.data_files import finite_or_none
from trim.linear.linear_model import LinearModel
from trim.point.solve import level_model


@checks_arguments
@dataclass(frozen=True, eq=False)
class LinearController(Advised):
    """Controller x' = A x + B [y; w] + W (u_applied - u), u = C x + D [y; w] at one value of the
    scheduling variable.

    y are the p measurements, w the q commands and u_applied the m saturated inputs. x are the n
    states of the controller.

    A: (n, n)
    B: (n, p + q)
    C: (m, n)
    D: (m, p + q)
    W: (n, m)
    limit: smallest delta of the game or, for loop shaping, smallest gamma
    checks: checks that certify the controller
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    W: np.ndarray
    limit: float = math.nan
    checks: tuple[Check, ...] = ()


class Feedback(NamedTuple):
    """Controller x' = A x + B y + W (u_applied - u), u = C x + D y of the sensors y of a design
    model.

    A: (n, n)
    B: (n, p)
    C: (m, n)
    D: (m, p)
    W: (n, m)
    limit, checks: as in `LinearController`
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    W: np.ndarray
    limit: float
    checks: tuple[Check, ...]


@checks_arguments
def design_controller(
    model: Model,
    design: Design,
    breakpoints: np.ndarray,
    *,
    progress: Progress | None = None,
) -> ScheduledController:
    """Return the scheduled controller of a design, computed at increasing scheduling values.

    breakpoints: (N,), values of the scheduling variable
    progress: called after each value

    Raises BadInputError if the model is not scheduled over a state of its linear model. Raises
    NoSolutionError with the breakpoint if there is no trim or no certified controller.
    """
    by = model.schedule
    if by not in model.linear:
        choices = f"one of {', '.join(model.linear)}"
        raise BadInputError(
            f"the scheduling variable of {model.name} is not a state of the linear model; "
            f"declare schedule=NAME, where NAME is {choices}"
        )
    design = design.of(model)
    controllers: list[LinearController] = []
    linear_models: list[LinearModel] = []
    for value in with_progress(breakpoints.tolist(), progress):
        try:
            linear_models.append(level_model(model, value))
            controllers.append(controller_at(model, linear_models[-1], design))
        except NoSolutionError as error:
            where = f"{by} {model.describe(by, value)}"
            raise NoSolutionError(f"design {design.name} at {where}: {error}") from error
    _warn_of_kinks(linear_models)
    trimmed_at = [linear.point.values[by] for linear in linear_models]
    limit = "gamma_min" if design.shaping else "delta_min"
    rows = [
        {by: value, limit: made.limit, "checks": [check.to_dict() for check in made.checks]}
        for value, made in zip(trimmed_at, controllers, strict=True)
    ]
    stacks = {part: np.array([getattr(made, part) for made in controllers]) for part in "ABCDW"}
    states, commands, command_filter = _names(design)
    return ScheduledController(
        name=design.name,
        feedback="output" if design.sensors else "state",
        breakpoints=np.array(trimmed_at),
        **stacks,
        states=states,
        measurements=_measurements(design),
        commands=commands,
        inputs=design.inputs,
        trim_states=np.array([linear.point.states for linear in linear_models]),
        trim_inputs=np.array([linear.point.inputs for linear in linear_models]),
        dynamics=model.name,
        parameters=identity(model),
        command_filter=command_filter,
        about={
            "delta": finite_or_none(design.delta),
            "angles": rows,
            "actuators": {name: asdict(acting) for name, acting in design.actuators.items()},
        },
        model=model,
    )


def _warn_of_kinks(linear_models: Sequence[LinearModel]) -> None:
    """Issue one warning if an entry of any A or B is the mean of two slopes at a kink."""
    kinked = [linear for linear in linear_models if linear.kinks]
    if kinked:
        first = kinked[0]
        model = first.point.model
        where = model.describe(model.schedule, first.point.values[model.schedule])
        count = f"{len(kinked)} of {len(linear_models)} places"
        warn(f"{first.kinks[0]} ({count}, the first at {where})")


@checks_arguments
def controller_at(model: Model, linear: LinearModel, design: Design) -> LinearController:
    """Return the controller of a design for one linear model.

    - With [shaping]: the robust controller (`_shaped`).
    - With sensors: the central controller of the game.
    - Otherwise: the gain u = -K z.

    Without [shaping], the last states of the controller are the integrals e' = y - r of outputs y
    and their commands r.

    Raises NoSolutionError if the controller is not certified.
    """
    built = design_model(model, linear, design)
    design = built.design
    if design.shaping is not None:
        return _shaped(model, built, design.shaping)
    if design.sensors:
        feedback = _output_feedback(built)
        sensors = built.sensors
    else:
        feedback = _state_feedback(built)
        sensors = design.states
    measured = _measurements(design)
    integrals = design.integral_states
    of_measured = selection(sensors, measured)
    of_integrals = selection(sensors, integrals)
    integrated = selection(design.integrals, measured)
    k = len(feedback.A)
    q = len(integrals)
    m = len(built.inputs)
    return LinearController(
        A=np.block([[feedback.A, feedback.B @ of_integrals], [np.zeros((q, k + q))]]),
        B=np.block([[feedback.B @ of_measured, np.zeros((k, q))], [integrated, -np.eye(q)]]),
        C=np.hstack([feedback.C, feedback.D @ of_integrals]),
        D=np.hstack([feedback.D @ of_measured, np.zeros((m, q))]),
        W=np.vstack([feedback.W, np.zeros((q, m))]),
        limit=feedback.limit,
        checks=feedback.checks,
    )


def _state_feedback(built: DesignModel) -> Feedback:
    """Return the exact gain of the game as feedback of all states."""
    game = built.game()
    exact = unconfirmed_solution(game)
    n = len(built.A)
    m = len(built.inputs)
    return Feedback(
        A=np.zeros((0, 0)),
        B=np.zeros((0, n)),
        C=np.zeros((m, 0)),
        D=-exact.K,
        W=np.zeros((0, m)),
        limit=minimum_delta(game).value,
        checks=exact.certificate.checks,
    )


def _output_feedback(built: DesignModel) -> Feedback:
    """Return the central controller of the game as feedback of the sensors."""
    plant = GeneralizedPlant.measured(built.game(), built.C, built.V, built.D)
    central: Any = solve_plant(plant, built.design.delta)
    return Feedback(
        A=central.Ak,
        B=central.Bk,
        C=central.Ck,
        D=central.Dk,
        W=built.B - central.Bk @ built.D,
        limit=plant.minimum_delta().value,
        checks=central.checks,
    )


def _shaped(model: Model, built: DesignModel, shaping: Shaping) -> LinearController:
    """Return the controller of a loop-shaping design, with the states [x_m; weights; x̂]."""
    # u = u_m - W1 F x̂
    # W1 is the diagonal matrix of the input gains, W2 contains the output weights, and F is the
    # state feedback of the shaped plant. x_m, u_m and y_m are states, inputs and outputs of the
    # reference model, which follows the commands. x̂ is the observer's estimate of the shaped
    # plant's state, from y_s = W2 (y - y_m) and the applied inputs.
    design = built.design
    z = np.zeros
    answer, A_m, B_m = _followed_model(model, built, shaping.following)
    gains = np.array([shaping.inputs[name] for name in design.inputs])
    eta = built.model.point.values[model.schedule]
    weights = output_weights(shaping.outputs_at(eta))
    n, m = built.B.shape
    k, p = weights.B.shape
    size, commands = B_m.shape
    h = n + k
    A_s = np.block([[built.A, z((n, k))], [weights.B @ built.C, weights.A]])
    B_s = np.vstack([built.B * gains, z((k, m))])
    C_s = np.hstack([weights.D @ built.C, weights.C])
    robust = robust_controller(A_s, B_s, C_s, shaping.factor)
    sensed = np.hstack([answer.C, z((p, m))])
    observed = robust.H @ weights.D
    observer = A_s - B_s @ robust.F - robust.H @ C_s
    return LinearController(
        A=np.block(
            [
                [A_m, z((size, k + h))],
                [-weights.B @ sensed, weights.A, z((k, h))],
                [-observed @ sensed, robust.H @ weights.C, observer],
            ]
        ),
        B=np.block(
            [[z((size, p)), B_m], [weights.B, z((k, commands))], [observed, z((h, commands))]]
        ),
        C=np.hstack([np.eye(m, size, k=size - m), z((m, k)), -gains[:, None] * robust.F]),
        D=z((m, p + commands)),
        W=np.vstack([z((size + k, m)), built.B, z((k, m))]),
        limit=robust.gamma_min,
        checks=(robust_check(A_s, B_s, C_s, robust),),
    )


def _followed_model(
    model: Model, built: DesignModel, following: Following
) -> tuple[DesignModel, np.ndarray, np.ndarray]:
    """Return the reference model of a loop-shaping design, and A and B of its response."""
    design = built.design
    slow = dict.fromkeys(design.inputs, Actuator(bandwidth=following.bandwidth))
    answer = design_model(model, built.model, replace(design, actuators=slow))
    rows = [answer.sensors.index(name) for name in following.outputs]
    A_m, B_m = following_model(
        answer.A,
        answer.B,
        answer.C[rows],
        following,
        paid=np.array([following.states.get(name, 0.0) for name in answer.states]),
        rates=np.array([following.rates[name] for name in design.inputs]),
    )
    return answer, A_m, B_m


def _names(design: Design) -> tuple[tuple[str, ...], tuple[str, ...], tuple[float, ...]]:
    """Return the names of states and commands, and the command filter (rad/s, damping) or ()."""
    if design.shaping is None:
        commands = tuple(f"{name}{COMMAND_SIGNALS[0]}" for name in design.integrals)
        if not design.sensors:
            return design.integral_states, commands, ()
        estimates = tuple(f"{name}_estimate" for name in design.states)
        return estimates + design.integral_states, commands, ()
    following = design.shaping.following
    weights = output_weights(design.shaping.outputs).states
    model = (
        *(f"model_{name}" for name in design.model.linear),
        *(f"model_{name}_position" for name in design.inputs),
        *(f"{name}_command" for name in design.inputs),
    )
    estimates = tuple(f"{name}_estimate" for name in (*design.plant_states, *weights))
    commands = tuple(f"{name}{signal}" for signal in COMMAND_SIGNALS for name in following.outputs)
    return (*model, *weights, *estimates), commands, tuple(following.filter)


def _measurements(design: Design) -> tuple[str, ...]:
    """Return the names of the signals that the controller of a design measures."""
    names = design.sensors or design.plant_states
    plain = [name for name in names if not name.endswith("_integral")]
    return tuple(dict.fromkeys([*plain, *design.integrals]))
