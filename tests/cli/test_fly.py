"""`hfa fly`: what it says, what it writes, its exit codes, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from game_files import stored

from controller import Game, basis
from verification import solve_game

FLY = ("fly", "--dihedral", "15", "--law", "exact")


def test_the_command_says_that_a_flight_held_and_writes_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = (*FLY, "--duration", "1", "--initial", "speed=0.1", "--gust", "50:2", "--error", "lift_slope=0.99")
    result = hfa(*words, "-o", "flight.json")
    assert (result.code, result.err) == (0, "")
    assert "stayed within limits: 1 s inside the envelope and the control limits" in result.out
    data = json.loads(Path("flight.json").read_text(encoding="utf-8"))
    assert data["schema"] == "hfa.flight/1"
    assert data["held"] is True
    assert data["departure"] is None
    assert data["scenario"]["errors"] == {"lift_slope": 0.99}
    assert data["scenario"]["gust"]["length"] == 50.0
    history = data["history"]
    assert (len(history["times"]), len(history["states"][0]), len(history["inputs"][0])) == (101, 7, 5)
    assert history["states"][0][0] == pytest.approx(68.1)
    assert len(history["angles_of_attack"]) == 101
    assert data["final"]["angle_of_attack"] == history["angles_of_attack"][-1]
    assert max(history["updrafts"]) == pytest.approx(2.0, abs=0.01)
    for suffix in ("npz", "csv"):
        assert hfa(*words, "-o", f"flight.{suffix}").code == 0
    with np.load("flight.npz") as stored:
        np.testing.assert_array_equal(stored["history.states"], np.array(history["states"]))
    lines = Path("flight.csv").read_text(encoding="utf-8").splitlines()
    assert "hfa.flight/1" in lines[1]
    assert lines[0].startswith("time [s],speed [ft/s],alpha [rad]")
    assert len(lines) == 102


def test_the_command_flies_a_gain_and_a_critic_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, game: Game
) -> None:
    """The exact gain, P and W from a file fly as --law exact does; another R changes the policy of P alone."""
    exact = solve_game(game)
    stored("K.json", K=exact.K)
    stored("P.npz", P=exact.P)
    stored("W.mat", W=basis("quadratic", 6).weights(exact.P))
    flight = ("fly", "--dihedral", "15", "--duration", "0.5", "--initial", "speed=0.1", "--json")
    expected = json.loads(hfa(*flight, "--law", "exact").out)
    for kind, file in (("gain", "K.json"), ("weights", "P.npz"), ("weights", "W.mat")):
        data = json.loads(hfa(*flight, "--weights", file).out)
        assert data["policy"]["law"] == f"{kind} of {file}"
        np.testing.assert_allclose(data["policy"]["K"], expected["policy"]["K"], rtol=1e-9)
        assert data["final"]["alpha"] == pytest.approx(expected["final"]["alpha"], rel=1e-6)
    costlier = json.loads(hfa(*flight, "--weights", "P.npz", "--R", "200,800,800,800,100").out)
    np.testing.assert_allclose(costlier["policy"]["K"], exact.K / 2, rtol=1e-9)
    stored("V.npz", W=np.ones(25))
    stored("small.npz", K=np.eye(2))
    for words, named in (
        ("--weights K.json --law exact", "--law changes nothing beside --weights; leave it out"),
        ("--weights P.npz --delta 300", "--delta changes nothing beside --weights"),
        ("--weights K.json --seed 3", "here nothing is random"),
        ("--weights small.npz", "small.npz: K is 2 x 2; on a plant with 6 states and 5 inputs it must be 5 x 6"),
        ("--weights V.npz", "V.npz: there are 25 weights; a simulation takes the 21 of the quadratic basis"),
        ("--weights none.npz", "there is no such file"),
    ):
        assert_refused(hfa("fly", "--dihedral", "15", *words.split()), 2, named)
