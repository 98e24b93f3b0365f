"""Policies on a linear plant in a file."""

import json
from pathlib import Path

import numpy as np
import pytest
from cli import answer, assert_refused, hfa
from scipy.signal import cont2discrete
from tolerances import FEW_ROUNDINGS

import hfa as toolchain
from hfa.main import main

DEPLOYMENT = """
[policy]
file = "K.npz"
[observation]
x1 = {}
x2 = {}
[action]
u1 = {}
[timing]
dt = 0.05
"""
SAMPLED = ("--sample-time", "0.05")
_PLANT = {"A": np.array([[0.0, 1.0], [2.0, -0.3]]), "B": np.array([[0.0], [1.0]])}
#: Files of gains and of a plant, name -> entries. The gain K stabilizes the plant.
FILES = {
    "K": {"K": [[4.24, 2.8]]},
    "steps_of_K": {"K": [[4.24, 2.8]], "dt": 0.1},
    "plant": _PLANT,
}


@pytest.fixture
def files(folder):
    """Write the files of `FILES` and a deployment of K.npz into the working folder."""
    for name, entries in FILES.items():
        np.savez(f"{name}.npz", **entries)
    Path("deployment.toml").write_text(DEPLOYMENT)


@pytest.fixture
def assessed(tmp_path, capsys):
    """Return a function that runs `hfa assess` on a plant with a gain.

    The function returns exit code, output and errors.
    """

    def run(K, *words, **plant):
        np.savez(tmp_path / "plant.npz", **plant)
        np.savez(tmp_path / "K.npz", K=K)
        (tmp_path / "deployment.toml").write_text(DEPLOYMENT)
        deployment, model = str(tmp_path / "deployment.toml"), str(tmp_path / "plant.npz")
        code = main(["assess", deployment, "--aircraft", model, "--samples", "2", *words])
        return code, *capsys.readouterr()

    return run


def test_a_linear_plant_is_assessed(assessed, tmp_path):
    """The spectral radius is that of the plant with held inputs, x⁺ = Ad x + Bd u by SciPy, under u = -K x,
    also for a singular A. The command has the points of `hfa.assess` with the same seed.

    The opposite gain destabilizes the plant: exit code 1.
    """
    A, B, K = [[0.0, 1.0], [0.0, 0.0]], np.array([[0.0], [1.0]]), np.array([[4.24, 2.8]])
    code, output, _ = assessed(K, "--json", "--seed", "3", A=A, B=B)
    data = json.loads(output)
    plant = toolchain.load_model(str(tmp_path / "plant.npz"))
    told = toolchain.assess(plant, str(tmp_path / "deployment.toml"), samples=2, seed=3)
    assert data["points"] == json.loads(told.report().json())["points"]
    Ad, Bd, *_ = cont2discrete((np.array(A), B, np.eye(2), np.zeros((2, 1))), 0.05)
    radius = np.abs(np.linalg.eigvals(Ad - Bd @ K)).max()
    assert data["points"][0]["spectral_radius"] == pytest.approx(radius, rel=1e3 * FEW_ROUNDINGS)
    assert code == 0
    assert assessed(-K, A=A, B=B)[0] == 1


def test_a_table_of_gains_has_the_loop_and_cost_of_its_gain_at_the_trim(folder):
    """At 10 deg, halfway between gains of 5 and 15 deg, the loop is that of their mean; at 20 deg there is
    no gain. The cost is that of Q and R in the files. `verify` leads to `assess`.
    """
    hfa(*["solve", "--dihedral", "5,15", "-o", "table.npz"])
    with np.load("table.npz") as table:
        mean = {name: table[name] for name in ("Q", "R", "states", "inputs")}
        np.savez("mean.npz", K=table["K"].mean(axis=0), **mean)
    words = ["--sample-time", ".04", "--dihedral", "10"]
    radii = [
        answer("assess", file, *words, "--samples", "0")["points"][0]["spectral_radius"]
        for file in ("table.npz", "mean.npz")
    ]
    assert radii[0] == pytest.approx(radii[1], rel=1e-9)
    assert (
        "cost of table.npz: Q diag(1000,"
        in hfa("assess", "table.npz", *words, "--samples", "1").out
    )
    assert_refused(hfa("assess", "table.npz", *words[:2], "--dihedral", "20"), 2, "5 deg to 15 deg")
    assert_refused(hfa("verify", "--dihedral", "10", "--weights", "table.npz"), 2, "hfa assess")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "plant.npz --sample-time 0.05",
            "the file contains no linear policy u = -K x; give a K",
        ),
        ("steps_of_K.npz --sample-time 0.05", "K is a gain for dt = 0.1 s"),
        ("K.npz", "add --sample-time"),
        ("policy.onnx", "a policy u(x) requires a sample time; add --sample-time"),
        ("deployment.toml --sample-time 0.05", "remove --sample-time"),
    ],
)
def test_a_file_that_is_no_sampled_policy_is_refused(files, words, said):
    """Refused are files without a policy, a gain for another sample time, a policy without a sample
    time, and a deployment with a second one.
    """
    Path("policy.onnx").touch()
    assert_refused(hfa("assess", *words.split(), "--aircraft", "plant.npz"), 2, said)
