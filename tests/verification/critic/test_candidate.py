"""A file that holds more than one of W, P and K: each is judged, none hides another."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import answer, hfa
from game_files import AT_15, stored

from controller import Game, basis
from hfa_cli.main import BAD_INPUT, DONE, FAILED
from hfa_support import BadInputError
from verification import from_gain, from_value, from_weights, solve_game
from verification.critic.candidate import Candidate

pytestmark = pytest.mark.usefixtures("folder")


@pytest.mark.parametrize(
    ("K", "P", "finite"),
    [(1.0, 1.0, True), (1.0, None, True), (np.nan, 1.0, False), (np.inf, None, False), (1.0, np.nan, False)],
)
def test_a_critic_is_finite_where_all_of_it_is(K: float, P: float | None, finite: bool) -> None:
    made = Candidate(np.full((5, 6), K), None if P is None else np.full((6, 6), P), basis("quadratic", 6))
    assert made.finite == finite


@pytest.fixture(scope="module")
def parts(game: Game) -> dict[str, Any]:
    """W, P and K of the exact solution at 15 degrees."""
    exact = solve_game(game)
    return {"W": basis("quadratic", 6).weights(exact.P), "P": exact.P, "K": exact.K}


@pytest.mark.parametrize("held", ["WPK", "WK", "PK", "WP"])
def test_right_ones_agree(parts: dict[str, Any], held: str) -> None:
    assert answer("verify", *AT_15, "--weights", stored("all.npz", **{key: parts[key] for key in held}))["ok"] is True


@pytest.mark.parametrize(
    ("held", "factor"), [("WPK", -1.0), ("WK", -1.0), ("PK", -1.0), ("WPK", 1.0 + 1e-4), ("WPK", 300.0)]
)
def test_a_wrong_gain_is_not_hidden(parts: dict[str, Any], held: str, factor: float) -> None:
    given = {key: parts[key] for key in held} | {"K": factor * parts["K"]}
    data = answer("verify", *AT_15, "--weights", stored("all.npz", **given), code=FAILED)
    assert data["K_rel_error"] == pytest.approx(abs(factor - 1.0), rel=1e-9)
    assert data["P_rel_error"] <= 1e-12
    words = "the gain has the wrong sign" if factor < 0 else f"every entry of K is {factor:.6g} times the exact one"
    assert data["diagnosis"].startswith(words)


def test_a_wrong_value_is_not_hidden(parts: dict[str, Any]) -> None:
    data = answer("verify", *AT_15, "--weights", stored("pk.npz", P=1.1 * parts["P"], K=parts["K"]), code=FAILED)
    assert data["K_rel_error"] <= 1e-12
    assert data["P_rel_error"] == pytest.approx(0.1)
    assert data["diagnosis"] == "every entry of P is 1.1 times the exact one"


def test_a_value_and_a_gain_of_another_game_are_told_whose_they_are(parts: dict[str, Any]) -> None:
    at_20 = ("verify", "--dihedral", "20", "--weights")
    both = answer(*at_20, stored("both.npz", P=parts["P"], K=parts["K"]), code=FAILED)
    assert both["diagnosis"] == "this is the solution of another game, at dihedral 15.0000 deg"


@pytest.mark.parametrize("wrong", ["W", "P"])
def test_weights_and_a_value_that_differ_are_refused(parts: dict[str, Any], wrong: str) -> None:
    given = {"W": parts["W"], "P": parts["P"]} | {wrong: (1.0 + 1e-4) * parts[wrong]}
    said = hfa("verify", *AT_15, "--weights", stored("wp.npz", **given))
    assert (said.code, said.out) == (BAD_INPUT, "")
    assert said.err == "hfa: wp.npz: W and P are of different values; leave one of them out\n"


def test_a_wrong_shape_beside_a_right_one_is_refused(parts: dict[str, Any]) -> None:
    said = hfa("verify", *AT_15, "--weights", stored("pk.npz", P=parts["P"], K=parts["K"].T))
    assert said.code == BAD_INPUT
    assert "K is 6 x 5" in said.err


def test_monte_carlo_simulates_the_gain_of_a_solution(parts: dict[str, Any]) -> None:
    assert hfa("solve", *AT_15, "-o", "s15.json").code == DONE
    assert "P" in json.loads(Path("s15.json").read_text(encoding="utf-8"))
    words = ("monte-carlo", *AT_15, "--samples", "1", "--duration", "0.1", "--json")
    given, exact = (json.loads(hfa(*words, *law).out) for law in (("--weights", "s15.json"), ("--law", "exact")))
    assert given["held"] == exact["held"] == 1


@pytest.mark.parametrize("held", "WPK")
def test_numbers_that_are_not_real_are_refused_in_python_too(game: Game, parts: dict[str, Any], held: str) -> None:
    """NumPy would drop the imaginary part, with a warning, and the rest would pass."""
    make = {"W": from_weights, "P": from_value, "K": from_gain}[held]
    for wrong in (parts[held] + 1j, [[1.0], [1.0, 2.0]], parts[held].astype(str)):
        with pytest.raises(BadInputError, match=f"{held} does not consist of rows of real numbers"):
            make(game, wrong)
