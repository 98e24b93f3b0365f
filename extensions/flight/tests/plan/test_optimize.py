"""Command `hfa optimize`."""

import json
from pathlib import Path

import numpy as np
import pytest
from cli import answer, assert_refused, hfa as run
from project import ROOT
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

PENDULUM = f"{ROOT}/examples/pendulum.py:PENDULUM"


def test_flights_of_a_linear_plant_have_their_costs_by_riccati_and_lyapunov(folder):
    """The best flight costs z'Pz with P of SciPy's Riccati equation, and that of the gain K costs z'Xz of
    SciPy's Lyapunov equation. `over_best` is the ratio of a policy's cost to that of the best flight.

    The gain -K destabilizes the plant: its flight has no cost, and the command fails.
    """
    A, B = np.array([[0.0, 1.0], [-2.0, -0.3]]), np.array([[0.0], [3.0]])
    np.savez("plant.npz", A=A, B=B)
    P = solve_continuous_are(A, B, np.eye(2), [[0.5]])
    K = B.T @ P
    np.savez("K.npz", K=K)
    words = "optimize --aircraft plant.npz --initial x1=0.5,x2=0.2 --policy K.npz --Q 1,1 --R 0.5"
    data = answer(*words.split())
    X = solve_continuous_lyapunov((A - B @ K).T, -(np.eye(2) + 0.5 * K.T @ K))
    z = np.array([0.5, 0.2])
    assert data["cost"] == pytest.approx(z @ P @ z, rel=2e-3)
    assert data["proposed_cost"] == pytest.approx(z @ P @ z, rel=1e-5)
    linear, other = data["policies"]
    assert linear["cost"] == pytest.approx(z @ P @ z, rel=1e-6)
    assert other["cost"] == pytest.approx(z @ X @ z, rel=1e-4)
    assert other["over_best"] == pytest.approx(other["cost"] / data["cost"])
    np.savez("K.npz", K=-K)
    failed = run(*words.split(), "-o", "flight.json")
    assert failed.code == 1
    assert " inf " not in failed.out
    _, unstable = json.loads(Path("flight.json").read_text())["policies"]
    assert (unstable["converges"], unstable["cost"], unstable["over_best"]) == (False, None, None)


def test_a_best_flight_between_trims_begins_at_that_of_hold_and_ends_at_that_of_to():
    """The best flight of the pendulum begins at the trim of --hold, 5 deg, and ends at that of --to,
    the upright one.
    """
    words = ["optimize", "--aircraft", PENDULUM, "--hold", "angle=5", "--to", "angle=0"]
    data = answer(*words)
    assert data["start"] == pytest.approx({"angle": np.radians(5.0)})
    assert data["operating_point"]["states"]["angle"] == 0.0


def test_optimize_counts_and_summarizes_initial_conditions(folder):
    """Initial conditions reach up to 0.9 of the nearer limit, 0.3, and not beyond. The median and the
    worst cost ratio of a policy are those of its listed flights, none of which is below 1.
    """
    np.savez("plant.npz", A=[[0.0, 1.0], [-2.0, -0.3]], B=[[0.0], [3.0]])
    np.savez("K.npz", K=[[0.2, 0.5]])
    words = ["optimize", "--aircraft", "plant.npz", "--starts", "6", "--policy", "K.npz"]
    limits = ["--limit", "x1=-1:0.3", "--limit", "x2=-9:9"]
    data = answer(*words, *limits, "--seed", "7")
    assert data["starts"] == data["found"] + data["refused"] == 6
    assert 0.265 < max(abs(best["start"]["x1"]) for best in data["flights"]) <= 0.27
    for place, policy in enumerate(data["policies"]):
        flown = [best["policies"][place] for best in data["flights"]]
        ratios = [row["over_best"] for row in flown if row["over_best"]]
        assert policy["median"] == pytest.approx(np.median(ratios))
        assert policy["worst"] == pytest.approx(max(ratios))
        assert min(ratios) >= 1.0


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("", "give either --initial NAME=VALUE,..., --starts N or --to NAME=VALUE"),
        ("--initial height=3", "height is unknown; choose from angle"),
        ("--initial angle", "'angle' is not NAME=VALUE"),
        ("--initial angle=1,angle=2", "angle is given twice"),
        ("--initial angle=95 --limit angle=-90:90", "give an initial condition within the limits"),
        ("--starts 2 --picture a.png", "applies only to a single flight"),
        ("--to height=3", "unknown trim variable 'height'"),
        ("--hold angle=10 --to angle=10", "give another initial condition"),
    ],
)
def test_wrong_options_of_optimize_are_refused(words, says):
    """Options that are missing, contradict each other or name no state are refused in one line."""
    assert_refused(run("optimize", "--aircraft", PENDULUM, *words.split()), 2, says)
