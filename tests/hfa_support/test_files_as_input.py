"""Input files that are not regular, too large, or not valid text are refused."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from cli import assert_refused, hfa

from hfa import BadInputError
from hfa_support.files import LARGEST, read_json, read_toml


@pytest.mark.parametrize("read", [read_json, read_toml])
def test_a_fifo_and_a_device_are_refused(tmp_path: Path, read) -> None:
    """FIFOs and devices are refused immediately, without reading them."""
    os.mkfifo(tmp_path / "fifo")
    for path in (tmp_path / "fifo", "/dev/zero"):
        with pytest.raises(OSError, match="not a regular file"):
            read(path)


@pytest.mark.parametrize(
    "words",
    [
        "trim --dihedral 15 --parameters",
        "solve --model",
        "verify --dihedral 15 --weights",
    ],
)
def test_every_command_refuses_a_fifo(folder: Path, words: str) -> None:
    """A command refuses a FIFO as input and does not block."""
    os.mkfifo("fifo.json")
    assert_refused(hfa(*words.split(), "fifo.json"), 2, "fifo")


@pytest.mark.parametrize(
    "words",
    [
        "trim --dihedral 15 -o a.json",
        "linearize --dihedral 15 --picture a.png",
    ],
)
def test_no_result_replaces_a_fifo(folder: Path, words: str) -> None:
    """A command refuses a FIFO as output file and leaves it in place."""
    fifo = folder / words.split()[-1]
    os.mkfifo(fifo)
    assert_refused(hfa(*words.split()), 2, "is not a regular file; choose another")
    assert list(folder.iterdir()) == [fifo]
    assert fifo.is_fifo()


def test_a_large_file_is_refused_before_reading(tmp_path: Path) -> None:
    """A file of more than 256 MiB is refused before it is read."""
    with (tmp_path / "large.json").open("wb") as file:
        file.truncate(LARGEST + 1)
    with pytest.raises(OSError, match="larger than 256 MiB"):
        read_json(tmp_path / "large.json")


def test_an_archive_above_the_size_limit_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An archive is refused if its unpacked size exceeds the limit."""
    import numpy as np

    from hfa_support.arrays import read as array_file

    np.savez_compressed(tmp_path / "plant.npz", A=np.zeros(1_000_000))
    # The real limit would need a file of hundreds of megabytes.
    monkeypatch.setattr(array_file, "LARGEST", 1 << 20)
    with pytest.raises(BadInputError, match="unpacks to more than 1 MiB"):
        array_file.read_arrays(tmp_path / "plant.npz")


@pytest.mark.parametrize(
    ("content", "said"), [(b"[" * 100_000, ""), (b"9" * 5000, "digits"), (b"\xff\xfe\xff", "")]
)
def test_unparsable_text_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    """JSON and TOML files that are nested too deeply or not UTF-8 are refused."""
    path = tmp_path / "a.json"
    path.write_bytes(content)
    with pytest.raises(BadInputError, match=f"is not JSON .*{said}"):
        read_json(path)
    path.write_bytes(b"x = " + content)
    with pytest.raises(BadInputError, match=f"is not a TOML file .*{said}"):
        read_toml(path)
