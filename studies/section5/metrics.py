"""Numbers that say how a flight went and how its critic learned; all are inf for a flight that was lost."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.flight.simulation import Flight
from controller.game.basis import Basis
from controller.game.learning_result import settled_at
from controller.game.zero_sum import Game
from hfa_model.vectors import INPUTS, LINEAR_STATES

if TYPE_CHECKING:
    from studies.section5.flown_laws import Critic
    from studies.section5.setting import PaperCase, Setting

#: The states that have a command in Section 5.
TRACKED = ("speed", "alpha", "dihedral")
_ROWS = [LINEAR_STATES.index(name) for name in TRACKED]


ByName = Mapping[str, float]


@dataclass(frozen=True)
class LearningMetrics:
    """How the critic learned, with the learning time T_w; its last tenth is called the end.

    path_share: share of the length of the path of W that lies before T_w. late_update: largest update of a tick after
    T_w over the largest before. end_update: the same for the end of the learning time. late_change: largest
    |W - W(T_w)| after T_w over |W(T_w)|. end_change: |W(T_w) - W| at the beginning of the end over |W(T_w)|.
    stack_residual: relative residual on the stack at the start, at T_w and at the end of the flight. flown_residual:
    |e| at the simulated error, at the start, and the largest before and after T_w. facts: the law's own.
    """

    path_share: float
    late_update: float
    end_update: float
    late_change: float
    end_change: float
    stack_residual: tuple[float, float, float]
    flown_residual: tuple[float, float, float]
    facts: Mapping[str, Any]

    @property
    def residual_growth(self) -> float:
        """|e| at the simulated error: its largest after T_w over its largest before."""
        _, before, after = self.flown_residual
        return over(after, before)

    @property
    def residual_drop(self) -> float:
        """|e| at the simulated error: its largest after T_w over that at the start."""
        start, _, after = self.flown_residual
        return over(after, start)


@dataclass(frozen=True)
class FlightMetrics:
    """Everything about errors, inputs and cost of a flight.

    lost_at: s, None for a flight that came to its end. rms_error, peak_error, late_peak_error: of z, by state; late is
    the window of the criteria. Of the tracked states: relative_error, late rms over the command; rise and settling, s,
    when the error entered its band for the first time and for good; growth, largest error after the short adjustment
    over the largest before. cost: ∫ z'Qz + u'Ru dt. early_cost: ∫ z'Qz dt during the adjustment. effort: ∫ u'Ru dt;
    peak_effort: largest (u'Ru)^½. attenuation: ∫ z'Qz + u'Ru over ∫ d'd, which the game promises below δ² for the
    disturbance alone; delta_squared: δ². rms_input, peak_input, peak_rate (per s, over one tick), wiggle (total
    variation over range, late), remaining_range (after the adjustment, over the peak), beyond_limits (share of the
    flight in which trim + u passes `CONTROL_LIMITS`, assumed): by input. learning: None for a law that does not learn.
    """

    lost_at: float | None
    rms_error: ByName
    peak_error: ByName
    late_peak_error: ByName
    relative_error: ByName
    rise: ByName
    settling: ByName
    growth: ByName
    cost: float
    early_cost: float
    effort: float
    peak_effort: float
    attenuation: float
    delta_squared: float
    rms_input: ByName
    peak_input: ByName
    peak_rate: ByName
    wiggle: ByName
    remaining_range: ByName
    beyond_limits: ByName
    learning: LearningMetrics | None = None

    @property
    def attenuation_share(self) -> float:
        """attenuation / δ², below 1 as the game promises."""
        return self.attenuation / self.delta_squared

    def to_dict(self) -> dict[str, Any]:
        """Plain values; `learning` is left out where nothing learns."""
        return {name: value for name, value in asdict(self).items() if name != "learning" or value is not None}


def flight_metrics(
    setting: Setting, case: PaperCase, flight: Flight, lost_at: float, learning: LearningMetrics | None
) -> FlightMetrics:
    """The metrics of a flight up to lost_at, s (inf: to its end)."""
    criteria, game = setting.configuration.criteria, case.game
    if not np.isinf(lost_at):
        return _lost(game, lost_at, learning)
    z, u, d, t = flight.errors, flight.inputs, flight.disturbances, flight.times
    late, early = _late(t, criteria.late), t <= criteria.short_adjustment + 1e-9
    each = setting.configuration.flight.steps_per_tick
    errors, efforts = _quadratic(z, game.Q), _quadratic(u, game.R)
    cost = _integral(errors + efforts, t)
    size, command = np.abs(z[:, _ROWS]), np.abs(setting.configuration.reference.signal.constant[_ROWS])
    peak = np.abs(u).max(axis=0)
    low, high = case.input_limits
    banded = list(zip(TRACKED, size.T, (criteria.close * command).tolist(), strict=True))
    return FlightMetrics(
        lost_at=None,
        rms_error=_named(LINEAR_STATES, _rms(z[late])),
        peak_error=_named(LINEAR_STATES, np.abs(z).max(axis=0)),
        late_peak_error=_named(LINEAR_STATES, np.abs(z[late]).max(axis=0)),
        relative_error=_named(TRACKED, _ratio(_rms(size[late]), command)),
        rise={name: first_at(t, error, band) for name, error, band in banded},
        settling={name: settled_at(t, error, band) for name, error, band in banded},
        growth=_named(TRACKED, _ratio(size[~early].max(axis=0), size[early].max(axis=0))),
        cost=cost,
        early_cost=_integral(errors[early], t[early]),
        effort=_integral(efforts, t),
        peak_effort=float(np.sqrt(efforts.max())),
        attenuation=over(cost, _integral(_quadratic(d, np.eye(d.shape[1])), t)),
        delta_squared=game.delta**2,
        rms_input=_named(INPUTS, _rms(u)),
        peak_input=_named(INPUTS, peak),
        peak_rate=_named(INPUTS, np.abs(np.diff(u[::each], axis=0)).max(axis=0) / (t[each] - t[0])),
        wiggle=_named(INPUTS, wiggle(u[late])),
        remaining_range=_named(INPUTS, _ratio(np.ptp(u[~early], axis=0), peak)),
        beyond_limits=_named(INPUTS, np.mean((u < low) | (u > high), axis=0)),
        learning=learning,
    )


def _lost(game: Game, lost_at: float, learning: LearningMetrics | None) -> FlightMetrics:
    """All numbers inf."""
    names = {"rms_error": LINEAR_STATES, "peak_error": LINEAR_STATES, "late_peak_error": LINEAR_STATES}
    names |= dict.fromkeys(("relative_error", "rise", "settling", "growth"), TRACKED)
    names |= dict.fromkeys(
        ("rms_input", "peak_input", "peak_rate", "wiggle", "remaining_range", "beyond_limits"), INPUTS
    )
    by_name = {number: dict.fromkeys(each, np.inf) for number, each in names.items()}
    single = dict.fromkeys(("cost", "early_cost", "effort", "peak_effort", "attenuation"), np.inf)
    numbers: dict[str, Any] = by_name | single
    return FlightMetrics(lost_at=lost_at, delta_squared=game.delta**2, learning=learning, **numbers)


def learning_metrics(
    times: np.ndarray, critic: Critic, residual: np.ndarray, predefined_time: float, lost_at: float
) -> LearningMetrics:
    """How the critic of a flight up to lost_at, s (inf: to its end) learned. residual: (N,), at the simulated error."""
    if not np.isinf(lost_at):
        never = (np.inf, np.inf, np.inf)
        return LearningMetrics(np.inf, np.inf, np.inf, np.inf, np.inf, never, never, critic.note)
    W = critic.weights
    updates = np.linalg.norm(np.diff(W, axis=0), axis=1)
    end, nearly = (int(np.count_nonzero(times < share * predefined_time - 1e-9)) for share in (1.0, 0.9))
    path, largest, final = float(updates.sum()), float(updates[:end].max()), float(np.linalg.norm(W[end]))
    size, on_stack = np.abs(residual), critic.residual
    return LearningMetrics(
        path_share=float(updates[:end].sum()) / path if path > 0.0 else 0.0,
        late_update=over(float(updates[end:].max()), largest),
        end_update=over(float(updates[nearly:end].max()), largest),
        late_change=float(np.linalg.norm(W[end:] - W[end], axis=1).max()) / final,
        end_change=float(np.linalg.norm(W[end] - W[nearly])) / final,
        stack_residual=(float(on_stack[0]), float(on_stack[end]), float(on_stack[-1])),
        flown_residual=(float(size[0]), float(size[: end + 1].max()), float(size[end:].max())),
        facts=critic.note,
    )


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
