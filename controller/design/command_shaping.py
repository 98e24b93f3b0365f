"""What a feedforward adds to the inputs after a command: best for several actuators at once, by a convex program."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.design.design import Feedforward
from controller.design.design_model import DesignModel
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, at_most

#: s: of the record of a step, and how long it is.
STEP, SECONDS = 0.1, 50.0
#: Of the curvature in its own units: what the stages have in common is left to rounding below it.
_LEAST = 1e-9
#: Of a rate beyond its limit, as a share, while the program is solved.
_CLOSE = 1e-10
#: The cost above the lower bound of the dual, as a share of that without a feedforward; the rate above its limit.
GAP = 1e-6


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
    loops: Sequence[FedBack], outputs: Sequence[str], plant: DesignModel, feedforward: Feedforward
) -> tuple[np.ndarray, tuple[Check, ...]]:
    """θ, (m, q stages), the stages of one command after the other, and checks that no other is better:

        min_θ Σ_loops importance Σ_i weight_i mean_t (e_i + Σ_k θ_k e_ik)²,  |a'| <= rate,  for a step of each command.

    e: without a feedforward, e_ik: of a stage alone. The loop is linear, so that errors and rates of the inputs'
    positions a are linear in θ and the program is convex: what its dual attains certifies that no θ is better.
    NoSolutionError when no θ keeps the rates, or none does anything.
    """
    m, count = len(plant.inputs), int(feedforward.stages)
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
