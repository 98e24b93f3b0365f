"""A sweep in a store: what it visits, what its columns are called, under which condition it is continued."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from hfa_model import DEGREE, INPUTS, STATES, Aircraft, Parameters
from hfa_model.vectors import LINEAR_ROWS, STATE_UNITS
from hfa_support import BadInputError
from trim import find_operating_point, level_flight, release, sweep
from trim.point.condition import LEVEL_FLIGHT
from trim.sweeps.sweep_plan import Steps, SweepPlan
from trim.sweeps.sweep_store import stored_sweep_report, stream_sweep

ALPHA_FREE = release(LEVEL_FLIGHT, free=("alpha",), hold={"aileron_outer": 0.0})
LIMITED = release(LEVEL_FLIGHT, limits={"throttle": (0.0, 40.0)})


def test_a_store_has_names_and_units(tmp_path: Path, parameters: Parameters) -> None:
    import xarray

    plan = SweepPlan({"dihedral": (0.0, 0.1), "speed": (60.0, 68.0)}, Aircraft(parameters))
    store = stream_sweep(plan, tmp_path / "a.zarr")
    counts = stored_sweep_report(plan, store, tmp_path).data["counts"]
    assert counts == {"missing": 0, "trimmed": 4, "beyond limits": 0, "no trim": 0}
    attributes = dict(zarr.open_group(str(tmp_path / "a.zarr"), mode="r").attrs)
    assert (attributes["schema"], attributes["state_units"][0]) == ("hfa.sweep-store/1", "ft/s")
    assert (attributes["variables"], attributes["variable_units"]) == (["dihedral", "speed"], ["rad", "ft/s"])
    assert attributes["status"] == ["trimmed", "beyond limits", "no trim"]
    read = xarray.open_zarr(tmp_path / "a.zarr", consolidated=False).load()
    assert read.A.dims == ("point", "rate", "state")
    assert read.eigenvalues.dims == ("point", "mode")
    assert (read.dihedral.dims, read.dihedral.attrs["units"], read.speed.attrs["units"]) == (("point",), "rad", "ft/s")
    assert {"dihedral", "speed", "state_unit", "rate_unit", "input_unit"} <= set(read.coords)
    assert [str(name) for name in read.input.values] == list(INPUTS)
    assert [str(unit) for unit in read.state_unit.values] == list(STATE_UNITS)
    pushed = read.B.sel(rate="pitch_rate", input="elevator_center")
    np.testing.assert_array_equal(
        pushed, store.read("B")[:, STATES.index("pitch_rate"), INPUTS.index("elevator_center")]
    )
    fast = read.where(read.speed == 68.0, drop=True)
    np.testing.assert_allclose(fast.dihedral, [0.0, 0.1])
    np.testing.assert_allclose(fast.states.sel(state="speed"), 68.0)
    assert read.states.attrs == {"long_name": "X0", "units_of": "state_unit"}
    assert read.status.attrs["flag_meanings"].split() == ["trimmed", "beyond_limits", "no_trim"]
    assert {read[name].dims[0] for name in read.attrs["arrays"]} == {"point"}


def test_a_plan_gives_any_slice_of_the_whole(parameters: Parameters) -> None:
    dihedrals = tuple(np.radians(np.linspace(0, 20, 7)).tolist())
    axes = {"dihedral": dihedrals, "speed": (25.0, 60.0, 68.0, 75.0)}
    plan = SweepPlan(axes, Aircraft(parameters))
    whole = plan.values(0, plan.count)
    assert plan.count == 28
    assert np.array_equal(whole[10:13], plan.values(10, 13))
    assert np.array_equal(whole[:4, 1], [25.0, 60.0, 68.0, 75.0])


def test_a_range_too_long_or_too_far_is_refused(parameters: Parameters) -> None:
    with pytest.raises(BadInputError, match=r"dihedral is 80\.2\d* deg; it must lie between -60 deg and 60 deg"):
        SweepPlan({"dihedral": Steps(0.0, 0.1, 15)}, Aircraft(parameters))
    with pytest.raises(BadInputError, match="has 1,234,570,000 points, at most 1,000,000,000"):
        SweepPlan({"dihedral": Steps(0.0, 1e-9, 123457), "speed": Steps(60.0, 1e-6, 10**4)}, Aircraft(parameters))


def test_where_a_search_begins_is_part_of_a_plan(parameters: Parameters) -> None:
    """It decides the last bits, and where there are two trims which one is found."""
    plans = [
        SweepPlan({"speed": (64.0, 68.0)}, Aircraft(parameters), condition=release(held, free=("alpha",)))
        for held in (LEVEL_FLIGHT, release(LEVEL_FLIGHT, hold={"alpha": 0.06}))
    ]
    assert plans[0] != plans[1]
    assert plans[0].condition.to_dict() == {"free": ["alpha"]}


def test_the_order_of_the_variables_is_part_of_a_plan(parameters: Parameters) -> None:
    """It is the order of the points: a store must not be continued in another."""
    axes = {"dihedral": (5 * DEGREE, 10 * DEGREE), "speed": (64.0, 68.0)}
    plans = [SweepPlan(dict(each), Aircraft(parameters)) for each in (axes.items(), reversed(axes.items()))]
    assert plans[0] != plans[1]


def _plan(aircraft: Aircraft, **more: Any) -> SweepPlan:
    axes = {"dihedral": (5 * DEGREE, 10 * DEGREE), "speed": (64.0, 68.0)}
    return SweepPlan(axes, aircraft, **more)


def test_a_store_has_the_points_of_a_sweep_in_memory(published_aircraft: Aircraft, tmp_path: Path) -> None:
    plan = _plan(published_aircraft, condition=ALPHA_FREE)
    store = stream_sweep(plan, tmp_path / "a.zarr")
    expected = sweep(published_aircraft, plan.axes, condition=ALPHA_FREE)  # type: ignore[arg-type]
    np.testing.assert_array_equal(store.read("A")[:, LINEAR_ROWS][:, :, LINEAR_ROWS], expected.A)
    attributes = dict(zarr.open_group(str(tmp_path / "a.zarr"), mode="r").attrs)
    assert attributes["grid"]["speed"] == {"values": [64.0, 68.0], "unit": "ft/s"}
    assert attributes["condition"] == ALPHA_FREE.to_dict()


@pytest.mark.parametrize("change", ["condition", "start", "limits"])
def test_a_store_is_not_continued_under_another_condition(
    published_aircraft: Aircraft, tmp_path: Path, change: str
) -> None:
    point = find_operating_point(published_aircraft, level_flight(0.1))
    other: dict[str, dict[str, Any]] = {
        "condition": {"condition": release(LEVEL_FLIGHT, hold={"gamma": 0.01})},
        "start": {"condition": ALPHA_FREE, "start": point},
        "limits": {"condition": LIMITED},
    }
    stream_sweep(_plan(published_aircraft), tmp_path / "a.zarr")
    with pytest.raises(BadInputError, match="another sweep"):
        stream_sweep(_plan(published_aircraft, **other[change]), tmp_path / "a.zarr", resume=True)
