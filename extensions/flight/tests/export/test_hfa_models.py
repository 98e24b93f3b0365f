"""Exchange of .mat files with GNU Octave, in both directions.

Octave reads the project's files with the exported function.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa

from hfa import solve
from hfa.paper import published_game
from hfa_support.arrays.read import read_arrays

OCTAVE = shutil.which("octave-cli")
pytestmark = pytest.mark.skipif(OCTAVE is None, reason="GNU Octave is not installed")
#: Commands for Octave, run in one process because its start takes most of the time.
SCRIPT = """
try; pkg load control; catch; exit(3); end
[models, data] = hfa_models('sweep.mat');
Q = diag([QQ]); R = diag([RR]);
count = numel(models); E = zeros(6, count); K = zeros(5, 6, count);
for k = 1:count
    E(:, k) = eig(models{k}.a);
    K(:, :, k) = lqr(models{k}, Q, R);
end
names = char([models{2}.stname; models{2}.inname]);
values = data.values;
save('-v7', 'seen.mat', 'E', 'K', 'names', 'values');
single = hfa_models('linear.mat'); outputs = char(single{1}.outname); C = single{1}.c;
save('-v6', 'single.mat', 'outputs', 'C');
A = models{2}.a; B = models{2}.b; delta = Inf;
save('-v6', 'plant6.mat', 'A', 'B', 'Q', 'R', 'delta');
save('-v7', 'plant7.mat', 'A', 'B', 'Q', 'R', 'delta');
K = K(:, :, 2); P = care(A, B, Q, R);
save('-v6', 'gain.mat', 'K'); save('-v7', 'value.mat', 'P');
K(2, 3) += 0.5; save('-v7', 'wrong.mat', 'K');
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("octave")
    assert hfa("sweep", "--dihedral", "0:20:5", "-q", "-o", str(made / "sweep.mat")).code == 0
    watched = ("--outputs", "gamma,load_factor")
    assert hfa("linearize", "--dihedral", "10", *watched, "-o", str(made / "linear.mat")).code == 0
    assert hfa("export", "-o", str(made / "hfa_models.m")).code == 0
    game = published_game(np.zeros((6, 6)), np.zeros((6, 5)))
    script = SCRIPT.replace("QQ", repr(np.diag(game.Q).tolist())).replace(
        "RR", repr(np.diag(game.R).tolist())
    )
    done = subprocess.run(
        [str(OCTAVE), "--quiet", "--norc", "--eval", script],
        cwd=made,
        capture_output=True,
        text=True,
    )
    if done.returncode == 3:
        pytest.skip("Octave is installed without its package control")
    assert (made / "wrong.mat").exists(), done.stderr
    return made


def test_octave_and_hfa_give_equal_results(folder: Path) -> None:
    """Octave and the product give equal eigenvalues and LQR gains at each angle of a sweep."""
    data = json.loads(hfa("sweep", "--dihedral", "0:20:5", "-q", "--json").out)
    seen = read_arrays(folder / "seen.mat")
    np.testing.assert_array_equal(seen["values"], data["values"])
    for k, (A, B) in enumerate(zip(data["A"], data["B"], strict=True)):
        ours = np.linalg.eigvals(np.array(A))
        theirs = seen["E"][:, k]
        assert max(abs(theirs - value).min() for value in ours) < 1e-8
        game = published_game(np.array(A), np.array(B), delta=np.inf)
        np.testing.assert_allclose(seen["K"][:, :, k], solve(game).K, rtol=1e-8, atol=1e-8)
    assert [name.strip() for name in seen["names"]] == [*data["states"], *data["inputs"]]


def test_outputs_are_exported_to_octave(folder: Path) -> None:
    """The names and the matrix C of outputs are read in Octave."""
    seen = read_arrays(folder / "single.mat")
    assert [name.strip() for name in seen["outputs"]] == ["gamma", "load_factor"]
    np.testing.assert_array_equal(seen["C"][0], [0, -1, 1, 0, 0, 0])


@pytest.mark.parametrize("version", [pytest.param(6, marks=pytest.mark.slow), 7])
def test_plants_and_critics_of_octave_are_checked(version: int, folder: Path) -> None:
    """Plants and critics in .mat files that Octave wrote are solved and checked, and a wrong critic
    fails.
    """
    plant = str(folder / f"plant{version}.mat")
    solved = json.loads(hfa("solve", "--model", plant, "--json").out)
    np.testing.assert_allclose(
        solved["K"], read_arrays(folder / "gain.mat")["K"], rtol=1e-8, atol=1e-8
    )
    for critic, code in (("gain.mat", 0), ("value.mat", 0), ("wrong.mat", 1)):
        result = hfa("verify", "--model", plant, "--weights", str(folder / critic), "--json")
        assert (result.code, json.loads(result.out)["ok"]) == (code, code == 0), critic
    assert_refused(
        hfa("solve", "--model", str(folder / "gain.mat")), 2, "there is no A", "found: K"
    )
