"""Numbers that say how a flight went and how its critic learned; all are inf for a flight that was lost."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.basis import Basis
from controller.closed_loop import Flight
from controller.game import Game
from hfa_model.vectors import INPUTS, LINEAR_STATES
from trim.condition import CONTROL_LIMITS

if TYPE_CHECKING:
    from verification.experiments.laws import Critic
    from verification.experiments.setting import Case, Setting

#: The states that have a command in Section 5.
TRACKED = ("speed", "alpha", "dihedral")
_ROWS = [LINEAR_STATES.index(name) for name in TRACKED]


def flight_metrics(setting: Setting, case: Case, flight: Flight, lost_at: float) -> dict[str, Any]:
    """Everything about errors, inputs and cost of a flight.

    rms_error, peak_error, late_peak_error: of z, by state; late is the window of the reading. settling: s, when an
    error entered its band for good, of the tracked states. cost: ∫ z'Qz + u'Ru dt. effort: ∫ u'Ru dt. attenuation:
    ∫ z'Qz + u'Ru over ∫ d'd, which the game promises below δ² for the disturbance alone; delta_squared: δ².
    rms_input, peak_input, peak_rate (per s, over one tick), wiggle (total variation over range, late), beyond_limits
    (share of the flight in which trim + u passes `CONTROL_LIMITS`, assumed): by input.
    """
    criteria, game = setting.reading["criteria"], case.game
    if not np.isinf(lost_at):
        return {"lost_at": lost_at} | _lost(game)
    z, u, d, t = flight.errors, flight.inputs, flight.disturbances, flight.times
    late = _late(t, criteria["late"])
    each = round(setting.reading["flight"]["tick"] / setting.reading["flight"]["step"])
    paid, effort = _quadratic(z, game.Q) + _quadratic(u, game.R), _quadratic(u, game.R)
    command = np.abs(setting.reading.signal("reference").constant)
    low, high = np.array(CONTROL_LIMITS).T - case.trim_inputs
    return {
        "lost_at": None,
        "rms_error": _named(LINEAR_STATES, _rms(z[late])),
        "peak_error": _named(LINEAR_STATES, np.abs(z).max(axis=0)),
        "late_peak_error": _named(LINEAR_STATES, np.abs(z[late]).max(axis=0)),
        "settling": {
            name: settled_at(t, np.abs(z[:, row]), criteria["close"] * command[row])
            for name, row in zip(TRACKED, _ROWS, strict=True)
        },
        "cost": _integral(paid, t),
        "effort": _integral(effort, t),
        "attenuation": _integral(paid, t) / _integral(_quadratic(d, np.eye(d.shape[1])), t),
        "delta_squared": game.delta**2,
        "rms_input": _named(INPUTS, _rms(u)),
        "peak_input": _named(INPUTS, np.abs(u).max(axis=0)),
        "peak_rate": _named(INPUTS, np.abs(np.diff(u[::each], axis=0)).max(axis=0) / (t[each] - t[0])),
        "wiggle": _named(INPUTS, wiggle(u[late])),
        "beyond_limits": _named(INPUTS, np.mean((u < low) | (u > high), axis=0)),
    }


def learning_metrics(
    times: np.ndarray, critic: Critic, residual: np.ndarray, predefined_time: float, lost_at: float
) -> dict[str, Any]:
    """How the critic learned, with the learning time T_w.

    path_share: share of the length of the path of W that lies before T_w. late_update: largest update of a tick after
    T_w over the largest before it. late_change: largest |W - W(T_w)| after T_w over |W(T_w)|. stack_residual_drop: at
    T_w over start, relative residual on the stack. flown_residual: |e| at the flown error, at the start, largest
    before and after T_w. facts: what the law says of itself.
    """
    names = ("path_share", "late_update", "late_change", "stack_residual_drop")
    if not np.isinf(lost_at):
        return dict.fromkeys(names, np.inf) | {"flown_residual": np.full(3, np.inf).tolist(), "facts": critic.note}
    updates = np.linalg.norm(np.diff(critic.weights, axis=0), axis=1)
    learning = times[:-1] < predefined_time - 1e-9
    end = int(np.count_nonzero(learning))
    at_end = critic.weights[end]
    changes = np.linalg.norm(critic.weights[end:] - at_end, axis=1)
    path = float(updates.sum())
    before, after = float(updates[learning].max()), float(updates[~learning].max())
    start = float(critic.residual[0])
    size = np.abs(residual)
    return {
        "path_share": float(updates[learning].sum()) / path if path > 0.0 else 1.0,
        "late_update": after / before if before > 0.0 else 0.0,
        "late_change": float(changes.max() / np.linalg.norm(at_end)),
        "stack_residual_drop": float(critic.residual[end]) / start,
        "flown_residual": [float(size[0]), float(size[: end + 1].max()), float(size[end:].max())],
        "facts": critic.note,
    }


def residual_at(game: Game, basis: Basis, weights: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """e = ∇V'A z + z'Qz - ¼ ∇V'S ∇V, ∇V = ∂ψ(z)'W: what is left of the Hamilton-Jacobi-Isaacs equation, (N,)."""
    gradient = np.einsum("jmi,jm->ji", basis.gradient(errors), weights)
    drift = np.einsum("ji,ji->j", gradient, errors @ game.A.T - 0.25 * gradient @ game.S)
    residual: np.ndarray = drift + _quadratic(errors, game.Q)
    return residual


def settled_at(times: np.ndarray, size: np.ndarray, band: float) -> float:
    """The first time from which size <= band to the end, s; inf when it is not so at the end."""
    outside = np.flatnonzero(~(size <= band))
    if len(outside) == 0:
        return float(times[0])
    return float(times[outside[-1] + 1]) if outside[-1] + 1 < len(times) else np.inf


def wiggle(inputs: np.ndarray) -> np.ndarray:
    """Total variation over range of each column, 0 for a constant: 1 for a monotone signal, large for one that chatters."""
    spread = np.ptp(inputs, axis=0)
    variation = np.abs(np.diff(inputs, axis=0)).sum(axis=0)
    return np.divide(variation, spread, out=np.zeros_like(spread), where=spread > 0.0)


def _late(times: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    inside: np.ndarray = (times >= window[0] - 1e-9) & (times <= window[1] + 1e-9)
    return inside


def _lost(game: Game) -> dict[str, Any]:
    by_state = ("rms_error", "peak_error", "late_peak_error")
    by_input = ("rms_input", "peak_input", "peak_rate", "wiggle", "beyond_limits")
    return {
        **{name: _named(LINEAR_STATES, np.full(len(LINEAR_STATES), np.inf)) for name in by_state},
        **{name: _named(INPUTS, np.full(len(INPUTS), np.inf)) for name in by_input},
        "settling": dict.fromkeys(TRACKED, np.inf),
        **dict.fromkeys(("cost", "effort", "attenuation"), np.inf),
        "delta_squared": game.delta**2,
    }


def _quadratic(rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
    result: np.ndarray = np.einsum("ji,ji->j", rows @ weight, rows)
    return result


def _integral(values: np.ndarray, times: np.ndarray) -> float:
    return float(np.trapezoid(values, times))


def _rms(rows: np.ndarray) -> np.ndarray:
    result: np.ndarray = np.sqrt(np.mean(rows**2, axis=0))
    return result


def _named(names: Iterable[str], values: np.ndarray) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))
