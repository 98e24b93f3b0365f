"""The numbers that claims are about, as functions of the flights that they look at."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from verification.experiments.claims import Evidence
from verification.experiments.experiment_flights import FlightPlan, FlightRecord
from verification.experiments.metrics import FlightMetrics, LearningMetrics, over
from verification.experiments.setting import Setting

#: From a setting and a law to the flights that a claim looks at.
Select = Callable[[Setting, str], tuple[FlightPlan, ...]]
Measure = Callable[[Evidence, str], float]
#: What is read of one flight: a number, or numbers by name.
Metric = Callable[[FlightMetrics], float | Mapping[str, float]]


def of_learning(number: Callable[[LearningMetrics], float]) -> Metric:
    """A number of the learning of a flight."""

    def quantity(metrics: FlightMetrics) -> float:
        assert metrics.learning is not None
        return number(metrics.learning)

    return quantity


def worst(select: Select, quantity: Metric, *, of: Iterable[str] = ()) -> Measure:
    """The largest number over the flights; of: names to look at, all when empty."""
    names = tuple(of)
    return lambda evidence, law: max(max(_numbers(one, quantity, names)) for one in _selected(evidence, select, law))


def smallest(select: Select, quantity: Metric, *, of: Iterable[str] = ()) -> Measure:
    """The smallest such number."""
    names = tuple(of)
    return lambda evidence, law: min(min(_numbers(one, quantity, names)) for one in _selected(evidence, select, law))


def spread(select: Select, quantity: Metric, *, of: Iterable[str] = ()) -> Measure:
    """The largest (largest - smallest) / largest of a number between the flights; inf when it is inf in some only.

    A number that is inf in all flights (an error that never settles, say) tells nothing and is left out; inf when
    that leaves none.
    """
    names = tuple(of)

    def measure(evidence: Evidence, law: str) -> float:
        found = []
        for values in np.array([_numbers(one, quantity, names) for one in _selected(evidence, select, law)]).T:
            if np.all(np.isfinite(values)):
                found.append(over(float(np.ptp(values)), float(values.max())) if np.ptp(values) > 0.0 else 0.0)
            elif np.any(np.isfinite(values)):
                found.append(np.inf)
        return max(found, default=np.inf)

    return measure


def ratio(select: Select, other: Select, quantity: Metric, *, of: Iterable[str] = ()) -> Measure:
    """The largest number over the same number of the other flights, flight by flight and name by name."""
    names = tuple(of)

    def measure(evidence: Evidence, law: str) -> float:
        pairs = zip(_selected(evidence, select, law), _selected(evidence, other, law), strict=True)
        return max(
            over(left, right)
            for one, two in pairs
            for left, right in zip(_numbers(one, quantity, names), _numbers(two, quantity, names), strict=True)
        )

    return measure


def residual_growth(select: Select) -> Measure:
    """Largest Bellman residual at the simulated error after T_w over the largest before."""
    return lambda evidence, law: max(
        over(after, before) for _, before, after in _flown_residuals(evidence, select, law)
    )


def residual_drop(select: Select) -> Measure:
    """Largest Bellman residual at the simulated error after T_w over the one at the start."""
    return lambda evidence, law: max(over(after, start) for start, _, after in _flown_residuals(evidence, select, law))


def _flown_residuals(evidence: Evidence, select: Select, law: str) -> list[tuple[float, float, float]]:
    """Largest Bellman residual at the start, before T_w and after it, of each flight."""
    learning = [record.metrics.learning for record in _selected(evidence, select, law)]
    return [metrics.flown_residual for metrics in learning if metrics is not None]


def gain_error(select: Select, *, at_end_of_flight: bool = False) -> Measure:
    """|K - K*| / |K*| at T_w or at the end of the flight, K of the learned value and K* of the exact solution."""

    def measure(evidence: Evidence, law: str) -> float:
        at = np.inf if at_end_of_flight else evidence.setting.configuration.predefined_time(evidence.section)
        return max(_gain_error(evidence, record, at) for record in _selected(evidence, select, law))

    return measure


def _gain_error(evidence: Evidence, record: FlightRecord, time: float) -> float:
    case = evidence.setting.case(record.plan.dihedral_deg)
    assert record.critic is not None
    row = min(int(np.searchsorted(record.times, time - 1e-9)), len(record.times) - 1)
    K = case.game.gain(record.critic.basis.matrix(record.critic.weights[row]))
    return float(np.linalg.norm(K - case.exact.K) / np.linalg.norm(case.exact.K))


def _selected(evidence: Evidence, select: Select, law: str) -> list[FlightRecord]:
    return evidence.records(*select(evidence.setting, law))


def _numbers(record: FlightRecord, quantity: Metric, names: tuple[str, ...]) -> list[float]:
    value = quantity(record.metrics)
    return [value[name] for name in names or value] if isinstance(value, Mapping) else [float(value)]
