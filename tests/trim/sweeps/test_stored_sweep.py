"""A sweep in a store: what its columns are called."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray
import zarr

from hfa_model import INPUTS, STATE_UNITS, STATES, Parameters
from trim import SweepPlan, stream_sweep
from trim.sweeps.stored_sweep import status_counts


def test_a_store_names_its_columns(tmp_path: Path, parameters: Parameters) -> None:
    axes = {"dihedral": (0.0, 0.1), "speed": (60.0, 68.0)}
    store = stream_sweep(SweepPlan(axes, parameters, "published"), tmp_path / "a.zarr")
    assert status_counts(store, 4) == {"missing": 0, "trimmed": 4, "beyond limits": 0, "no trim": 0}
    attributes = dict(zarr.open_group(str(tmp_path / "a.zarr"), mode="r").attrs)
    assert attributes["schema"] == "hfa.sweep-store/1"
    assert attributes["variables"] == ["dihedral", "speed"]
    assert attributes["variable_units"] == ["rad", "ft/s"]
    assert attributes["state_units"][0] == "ft/s"
    assert attributes["status"] == ["trimmed", "beyond limits", "no trim"]


def test_xarray_reads_names_and_units(tmp_path: Path, parameters: Parameters) -> None:
    axes = {"dihedral": (0.0, 0.1), "speed": (60.0, 68.0)}
    store = stream_sweep(SweepPlan(axes, parameters, "published"), tmp_path / "a.zarr")
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
