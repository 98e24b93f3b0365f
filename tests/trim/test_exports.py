"""What results of trims and sweeps are exported to: data frames, arrays and tables."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hfa
from hfa import BadInputError
from hfa.paper import level_flight


@pytest.fixture(scope="module")
def point() -> hfa.OperatingPoint:
    return hfa.trim(hfa.aircraft(), level_flight(0.17))


EXPORTS: dict[str, Callable[[Any], Any]] = {
    "sweep to pandas": lambda point: hfa.sweep(point.model, dihedral=[0.1, 0.2]).to_pandas(),
    "sweep to xarray": lambda point: hfa.sweep(point.model, dihedral=[0.1, 0.2]).to_xarray(),
    "point to pandas": lambda point: point.to_pandas(),
    "point to xarray": lambda point: point.to_xarray(),
    "linear model to pandas": lambda point: point.linearize().to_pandas(),
    "modes to pandas": lambda point: point.modes.to_pandas(),
    "flight to pandas": lambda point: hfa.fly(point.model, point, None, duration=0.01).to_pandas(),
    "flight to xarray": lambda point: hfa.fly(point.model, point, None, duration=0.01).to_xarray(),
}


@pytest.mark.parametrize("name", EXPORTS)
def test_a_missing_package_is_named(
    name: str, point: hfa.OperatingPoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without pandas or xarray an export is refused in one line with the command that installs it."""
    package = name.split()[-1]
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(BadInputError) as caught:
        EXPORTS[name](point)
    assert str(caught.value).endswith(f"python -m pip install {package}")
    assert "\n" not in str(caught.value)


def test_records_of_a_sheet_contain_its_figures(point: hfa.OperatingPoint) -> None:
    """The records have airspeed, load factor, L/D, margins and modes, as the sheet has."""
    report = point.report()
    found = {name: value for _, name, value, *_ in report.records.rows}
    for name in ("calibrated airspeed", "load factor", "L/D", "static margin"):
        assert found[name] == report.data["sheet"][name]["value"] == point.sheet[name].value
    assert found["throttle margin"] == min(point["throttle"], 200.0 - point["throttle"])
    for mode in point.modes:
        assert found[f"{mode.name} eigenvalue real"] == mode.eigenvalue.real


def test_a_report_in_latex_has_the_cells_of_its_tables(
    point: hfa.OperatingPoint, tmp_path: Path
) -> None:
    """A .tex file has a booktabs table with each value of the printed modes, and escapes names."""
    pytest.importorskip("pandas")
    file = tmp_path / "sheet.tex"
    point.report().save(file)
    text = file.read_text("utf-8")
    assert text.count(r"\toprule") == text.count(r"\bottomrule") == text.count(r"\begin{tabular}")
    assert r"pitch\_rate" in text
    assert "pitch_rate" not in text
    for mode in point.modes:
        assert f"{mode.eigenvalue.real:.4f}" in text


def test_a_sweep_in_netcdf_is_read_back(point: hfa.OperatingPoint, tmp_path: Path) -> None:
    """A .nc file contains each array of the sweep, and the parts of its complex eigenvalues."""
    xarray = pytest.importorskip("xarray")
    swept = hfa.sweep(point.model, dihedral=[0.1, 0.2])
    swept.save(tmp_path / "sweep.nc")
    read = xarray.load_dataset(tmp_path / "sweep.nc", engine="scipy")
    held = swept.to_xarray()
    assert np.array_equal(read["A"], held["A"])
    assert np.array_equal(
        read["eigenvalues_real"] + 1j * read["eigenvalues_imag"], held["eigenvalues"]
    )
    assert read["A"].attrs == held["A"].attrs
    assert list(read["state"].values) == list(held["state"].values)
