"""A sweep in a store: what its columns are called."""

from __future__ import annotations

from pathlib import Path

import zarr

from hfa_model.parameters import Parameters
from trim.sweeps.stored_sweep import stream_sweep
from trim.sweeps.sweep_plan import SweepPlan


def test_a_store_names_its_columns(tmp_path: Path, parameters: Parameters) -> None:
    axes = {"dihedral": (0.0, 0.1), "speed": (60.0, 68.0)}
    stream_sweep(SweepPlan(axes, parameters, "published"), tmp_path / "a.zarr")
    attributes = dict(zarr.open_group(str(tmp_path / "a.zarr"), mode="r").attrs)
    assert attributes["schema"] == "hfa.sweep-store/1"
    assert attributes["variables"] == ["dihedral", "speed"]
    assert attributes["variable_units"] == ["rad", "ft/s"]
    assert attributes["state_units"][0] == "ft/s"
    assert attributes["status"] == ["trimmed", "beyond limits", "no trim"]
