"""What results of trims and sweeps are exported to: data frames, arrays and tables."""

import sys

import numpy as np
import pytest

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
