"""Files written by `hfa`: precision, names, units, schema, reproducible bytes, and reports."""

import contextlib
import json
import time

import pytest
from cli import hfa

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
