"""Files of matrices. Every format gives the same mapping, and a faulty file is refused in one
line.
"""

from pathlib import Path

import numpy as np
import pytest
import scipy.io

import hfa
from controller import load_game
from hfa import BadInputError

pytestmark = pytest.mark.usefixtures("folder")

#: A game of two states and two inputs, for which a file gives a critic K of 2 x 2.
GAME = hfa.Game([[0.0, 1.0], [-2.0, -3.0]], np.eye(2), Q=np.eye(2), R=np.eye(2))


def half_of(content):
    return content[: len(content) // 2]


def with_wrong_type(content):
    """Return a .mat file whose numbers have the tag of a matrix, on which SciPy 1.17 crashes."""
    return content[:176] + b"\x0e" + content[177:]


@pytest.mark.parametrize(
    ("compressed", "damaged"),
    [
        (False, with_wrong_type),
        (False, half_of),
        (True, half_of),
    ],
)
def test_a_damaged_mat_file_is_refused_in_one_line(compressed, damaged):
    """A .mat file with a wrong tag, on which SciPy crashes, or of which half is missing, is refused.
    The undamaged file gives its matrix.
    """
    K = np.arange(4.0).reshape(2, 2)
    scipy.io.savemat("K.mat", {"K": K, "text": "wing"}, do_compression=compressed)
    assert np.array_equal(hfa.read_critic("K.mat", GAME).K, K)
    Path("a.mat").write_bytes(damaged(Path("K.mat").read_bytes()))
    with pytest.raises(BadInputError, match=r"^a\.mat cannot be read as \.mat [^\n]*$"):
        hfa.read_critic("a.mat", GAME)


@pytest.mark.parametrize("of_size", [lambda n: {"a": np.zeros(n)}, lambda n: "0" * n])
def test_a_small_mat_file_with_large_compressed_data_is_refused(of_size, monkeypatch):
    """With a limit of 1 MiB, a compressed .mat file with 2**20 numbers in a structure (8 MiB) or
    2**20 letters of a text (2 MiB) is refused for its size. One with 1000 is refused too, because K
    is not a matrix, but not for its size.
    """
    monkeypatch.setattr("hfa_support.arrays.read.LARGEST", 2**20)
    for count, is_large in ((1000, False), (2**20, True)):
        scipy.io.savemat("K.mat", {"K": of_size(count)}, do_compression=True)
        with pytest.raises(BadInputError) as refusal:
            hfa.read_critic("K.mat", GAME)
        assert ("more than 1 MiB" in str(refusal.value)) == is_large


# .csv

A = np.array([[0.0, 1.0], [-2.0, -3.0]])
B = np.array([[0.5], [1.0]])
#: Texts of A.csv and B.csv: numbers alone (BARE), with names of rows and columns (NAMED), and with
#: names of columns (HEADED).
BARE = "0,1\n-2,-3\n", ".5\n1e0\n"
NAMED = (
    ",speed [ft/s],alpha [rad]\nspeed,0,1\nalpha,-2,-3\n",
    ",push\nspeed,0.5\nalpha,1\n",
)


def game_of_csv(**texts):
    """Write matrices to .csv files, and return the game of the first and those beside it."""
    for name, text in texts.items():
        Path(f"{name}.csv").write_text(text, encoding="utf-8")
    return load_game(f"{next(iter(texts))}.csv", Q=np.eye(2), R=np.eye(1), delta=np.inf)


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        ({"A": "0,1\n-2\n"}, "row 2 has 1 cells, but row 1 has 2"),
        ({"A": "x,y\n0,1\n-2,x\n"}, "A.csv, row 3: y is 'x'; give a number"),
        (
            {"A": ",x,y\ny,-2,-3\nx,0,1\n"},
            "the columns of A are x, y, but the states are y, x",
        ),
        (
            {"A": NAMED[0], "B": ",push\nalpha,1\nspeed,0.5\n"},
            "the rows of B are alpha, speed, but the states are speed, alpha",
        ),
        ({"plant": BARE[0]}, "use .json, .npz or .mat"),
        ({"A": "x,y\n"}, "A has no numbers"),
    ],
)
def test_csv_files_without_a_matrix_are_refused(texts, said):
    """.csv files that do not contain a matrix, or have its rows or columns in another order than
    the states, are refused with the reason.
    """
    with pytest.raises(BadInputError, match=said):
        game_of_csv(**texts)


class RunsCode:
    """An object whose pickle writes the file "ran" when it is loaded."""

    def __reduce__(self):
        return Path.touch, (Path("ran"),)


@pytest.mark.parametrize("name", ["K.npy", "other.npy", "K.npz"])
def test_a_file_of_arrays_runs_no_code(name):
    """A pickled object in a .npy or .npz file is refused, and its code does not run."""
    held = np.array([RunsCode()], dtype=object)
    save = np.savez if name.endswith("z") else np.save
    save(name, held, allow_pickle=True)
    with pytest.raises(BadInputError, match=f"{name}.*Object arrays cannot be loaded"):
        hfa.read_critic(name, GAME)
    assert not Path("ran").exists()
