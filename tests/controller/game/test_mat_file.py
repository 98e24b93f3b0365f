"""The reader of .mat files: the numbers of SciPy's, and no length in a damaged file is believed."""

from __future__ import annotations

import io
import struct
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from damage import damaged
from scipy.sparse import csc_array, issparse

from controller.game import mat_file
from controller.game.mat_file import read_mat

#: Files that MATLAB 4 to 7.4 wrote on several machines, where this SciPy brings them along.
FILES = sorted((Path(scipy.io.__file__).parent / "matlab" / "tests" / "data").glob("*.mat"))


def _agrees(content: bytes) -> int:
    """Number of matrices and texts that are as `loadmat` reads them; everything else is an object to both."""
    theirs = scipy.io.loadmat(io.BytesIO(content))
    ours = read_mat(content)
    count = 0
    for name, value in theirs.items():
        if name.startswith("__"):
            continue
        expected = value.toarray() if issparse(value) else value
        if expected.dtype.kind in "iufcU" and expected.size:
            np.testing.assert_array_equal(ours[name], expected)
            count += 1
        else:
            assert name in ours
    return count


def _content(rng: np.random.Generator, form: str) -> dict[str, Any]:
    numbers = 10 * rng.normal(size=rng.integers(1, 6, 2))
    common = {"full": numbers, "complex": numbers + 1j, "text": "wing"[: rng.integers(1, 5)]}
    more = {"sparse": csc_array(numbers * (numbers > 0)), "short": numbers.astype("i2"), "single": numbers.astype("f4")}
    return common if form == "4" else common | more | {"flags": numbers > 0, "tree": {"A": numbers}} | _TREES


#: What `hfa linearize -o` writes beside its matrices, and what is not looked at.
_TREES = {
    "names": np.array(["speed", "", "pitch rate"], dtype=object),
    "deep": {"block": {"text": "x", "empty": "", "names": np.array(["a"], dtype=object)}, "count": 3.0},
    "mixed": np.array(["a", 3.0], dtype=object),
    "tall": np.array([np.array(["ab", "cd"]), "e"], dtype=object),
    "many": np.array([(1.0,), (2.0,)], dtype=[("a", object)]),
}


@pytest.mark.parametrize(("form", "packed"), [("4", False), ("5", False), ("5", True)])
def test_what_scipy_writes(form: str, packed: bool) -> None:
    for seed in range(30):
        stream = io.BytesIO()
        scipy.io.savemat(stream, _content(np.random.default_rng(seed), form), format=form, do_compression=packed)
        assert _agrees(stream.getvalue()) == (3 if form == "4" else 7)


@pytest.mark.parametrize("packed", [False, True])
def test_cells_of_text_and_structures(packed: bool) -> None:
    stream = io.BytesIO()
    scipy.io.savemat(stream, _TREES, do_compression=packed)
    found = read_mat(stream.getvalue())
    assert found["names"].tolist() == ["speed", "", "pitch rate"]
    block = found["deep"]["block"]
    assert (block["text"].tolist(), block["names"].tolist(), block["empty"].size) == (["x"], ["a"], 0)
    assert found["deep"]["count"] == 3.0
    assert {found[name].dtype.kind for name in ("mixed", "tall", "many")} == {"O"}


def test_structures_within_structures_end_somewhere() -> None:
    tree: dict[str, Any] = {"leaf": 1.0}
    for _ in range(30):
        tree = {"next": tree}
    stream = io.BytesIO()
    scipy.io.savemat(stream, {"tree": tree})
    found, depth = read_mat(stream.getvalue())["tree"], 0
    while isinstance(found, dict):
        found, depth = found["next"], depth + 1
    assert (depth, found.dtype.kind) == (8, "O")


@pytest.mark.skipif(not FILES, reason="this SciPy comes without its test files")
def test_what_matlab_writes() -> None:
    agreed = 0
    for path in FILES:
        content = path.read_bytes()
        try:
            scipy.io.loadmat(io.BytesIO(content))
        except (ValueError, NotImplementedError, zlib.error):
            continue  # damaged on purpose
        agreed += _agrees(content)
    assert agreed > 40


@pytest.mark.parametrize("form", ["4", "5"])
def test_a_damaged_file_is_an_error_and_nothing_worse(form: str) -> None:
    """On one in thirty of such files `loadmat` ends the process."""
    stream = io.BytesIO()
    scipy.io.savemat(stream, _content(np.random.default_rng(0), form), format=form)
    refused = 0
    for seed in range(500):
        try:
            read_mat(damaged(stream.getvalue(), np.random.default_rng(seed)))
        except (ValueError, NotImplementedError):
            refused += 1
    assert refused > 200


def test_a_small_file_does_not_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    header = b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    bomb = zlib.compress(bytes(10_000_000))
    monkeypatch.setattr(mat_file, "LARGEST", 1 << 20)
    with pytest.raises(ValueError, match="unpacks to more than 1 MiB"):
        read_mat(header + struct.pack("<II", 15, len(bomb)) + bomb)
    sparse = struct.pack("<5i", 2, 1, 3, 0, 2) + b"A\0" + np.array([1e9, 1e9, 0]).tobytes()
    with pytest.raises(ValueError, match="1000000000 x 1000000000 entries"):
        read_mat(sparse)


@pytest.mark.parametrize("rows", [2**31 - 1, 2**20])
def test_rows_of_text_without_columns_are_not_made(rows: int) -> None:
    begin = time.process_time()
    (found,) = read_mat(struct.pack("<5i", 1, rows, 0, 0, 2) + b"A\0").values()
    assert found.shape == (1, 1)
    assert time.process_time() - begin < 0.1


def test_text_of_millions_of_letters_is_not_read() -> None:
    stream = io.BytesIO()
    scipy.io.savemat(stream, {"A": np.eye(2), "B": "long " * 10**6}, do_compression=True)
    found = read_mat(stream.getvalue())
    assert found["B"].shape == (1, 1)
    np.testing.assert_array_equal(found["A"], np.eye(2))
