"""Files that are read: regular, of limited size, never overwritten. Files are written whole."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import assert_refused, hfa as run
from game_files import small, stored
from project import ROOT

import hfa

pytestmark = pytest.mark.usefixtures("folder")
AT_15 = "--dihedral 15"
#: Content of a file, or a fault -> commands that name the file.
UNREADABLE: dict[str, Any] = {
    "fifo": os.mkfifo,
    "larger than 256 MiB": lambda path: os.truncate(
        os.open(path, os.O_CREAT | os.O_RDWR), 2**28 + 1
    ),
    "a folder": os.mkdir,
    "missing": lambda path: None,
    "nested": lambda path: Path(path).write_bytes(b"[" * 100_000),
    "long number": lambda path: Path(path).write_bytes(b"9" * 5000),
    "many dots": lambda path: Path(path).write_bytes(b"a" + b".a" * 40_000 + b" = 1"),
    "a device": lambda path: os.symlink("/dev/zero", path),
    "not UTF-8": lambda path: Path(path).write_bytes(b"\xff\xfe\xff"),
}


@pytest.mark.parametrize("fault", UNREADABLE)
@pytest.mark.parametrize(
    "words", [f"trim {AT_15} --parameters a.toml", f"verify {AT_15} --weights a.json"]
)
def test_an_unreadable_file_is_refused(fault: str, words: str) -> None:
    """FIFOs, folders, large, missing and damaged files are refused in one line, without blocking."""
    name = words.split()[-1]
    UNREADABLE[fault](name)
    # Such a file of weights is refused before it is read.
    said = [fault] if "MiB" in fault and words.startswith("verify") else []
    assert_refused(run(*words.split()), 2, name, *said)


def test_a_full_disk_is_told_with_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """An output that the disk cannot hold is refused by its name, and nothing remains."""

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "replace", full)
    assert_refused(run("trim", *AT_15.split(), "-o", "trim.json"), 2, "trim.json")
    assert os.listdir() == []


@pytest.mark.parametrize(
    ("words", "kept"),
    [
        ("solve --model A.csv --Q 1,1 --R 1 --delta inf -o B.csv", "B.csv"),
        ("solve --model link.csv --Q 1,1 --R 1 --delta inf -o ./A.csv", "A.csv"),
        ("solve --model A.csv --Q 1,1 --R 1 --delta inf -o link.csv", "A.csv"),
        ("verify --model plant.json --weights a.json -o a.json", "a.json"),
        ("trim --aircraft navion.py:NAVION --picture navion.py", "navion.py"),
        ("solve --model=plant.json --output=plant.json", "plant.json"),
        (f"trim {AT_15} -o plant.json --picture=./plant.json", "plant.json"),
        (f"trim {AT_15} -o fifo.json", "plant.json"),
    ],
)
def test_an_output_replaces_no_input(words: str, kept: str) -> None:
    """An output that is an input of the run, another output or no regular file is refused."""
    np.savetxt("A.csv", [[0.0, 1.0], [-1.0, -1.0]], delimiter=",")
    np.savetxt("B.csv", [[0.0], [1.0]], delimiter=",")
    Path("link.csv").symlink_to("A.csv")
    os.mkfifo("fifo.json")
    small("plant.json")
    stored("a.json", W=np.ones(3))
    shutil.copy(ROOT / "examples" / "navion.py", ".")
    before = Path(kept).read_bytes()
    names = set(Path().iterdir())
    assert_refused(run(*words.split()), 2)
    assert (Path(kept).read_bytes(), set(Path().iterdir())) == (before, names)


def test_an_interrupted_write_keeps_the_old_file(monkeypatch: pytest.MonkeyPatch) -> None:
    """If writing is interrupted, the old file remains, and no temporary file is left."""
    game = hfa.Game([[1.0]], [[1.0]], Q=[1.0], R=[1.0])
    hfa.solve(game).save("kept.npz")
    before = Path("kept.npz").read_bytes()

    def broken(stream: Any, **arrays: Any) -> None:
        stream.write(b"half")
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(np, "savez", broken)  # Ctrl-C, which a test cannot send at this time
        with pytest.raises(KeyboardInterrupt):
            hfa.solve(game).save("kept.npz")
    assert Path("kept.npz").read_bytes() == before
    assert [entry.name for entry in Path().iterdir()] == ["kept.npz"]
    Path("kept.npz").chmod(0o640)
    hfa.solve(game).save("kept.npz")
    assert Path("kept.npz").stat().st_mode & 0o777 == 0o640
    with pytest.raises(hfa.BadInputError, match="choose a writable folder"):
        hfa.solve(game).save("no/state.npz")
