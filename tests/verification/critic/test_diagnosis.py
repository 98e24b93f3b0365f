"""Each planted mistake is named, and random errors are not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from game_samples import game_models
from known_models import game_at
from planted_critics import NAMED, UNNAMED, candidate_of, gain, solved, value, weights_of

from controller import Game, basis
from verification import from_gain, from_value, from_weights
from verification.critic.candidate import Candidate
from verification.critic.critic_check import LIMIT
from verification.critic.critic_errors import critic_errors
from verification.critic.diagnosis import diagnose

#: How many of a hundred random errors may get a cause.
FALSE_CAUSES = 1


def named(game: Game, candidate: Candidate, at: Callable[[float], Game] | None = None) -> str:
    return diagnose(game, solved(game), candidate, LIMIT, at)


def wrong(game: Game, candidate: Candidate) -> bool:
    """Whether its errors refuse it, which `test_critic_check.py` turns into the verdict."""
    return not all(check.ok for check in critic_errors(game, candidate, solved(game), LIMIT))


@pytest.mark.parametrize("mistake", NAMED)
def test_a_planted_mistake_is_refused_and_named(game: Game, mistake: str) -> None:
    kind, plant, words = NAMED[mistake]
    candidate = candidate_of(game, kind, plant)
    assert wrong(game, candidate)
    assert words in named(game, candidate)


@pytest.mark.parametrize(
    "mistake", [pytest.param(each, marks=[pytest.mark.slow] * (place % 3 > 0)) for place, each in enumerate(UNNAMED)]
)
def test_a_mistake_that_is_not_recognized_is_refused_without_a_cause(game: Game, mistake: str) -> None:
    candidate = candidate_of(game, *UNNAMED[mistake])
    assert wrong(game, candidate)
    assert named(game, candidate) == ""


@pytest.mark.parametrize("mistake", ["degrees, P", "column order", "another delta, K", "thousandfold"])
def test_a_critic_of_four_digits_is_named_too(game: Game, mistake: str) -> None:
    kind, plant, words = NAMED[mistake]
    rng = np.random.default_rng(1)
    wrong = candidate_of(game, kind, lambda game: plant(game) * (1.0 + 1e-6 * rng.standard_normal(plant(game).shape)))
    assert words in named(game, wrong)


#: Two states and one input: a few numbers are not explained by as many factors.
SMALL = Game([[0.0, 1.0], [-1.0, -1.0]], [[0.0], [1.0]], np.eye(2), np.eye(2), [[1.0]], 10.0)


@pytest.mark.parametrize("draws", [2, pytest.param(100, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", ["W", "P", "K"])
@pytest.mark.parametrize("plant", ["aircraft", "small"])
def test_random_errors_get_no_cause(game: Game, plant: str, kind: str, draws: int) -> None:
    game = game if plant == "aircraft" else SMALL
    right = {"W": weights_of(value(game)), "P": value(game), "K": gain(game)}[kind]
    rng, found = np.random.default_rng(0), []
    for size in 10.0 ** rng.uniform(-4.0, -1.0, draws):
        noise = rng.standard_normal(right.shape)
        noise = (noise + noise.T) / np.sqrt(2.0) if kind == "P" else noise
        wrong = right * (1.0 + size * noise)
        found.append(named(game, candidate_of(game, kind, lambda _, wrong=wrong: wrong)))
    assert sum(cause != "" for cause in found) <= FALSE_CAUSES * draws // 100, set(found)


def test_random_errors_of_a_gain_beside_its_value_get_no_cause(game: Game) -> None:
    rng = np.random.default_rng(2)
    for size in 10.0 ** rng.uniform(-4.0, -1.0, 20):
        wrong = gain(game) * (1.0 + size * rng.standard_normal(gain(game).shape))
        found = named(game, Candidate(wrong, value(game), basis("quadratic", len(game.A))))
        assert found == "" or "do not belong together" in found


@pytest.mark.parametrize(
    ("kind", "dynamics", "degrees", "other"),
    [
        ("P", "published", 15.0, 12.3),
        ("K", "published", 15.0, 12.3),
        ("K", "newton", 0.0, 0.5),
        ("K", "newton", 2.0, 1.0),
        ("K", "newton", 15.0, 15.1),
    ],
)
def test_a_critic_of_another_angle_is_named_with_its_angle(
    kind: str, dynamics: str, degrees: float, other: float
) -> None:
    game, theirs = game_at(degrees, dynamics), game_at(other, dynamics)
    candidate = candidate_of(game, kind, lambda _: value(theirs) if kind == "P" else gain(theirs))
    said = named(game, candidate, lambda at: game_at(at, dynamics))
    assert said.endswith(f"of another game, at dihedral {other:.4f} deg")
    assert named(game, candidate) == ""  # the plants cannot be told without the aircraft


def test_a_noisy_gain_is_not_taken_for_that_of_another_angle(game: Game) -> None:
    noise = np.random.default_rng(2).standard_normal(gain(game).shape)
    assert named(game, from_gain(game, gain(game) * (1.0 + 0.01 * noise)), game_at) == ""


@pytest.mark.parametrize("degrees", [5, 15])
def test_a_critic_of_the_printed_matrices_is_named(game: Game, degrees: int) -> None:
    """Where their rounding alone makes the difference, it has its cause all the same."""
    printed = game_models()[f"published-{degrees}"]
    for other in (from_value(game, value(printed)), from_gain(game, gain(printed))):
        assert wrong(game, other)
        said = named(game, other, lambda _: game)
        assert said.endswith(f"of another game, of the matrices printed for {degrees} deg")


def test_a_weight_beyond_the_quadratic_ones_is_named(game: Game) -> None:
    functions = basis("paper", 6)
    weights = functions.weights(value(game))
    weights[24] = 3.0
    said = named(game, from_weights(game, weights, functions))
    assert said.startswith("weight 25 is 3: on a linear plant the value is quadratic")


def test_a_transposed_gain_of_a_square_plant_is_named() -> None:
    game = Game([[-1.0, 0.4], [0.1, -2.0]], np.eye(2), np.eye(2), np.eye(2), np.diag([1.0, 3.0]), 5.0)
    assert named(game, from_gain(game, gain(game).T)) == "K is transposed"


def test_one_number_is_not_taken_for_another_game() -> None:
    game = Game([[1.0]], [[1.0]], [[1.0]], [[1e-8]], [[1.0]], delta=2.0)
    assert named(game, from_value(game, value(game) * 1.2)) == ""
    assert named(game, from_value(game, value(game) / 2.0)).startswith("the value is half")


def test_three_numbers_are_enough_to_tell_another_game_and_two_are_not() -> None:
    other = SMALL.with_delta(4.0)
    assert "this is the solution of another game, at delta = 4" in named(SMALL, from_value(SMALL, value(other)))
    assert named(SMALL, from_gain(SMALL, gain(other))) == ""
