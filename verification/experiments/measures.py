"""The numbers that claims are about, as functions of the flights that they look at."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from verification.experiments.claims import Evidence
from verification.experiments.experiment_flights import FlightPlan, FlightRecord
from verification.experiments.metrics import over
from verification.experiments.setting import Setting

#: From a setting and a law to the flights that a claim looks at.
Select = Callable[[Setting, str], tuple[FlightPlan, ...]]
Measure = Callable[[Evidence, str], float]


def worst(select: Select, *path: str, of: Iterable[str] = ()) -> Measure:
    """The largest number under metrics[path...] over the flights; of: names to look at, all when empty."""
    names = tuple(of)

    def measure(evidence: Evidence, law: str) -> float:
        return max(_largest(_at(record, path), names) for record in evidence.records(*select(evidence.setting, law)))

    return measure


def smallest(select: Select, *path: str, of: Iterable[str] = ()) -> Measure:
    """The smallest such number."""
    names = tuple(of)

    def measure(evidence: Evidence, law: str) -> float:
        return min(
            -_largest(_negative(_at(record, path)), names)
            for record in evidence.records(*select(evidence.setting, law))
        )

    return measure


def spread(select: Select, *path: str, of: Iterable[str] = ()) -> Measure:
    """The largest (largest - smallest) / largest of a number between the flights; inf when it is inf in some only.

    A number that is inf in all flights (an error that never settles, say) tells nothing and is left out; inf when
    that leaves none.
    """
    names = tuple(of)

    def measure(evidence: Evidence, law: str) -> float:
        tables = [_at(record, path) for record in evidence.records(*select(evidence.setting, law))]
        found = []
        for name in names or tables[0]:
            values = np.array([table[name] for table in tables])
            if np.all(np.isfinite(values)):
                found.append(over(float(np.ptp(values)), float(values.max())) if np.ptp(values) > 0.0 else 0.0)
            elif np.any(np.isfinite(values)):
                found.append(np.inf)
        return max(found, default=np.inf)

    return measure


def ratio(select: Select, other: Select, *path: str, of: Iterable[str] = ()) -> Measure:
    """The largest number over the same number of the other flights, flight by flight and name by name."""
    names = tuple(of)

    def measure(evidence: Evidence, law: str) -> float:
        pairs = zip(
            evidence.records(*select(evidence.setting, law)),
            evidence.records(*other(evidence.setting, law)),
            strict=True,
        )
        found = []
        for one, two in pairs:
            left, right = _at(one, path), _at(two, path)
            if isinstance(left, Mapping):
                found += [over(left[name], right[name]) for name in names or left]
            else:
                found.append(over(left, right))
        return max(found)

    return measure


def residual_growth(select: Select) -> Measure:
    """Largest Bellman residual at the flown error after T_w over the largest before."""

    def measure(evidence: Evidence, law: str) -> float:
        return max(over(after, before) for _, before, after in _flown_residuals(evidence, select, law))

    return measure


def residual_drop(select: Select) -> Measure:
    """Largest Bellman residual at the flown error after T_w over the one at the start."""

    def measure(evidence: Evidence, law: str) -> float:
        return max(over(after, start) for start, _, after in _flown_residuals(evidence, select, law))

    return measure


def _flown_residuals(evidence: Evidence, select: Select, law: str) -> list[Any]:
    """Largest Bellman residual at the start, before T_w and after it, of each flight."""
    return [record.metrics["learning"]["flown_residual"] for record in evidence.records(*select(evidence.setting, law))]


def gain_error(select: Select, *, at_end_of_flight: bool = False) -> Measure:
    """|K - K*| / |K*| at T_w or at the end of the flight, K of the learned value and K* of the exact solution."""

    def measure(evidence: Evidence, law: str) -> float:
        at = np.inf if at_end_of_flight else evidence.setting.reading.predefined_time(evidence.section)
        return max(_gain_error(evidence, record, at) for record in evidence.records(*select(evidence.setting, law)))

    return measure


def _gain_error(evidence: Evidence, record: FlightRecord, time: float) -> float:
    case = evidence.setting.case(record.plan.dihedral_deg)
    assert record.critic is not None
    row = min(int(np.searchsorted(record.times, time - 1e-9)), len(record.times) - 1)
    K = case.game.gain(record.critic.basis.matrix(record.critic.weights[row]))
    return float(np.linalg.norm(K - case.exact.K) / np.linalg.norm(case.exact.K))


def _at(record: FlightRecord, path: tuple[str, ...]) -> Any:
    value: Any = record.metrics
    for name in path:
        value = value[name]
    return value


def _largest(value: Any, names: tuple[str, ...]) -> float:
    return max(value[name] for name in names or value) if isinstance(value, Mapping) else float(value)


def _negative(value: Any) -> Any:
    return {name: -number for name, number in value.items()} if isinstance(value, Mapping) else -value
