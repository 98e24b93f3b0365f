"""What a feedforward adds to the inputs of a controller after a command: best for several actuators at once, by a
convex program; and the table [feedforward] of the study's designs, which the designs of the package do not have."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller import ScheduledController, design_controller
from controller.design.controllers import Value
from controller.design.design import ACTUATORS, Actuator, Design, actuators_of, design_of
from controller.design.design_model import DesignModel
from controller.design.scheduled_controller import COMMAND_SIGNALS
from controller.design.servo_loop import servo_loop, servo_plant
from controller.export.exported_loop import commandable
from hfa_model import Aircraft
from hfa_support import BadInputError, NoSolutionError
from hfa_support.errors import refuse_unknown, refuse_unless_positive, said_of
from hfa_support.reporting.checks import Check, at_most
from hfa_support.schema import NUMBER, Number, checked
from trim import LinearModel, level_model

#: s: of the record of a step, and how long it is.
STEP, SECONDS = 0.1, 50.0
#: Beyond them the stages are alike to rounding.
_MOST_STAGES = 12
#: Of the curvature in its own units: what the stages have in common is left to rounding below it.
_LEAST = 1e-9
#: Of a rate beyond its limit, as a share, while the program is solved.
_CLOSE = 1e-10
#: The cost above the lower bound of the dual, as a share of that without a feedforward; the rate above its limit.
GAP = 1e-6


@dataclass(frozen=True)
class Feedforward:
    """u_ff = Σ_j Σ_k θ_jk z_jk,  lag z_jk' = z_j,k-1 - z_jk,  k = 1..stages,  z_j0 = r_end of the j-th command.

    θ makes the errors y - r after a step of one command small, on all `actuators` at once: the sum of importance times
    weight times the mean square, no input moving faster than the rate of that command times the step.

    lag: s. stages: whole. bandwidth ω: rad/s, damping ζ: 1, of the command filter r'' = ω² r_end - 2 ζ ω r' - ω² r.
    actuators: by any name, each at every input. importance: of these, 1 without. weights: of outputs, 1 without. rates:
    rad/s per unit of an output, inf without. BadInputError for a number that is none of these.
    """

    lag: float = 3.0
    stages: float = 6
    bandwidth: float = 0.5
    damping: float = 2.0
    actuators: Mapping[str, Actuator] = field(default_factory=lambda: {"designed": Actuator()})
    importance: Mapping[str, float] = field(default_factory=dict)
    weights: Mapping[str, float] = field(default_factory=dict)
    rates: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse a filter that never arrives, and a choice among nothing."""
        for name in ("lag", "bandwidth", "damping"):
            refuse_unless_positive(f"the {name} of a feedforward", getattr(self, name))
        for name, value in self.rates.items():
            refuse_unless_positive(f"the rate of {name} of a feedforward", value)
        if not (1 <= self.stages <= _MOST_STAGES and self.stages == int(self.stages)):
            raise BadInputError(
                f"the stages of a feedforward are {self.stages}; give a whole number from 1 to {_MOST_STAGES}"
            )
        if not self.actuators:
            raise BadInputError("a feedforward has no actuators to be made for; name one")
        for name in self.importance:
            refuse_unknown("the feedforward has no actuators", name, tuple(self.actuators))


_NUMBERS = {str: Number(0.0, 1e100)}
_FEEDFORWARD = {each.name: NUMBER for each in fields(Feedforward)} | {
    "actuators": ACTUATORS,
    **dict.fromkeys(("importance", "weights", "rates"), _NUMBERS),
}


def shaped_design(name: str, entries: Mapping[str, Any]) -> tuple[Design, Feedforward | None]:
    """The design of the entries of a file, and its table [feedforward], None without one.

    [feedforward]: lag, stages, bandwidth, damping; [feedforward.actuators.NAME]: as in [actuators.INPUT] of a design;
    [feedforward.importance]: NAME = number; [feedforward.weights], [feedforward.rates]: output = number.
    BadInputError names the file, the entry and the fault.
    """
    entries = dict(entries)
    table = entries.pop("feedforward", None)
    design = design_of(name, entries)
    if table is None:
        return design, None
    table = checked(name, table, _FEEDFORWARD, "feedforward")
    if "actuators" in table:
        table["actuators"] = actuators_of(name, "feedforward.actuators", table["actuators"])
    with said_of(f"{name}: feedforward"):
        found = Feedforward(**table)
        for output in (*found.weights, *found.rates):
            refuse_unknown("unknown output", output, design.integrals)
    return design, found


def shaped_controller(
    aircraft: Aircraft,
    design: Design,
    feedforward: Feedforward | None,
    dihedrals: np.ndarray,
    feedback: str = "",
    value: Value | None = None,
) -> ScheduledController:
    """The controller of `design_controller` with a feedforward; NoSolutionError where one of them is not certified."""
    table = design_controller(aircraft, design, dihedrals, feedback, value=value)
    if feedforward is None:
        return table
    models = [level_model(aircraft, dihedral) for dihedral in dihedrals.tolist()]
    found, checks = with_feedforward(aircraft, models, table, feedforward)
    for check in checks:
        if not check.ok:
            raise NoSolutionError(f"design {design.name}: {check.sentence}: {check.reason}")
    return found


def with_feedforward(
    aircraft: Aircraft, models: Sequence[LinearModel], table: ScheduledController, feedforward: Feedforward
) -> tuple[ScheduledController, tuple[Check, ...]]:
    """A controller that adds θ z to the inputs of `table`, θ the best at each angle; checks that none is better.

    models: the linear models at the angles of `table`. The stages z come before its states, the values r_end that the
    commands go to behind its commands; the rest stays as it is. NoSolutionError as `best_feedforward`.
    """
    outputs, thetas, checks = commandable(table), [], []
    for model in models:
        loops = [
            _fed_back(
                servo_plant(aircraft, model, table, dict.fromkeys(table.inputs, actuator)),
                table,
                outputs,
                feedforward.importance.get(name, 1.0),
            )
            for name, actuator in feedforward.actuators.items()
        ]
        theta, found = best_feedforward(loops, outputs, feedforward)
        thetas.append(theta)
        checks += found
    (F, g), q = stage_rates(feedforward), len(outputs)
    count = q * len(F)
    A = np.pad(table.A, ((0, 0), (count, 0), (count, 0)))
    B = np.pad(table.B, ((0, 0), (count, 0), (0, q)))
    A[:, :count, :count], B[:, :count, -q:] = np.kron(np.eye(q), F), np.kron(np.eye(q), g[:, None])
    shaped = replace(
        table,
        A=A,
        B=B,
        C=np.concatenate([thetas, table.C], axis=2),
        D=np.pad(table.D, ((0, 0), (0, 0), (0, q))),
        W=np.pad(table.W, ((0, 0), (count, 0), (0, 0))),
        states=(*(f"{name}_command_end_lag_{k + 1}" for name in outputs for k in range(len(F))), *table.states),
        commands=(*table.commands, *(f"{name}{COMMAND_SIGNALS[2]}" for name in outputs)),
        command_filter=(feedforward.bandwidth, feedforward.damping),
    )
    return shaped, tuple(checks)


class FedBack(NamedTuple):
    """x' = A x + told r + moved u_ff: a loop with its controller.

    errors: (q, n), the outputs of x that follow r. positions: of the inputs, their places in x. importance: 1.
    """

    A: np.ndarray
    told: np.ndarray
    moved: np.ndarray
    errors: np.ndarray
    positions: tuple[int, ...]
    importance: float


def _fed_back(plant: DesignModel, table: ScheduledController, outputs: Sequence[str], importance: float) -> FedBack:
    """The loop of a plant whose inputs act through actuators, with a controller without a feedforward."""
    _, Bk, _, Dk = table.at(plant.model.point.states.dihedral)
    p, n = len(plant.C), len(Bk)
    return FedBack(
        A=servo_loop(plant, table).closed,
        told=np.vstack([plant.B @ Dk[:, p:], Bk[:, p:]]),
        moved=np.pad(plant.B, ((0, n), (0, 0))),
        errors=np.pad(plant.C[[plant.sensors.index(name) for name in outputs]], ((0, 0), (0, n))),
        positions=tuple(plant.states.index(f"{name}_position") for name in plant.inputs),
        importance=importance,
    )


def command_rates(feedforward: Feedforward, outputs: int) -> np.ndarray:
    """S of the command filters r'' = ω² r_end - 2 ζ ω r' - ω² r, w = [r; r'; r_end], r_end constant; (3q, 3q)."""
    w, zeta = feedforward.bandwidth, feedforward.damping
    one = np.array([[0.0, 1.0, 0.0], [-(w**2), -2 * zeta * w, w**2], [0.0, 0.0, 0.0]])
    return np.kron(one, np.eye(outputs))


def stage_rates(feedforward: Feedforward) -> tuple[np.ndarray, np.ndarray]:
    """z' = F z + g r_end of the stages of one command, (stages, stages), (stages,)."""
    count = int(feedforward.stages)
    return (np.eye(count, k=-1) - np.eye(count)) / feedforward.lag, np.eye(count)[0] / feedforward.lag


def best_feedforward(
    loops: Sequence[FedBack], outputs: Sequence[str], feedforward: Feedforward
) -> tuple[np.ndarray, tuple[Check, ...]]:
    """θ, (m, q stages), the stages of one command after the other, and checks that no other is better:

        min_θ Σ_loops importance Σ_i weight_i mean_t (e_i + Σ_k θ_k e_ik)²,  |a'| <= rate,  for a step of each command.

    e: without a feedforward, e_ik: of a stage alone. The loop is linear, so that errors and rates of the inputs'
    positions a are linear in θ and the program is convex: what its dual attains certifies that no θ is better.
    NoSolutionError when no θ keeps the rates, or none does anything.
    """
    m, count = len(loops[0].positions), int(feedforward.stages)
    with np.errstate(over="ignore", invalid="ignore"):
        responses = [_responses(loop, feedforward) for loop in loops]
    weights = np.sqrt([feedforward.weights.get(name, 1.0) for name in outputs])
    gains, checks = np.zeros((m, len(outputs) * count)), []
    for j, name in enumerate(outputs):
        errors, rates = [], []
        for loop, (error, rate) in zip(loops, responses, strict=True):
            chosen = [j, *range(len(outputs), error.shape[-1])]
            size = math.sqrt(loop.importance / len(error))
            errors.append((size * weights[:, None] * error[..., chosen]).reshape(-1, len(chosen)))
            rates.append(rate[..., chosen].reshape(-1, len(chosen)))
        found, gap = _smallest(np.vstack(errors), np.vstack(rates), feedforward.rates.get(name, math.inf), name)
        gains[:, j * count : (j + 1) * count] = found.reshape(m, count)
        checks.append(at_most(f"feedforward_{name}", gap, GAP, f"a better answer to {name} may exist"))
    return gains, tuple(checks)


def _responses(loop: FedBack, feedforward: Feedforward) -> tuple[np.ndarray, np.ndarray]:
    """Errors (T, q, q + m stages) and rates of the inputs (T, m, the same) after r_end = 1 of each command, without a
    feedforward, then of each stage into each input alone, which is the same for every command."""
    from scipy.linalg import expm

    F, g = stage_rates(feedforward)
    n, s, q = len(loop.A), 3 + len(F), loop.told.shape[1]
    S = np.zeros((s, s))
    S[:3, :3], S[3:, 3:], S[3:, 2] = command_rates(feedforward, 1), F, g
    into = [np.outer(loop.told[:, j], np.eye(s)[0]) for j in range(q)]
    into += [np.outer(column, np.eye(s)[3 + k]) for column in loop.moved.T for k in range(len(F))]
    per = [expm(STEP * np.block([[loop.A, each], [np.zeros((s, n)), S]])) for each in into]
    signals = np.zeros((round(SECONDS / STEP) + 1, s))
    signals[0, 2] = 1.0
    for k in range(1, len(signals)):
        signals[k] = per[0][n:, n:] @ signals[k - 1]
    states = np.zeros((len(signals), n, len(into)))
    forced = np.stack([signals @ each[:n, n:].T for each in per], axis=-1)
    for k in range(1, len(signals)):
        states[k] = per[0][:n, :n] @ states[k - 1] + forced[k - 1]
    errors, moving = loop.errors @ states, list(loop.positions)
    for j in range(q):
        errors[:, j, j] -= signals[:, 0]
    rates = loop.A[moving] @ states + np.stack([signals @ each[moving].T for each in into], axis=-1)
    return errors, rates


def _smallest(errors: np.ndarray, rates: np.ndarray, fastest: float, name: str) -> tuple[np.ndarray, float]:
    """θ of the smallest |e_0 + E θ|² with |a_0 + A θ| <= fastest, e_0 and a_0 the first columns.

    And how far its cost may lie above the smallest, as a share of |e_0|², or a rate above its limit, as a share.
    """
    E, e = errors[:, 1:], errors[:, 0]
    moved = np.linalg.norm(E, axis=0)
    if not (np.all(np.isfinite(moved)) and np.all(moved > 0.0)):
        raise NoSolutionError(
            f"a feedforward of this lag and weight moves the errors of {name} by nothing, or by infinity"
        )
    size = 1.0 / moved
    H, g = size[:, None] * (E.T @ E) * size, size * (E.T @ e)
    H += _LEAST * np.eye(len(H))
    bounded = math.isfinite(fastest)
    A, a = (rates[:, 1:] * size / fastest, rates[:, 0] / fastest) if bounded else (np.zeros((0, len(g))), np.zeros(0))
    shapes = {"h": ca.Sparsity.dense(*H.shape), "a": ca.Sparsity.dense(*A.shape)}
    solver = ca.conic("feedforward", "daqp", shapes, {"error_on_fail": False, "daqp": {"primal_tol": _CLOSE}})
    found = solver(h=H, g=g, a=A, lba=-1.0 - a, uba=1.0 - a)
    if not solver.stats()["success"]:
        raise NoSolutionError(
            f"no feedforward keeps the inputs below {fastest:.3g} for each unit of {name}; allow more"
        )
    theta, forces = (np.array(found[part]).ravel() for part in ("x", "lam_a"))
    pushed = g + A.T @ forces
    dual = -0.5 * pushed @ np.linalg.solve(H, pushed) + forces @ a - np.abs(forces).sum()
    gap = 2.0 * (0.5 * theta @ H @ theta + g @ theta - dual) / (e @ e)
    too_fast = np.abs(a + A @ theta).max(initial=0.0) - 1.0
    return size * theta, float(max(gap, too_fast))
