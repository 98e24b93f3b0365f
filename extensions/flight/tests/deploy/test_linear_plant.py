"""Policies on a linear plant in a file."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are
from scipy.signal import cont2discrete
from tolerances import FEW_ROUNDINGS

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
        code = main(["assess", deployment, "--model", model, "--samples", "2", *words])
        return code, *capsys.readouterr()

    return run


def test_a_linear_plant_is_assessed(assessed):
    """The spectral radius equals that of SciPy's held plant. A is singular."""
    A, B, K = [[0.0, 1.0], [0.0, 0.0]], np.array([[0.0], [1.0]]), np.array([[4.24, 2.8]])
    code, output, _ = assessed(K, "--json", A=A, B=B)
    data = json.loads(output)
    Ad, Bd, *_ = cont2discrete((np.array(A), B, np.eye(2), np.zeros((2, 1))), 0.05)
    radius = np.abs(np.linalg.eigvals(Ad - Bd @ K)).max()
    assert data["points"][0]["spectral_radius"] == pytest.approx(radius, rel=1e3 * FEW_ROUNDINGS)
    assert code == 0


@pytest.mark.parametrize(
    ("plant", "said"),
    [
        ({"A": np.eye(2)}, "unknown input 'u1'"),
        (
            {"A": np.eye(2), "B": np.ones((2, 1)), "time": "discrete"},
            "the plant is in discrete time",
        ),
        ({"A": np.full((2, 2), np.nan), "B": np.ones((2, 1))}, "A[0][0] is nan"),
    ],
)
def test_a_file_without_a_linear_plant_is_refused(assessed, plant, said):
    """A file without B, a discrete-time plant and matrices with nan are refused in one line."""
    code, _, errors = assessed([[1.0, 1.0]], **plant)
    assert code == 2
    assert said in errors
    assert len(errors.splitlines()) == 1


@pytest.mark.parametrize(("doubles", "code"), [(150.0, 0), (5.0, 1)])
def test_an_unobservable_slow_mode_is_reported(assessed, doubles, code):
    """An unobservable mode that doubles in 150 s is reported and does not fail the policy.

    If the mode doubles in 5 s, the policy fails.
    """
    rate = np.log(2.0) / doubles
    A = [[0.0, 1.0, 0.0], [2.0, -0.3, 0.0], [0.0, 0.05, rate]]
    exit_code, output, _ = assessed([[4.24, 2.8]], "--json", A=A, B=[[0.0], [1.0], [0.1]])
    data = json.loads(output)
    told = ["warning", "not judged: x3 (doubles in 150 s), which no observation shows"]
    found = [[each["severity"], each["text"]] for each in data["findings"]]
    assert exit_code == code
    assert (told in found) is (code == 0)


@pytest.mark.slow
def test_an_uncontrolled_slow_mode_is_named_first(folder, capsys):
    """An unstable slow mode on which the policy has no gain is the first finding.

    A mode on which the policy has a gain is not named.
    """
    A = [[0.0, 1.0, 0.0], [2.0, -0.3, 0.0], [0.0, 0.05, np.log(2.0) / 150.0]]
    np.savez("plant.npz", A=A, B=[[0.0], [1.0], [0.1]])
    for gain, is_left in ((0.0, True), (0.02, False)):
        np.savez("K.npz", K=[[4.24, 2.8, gain]])
        words = ["assess", "K.npz", "--model", "plant.npz", *SAMPLED, "--samples", "2", "--json"]
        assert main(words) == 1
        data = json.loads(capsys.readouterr().out)
        assert data["first_line"].startswith("FAIL on the linear plant: does not hold")
        assert len(data["first_line"]) <= 80
        first = data["findings"][0]["text"]
        assert (first == "leaves x3 (doubles in 150 s) as it is") is is_left


def test_a_gain_alone_is_assessed(folder, capsys):
    """A file with a gain alone has the same spectral radius as a deployment of all states and
    inputs.

    A sample time is required for a gain and refused for a deployment file. Files without a gain of
    the required size are refused.
    """
    A, B = np.array([[0.0, 1.0], [2.0, -0.3]]), np.array([[0.0], [1.0]])
    np.savez("plant.npz", A=A, B=B)
    np.savez("K.npz", K=[[4.24, 2.8]])
    np.save("K.npy", [[4.24, 2.8]])
    np.save("P.npy", np.eye(2))
    (folder / "deployment.toml").write_text(DEPLOYMENT)
    words = ["--model", "plant.npz", "--samples", "0", "--json"]
    radii = []
    for named in (["K.npz", *SAMPLED], ["K.npy", *SAMPLED], ["deployment.toml"]):
        assert main(["assess", *named, *words]) == 0
        (point,) = json.loads(capsys.readouterr().out)["points"]
        radii.append(point["spectral_radius"])
    assert radii[0] == radii[1] == radii[2]
    assert main(["assess", "P.npy", *SAMPLED, *words]) == 2
    assert (
        "P.npy: the file contains no linear policy u = -K x; write a deployment file"
        in capsys.readouterr().err
    )
    assert main(["assess", "plant.npz", *SAMPLED, *words]) == 2
    assert (
        "the file contains no K; give a K of 1 x 2 (inputs u1 by states x1, x2)"
        in capsys.readouterr().err
    )
    assert main(["assess", "K.npz", *words]) == 2
    assert "add --sample-time" in capsys.readouterr().err
    Path("policy.onnx").touch()
    assert main(["assess", "policy.onnx", *words]) == 2
    assert "a network requires a deployment file" in capsys.readouterr().err
    assert main(["assess", "deployment.toml", *SAMPLED, *words]) == 2
    assert "--sample-time applies only to a file with a gain" in capsys.readouterr().err


@pytest.mark.slow
def test_weights_of_the_plant_file_are_those_of_the_cost(assessed):
    """The exact gain of Q and R in the plant file costs 1.00 times its own cost, as they are used.

    Without R in the file, it is 1. With both, the cost is compared with the optimum, and satisfies
    `--need cost`. A weight of another size and cross weights are refused.
    """
    plant = {"A": [[0.0, 1.0], [2.0, -0.3]], "B": [[0.0], [1.0]], "Q": [[1.0, 0.1], [0.1, 0.1]]}
    for weights, marked in (
        ({"R": [[0.05]]}, "R diag(0.05) (file)"),
        ({}, "R diag(1) (1/nominal^2, as by default)"),
    ):
        R = weights.get("R", [[1.0]])
        P = solve_continuous_are(plant["A"], plant["B"], plant["Q"], R)
        K = np.linalg.solve(R, np.transpose(plant["B"]) @ P)
        code, output, _ = assessed(K, "--json", **plant, **weights)
        best = json.loads(output)["points"][0]["best"]
        assert best["policy_over_lqr"]["median"] == pytest.approx(1.0, abs=0.01)
        assert (best["policy_over_best"] is None) is (not weights)
        code, output, _ = assessed(K, *["--need", "cost=1"] * bool(weights), **plant, **weights)
        assert code == 0
        assert f"cost: Q [1 0.1; 0.1 0.1] (file), {marked}" in output
    for wrong, said in (
        ({"Q": np.eye(3)}, "plant.npz: Q is 3 x 3; give 2 x 2"),
        ({"N": [[0.1], [0.0]]}, "plant.npz has cross weights N"),
    ):
        code, _, errors = assessed(K, **plant | wrong)
        assert (code, said in errors) == (2, True)
