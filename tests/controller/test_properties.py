"""Properties of solutions of games, for any game that hypothesis draws."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from game_files import stored
from hypothesis import assume, given, strategies as st
from stored_games import stored as of_kind
from strategies import changed_matrix, coordinates, games, in_coordinates

import hfa
from controller import load_game, minimum_delta
from hfa import Game, NoSolutionError, from_gain, from_value, solve, verify

#: Relative accuracy of two brackets of delta_min.
CLOSE = 3e-6


def solution_of(problem: Game) -> Any:
    """Return the solution of a game, or None if it is refused."""
    try:
        return solve(problem)
    except NoSolutionError:
        return None


@pytest.mark.slow  # test_units, and riccati/test_stored_games
@given(game=games(), data=st.data())
def test_coordinates_change_no_solution(game: Game, data: st.DataObject) -> None:
    """In other coordinates, delta_min is the same; just above it K is that of the game, and just
    below it neither has a value. The exact critic passes, and a wrong one fails.
    """
    T = data.draw(coordinates(game.A))
    other = in_coordinates(game, T)
    exact = solution_of(game)
    assume(exact is not None and solution_of(other) is not None)
    smallest = minimum_delta(game)
    assert minimum_delta(other).value == pytest.approx(smallest.value, rel=CLOSE, abs=1e-12)
    if smallest.value > 1e-3 and not smallest.uncertain:
        assert solution_of(other.with_delta(1.001 * smallest.value)) is not None
        assert solution_of(other.with_delta(0.999 * smallest.value)) is None
        game = game.with_delta(3.0 * smallest.value)
        other = other.with_delta(3.0 * smallest.value)
        exact = solve(game)
    K = changed_matrix("K", exact.K, T)
    P = changed_matrix("P", exact.P, T)
    np.testing.assert_allclose(solve(other).K, K, rtol=1e-7, atol=1e-8 * np.abs(K).max())
    assume(np.abs(exact.K).max() > 1e-3)
    assert verify(other, from_value(other, P)).ok
    assert verify(other, from_gain(other, K)).ok
    assert not verify(other, from_gain(other, 1.0001 * K)).ok


@pytest.mark.parametrize("suffix", [".npz", ".json", ".mat"])
def test_games_and_solutions_survive_their_files(tmp_path: Path, suffix: str) -> None:
    """A game is read from each kind of file bit for bit, and so is the K of its solution."""
    game = of_kind("cross", 12).game
    entries = {name: getattr(game, name) for name in ("A", "B", "E", "Q", "R", "N", "delta")}
    assert load_game(stored(tmp_path / f"plant{suffix}", **entries)) == game
    found = solve(game)
    found.save(tmp_path / f"solution{suffix}")
    read = hfa.read_critic(tmp_path / f"solution{suffix}", game)
    assert read.K.tobytes() == found.K.tobytes()
