"""Metrics of a flight and of the learning of its critic.

Measured metrics are inf for a flight that left the envelope.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.critic.training_run import settled_at
from controller.game.basis import Basis
from hfa import Game
from hfa_flight.history import Deviations
from hfa_model import INPUTS, LINEAR_STATES
from studies.section5.configuration import Configuration

#: The states that have a command in Section 5.
TRACKED = ("speed", "alpha", "dihedral")
_ROWS = [LINEAR_STATES.index(name) for name in TRACKED]
#: Metric -> names of its entries, for metrics with several entries.
_BY_NAME = {
    **dict.fromkeys(("rms_error", "peak_error", "late_peak_error"), LINEAR_STATES),
    **dict.fromkeys(("relative_error", "rise", "settling", "growth"), TRACKED),
    **dict.fromkeys(
        ("rms_input", "peak_input", "peak_rate", "wiggle", "remaining_range", "beyond_limits"),
        INPUTS,
    ),
}
_SINGLE = ("cost", "early_cost", "effort", "peak_effort", "attenuation")


@dataclass(frozen=True, eq=False)
class Critic:
    """The learned critic of a law during a flight.

    weights: (N, M), one row for each tick, in the units of the model
    residual: relative Bellman residual |e|/|z'Qz| of the game over the recorded samples, (N,)
    facts: further results of the learning by name
    """

    basis: Basis
    weights: np.ndarray
    residual: np.ndarray
    facts: dict[str, Any]


def flight_metrics(
    configuration: Configuration, game: Game, limits: np.ndarray, flight: Deviations, lost_at: float
) -> dict[str, Any]:
    """Return the metrics of a flight.

    limits: lowest and highest deviations of the inputs, (2, 5)
    lost_at: time when the flight leaves the envelope, s, or inf, which becomes None in the result

    For each state (late: within the window of the criteria):

    - rms_error, peak_error, late_peak_error: of the error z

    For each tracked state:

    - relative_error: late rms error divided by the constant part of the command
    - rise, settling: time when the error enters its band first, and permanently, s
    - growth: largest error after the adjustment divided by the largest one before

    Single numbers:

    - cost: ∫ z'Qz + u'Ru dt
    - early_cost: ∫ z'Qz dt during the adjustment
    - effort: ∫ u'Ru dt
    - peak_effort: largest (u'Ru)^½
    - attenuation: ∫ z'Qz + u'Ru dt divided by ∫ d'd dt, for which the game guarantees a value below
      δ² for the disturbance alone
    - delta_squared: δ²

    For each input:

    - rms_input, peak_input
    - peak_rate: largest rate over one tick, per s
    - wiggle: late total variation divided by the range
    - remaining_range: range after the adjustment divided by the peak
    - beyond_limits: fraction of the flight in which u exceeds `limits`
    """
    if not np.isinf(lost_at):
        lost: dict[str, Any] = {
            name: dict.fromkeys(entries, np.inf) for name, entries in _BY_NAME.items()
        }
        return {
            "lost_at": lost_at,
            **lost,
            **dict.fromkeys(_SINGLE, np.inf),
            "delta_squared": game.delta**2,
        }
    criteria = configuration.criteria
    each = configuration.steps_per_tick()
    z = flight.errors
    u = flight.inputs
    t = flight.times
    d = configuration.disturbance.sampled(t)
    early = t <= criteria.short_adjustment + 1e-9
    late = (t >= criteria.late[0] - 1e-9) & (t <= criteria.late[1] + 1e-9)
    errors = _quadratic(z, game.Q)
    efforts = _quadratic(u, game.R)
    cost = _integral(errors + efforts, t)
    size = np.abs(z[:, _ROWS])
    command = np.abs(configuration.reference.constant[_ROWS])
    peak = np.abs(u).max(axis=0)
    low, high = limits
    banded = list(zip(size.T, (criteria.close * command).tolist(), strict=True))
    tables: dict[str, Iterable[float]] = {
        "rms_error": _rms(z[late]),
        "peak_error": np.abs(z).max(axis=0),
        "late_peak_error": np.abs(z[late]).max(axis=0),
        "relative_error": _ratio(_rms(size[late]), command),
        "rise": np.array([first_at(t, error, band) for error, band in banded]),
        "settling": np.array([settled_at(t, error, band) for error, band in banded]),
        "growth": _ratio(size[~early].max(axis=0), size[early].max(axis=0)),
        "rms_input": _rms(u),
        "peak_input": peak,
        "peak_rate": np.abs(np.diff(u[::each], axis=0)).max(axis=0) / (t[each] - t[0]),
        "wiggle": wiggle(u[late]),
        "remaining_range": _ratio(np.ptp(u[~early], axis=0), peak),
        "beyond_limits": np.mean((u < low) | (u > high), axis=0),
    }
    return {
        "lost_at": None,
        **{
            name: dict(zip(_BY_NAME[name], map(float, row), strict=True))
            for name, row in tables.items()
        },
        "cost": cost,
        "early_cost": _integral(errors[early], t[early]),
        "effort": _integral(efforts, t),
        "peak_effort": float(np.sqrt(efforts.max())),
        "attenuation": over(cost, _integral(_quadratic(d, np.eye(d.shape[1])), t)),
        "delta_squared": game.delta**2,
    }


def learning_metrics(
    times: np.ndarray, critic: Critic, residual: np.ndarray, T_w: float, lost_at: float
) -> dict[str, Any]:
    """Return the metrics of learning, relative to the learning time T_w in s.

    times: times of the flight, s, (N,)
    residual: Bellman residual at the simulated error, (N,)
    lost_at: time when the flight leaves the envelope, s, or inf

    The end denotes the last 10 % of the learning time. The metrics are:

    - path_share: fraction of the path length of W before T_w
    - late_update: largest update in a tick after T_w divided by the largest one before
    - end_update: largest update in a tick of the end divided by the largest one before T_w
    - late_change: largest |W - W(T_w)| after T_w divided by |W(T_w)|
    - end_change: change of W in the end divided by |W(T_w)|
    - stack_residual: relative residual on the recorded samples at the start, at T_w and at the end
      of the flight
    - flown_residual: |e| at the simulated error, at the start, and the largest before and after T_w
    - facts: further results of the law
    """
    names = ("path_share", "late_update", "end_update", "late_change", "end_change")
    if not np.isinf(lost_at):
        never = dict.fromkeys(("stack_residual", "flown_residual"), (np.inf, np.inf, np.inf))
        return {**dict.fromkeys(names, np.inf), **never, "facts": critic.facts}
    W = critic.weights
    updates = np.linalg.norm(np.diff(W, axis=0), axis=1)
    end, nearly = (int(np.count_nonzero(times < share * T_w - 1e-9)) for share in (1.0, 0.9))
    path = float(updates.sum())
    largest = float(updates[:end].max())
    final = float(np.linalg.norm(W[end]))
    size = np.abs(residual)
    on_stack = critic.residual
    return {
        "path_share": float(updates[:end].sum()) / path if path > 0.0 else 0.0,
        "late_update": over(float(updates[end:].max()), largest),
        "end_update": over(float(updates[nearly:end].max()), largest),
        "late_change": float(np.linalg.norm(W[end:] - W[end], axis=1).max()) / final,
        "end_change": float(np.linalg.norm(W[end] - W[nearly])) / final,
        "stack_residual": (float(on_stack[0]), float(on_stack[end]), float(on_stack[-1])),
        "flown_residual": (float(size[0]), float(size[: end + 1].max()), float(size[end:].max())),
        "facts": critic.facts,
    }


def residual_at(game: Game, basis: Basis, weights: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Return e = ∇V'A z + z'Qz - ¼ ∇V'S ∇V, (N,), where ∇V = ∂ψ(z)'W.

    e is the residual of the Hamilton-Jacobi-Isaacs equation.

    weights: W, (N, M)
    errors: z, (N, n)
    """
    gradient = np.einsum("jmi,jm->ji", basis.gradient(errors), weights)
    drift = np.einsum("ji,ji->j", gradient, errors @ game.A.T - 0.25 * gradient @ game.S)
    residual: np.ndarray = drift + _quadratic(errors, game.Q)
    return residual


def first_at(times: np.ndarray, size: np.ndarray, band: float) -> float:
    """Return the first time at which size <= band, s, or inf if there is no such time.

    times: (N,), s
    size: (N,)
    """
    inside = np.flatnonzero(size <= band)
    return float(times[inside[0]]) if len(inside) else np.inf


def wiggle(inputs: np.ndarray) -> np.ndarray:
    """Return the total variation of each column divided by its range, or 0 for a constant column.

    The ratio is 1 for a monotonic signal and large for chatter.
    """
    spread = np.ptp(inputs, axis=0)
    variation = np.abs(np.diff(inputs, axis=0)).sum(axis=0)
    return np.divide(variation, spread, out=np.zeros_like(spread), where=spread > 0.0)


def over(one: float, other: float) -> float:
    """Return the ratio one / other of nonnegative numbers, or inf for a zero denominator."""
    return one / other if other > 0.0 else np.inf


def _quadratic(rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
    result: np.ndarray = np.einsum("ji,ji->j", rows @ weight, rows)
    return result


def _ratio(over: np.ndarray, under: np.ndarray) -> np.ndarray:
    """Return the entrywise ratio over / under, with inf for a zero denominator."""
    return np.divide(over, under, out=np.full_like(over, np.inf), where=under > 0.0)


def _integral(values: np.ndarray, times: np.ndarray) -> float:
    return float(np.trapezoid(values, times))


def _rms(rows: np.ndarray) -> np.ndarray:
    result: np.ndarray = np.sqrt(np.mean(rows**2, axis=0))
    return result
