"""A sweep under any condition: the points of a single trim each, in memory and in a store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from hfa_model import DEGREE, STATES, Aircraft
from hfa_support import BadInputError
from trim import (
    NamedCondition,
    SweepPlan,
    TrimError,
    find_operating_point,
    level_flight,
    linearize,
    load_condition,
    release,
    stream_sweep,
    sweep,
)
from trim.point.condition import BALANCED
from trim.point.named_condition import LEVEL_FLIGHT
from trim.sweeps.level_flights import are_level_flights

ALPHA_FREE = LEVEL_FLIGHT.changed(free=("alpha",), hold={"aileron_outer": 0.0})
LIMITED = LEVEL_FLIGHT.changed(limits={"throttle": (0.0, 40.0)})
#: Grid, condition, whether the compiled function does it.
CASES: dict[str, tuple[dict[str, list[float]], NamedCondition, bool]] = {
    "climb": ({"gamma": [-0.02, 0.02], "dihedral": [0.1, 0.2]}, LEVEL_FLIGHT, True),
    "limits": ({"dihedral": [0.05, 0.2]}, LIMITED, True),
    "table": ({"dihedral": [0.1, 0.3]}, NamedCondition("x", {"alpha": ((0.1, 0.3), (0.04, 0.06))}), True),
    "released simulation": ({"dihedral": [0.1, 0.3]}, load_condition("simvfa-64"), False),
    "dihedral held": ({"speed": [64.0, 68.0]}, LEVEL_FLIGHT.changed(hold={"dihedral": 0.2}), True),
    "alpha free": ({"dihedral": [0.1, 0.2]}, ALPHA_FREE, False),
    "alpha free, limited": ({"speed": [40.0, 68.0]}, ALPHA_FREE.changed(limits={"alpha": (0.0, 0.09)}), False),
    "glide": ({"throttle": [0.0, 20.0]}, LEVEL_FLIGHT.changed(free=("gamma",)), False),
    "center aileron": ({"dihedral": [0.1], "aileron_center": [0.0, 0.02]}, LEVEL_FLIGHT, False),
}


@pytest.mark.parametrize("name", CASES)
def test_each_point_is_that_of_a_single_trim(published_aircraft: Aircraft, name: str) -> None:
    grid, condition, compiled = CASES[name]
    assert are_level_flights(tuple(grid), condition) == compiled
    result = sweep(published_aircraft, grid, condition=condition)
    trimmed = 0
    for i, row in enumerate(result.values.tolist()):
        values = dict(zip(grid, row, strict=True))
        single = condition.at(values.get("dihedral", 0.0), values)
        if result.reasons[i]:
            with pytest.raises(TrimError) as caught:
                find_operating_point(published_aircraft, single)
            assert result.reasons[i] == str(caught.value)
            continue
        point = find_operating_point(published_aircraft, single)
        np.testing.assert_allclose(result.states[i], point.states, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(result.inputs[i], point.inputs, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(result.A[i], linearize(published_aircraft, point).A, rtol=1e-9, atol=1e-9)
        trimmed += 1
    assert trimmed == result.trimmed.sum() >= 1


def test_a_condition_of_a_trim_is_one_of_a_sweep(published_aircraft: Aircraft) -> None:
    """Also with a rate that is not zero: at each dihedral angle the same pull-up."""
    held = release(level_flight(0.1), free=("alpha",), hold={"aileron_outer": 0.0})
    by_sweep = sweep(published_aircraft, {"dihedral": [0.1, 0.2]}, condition=held)
    named = sweep(published_aircraft, {"dihedral": [0.1, 0.2]}, condition=ALPHA_FREE)
    np.testing.assert_array_equal(by_sweep.A, named.A)
    rates = dict.fromkeys(BALANCED, 0.0) | {"speed": 1.0}
    faster = sweep(published_aircraft, {"dihedral": [0.1]}, condition=replace(level_flight(0.0), rates=rates))
    rate = published_aircraft.rates(faster.states[0], faster.inputs[0])
    assert rate[STATES.index("speed")] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("grid", "condition", "words"),
    [
        ({"throttle": [0.0, 50.0]}, LIMITED, "throttle is 50; it must lie between 0 and 40"),
        ({"dihedral": [0.1, 0.5]}, load_condition("simvfa-64"), "alpha is given from 0 to 20 deg of dihedral"),
        ({"flaps": [0.1]}, LEVEL_FLIGHT, "cannot sweep 'flaps'; choose from speed, alpha"),
        ({"speed": [60.0]}, NamedCondition("x", free=("alpha",)).changed(hold={"alpha": 1.0}), "alpha is 57.2958 deg"),
    ],
)
def test_what_no_trim_takes_no_sweep_takes(
    published_aircraft: Aircraft, grid: dict[str, list[float]], condition: NamedCondition, words: str
) -> None:
    with pytest.raises(BadInputError, match=words):
        sweep(published_aircraft, grid, condition=condition)
    axes = {name: tuple(values) for name, values in grid.items()}
    with pytest.raises(BadInputError, match=words):
        SweepPlan(axes, published_aircraft.parameters, "published", condition=condition)


def _plan(aircraft: Aircraft, **more: Any) -> SweepPlan:
    axes: Mapping[str, tuple[float, ...]] = {"dihedral": (5 * DEGREE, 10 * DEGREE), "speed": (64.0, 68.0)}
    return SweepPlan(axes, aircraft.parameters, "published", **more)


def test_a_store_has_the_points_of_a_sweep_in_memory(published_aircraft: Aircraft, tmp_path: Path) -> None:
    plan = _plan(published_aircraft, condition=ALPHA_FREE)
    store = stream_sweep(plan, tmp_path / "a.zarr")
    expected = sweep(published_aircraft, plan.axes, condition=ALPHA_FREE, full=True)  # type: ignore[arg-type]
    np.testing.assert_array_equal(store.read("A"), expected.A)
    attributes = dict(zarr.open_group(str(tmp_path / "a.zarr"), mode="r").attrs)
    assert attributes["grid"]["speed"] == {"values": [64.0, 68.0], "unit": "ft/s"}
    assert attributes["condition"] == ALPHA_FREE.to_dict()


@pytest.mark.parametrize("change", ["condition", "start", "limits"])
def test_a_store_is_not_continued_under_another_condition(
    published_aircraft: Aircraft, tmp_path: Path, change: str
) -> None:
    point = find_operating_point(published_aircraft, level_flight(0.1))
    other: dict[str, dict[str, Any]] = {
        "condition": {"condition": LEVEL_FLIGHT.changed(hold={"gamma": 0.01})},
        "start": {"condition": ALPHA_FREE, "start": point},
        "limits": {"condition": LIMITED},
    }
    stream_sweep(_plan(published_aircraft), tmp_path / "a.zarr")
    with pytest.raises(BadInputError, match="another sweep"):
        stream_sweep(_plan(published_aircraft, **other[change]), tmp_path / "a.zarr", resume=True)
