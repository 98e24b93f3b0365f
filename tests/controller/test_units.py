"""An answer does not depend on units, which differ by factors of 2^-27 to 2^27, 1e-8 to 1e8."""

import math

import numpy as np
import pytest
from stored_games import in_units, stored

import hfa
from controller import minimum_delta
from hfa import NoSolutionError

#: Relative size of errors of numbers.
CLOSE = 1e-7


def drawn(kind, number):
    """Return a stored game without disturbance."""
    return stored(kind, number).game.with_delta(math.inf)


def game_of(kind, seed):
    """Return a game whose delta is far above its smallest one."""
    return far_above(drawn(kind, seed))


def far_above(game):
    smallest = minimum_delta(game).value
    return game.with_delta(3.0 * smallest if smallest > 0.0 else math.inf)


def in_other_units(game, seed):
    """Return the game in random units, powers of two, which change no digit."""
    return in_units(game, np.random.default_rng(seed), base=2.0, most=27)


def words(text):
    """Return a text without its numbers."""
    return " ".join(word for word in str(text).split() if not any(map(str.isdigit, word)))


def refusal_of(game):
    """Return the words with which a game is refused, or ""."""
    try:
        hfa.solve(game)
    except NoSolutionError as refusal:
        return words(refusal)
    return ""


def agree(found, expected, sizes):
    """Return whether two arrays agree, relative to typical sizes of their entries."""
    return bool(np.abs((found - expected) / sizes).max() <= CLOSE)


CASES = [
    ("continuous", 39),
    ("discrete", 41),
    ("cross", 43),
    ("disturbance", 39),
    ("discount", 40),
]


@pytest.mark.parametrize(("kind", "seed"), CASES)
def test_solutions_scale_with_the_units(kind, seed):
    """P, K, L, delta_min, the L2 gain and the eigenvalues scale, and margins are the same.

    z, u, d, t and cost are the new units in one old unit, of states, inputs, disturbance, time and
    cost. Errors are relative to the sizes of P, K and L where the optimal cost is 1.
    """
    drawn_game = drawn(kind, seed)
    refused = [refusal_of(each) for each in (drawn_game, in_other_units(drawn_game, seed)[0])]
    assert refused[0] == refused[1]
    if refused[0]:
        return
    game = game_of(kind, seed)
    other, (z, u, d, t, cost) = in_other_units(game, seed)
    found, expected = hfa.solve(other), hfa.solve(game)
    of_P, of_u = np.sqrt(np.diag(expected.P)), np.sqrt(np.diag(expected.suboptimality_weight))
    of_P = np.where(of_P > 1e-6 * of_P.max(), of_P, of_P.max() or 1.0)
    assert agree(found.P * np.outer(z, z) / cost, expected.P, np.outer(of_P, of_P))
    large = max(1.0, float(np.abs(expected.K * of_u[:, None] / of_P).max()))
    assert agree(found.K / u[:, None] * z, expected.K, large * of_P / of_u[:, None])
    of_L = np.abs(expected.disturbance_gain / of_P).max(initial=0.0) or 1.0
    assert agree(found.disturbance_gain / d * z, expected.disturbance_gain, of_L * of_P)
    size = math.sqrt(cost / t) / d
    assert found.delta_min / size == pytest.approx(expected.delta_min, rel=3e-6, abs=1e-12)
    assert found.l2_gain / size == pytest.approx(expected.l2_gain, rel=1e-6, abs=1e-9)
    poles = np.sort_complex(found.poles() * t), np.sort_complex(expected.poles())
    np.testing.assert_allclose(*poles, rtol=1e-5, atol=1e-6)
    for margins, exact in zip(found.loops, expected.loops, strict=True):
        same = margins._replace(crossover=margins.crossover * t, delay=margins.delay / t)
        assert same == pytest.approx(exact, rel=1e-5, abs=1e-7, nan_ok=True)
    if game.delta < math.inf:
        refused = [refusal_of(each.with_delta(0.3 * each.delta)) for each in (game, other)]
        assert refused[0] == refused[1] != ""


def test_a_too_short_step_is_refused():
    """So is a step of True, which is that of an unknown sample time."""
    game = drawn("continuous", 2)
    with pytest.raises(hfa.BadInputError, match="too short"):
        game.sampled(1e-9)
    with pytest.raises(hfa.BadInputError, match="dt is of type bool"):
        game.sampled(True)
