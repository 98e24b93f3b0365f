"""Numbers that say how a flight went and how its critic learned; all are inf for a flight that was lost."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.flight.closed_loop import Flight
from controller.game.basis import Basis
from controller.game.zero_sum import Game
from hfa_model.vectors import INPUTS, LINEAR_STATES
from trim.point.condition import CONTROL_LIMITS

if TYPE_CHECKING:
    from verification.experiments.flown_laws import Critic
    from verification.experiments.setting import Case, Setting

#: The states that have a command in Section 5.
TRACKED = ("speed", "alpha", "dihedral")
_ROWS = [LINEAR_STATES.index(name) for name in TRACKED]


def flight_metrics(setting: Setting, case: Case, flight: Flight, lost_at: float) -> dict[str, Any]:
    """Everything about errors, inputs and cost of a flight.

    rms_error, peak_error, late_peak_error: of z, by state; late is the window of the reading. Of the tracked states:
    relative_error, late rms over the command; rise and settling, s, when the error entered its band for the first time
    and for good; growth, largest error after the short adjustment over the largest before. cost: ∫ z'Qz + u'Ru dt.
    early_cost: ∫ z'Qz dt during the adjustment. effort: ∫ u'Ru dt; peak_effort: largest (u'Ru)^½. attenuation:
    ∫ z'Qz + u'Ru over ∫ d'd, which the game promises below δ² for the disturbance alone; delta_squared: δ².
    rms_input, peak_input, peak_rate (per s, over one tick), wiggle (total variation over range, late), remaining_range
    (after the adjustment, over the peak), beyond_limits (share of the flight in which trim + u passes
    `CONTROL_LIMITS`, assumed): by input.
    """
    criteria, game = setting.reading["criteria"], case.game
    if not np.isinf(lost_at):
        return {"lost_at": lost_at} | _lost(game)
    z, u, d, t = flight.errors, flight.inputs, flight.disturbances, flight.times
    late, early = _late(t, criteria["late"]), t <= criteria["short_adjustment"] + 1e-9
    each = setting.reading.steps_per_tick
    errors, efforts = _quadratic(z, game.Q), _quadratic(u, game.R)
    size, command = np.abs(z[:, _ROWS]), np.abs(setting.reading.signal("reference").constant[_ROWS])
    peak = np.abs(u).max(axis=0)
    low, high = np.array(CONTROL_LIMITS).T - case.trim_inputs
    return {
        "lost_at": None,
        "rms_error": _named(LINEAR_STATES, _rms(z[late])),
        "peak_error": _named(LINEAR_STATES, np.abs(z).max(axis=0)),
        "late_peak_error": _named(LINEAR_STATES, np.abs(z[late]).max(axis=0)),
        "relative_error": _named(TRACKED, _ratio(_rms(size[late]), command)),
        "rise": _named(TRACKED, np.array([first_at(t, *pair) for pair in _banded(size, criteria["close"] * command)])),
        "settling": _named(
            TRACKED, np.array([settled_at(t, *pair) for pair in _banded(size, criteria["close"] * command)])
        ),
        "growth": _named(TRACKED, _ratio(size[~early].max(axis=0), size[early].max(axis=0))),
        "cost": _integral(errors + efforts, t),
        "early_cost": _integral(errors[early], t[early]),
        "effort": _integral(efforts, t),
        "peak_effort": float(np.sqrt(efforts.max())),
        "attenuation": over(_integral(errors + efforts, t), _integral(_quadratic(d, np.eye(d.shape[1])), t)),
        "delta_squared": game.delta**2,
        "rms_input": _named(INPUTS, _rms(u)),
        "peak_input": _named(INPUTS, peak),
        "peak_rate": _named(INPUTS, np.abs(np.diff(u[::each], axis=0)).max(axis=0) / (t[each] - t[0])),
        "wiggle": _named(INPUTS, wiggle(u[late])),
        "remaining_range": _named(INPUTS, _ratio(np.ptp(u[~early], axis=0), peak)),
        "beyond_limits": _named(INPUTS, np.mean((u < low) | (u > high), axis=0)),
    }


def _lost(game: Game) -> dict[str, Any]:
    """The same names, all inf."""
    by_state = ("rms_error", "peak_error", "late_peak_error")
    by_tracked = ("relative_error", "rise", "settling", "growth")
    by_input = ("rms_input", "peak_input", "peak_rate", "wiggle", "remaining_range", "beyond_limits")
    whole = ("cost", "early_cost", "effort", "peak_effort", "attenuation")
    return {
        **{name: dict.fromkeys(LINEAR_STATES, np.inf) for name in by_state},
        **{name: dict.fromkeys(TRACKED, np.inf) for name in by_tracked},
        **{name: dict.fromkeys(INPUTS, np.inf) for name in by_input},
        **dict.fromkeys(whole, np.inf),
        "delta_squared": game.delta**2,
    }


def learning_metrics(
    times: np.ndarray, critic: Critic, residual: np.ndarray, predefined_time: float, lost_at: float
) -> dict[str, Any]:
    """How the critic learned, with the learning time T_w; its last tenth is called the end.

    path_share: share of the length of the path of W that lies before T_w. late_update: largest update of a tick after
    T_w over the largest before. end_update: the same for the end of the learning time. late_change: largest
    |W - W(T_w)| after T_w over |W(T_w)|. end_change: |W(T_w) - W| at the beginning of the end over |W(T_w)|.
    stack_residual: relative residual on the stack at the start, at T_w and at the end of the flight. flown_residual:
    |e| at the flown error, at the start, and the largest before and after T_w. facts: what the law says of itself.
    """
    if not np.isinf(lost_at):
        names = ("path_share", "late_update", "end_update", "late_change", "end_change")
        triples = {name: [np.inf, np.inf, np.inf] for name in ("stack_residual", "flown_residual")}
        return dict.fromkeys(names, np.inf) | triples | {"facts": critic.note}
    W = critic.weights
    updates = np.linalg.norm(np.diff(W, axis=0), axis=1)
    end, nearly = (int(np.count_nonzero(times < share * predefined_time - 1e-9)) for share in (1.0, 0.9))
    path, largest, final = float(updates.sum()), float(updates[:end].max()), float(np.linalg.norm(W[end]))
    size = np.abs(residual)
    return {
        "path_share": float(updates[:end].sum()) / path if path > 0.0 else 0.0,
        "late_update": over(float(updates[end:].max()), largest),
        "end_update": over(float(updates[nearly:end].max()), largest),
        "late_change": float(np.linalg.norm(W[end:] - W[end], axis=1).max()) / final,
        "end_change": float(np.linalg.norm(W[end] - W[nearly])) / final,
        "stack_residual": critic.residual[[0, end, -1]].tolist(),
        "flown_residual": [float(size[0]), float(size[: end + 1].max()), float(size[end:].max())],
        "facts": critic.note,
    }


def residual_at(game: Game, basis: Basis, weights: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """e = ∇V'A z + z'Qz - ¼ ∇V'S ∇V, ∇V = ∂ψ(z)'W: what is left of the Hamilton-Jacobi-Isaacs equation, (N,)."""
    gradient = np.einsum("jmi,jm->ji", basis.gradient(errors), weights)
    drift = np.einsum("ji,ji->j", gradient, errors @ game.A.T - 0.25 * gradient @ game.S)
    residual: np.ndarray = drift + _quadratic(errors, game.Q)
    return residual


def first_at(times: np.ndarray, size: np.ndarray, band: float) -> float:
    """The first time at which size <= band, s; inf when it never is."""
    inside = np.flatnonzero(size <= band)
    return float(times[inside[0]]) if len(inside) else np.inf


def settled_at(times: np.ndarray, size: np.ndarray, band: float) -> float:
    """The first time from which size <= band to the end, s; inf when it is not so at the end."""
    outside = np.flatnonzero(~(size <= band))
    if len(outside) == 0:
        return float(times[0])
    return float(times[outside[-1] + 1]) if outside[-1] + 1 < len(times) else np.inf


def wiggle(inputs: np.ndarray) -> np.ndarray:
    """Total variation over range of each column, 0 for a constant: 1 for a monotone signal, large for chatter."""
    spread = np.ptp(inputs, axis=0)
    variation = np.abs(np.diff(inputs, axis=0)).sum(axis=0)
    return np.divide(variation, spread, out=np.zeros_like(spread), where=spread > 0.0)


def over(one: float, other: float) -> float:
    """one / other of numbers that are not negative; inf over nothing."""
    return one / other if other > 0.0 else np.inf


def _late(times: np.ndarray, window: tuple[float, float]) -> np.ndarray:
    inside: np.ndarray = (times >= window[0] - 1e-9) & (times <= window[1] + 1e-9)
    return inside


def _quadratic(rows: np.ndarray, weight: np.ndarray) -> np.ndarray:
    result: np.ndarray = np.einsum("ji,ji->j", rows @ weight, rows)
    return result


def _banded(size: np.ndarray, bands: np.ndarray) -> list[tuple[np.ndarray, float]]:
    return list(zip(size.T, bands.tolist(), strict=True))


def _ratio(over: np.ndarray, under: np.ndarray) -> np.ndarray:
    """over / under, and inf where nothing is below."""
    return np.divide(over, under, out=np.full_like(over, np.inf), where=under > 0.0)


def _integral(values: np.ndarray, times: np.ndarray) -> float:
    return float(np.trapezoid(values, times))


def _rms(rows: np.ndarray) -> np.ndarray:
    result: np.ndarray = np.sqrt(np.mean(rows**2, axis=0))
    return result


def _named(names: Iterable[str], values: np.ndarray) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))
