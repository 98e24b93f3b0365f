"""Reasons of verdicts."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from cli import answer
from game_files import AT_15, stored
from game_samples import failed_names, game_models
from planted_critics import gain, value, weights_of
from planted_mistakes import NAMED, OF_ANY_GAME, UNNAMED, candidate_of, random_game

from hfa import Critic, Game, from_gain, from_network, from_value, verify
from hfa.main import DONE, FAILED

pytestmark = pytest.mark.usefixtures("folder")


def test_a_value_inaccurate_for_its_gain_is_named() -> None:
    """The reason states that a P with eight right digits is not accurate enough for its gain.

    The input moves both states equally. This motion costs almost nothing, and K = B'P is a small
    difference of large numbers.
    """
    A = np.array([[-1.0, 0.1], [0.1, -1.0]])
    Q = np.array([[1.0, -0.999], [-0.999, 1.0]])
    game = Game(A, [[1.0], [1.0]], np.zeros((2, 1)), Q, [[1.0]], np.inf)
    P = np.vectorize(lambda entry: float(f"{entry:.8g}"))(value(game))
    verdict = verify(game, from_value(game, P))
    failed = failed_names(verdict.checks)
    assert failed == {"K_rel_error", "K_balanced_error", "K_entry_error", "policy_rel_error"}
    assert verdict.reason.startswith(
        "P is right within the limit; the K that follows from it is off by "
        f"{verdict.K_rel_error:.2g}"
    )


def test_no_mistake_is_named_if_a_small_column_of_a_symmetric_gain_is_wrong() -> None:
    """Entries of a gain compare within their column, also if the exact gain is symmetric."""
    game = Game(np.diag([1.0, -1.0]), np.eye(2), np.eye(2), np.diag([1e4, 1e-3]), np.eye(2), 10.0)
    K = np.diag([-1.0, 1.0]) @ gain(game)
    assert "input 1 has the wrong sign" in verify(game, from_gain(game, K)).reason
    K[0, 1] = 0.2 * K[1, 1]
    assert verify(game, from_gain(game, K)).reason == ""


# Planted mistakes.


@pytest.mark.parametrize("mistake", NAMED)
def test_a_planted_mistake_fails_and_is_named(mistake: str) -> None:
    """The mistake is named on a printed model of the aircraft, and on a random game."""
    models = list(game_models().values())
    number = list(NAMED).index(mistake) % len(models)
    kind, plant, words = NAMED[mistake]
    verdict = verify(models[number], candidate_of(models[number], kind, plant))
    assert not verdict.ok
    assert words in verdict.reason
    if mistake in OF_ANY_GAME:
        other = random_game(np.random.default_rng(number))
        kind, plant, words = OF_ANY_GAME[mistake]
        assert words in verify(other, candidate_of(other, kind, plant)).reason


@pytest.mark.parametrize("mistake", UNNAMED)
def test_another_mistake_fails_without_a_reason(game: Game, mistake: str) -> None:
    verdict = verify(game, candidate_of(game, *UNNAMED[mistake]))
    assert (verdict.ok, verdict.reason) == (False, "")


def test_random_errors_have_no_reason(game: Game) -> None:
    """Of a right P with random errors in K, at most the inconsistency is named."""
    rng = np.random.default_rng(2)
    for size in 10.0 ** rng.uniform(-4.0, -0.5, 3):
        noise = size * rng.standard_normal((6, 6))
        assert verify(game, from_value(game, value(game) * (1.0 + noise + noise.T))).reason == ""
        wrong = gain(game) * (1.0 + size * rng.standard_normal(gain(game).shape))
        assert verify(game, from_gain(game, wrong)).reason == ""
        both = verify(game, Critic(wrong, value(game), "P and K")).reason
        assert both == "" or "do not belong together" in both


def test_a_transposed_gain_is_named() -> None:
    plant = Game(
        [[-1.0, 0.4], [0.1, -2.0]], np.eye(2), np.eye(2), np.eye(2), np.diag([1.0, 3.0]), 5.0
    )
    assert verify(plant, from_gain(plant, gain(plant).T)).reason == "K is transposed"


def test_a_value_read_as_a_policy_is_named() -> None:
    """The one output of a network on a plant with one input is read as u, without --network."""
    plant = Game([[-1.0, 0.4], [0.1, -2.0]], [[1.0], [0.5]], Q=np.eye(2), R=[[1.0]])
    z = ca.SX.sym("z", 2)
    V = ca.Function("f", [z], [ca.bilin(ca.DM(value(plant)), z, z)])
    critic = from_network(plant, V)
    assert "kink" not in critic.origin
    assert "if it is V: --network V=NAME" in verify(plant, critic).reason


def test_a_value_per_second_of_a_step_is_named() -> None:
    """The value of a training whose costs were not multiplied by dt = 0.05 is 20 times too large,
    with the right gain.
    """
    continuous = Game([[-1.0, 0.4], [0.1, -2.0]], [[1.0], [0.5]], Q=np.eye(2), R=[[1.0]])
    sampled = continuous.sampled(0.05, 0.99)
    verdict = verify(sampled, Critic(gain(sampled), 20.0 * value(sampled), "P and K"))
    assert "every entry of P is 1/dt times" in verdict.reason


# A file that holds more than one of W, P and K: each is judged, none hides another.


@pytest.mark.parametrize(
    ("held", "factors", "said"),
    [
        ("WPK", {}, ""),
        ("PK", {"K": -1.0}, "the gain has the wrong sign"),
        ("WK", {"K": 2.0}, "the gain is twice the exact one"),
        ("PK", {"P": 10.0}, "every entry of P is 10 times the exact one"),
    ],
)
def test_each_part_of_a_file_is_checked(
    game: Game, held: str, factors: dict[str, float], said: str
) -> None:
    """Each of W, P and K in a file is checked, and a wrong one is named."""
    parts = {"W": weights_of(value(game)), "P": value(game), "K": gain(game)}
    file = stored("all.npz", **{key: factors.get(key, 1.0) * parts[key] for key in held})
    data = answer("verify", *AT_15, "--weights", file, code=FAILED if said else DONE)
    assert data["diagnosis"].startswith(said)
    assert bool(data["diagnosis"]) == bool(said)
    for name in "PK":
        assert data[f"{name}_rel_error"] == pytest.approx(
            abs(factors.get(name, 1.0) - 1.0), rel=1e-6, abs=1e-12
        )
