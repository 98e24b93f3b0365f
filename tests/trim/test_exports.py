"""What results of trims and sweeps are exported to: data frames, arrays and tables."""

import csv
import math
import sys
from pathlib import Path

import numpy as np
import pytest
from cli import hfa as command
from project import ROOT

import hfa
from hfa import BadInputError
from hfa.paper import level_flight


@pytest.fixture(scope="module")
def point():
    return hfa.trim(hfa.aircraft(), level_flight(0.17))


EXPORTS = {
    "sweep to pandas": lambda point: hfa.sweep(point.model, dihedral=[0.1, 0.2]).to_pandas(),
    "sweep to xarray": lambda point: hfa.sweep(point.model, dihedral=[0.1, 0.2]).to_xarray(),
    "point to pandas": lambda point: point.to_pandas(),
    "modes to pandas": lambda point: point.modes.to_pandas(),
    "flight to pandas": lambda point: hfa.fly(point.model, point, None, duration=0.01).to_pandas(),
    "a sheet by reportlab": lambda point: point.save("sheet.pdf"),
}


@pytest.mark.parametrize("name", EXPORTS)
def test_a_missing_package_is_named(name, point, monkeypatch):
    """An export without its package is refused in one line with the command that installs it."""
    package = name.split()[-1]
    monkeypatch.setitem(sys.modules, package, None)  # its import then fails
    with pytest.raises(BadInputError) as caught:
        EXPORTS[name](point)
    assert str(caught.value).endswith(f"python -m pip install {package}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("file", "variable", "value"),
    [("", "dihedral", 10.0), ("uav.toml", "speed", 30.0), ("navion.py:NAVION", "speed", 176.0)],
)
def test_rows_of_a_sheet_are_those_of_its_data_and_csv_files(file, variable, value, folder):
    """Each row of a sheet is in its data, with value, unit and level, and in the CSV file of a list of
    conditions, with angles in degrees.

    Each entry that is compared is removed, so that at the end nothing may be left.
    """
    name = f"{ROOT}/examples/{file}"
    model = hfa.load_model(name) if file else hfa.aircraft()
    held = math.radians(value) if variable == "dihedral" else value
    point = hfa.trim(model, hold={variable: held})
    Path("conditions.csv").write_text(f"{variable}\n{value}\n", "utf-8")
    words = ("trim", *(("--aircraft", name) if file else ()), "--conditions", "conditions.csv")
    assert command(*words, "-o", "matrix.csv").code == 0
    (cells,) = csv.DictReader(Path("matrix.csv").read_text("utf-8").splitlines())
    data = dict(point.report().data["sheet"])
    # First the columns that are no rows: result, imposed value, and qualities of the worst level.
    assert cells.pop("results") == "trimmed"
    imposed = [each for each in cells if each.partition(" [")[0] == f"hold {variable}"]
    assert [float(cells.pop(each)) for each in imposed] == [value]
    del cells["about"]
    assert cells.pop("qualities of the worst level") == point.sheet["worst level"].note
    # Then each row; an eigenvalue has a column for its real and its imaginary part.
    for row in point.sheet:
        entry, parts = data.pop(row.name), {"": row.value}
        stored = entry["value"]
        if isinstance(row.value, complex):
            parts = {" real": row.value.real, " imaginary": row.value.imag}
            stored = complex(*stored)
        found = stored, entry["unit"], entry.get("level")
        assert found == (row.value, row.unit, row.stated_level)
        unit = row.cells()[2]  # as printed
        assert str(cells.pop(f"{row.name} level", None)) == str(row.stated_level)
        for part, number in parts.items():
            cell = cells.pop(f"{row.name}{part} [{unit}]" if unit else row.name + part)
            if isinstance(number, str):
                assert cell == number
            else:
                shown = math.degrees(number) if "deg" in unit != row.unit else number
                assert float(cell) == pytest.approx(shown, rel=1e-12, abs=1e-13)
    assert (data, cells) == ({}, {})


def test_a_sweep_in_netcdf_is_read_back(point, tmp_path):
    """A .nc file contains each array of numbers of the sweep, complex ones as two parts, with the
    attributes of A and the names of the states.
    """
    xarray = pytest.importorskip("xarray")
    swept = hfa.sweep(point.model, dihedral=[0.1, 0.2])
    swept.save(tmp_path / "sweep.nc")
    read = xarray.load_dataset(tmp_path / "sweep.nc", engine="scipy")
    in_memory = swept.to_xarray()
    for name, array in in_memory.items():
        stored = (
            read[f"{name}_real"] + 1j * read[f"{name}_imag"] if name not in read else read[name]
        )
        assert np.array_equal(stored, array), name
    assert read["A"].attrs == in_memory["A"].attrs
    assert list(read["state"].values) == list(in_memory["state"].values)
