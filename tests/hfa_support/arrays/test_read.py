"""Files of matrices. Every format gives the same mapping, and a faulty file is refused in one
line.
"""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from scipy.sparse import csc_array, issparse

from hfa import BadInputError
from hfa_support.arrays import mat_file
from hfa_support.arrays.read import read_arrays

pytestmark = pytest.mark.usefixtures("folder")

NUMBERS = 10 * np.random.default_rng(0).normal(size=(4, 4))
PLAIN = {"full": NUMBERS, "complex": NUMBERS + 1j, "text": "wing"}
#: Entries that `hfa linearize -o` writes in addition to its matrices, and entries that are omitted.
TREES = {
    "sparse": csc_array(NUMBERS * (NUMBERS > 0)),
    "short": NUMBERS.astype("i2"),
    "names": np.array(["speed", "", "pitch rate"], dtype=object),
    "deep": {"block": {"text": "x", "names": np.array(["a"], dtype=object)}, "count": 3.0},
    "mixed": np.array(["a", 3.0], dtype=object),
    "many": np.array([(1.0,), (2.0,)], dtype=[("a", object)]),
}
#: Files written by MATLAB 4 to 7.4 on several machines, if the installed SciPy contains them.
FILES = sorted(
    (Path(scipy.io.__file__).parent / "matlab" / "tests" / "data").glob("test*_7.4_GLNX86.mat")
)[:1]


def mat(form: str = "5", **content: Any) -> bytes:
    stream = io.BytesIO()
    scipy.io.savemat(stream, content, format=form, do_compression=form == "5" and "text" in content)
    return stream.getvalue()


def read(content: bytes | str, name: str = "a.mat") -> dict[str, Any]:
    Path(name).write_bytes(content.encode() if isinstance(content, str) else content)
    return read_arrays(name)


@pytest.mark.parametrize("content", [path.read_bytes() for path in FILES])
def test_numbers_and_texts_equal_those_of_loadmat(content: bytes) -> None:
    """The .mat reader returns the same numbers and texts as SciPy's loadmat."""
    arrays = read(content)
    for name, value in scipy.io.loadmat(io.BytesIO(content)).items():
        expected = value.toarray() if issparse(value) else value
        if not name.startswith("__") and expected.dtype.kind in "iufcU":
            np.testing.assert_array_equal(arrays[name], expected)


def test_a_damaged_file_is_refused_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Damaged .mat files are refused in one line, also if the reading process crashes or hangs."""
    whole = mat(**{**TREES, "full": NUMBERS})
    with pytest.raises(BadInputError, match=r"^a.mat cannot be read as .mat \([^\n]*$"):
        read(whole[:-9])
    # No small file crashes or stalls the installed SciPy.
    monkeypatch.setattr(mat_file, "_CHILD", Path("child.py"))
    for code, longest, said in (
        ("import os; os.abort()", 60.0, "SciPy crashes on it"),
        ("while True: pass", 0.2, "longer than 0.2 s"),
    ):
        Path("child.py").write_text(code, encoding="utf-8")
        monkeypatch.setattr(mat_file, "_LONGEST", longest)
        with pytest.raises(BadInputError, match=f"^a.mat cannot be read as .mat .*{said}"):
            read(whole)


@pytest.mark.slow
def test_a_small_file_does_not_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files whose content exceeds the size limit are refused before they are unpacked."""
    header = b"MATLAB 5.0".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    bomb = zlib.compress(mat(A=np.zeros(2_000_000))[128:])
    # Reaching the real limit would take a file of hundreds of megabytes.
    monkeypatch.setattr(mat_file, "LARGEST", 1 << 23)
    sparse = struct.pack("<5i", 2, 1, 3, 0, 2) + b"A\0" + np.array([1e9, 1e9, 0]).tobytes()
    with pytest.raises(BadInputError, match=r"cannot be read as .mat .*unpacks to more than 8 MiB"):
        read(header + struct.pack("<II", 15, len(bomb)) + bomb)
    with pytest.raises(BadInputError, match=r"cannot be read as .mat"):
        read(sparse)


# .csv

A = np.array([[0.0, 1.0], [-2.0, -3.0]])
B = np.array([[0.5], [1.0]])
BARE = "0,1\n-2,-3\n", ".5\n1e0\n"
NAMED = (
    ",speed [ft/s],alpha [rad]\nspeed [ft/s],0,1\nalpha [rad],-2,-3\n",
    ",push\nspeed,0.5\nalpha,1\n",
)
HEADED = "speed,alpha\n0,1\n-2,-3\n", '"push"\n0.5\n1\n'
NAMES = {"states": ["speed", "alpha"], "inputs": ["push"]}


def of(**texts: str) -> dict[str, Any]:
    for name, text in texts.items():
        Path(f"{name}.csv").write_text(text, encoding="utf-8")
    return read_arrays(f"{next(iter(texts))}.csv")


@pytest.mark.parametrize(
    ("texts", "names"),
    [
        ({"A": BARE[0], "B": BARE[1]}, {}),
        ({"A": "\ufeff" + BARE[0], "B": BARE[1]}, {}),
        ({"A": NAMED[0], "B": NAMED[1]}, {**NAMES, "state_units": ["ft/s", "rad"]}),
        ({"A": HEADED[0], "B": HEADED[1]}, NAMES),
    ],
)
def test_csv_matrices_are_read_with_optional_names(
    texts: dict[str, str], names: dict[str, list[str]]
) -> None:
    """A and B are read from .csv files with or without names of rows and columns."""
    arrays = of(**texts)
    np.testing.assert_array_equal(arrays.pop("A"), A)
    np.testing.assert_array_equal(arrays.pop("B"), B)
    assert {key: value for key, value in arrays.items() if value} == names


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        ({"A": "0,1\n-2\n"}, "A has rows of 1 and of 2 cells"),
        ({"A": "x,y,z\n0,1\n-2,-3\n"}, "A has rows of 2 and of 3 cells"),
        ({"A": "0,1\n-2,x\n"}, "could not convert string to float: 'x'"),
        ({"A": "0;1\n-2;-3\n"}, "could not convert string to float: '-2;-3'"),
        (
            {"A": ",x,y\ny,-2,-3\nx,0,1\n"},
            "the columns of A are x, y, but A has y, x; use A's order",
        ),
        (
            {"A": NAMED[0], "B": ",push\nalpha,1\nspeed,0.5\n"},
            "the rows of B are alpha, speed, but A has speed, alpha",
        ),
        ({"plant": BARE[0]}, "use .json, .npz or .mat"),
        ({"A": ""}, "A has no numbers"),
    ],
)
def test_csv_files_without_a_matrix_are_refused(texts: dict[str, str], said: str) -> None:
    """.csv files that do not contain a matrix are refused, and the message states the reason."""
    with pytest.raises(BadInputError, match=said):
        of(**texts)


class RunsCode:
    """An object whose pickle writes the file "ran" when it is loaded."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (Path("ran"),)


@pytest.mark.parametrize("name", ["K.npy", "other.npy", "K.npz"])
def test_a_file_of_arrays_runs_no_code(name: str) -> None:
    """A pickled object in a .npy or .npz file is refused and not loaded."""
    held = np.array([RunsCode()], dtype=object)
    save = np.savez if name.endswith("z") else np.save
    save(name, held, allow_pickle=True)
    with pytest.raises(BadInputError, match=name):
        read_arrays(name)
    assert not Path("ran").exists()
