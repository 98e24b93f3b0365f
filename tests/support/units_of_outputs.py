"""Assertions on outputs in SI units, for commands of the core and of extensions."""

import re

import numpy as np
from cli import assert_refused, hfa

from hfa.main import BAD_INPUT

FOOT = 0.3048


def assert_no_feet(*words, folder):
    """Assert that the text and the picture of a command with --units si contain no English unit.

    The texts of the picture are read from the comments that matplotlib writes into an .svg file.
    """
    picture = folder / "p.svg"
    result = hfa(*words, "--picture", str(picture), "--units", "si")
    assert result.code == 0, result.err
    drawn = re.findall(r"<!-- (.*) -->", picture.read_text("utf-8"))
    assert any(re.search(r"\bm(/s)?\b", text) for text in drawn)
    texts = [*drawn, *result.out.split("\nhfa 0.")[0].split("\n")]
    assert not [text for text in texts if re.search(r"\b(ft|slug|lbf)\b", text)]


def assert_store_in_metres(*words, folder):
    """Assert that states in SI units are converted, and that the store is not resumed in others."""
    import zarr

    stores = {}
    for system, units in {"english": (), "si": ("--units", "si")}.items():
        path = folder / f"{system}.zarr"
        result = hfa(*words, *units, "-o", str(path))
        assert result.code == 0, result.err
        stores[system] = zarr.open_group(str(path), mode="r")
    assert stores["si"].attrs["state_units"][:3] == ["m/s", "rad", "m"]
    feet, metres = (np.asarray(store["states"])[:, :3] for store in stores.values())
    np.testing.assert_allclose(metres, feet * np.array([FOOT, 1.0, FOOT]), rtol=1e-9)
    continued = hfa(*words, "--resume", "-o", str(folder / "si.zarr"))
    assert_refused(continued, BAD_INPUT, "is the store of another")
