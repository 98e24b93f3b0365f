"""Files written by `hfa`: precision, names, units, schema, reproducible bytes, and reports."""

import contextlib
import json
import time

import numpy as np
import pytest
from cli import hfa
from json_places import leaves

from hfa.main import DONE
from hfa_model import STATES

#: Name -> command. In "failing", the aircraft has no trim at 20 ft/s.
COMMANDS = {
    "linearize": ("linearize", "--dihedral", "11.1"),
    "full": (
        "linearize",
        "--dihedral",
        "11.1",
        "--states",
        ",".join(STATES),
        "--dynamics",
        "newton",
    ),
    "failing": ("sweep", "--dihedral", "0", "--hold", "speed=20,68"),
    "plane": ("sweep", "--dihedral", "0:20:10", "--hold", "speed=66,70"),
    "trim": ("trim", "--dihedral", "11.1"),
}


def written(folder, name, suffix):
    """Run a command with -o and --json, and return the path of the file, and the printed JSON data.

    The function asserts that the command writes no other file.

    name: key of COMMANDS
    """
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.{suffix}"
    with contextlib.chdir(folder):  # outputs contain the command
        result = hfa(*COMMANDS[name], "--json", "-o", path.name)
    assert result.code == DONE
    assert [entry.name for entry in folder.iterdir()] == [path.name], (
        "nothing else, and no temporary file"
    )
    return path, json.loads(result.out)


def numbers(data):
    """Return all numbers in nested JSON data, in order. null becomes nan, true 1 and false 0."""
    return [
        np.nan if value is None else float(value)
        for _, value in leaves(data)
        if not isinstance(value, str)
    ]


def without_inf(values):
    """Return numbers with nan in place of inf, for which JSON has no number."""
    return np.where(np.isinf(values), np.nan, values)


def texts(data):
    """Return all texts in nested JSON data, in order."""
    return [value for _, value in leaves(data) if isinstance(value, str)]


@pytest.mark.parametrize("name", COMMANDS)
def test_npz_files_contain_every_number_and_name(tmp_path, name):
    """A .npz file contains exactly the numbers and texts of the JSON, and no pickled object.

    name: key of `COMMANDS`
    """
    path, data = written(tmp_path, name, "npz")
    assert data["schema"].startswith("hfa.")
    with np.load(path, allow_pickle=False) as archive:
        arrays = {key: archive[key] for key in archive}
    assert str(arrays["schema"]) == data["schema"]
    values = [
        value
        for array in arrays.values()
        if array.dtype.kind in "fib"  # float, integer and boolean
        for value in array.ravel().tolist()
    ]
    np.testing.assert_array_equal(without_inf(values), numbers(data))
    words = [
        value
        for array in arrays.values()
        if array.dtype.kind == "U"
        for value in array.ravel().tolist()
    ]
    assert words == texts(data)


@pytest.mark.parametrize(
    ("name", "suffix"),
    [("linearize", "json"), ("full", "npz"), ("failing", "mat"), ("trim", "csv")],
)
def test_two_runs_write_the_same_bytes(tmp_path, monkeypatch, name, suffix):
    """Two runs at different times write equal bytes, because files contain no time of writing.

    name: key of `COMMANDS`
    """
    first, data = written(tmp_path / "first", name, suffix)
    # The second run is on another day. Files must not contain the time of writing.
    monkeypatch.setattr(time, "asctime", lambda *_: "Thu Jan  1 00:00:00 1970")
    monkeypatch.setattr(time, "time", lambda: 0.0)
    second, again = written(tmp_path / "second", name, suffix)
    assert again == data
    assert second.read_bytes() == first.read_bytes()
