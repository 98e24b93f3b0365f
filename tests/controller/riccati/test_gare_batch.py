"""Batches of games, with the solutions and refusals of single games and little memory."""

import tracemalloc

import numpy as np
import pytest

import hfa
from controller import minimum_delta, solve_games
from controller.riccati import certificate
from controller.riccati.certificate import certified_stack
from controller.riccati.derivations import by_doubling, by_eigenvectors
from controller.riccati.normal_form import NormalForm
from hfa import BadInputError, Game, NoSolutionError, solve
from hfa.paper import published_game
from hfa_model import LINEAR_STATES, STATES, VARIANTS
from trim import trim_points


def _models(dynamics: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    angles = np.radians(np.linspace(0, 20, count))[:, None]
    flights = trim_points(hfa.aircraft(dynamics), ("dihedral",), angles)
    rows = [STATES.index(name) for name in LINEAR_STATES]
    return flights.A[:, rows][:, :, rows], flights.B[:, rows]


@pytest.mark.parametrize("dynamics", VARIANTS)
def test_every_model_has_its_own_solution(dynamics):
    """Each game of a batch has the solution of `solve`."""
    A, B = _models(dynamics, 21)
    batch = solve_games(A, B, published_game(A[10], B[10]))
    assert batch.certified.all()
    for i in range(len(A)):
        alone = solve(published_game(A[i], B[i]))
        # P is refined in twice the precision in both ways; K = R⁻¹B'P loses one more digit.
        assert np.linalg.norm(batch.P[i] - alone.P) <= 1e-12 * np.linalg.norm(alone.P)
        assert np.linalg.norm(batch.K[i] - alone.K) <= 1e-11 * np.linalg.norm(alone.K)


def test_the_schur_form_resolves_contradicting_methods(monkeypatch):
    """If the doubling method contradicts the eigenvectors, the Schur form and refined doubling
    decide.
    """
    A, B = _models("published", 3)
    like = published_game(A[0], B[0])
    assert certified_stack(NormalForm.of_plants(A, B, like)).holds.all()
    # Planted fault: a wrong limit of the doublings, which no plant causes.
    monkeypatch.setattr(
        certificate, "by_doubling", lambda *given: by_doubling(*given) * (1.0 + 1e-7)
    )
    stack = certified_stack(NormalForm.of_plants(A, B, like))
    assert np.isnan(stack.X).all()
    assert not stack.holds.any()
    assert solve_games(A, B, like).certified.all()


def test_the_spectral_abscissa_bound_is_close():
    """The bound of the spectral abscissa of A - S X exceeds the computed value by at most 0.1 %.

    The games have up to twelve states, with rows of A of very different size.
    """
    rng = np.random.default_rng(0)
    for n in (2, 6, 12):
        A = rng.standard_normal((20, n, n)) * np.exp(rng.uniform(-3.0, 3.0, (20, n, 1)))
        B = rng.standard_normal((20, n, 2))
        like = Game(A[0], B[0], 0.1 * np.eye(n), np.eye(n), np.eye(2), 20.0)
        form = NormalForm.of_plants(A, B, like)
        found = by_eigenvectors(form)
        abscissa = np.linalg.eigvals(form.A - form.S @ found.X).real.max(axis=1)
        bound = found.loop.real.max(axis=1) + found.spread
        assert (bound >= (1.0 + 1e-12) * abscissa).all()
        assert (bound <= 0.999 * abscissa).all()


def test_nothing_is_certified_below_the_smallest_delta():
    """For a delta below the smallest one, no game of a batch is certified and all P and K are
    nan."""
    A, B = _models("published", 5)
    batch = solve_games(A, B, published_game(A[2], B[2], delta=50.0))
    assert not batch.certified.any()
    assert np.isnan(batch.P).all()
    assert np.isnan(batch.K).all()


@pytest.mark.parametrize("count", [4, pytest.param(30, marks=pytest.mark.slow)])
def test_random_games_are_accepted_exactly_when_solvable(count: int) -> None:
    """A batch certifies a random game if and only if `solve` solves it."""
    rng = np.random.default_rng(7)
    accepted = refused = 0
    for delta in (0.7, 1.5, 3.0, 8.0):
        A = rng.standard_normal((count, 6, 6))
        B = rng.standard_normal((count, 6, 2))
        like = Game(A[0], B[0], np.eye(6), np.eye(6), np.eye(2), delta)
        batch = solve_games(A, B, like)
        for i in range(len(A)):
            try:
                alone = solve(Game(A[i], B[i], np.eye(6), np.eye(6), np.eye(2), delta))
            except NoSolutionError:
                assert not batch.certified[i]
                refused += 1
                continue
            assert batch.certified[i]
            # Two derivations may differ by DISAGREEMENT, 1e-8.
            assert np.linalg.norm(batch.P[i] - alone.P) <= 1e-8 * np.linalg.norm(alone.P)
            accepted += 1
    assert min(accepted, refused) >= 2 * count // 3


def test_a_batch_refuses_the_same_games():
    """Near the smallest delta, a batch refuses the same games as `solve`, for the same
    reasons.
    """
    rng = np.random.default_rng(8)
    A = rng.standard_normal((2, 4, 4))
    B = rng.standard_normal((2, 4, 2))
    for i in range(len(A)):
        game = Game(A[i], B[i], np.eye(4), np.eye(4), np.eye(2), 1.0)
        near = game.with_delta(minimum_delta(game).value * (1.0 + 10.0 ** rng.uniform(-6.0, -3.0)))
        batch = solve_games(A[i : i + 1], B[i : i + 1], near)
        try:
            alone = solve(near).P
            assert np.linalg.norm(batch.P[0] - alone) <= 1e-10 * np.linalg.norm(alone)
        except NoSolutionError as refusal:
            assert not batch.certified[0]
            assert batch.reasons[0] in str(refusal)  # noqa: PT017


def test_a_batch_of_24_states_needs_little_memory():
    """A batch of two games with 24 states allocates less than 20 MB."""
    rng = np.random.default_rng(9)
    A = rng.standard_normal((2, 24, 24)) - 4.0 * np.eye(24)
    B = rng.standard_normal((2, 24, 3))
    like = Game(A[0], B[0], np.eye(24), np.eye(24), np.eye(3), 50.0)
    tracemalloc.start()
    assert solve_games(A, B, like).certified.all()
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


def test_a_singular_plant_does_not_affect_the_others():
    """A plant of zeros is not certified, but the other plants of its batch are.

    A plant with nan is refused, and the message states its number.
    """
    A, B = _models("published", 3)
    A = A.copy()
    B = B.copy()
    A[1], B[1] = 0.0, 0.0
    batch = solve_games(A, B, published_game(A[0], B[0]))
    assert batch.certified.tolist() == [True, False, True]
    A[1] = np.nan
    with pytest.raises(BadInputError, match="model 1 of the batch"):
        solve_games(A, B, published_game(A[0], B[0]))
