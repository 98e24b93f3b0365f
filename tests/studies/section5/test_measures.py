"""Measures look at the flights and names that they are asked for; times and wiggle of known signals."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from controller.game.learning_result import settled_at
from studies.section5.claims import Evidence, FlightLostError
from studies.section5.configuration import section5_configuration
from studies.section5.experiment_flights import FlightPlan, FlightRecord
from studies.section5.flown_laws import EXACT
from studies.section5.measures import ratio, smallest, spread, worst
from studies.section5.metrics import ByName, FlightMetrics, first_at, wiggle
from studies.section5.setting import Setting

#: The measures look at flights alone.
SETTING = Setting(section5_configuration(), "regenerated", ())


def metrics_of(table: ByName) -> FlightMetrics:
    """Errors by name and a cost; no other number is looked at."""
    blank: dict[str, Any] = {field.name: np.nan for field in fields(FlightMetrics)}
    return FlightMetrics(**blank | {"rms_error": table, "cost": table["a"]})


def by_name(metrics: FlightMetrics) -> ByName:
    return metrics.rms_error


def whole(metrics: FlightMetrics) -> float:
    return metrics.cost


def recorded(plan: FlightPlan, table: ByName, lost_at: float = np.inf) -> FlightRecord:
    nothing = np.zeros((1, 6))
    arrays = (np.zeros(1), nothing, nothing, nothing, nothing)
    return FlightRecord(plan, *arrays, None, np.zeros(1), 0.0, lost_at, metrics_of(table), np.zeros((2, 5)))


def evidence_of(*records: FlightRecord) -> Evidence:
    return Evidence(SETTING, "5.3", {record.plan: record for record in records})


def test_measures_look_at_the_right_flights_and_names() -> None:
    plans = [FlightPlan(5.0, EXACT, uncertainty=factor) for factor in (0.0, 0.1)]
    tables = ({"a": 1.0, "b": 4.0, "c": np.inf}, {"a": 2.0, "b": 3.0, "c": np.inf})
    one, two = (recorded(plan, table) for plan, table in zip(plans, tables, strict=True))
    evidence = evidence_of(one, two)

    def both(setting: Setting, law: str) -> tuple[FlightPlan, ...]:
        return tuple(plans)

    def first(setting: Setting, law: str) -> tuple[FlightPlan, ...]:
        return (plans[0],)

    def second(setting: Setting, law: str) -> tuple[FlightPlan, ...]:
        return (plans[1],)

    assert worst(both, by_name, of=("a", "b"))(evidence, EXACT) == 4.0
    assert worst(both, whole)(evidence, EXACT) == 2.0
    assert smallest(both, by_name, of=("a", "b"))(evidence, EXACT) == 1.0
    assert spread(both, by_name)(evidence, EXACT) == 0.5
    assert spread(both, by_name, of=("b",))(evidence, EXACT) == 0.25
    assert spread(both, by_name, of=("c",))(evidence, EXACT) == np.inf
    assert ratio(first, second, by_name, of=("a", "b"))(evidence, EXACT) == 4.0 / 3.0
    assert ratio(second, first, whole)(evidence, EXACT) == 2.0
    settles_once = replace(two, metrics=metrics_of(tables[1] | {"c": 1.0}))
    assert spread(both, by_name)(evidence_of(one, settles_once), EXACT) == np.inf
    with pytest.raises(FlightLostError, match="5 deg, exact"):
        worst(first, whole)(evidence_of(recorded(plans[0], tables[0], 0.5)), EXACT)


def test_times_and_wiggle() -> None:
    times, size = np.arange(6.0), np.array([3.0, 0.5, 2.0, 0.4, 0.3, 0.2])
    assert (first_at(times, size, 1.0), settled_at(times, size, 1.0)) == (1.0, 3.0)
    assert (first_at(times, size, 0.1), settled_at(times, size, 0.1)) == (np.inf, np.inf)
    assert settled_at(times, np.zeros(6), 1.0) == 0.0
    assert settled_at(times, size[::-1], 1.0) == np.inf
    waves = np.column_stack([times, np.ones(6), (-1.0) ** times])
    assert wiggle(waves).tolist() == [1.0, 0.0, 5.0]
