"""Stores in metric units."""

import numpy as np
import pytest
from cli import assert_refused, hfa

from hfa.main import BAD_INPUT

FOOT = 0.3048


@pytest.mark.slow
def test_stores_in_si_and_english_units_agree(folder):
    """A store in metric units has the converted states of one in English units, and is not resumed
    in these.
    """
    zarr = pytest.importorskip("zarr")
    sweep, stores = ("sweep", "--dihedral", "5,15"), {}
    for system, units in {"english": (), "si": ("--units", "si")}.items():
        result = hfa(*sweep, *units, "-o", f"{system}.zarr")
        assert result.code == 0, result.err
        stores[system] = zarr.open_group(f"{system}.zarr", mode="r")
    assert stores["si"].attrs["state_units"][:3] == ["m/s", "rad", "m"]
    feet, metres = (np.asarray(store["states"])[:, :3] for store in stores.values())
    np.testing.assert_allclose(metres, feet * [FOOT, 1.0, FOOT], rtol=1e-9)
    continued = hfa(*sweep, "--resume", "-o", "si.zarr")
    assert_refused(continued, BAD_INPUT, "is the store of another")
