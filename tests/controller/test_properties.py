"""Properties of solutions of games, for any game that hypothesis draws."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from game_files import stored
from hypothesis import assume, given, strategies as st
from strategies import changed_matrix, coordinates, games, in_coordinates

import hfa
from controller import disk_margin, load_game, minimum_delta
from hfa import Game, NoSolutionError, from_gain, from_value, solve, verify

#: Relative accuracy of two brackets of delta_min.
CLOSE = 3e-6


def solution_of(problem: Game) -> Any:
    """Return the solution of a game, or None if it is refused."""
    try:
        return solve(problem)
    except NoSolutionError:
        return None


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


@given(game=games(), share=st.sampled_from([1.5, 4.0, math.inf]))
def test_a_solution_solves_its_game(game: Game, share: float) -> None:
    """P satisfies the Riccati equation, stabilizes both loops and is the cost of K's flights."""
    if math.isfinite(share):
        assume(solution_of(game) is not None)
        game = game.with_delta(share * (minimum_delta(game).value or 1.0))
    found = solution_of(game)
    assume(found is not None)
    P, K, L = found.P, found.K, found.disturbance_gain
    spread = 0.0 if math.isinf(game.delta) else game.E @ game.E.T / game.delta**2
    terms = [
        game.A.T @ P,
        P @ game.A,
        game.Q,
        P @ game.B @ K,
        P @ spread @ P if np.ndim(spread) else 0 * P,
    ]
    residual = terms[0] + terms[1] + terms[2] - terms[3] + terms[4]
    assert np.abs(residual).max() <= 1e-9 * max(np.abs(term).max() for term in terms)
    np.testing.assert_allclose(
        game.R @ K, game.B.T @ P, rtol=1e-9, atol=1e-9 * np.abs(game.B.T @ P).max()
    )
    if math.isfinite(game.delta):
        np.testing.assert_allclose(
            L, game.E.T @ P / game.delta**2, rtol=1e-8, atol=1e-9 * np.abs(L).max()
        )
    assert np.linalg.eigvalsh(P).min() >= -1e-9 * np.abs(P).max()
    assert np.linalg.eigvals(game.A - game.B @ K).real.max() < 0.0
    skew = np.triu(np.ones_like(P), 1) * np.abs(P).max()
    np.testing.assert_allclose(from_value(game, P + skew - skew.T).K, K, rtol=1e-7, atol=1e-7)
    assert found.cost(np.ones(len(P))) == pytest.approx(P.sum(), rel=1e-12)
    assert found.delta_margin == pytest.approx(
        game.delta / found.delta_min if found.delta_min else math.inf
    )


@given(game=games())
def test_margins_agree_with_the_definition(game: Game) -> None:
    """Gain, phase, delay and disk margins are those of the loop at its own frequencies."""
    found = solution_of(game)
    assume(found is not None and np.abs(found.K).max() > 1e-3)
    K = found.K
    n = len(game.A)
    frequencies = np.geomspace(1e-3, 1e3, 4000)

    def loop(points: np.ndarray) -> np.ndarray:
        resolvent = np.linalg.inv(1j * points[:, None, None] * np.eye(n) - game.A)
        return K @ resolvent @ game.B

    L = loop(frequencies)
    m = len(K)
    M = np.linalg.inv(np.eye(m) + L) - np.eye(m) / 2.0
    least = 1.0 / np.abs(M).max(axis=(1, 2)).max() if m == 1 else None
    if least is not None:
        assert disk_margin(game, K).disk <= min(least, 2.0) * (1 + 1e-9)
        assert disk_margin(game, K).disk == pytest.approx(min(least, 2.0), rel=2e-2)
    margins = hfa.margins(hfa.LinearModel.of(game.A, game.B), K)
    for i, margin in enumerate(margins.values()):
        # The margin of an input, with the other loops closed.
        others = np.delete(K, i, axis=0)
        A = game.A - np.delete(game.B, i, axis=1) @ others

        def is_stable(factor: complex, i: int = i, A: np.ndarray = A) -> bool:
            closed = A - factor * np.outer(game.B[:, i], K[i])
            return bool(np.linalg.eigvals(closed).real.max() < 0.0)

        assert is_stable(1.0)
        if 1.0 < margin.gain_high < 1e3:
            assert is_stable(0.99 * margin.gain_high) or margin.gain_high < 1.01
            assert not is_stable(1.01 * margin.gain_high)
        if 1e-3 < margin.gain_low < 1.0:
            assert not is_stable(0.99 * margin.gain_low)
        if margin.phase < 180.0:
            assert margin.phase >= 60.0 - 1e-6 or math.isfinite(game.delta) or m > 1
            # exp(-i w T) at the crossover turns the loop by the phase margin.
            at = loop(np.array([margin.crossover]))[0] if m == 1 else None
            if at is not None:
                assert abs(at[0, 0]) == pytest.approx(1.0, rel=1e-6)
                turned = math.degrees(abs(math.remainder(np.angle(-at[0, 0]), 2 * math.pi)))
                assert margin.phase == pytest.approx(turned, abs=1e-5)
                assert margin.delay * margin.crossover >= math.radians(margin.phase) * (1 - 1e-6)
                if margin.delay * margin.crossover < 10.0 and 1e-2 < margin.crossover < 1e2:
                    delayed = L[:, 0, 0] * np.exp(-1j * frequencies * margin.delay)
                    assert np.abs(1.0 + delayed).min() < 0.05


@given(
    game=games(),
    data=st.data(),
    discount=st.sampled_from([1.0, 0.9]),
    dt=st.sampled_from([0.01, 0.5]),
)
def test_coordinates_change_no_discrete_solution(
    game: Game, data: st.DataObject, discount: float, dt: float
) -> None:
    """In other coordinates, a game in discrete time has the same delta_min and the same K."""
    problem = game.sampled(dt, discount)
    exact = solution_of(problem)
    T = data.draw(coordinates(game.A))
    other = in_coordinates(problem, T)
    assume(exact is not None and solution_of(other) is not None)
    K = changed_matrix("K", exact.K, T)
    np.testing.assert_allclose(solve(other).K, K, rtol=1e-7, atol=1e-8 * np.abs(K).max())
    try:
        smallest, found = (minimum_delta(each) for each in (problem, other))
    except NoSolutionError as refusal:
        assert "rounding" in str(refusal)  # noqa: PT017
        return
    slack = 1.0 + CLOSE
    assert found.refused <= slack * smallest.value + 1e-12
    assert smallest.refused <= slack * found.value + 1e-12


@given(game=games(), suffix=st.sampled_from([".npz", ".json", ".mat"]))
def test_games_and_solutions_survive_their_files(game: Game, suffix: str) -> None:
    """A game is read from each kind of file bit for bit, and so is the K of its solution."""
    entries = {name: getattr(game, name) for name in ("A", "B", "E", "Q", "R")}
    with tempfile.TemporaryDirectory() as folder:
        path = stored(Path(folder) / f"plant{suffix}", **entries, delta=7.0)
        assert load_game(path) == game.with_delta(7.0)
        found = solution_of(game)
        assume(found is not None)
        written = Path(folder) / f"solution{suffix}"
        found.save(written)
        assert hfa.read_critic(written, game).K.tobytes() == found.K.tobytes()
