"""The game over a sweep: at every point what it is alone, and why not where there is none."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from cli import hfa
from scipy.io import loadmat

from controller import published_game
from controller.analysis.game_sweep import sweep_games
from hfa_cli.main import DONE
from hfa_model import Aircraft, default_parameters
from trim import sweep
from trim.sweeps.sweep import Sweep
from verification import analyse_game


@pytest.fixture(scope="module")
def found() -> Sweep:
    return sweep(Aircraft(default_parameters().values), {"dihedral": np.radians([0.0, 10.0]), "speed": [40.0, 68.0]})


def test_every_point_has_the_numbers_that_it_has_alone(found: Sweep) -> None:
    games = sweep_games(found, R=np.diag([100.0, 300.0, 300.0, 300.0, 50.0]), delta=250.0)
    assert games.K.shape == (4, 5, 6)
    assert games.delta == 250.0
    solved = 0
    for i, reason in enumerate(games.reasons):
        if found.reasons[i]:
            assert reason == found.reasons[i]
            assert np.isnan(games.K[i]).all()
            assert np.isnan([each[i] for each in games[2:6]]).all()
            continue
        alone = analyse_game(
            published_game(found.A[i], found.B[i], R=np.diag([100.0, 300.0, 300.0, 300.0, 50.0]), delta=250.0)
        )
        np.testing.assert_allclose(games.K[i], alone.solution.K, rtol=1e-9, atol=1e-12)
        assert games.delta_min[i] == alone.delta_min.value
        margins = games.disk_margin[i], games.gain_margin[i], games.phase_margin_deg[i]
        np.testing.assert_allclose(margins, alone.disk[:3], rtol=1e-6)
        solved += 1
    assert 0 < solved < 4


def test_points_below_their_smallest_delta_say_it(tmp_path: Path) -> None:
    """At delta 113 the game has a value at 20 degrees, not at 0 and 10."""
    path = tmp_path / "sweep.csv"
    text = hfa("sweep", "--dihedral", "0:20:10", "--game", "--delta", "113", "-o", str(path))
    assert text.code == DONE
    assert [line.split()[1] for line in text.out.splitlines() if line.startswith(("0  ", "10  ", "20  "))][3:] == [
        "114.9",
        "114.5",
        "112.1",
    ]
    assert "\n0: no value of the game: the Hamiltonian has an eigenvalue on the imaginary axis" in text.out
    assert "delta = 113 is below delta_min = 114.9205; ask for a larger delta\n10: no value" in text.out
    rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    assert [row["disk_margin"] == "NaN" for row in rows] == [True, True, False]
    assert [round(float(row["delta_min"]), 1) for row in rows] == [114.9, 114.5, 112.1]
    assert float(rows[2]["K(throttle, speed) [(1)/(ft/s)]"]) > 0.0


def test_files_hold_stacked_arrays(tmp_path: Path) -> None:
    for name in ("sweep.npz", "sweep.mat", "sweep.json"):
        assert hfa("sweep", "--dihedral", "0,15", "--game", "-o", str(tmp_path / name)).code == DONE
    stored = np.load(tmp_path / "sweep.npz")
    assert stored["game.K"].shape == (2, 5, 6)
    assert stored["game.delta_min"][1] == pytest.approx(113.5486, abs=1e-3)
    game = json.loads((tmp_path / "sweep.json").read_text(encoding="utf-8"))["game"]
    assert game["delta"] == 200.0
    assert game["reasons"] == ["", ""]
    np.testing.assert_array_equal(game["K"], stored["game.K"])
    np.testing.assert_array_equal(loadmat(tmp_path / "sweep.mat")["game"]["disk_margin"][0, 0][0], game["disk_margin"])
