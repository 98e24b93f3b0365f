"""Search for planted mistakes and random errors in critics."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cli import answer, hfa
from extension import Extension
from game_files import AT_15, stored
from game_samples import game_models
from known_models import game_at
from planted_critics import gain, solved, value, weights_of
from planted_mistakes import (
    NAMED,
    OF_ANY_GAME,
    UNNAMED,
    candidate_of,
    noisy,
    random_game,
)
from project import ROOT

from controller.critic.critic import Critic, from_functions
from examples.train_a_network import fit
from hfa import Game, from_gain, from_value, verify
from hfa.main import FAILED
from verification.box import ordinary_box, usual_box
from verification.critic.critic_check import LIMIT
from verification.critic_errors import critic_errors
from verification.judged_game import JudgedGame
from verification.reasons.diagnosis import diagnose, nearest_linear
from verification.reasons.hypotheses import Hypothesis, View
from verification.reasons.other_games import discounted, other_games
from verification.scope import Nearby, Scheduled, Scope

network_files = Extension("network_files")
searches = Extension("verification.network.search")
networks = Extension("controller.critic.network.critic")

pytestmark = pytest.mark.usefixtures("folder")
SLOW = pytest.mark.slow


def named(
    game: Game,
    candidate: Critic,
    at: Callable[[float], Game] | None = None,
    box: np.ndarray | None = None,
    printed: Mapping[str, Game] | None = None,
) -> str:
    scheduled = None
    if at is not None:
        starts = (1.0, 3.0, 5.0, 8.0, 12.0, 16.0, 20.0)
        scheduled = Scheduled(lambda x: f"at dihedral {x:.4f} deg", at, starts)
    half_widths = np.ones(len(game.A)) if box is None else box
    others = other_games(game, Nearby(printed or {}, scheduled))
    return diagnose(JudgedGame(game), candidate, LIMIT, half_widths, others)


def wrong(game: Game, candidate: Critic) -> bool:
    """Return whether the errors of a critic exceed their limits."""
    errors = critic_errors(game, candidate, solved(game), LIMIT, usual_box(game).half_widths)
    return not all(check.ok for check in errors)


#: Mistakes whose names take a search for other games, and are found in the same way as others.
SEARCHED = (
    *("LQR gain", "delta² as delta, P", "delta² as delta, K", "another delta, K", "Q scaled, P"),
    *("R scaled, K", "discrete time, P", "discrete time, K", "discrete LQR, K", "I + A dt, K"),
)


@pytest.mark.parametrize(
    "mistake",
    [pytest.param(mistake, marks=[SLOW] if mistake in SEARCHED else []) for mistake in NAMED],
)
def test_a_planted_mistake_is_refused_and_named(game: Game, mistake: str) -> None:
    """A critic with a planted mistake is not exact, and the mistake is named."""
    kind, plant, words = NAMED[mistake]
    candidate = candidate_of(game, kind, plant)
    assert wrong(game, candidate)
    assert words in named(game, candidate)


@pytest.mark.parametrize(
    "mistake",
    [
        pytest.param(mistake, marks=[SLOW] if number else [])
        for number, mistake in enumerate(UNNAMED)
    ],
)
def test_an_unknown_mistake_fails_without_a_cause(game: Game, mistake: str) -> None:
    """A critic with an unknown mistake fails, and no mistake is named."""
    candidate = candidate_of(game, *UNNAMED[mistake])
    assert wrong(game, candidate)
    assert named(game, candidate) == ""


#: Two states and one input: too few numbers to fit several factors.
SMALL = Game([[0.0, 1.0], [-1.0, -1.0]], [[0.0], [1.0]], np.eye(2), np.eye(2), [[1.0]], 10.0)


#: Right critics, used in turn.
RIGHT = (("W", lambda game: weights_of(value(game)), ""), ("P", value, ""), ("K", gain, ""))


class NoGames:
    """No other games that a critic may solve."""

    def of_matrix(self, view: View) -> Iterator[Hypothesis]:
        yield from ()

    def of_network(self, view: View) -> Iterator[Hypothesis]:
        yield from ()


def named_under_noise(mistake: str, size: float, games: int, seed: int) -> int:
    """Return the number of noisy critics of random games that are diagnosed correctly.

    mistake: planted mistake, or "" for noise alone, for which no mistake may be named
    size: standard deviation of the relative noise
    games: number of games
    """
    rng = np.random.default_rng(seed)
    count = 0
    for index in range(games):
        game = random_game(rng)
        kind, plant, words = OF_ANY_GAME.get(mistake, RIGHT[index % 3])
        table = noisy(kind, plant(game), size, rng)
        candidate = candidate_of(game, kind, lambda _, table=table: table)
        reason = diagnose(JudgedGame(game), candidate, LIMIT, np.ones(len(game.A)), NoGames())
        if words:
            count += words in reason
        else:
            count += reason == ""
    return count


@pytest.mark.parametrize("mistake", OF_ANY_GAME)
def test_mistakes_under_1_percent_noise_are_named(mistake: str) -> None:
    """A mistake is named in three of three critics with noise of 1 %."""
    assert named_under_noise(mistake, 0.01, 3, 0) == 3


@pytest.mark.parametrize("games", [10, pytest.param(100, marks=SLOW)])
@pytest.mark.parametrize(
    "size", [0.01, *(pytest.param(size, marks=SLOW) for size in (0.003, 0.04))]
)
def test_noise_alone_has_no_cause_in_99_percent(size: float, games: int) -> None:
    """For noise alone, no mistake is named in at least 99 % of the critics."""
    assert named_under_noise("", size, games, 2) >= 0.99 * games


def test_a_common_factor_must_explain_the_error(game: Game) -> None:
    """A common factor is named if the remaining error is small, and not if it is larger."""
    table = noisy("P", 1.3 * value(game), 1.0, np.random.default_rng(3))
    noise = table - 1.3 * value(game)
    for share, says in ((0.02, ""), (0.002, "every entry of P is 1.3")):
        size = share * 0.3 / np.linalg.norm(noise) * np.linalg.norm(value(game))
        wrong = from_value(game, 1.3 * value(game) + size * noise)
        assert named(game, wrong).startswith(says) if says else named(game, wrong) == ""


def test_random_gain_errors_are_called_inconsistent(game: Game) -> None:
    """For an exact P with random errors in K, no reason is given except that P and K are
    inconsistent.
    """
    rng = np.random.default_rng(2)
    for size in 10.0 ** rng.uniform(-4.0, -1.0, 20):
        wrong = gain(game) * (1.0 + size * rng.standard_normal(gain(game).shape))
        reason = named(game, Critic(wrong, value(game), "P and K"))
        assert reason == "" or "do not belong together" in reason


@pytest.mark.parametrize(
    ("kind", "dynamics", "degrees", "other"),
    [
        ("P", "published", 15.0, 12.3),
        pytest.param("K", "published", 15.0, 12.3, marks=SLOW),
        pytest.param("K", "newton", 0.0, 0.5, marks=SLOW),
        pytest.param("K", "newton", 2.0, 1.0, marks=SLOW),
        pytest.param("K", "newton", 15.0, 15.1, marks=SLOW),
    ],
)
def test_a_critic_for_another_angle_is_named(
    kind: str, dynamics: str, degrees: float, other: float
) -> None:
    """A critic for another dihedral angle is named with this angle if the aircraft is given.

    Without the aircraft, no mistake is named.
    """
    game = game_at(degrees, dynamics)
    theirs = game_at(other, dynamics)
    candidate = candidate_of(game, kind, lambda _: value(theirs) if kind == "P" else gain(theirs))
    reason = named(game, candidate, lambda at: game_at(at, dynamics))
    assert reason.endswith(f"of another game, at dihedral {other:.4f} deg")
    assert named(game, candidate) == ""  # the plants cannot be told without the aircraft


@pytest.mark.parametrize("degrees", [5, pytest.param(15, marks=SLOW)])
def test_a_critic_of_the_printed_matrices_is_named(game: Game, degrees: int) -> None:
    """A critic that solves the printed, rounded matrices fails and is recognized."""
    printed = game_models()[f"published-{degrees}"]
    for candidate in (from_value(game, value(printed)), from_gain(game, gain(printed))):
        assert wrong(game, candidate)
        description = f"of the matrices printed for {degrees} deg"
        reason = named(game, candidate, printed={description: printed})
        assert reason.endswith(f"of another game, of the matrices printed for {degrees} deg")


def test_a_transposed_gain_is_named() -> None:
    """A transposed gain is recognized for a plant with as many inputs as states."""
    game = Game(
        [[-1.0, 0.4], [0.1, -2.0]], np.eye(2), np.eye(2), np.eye(2), np.diag([1.0, 3.0]), 5.0
    )
    assert named(game, from_gain(game, gain(game).T)) == "K is transposed"


def test_one_number_identifies_no_other_game() -> None:
    """From a scalar P alone, no other game is suggested. A value of half the exact one is named."""
    game = Game([[1.0]], [[1.0]], [[1.0]], [[1e-8]], [[1.0]], delta=2.0)
    assert named(game, from_value(game, value(game) * 1.2)) == ""
    assert named(game, from_value(game, value(game) / 2.0)).startswith("the value is half")


def test_another_delta_is_identified_from_three_entries() -> None:
    """The solution for another delta is identified from three entries of P, not from two of K."""
    candidate = SMALL.with_delta(4.0)
    assert "this is the solution of another game, at delta = 4" in named(
        SMALL, from_value(SMALL, value(candidate))
    )
    assert named(SMALL, from_gain(SMALL, gain(candidate))) == ""


# Networks fitted to the game at 15 deg by examples/train_a_network.py, right and with a mistake
# planted in each.

# trained/: V, gradient and policy are 6-32-32-k; gamma_120, steps_of_0.1_s and at_8_deg are
# 6-16-16-5 policies of other problems. All are tanh, float32, and take z / (7 ft/s, 0.1 rad, 0.1
# rad/s).
TRAINED = ROOT / "tests/verification/network/trained"
BOX = np.array([7.0, *[0.1] * 5])
DEGREES = np.array([1.0, *[np.pi / 180.0] * 5])
ORDER = [0, 2, 1, 3, 5, 4]
SCALE = ",".join(map(str, 1.0 / BOX))
NETWORK = ("--set", "activation=tanh", "--set", f"scale={SCALE}")


def layers(
    name: str, out: Any = 1.0, states: Any = slice(None), outputs: Any = slice(None)
) -> dict[str, Any]:
    """Return the state dict of a trained network with scaled outputs and reordered states and
    outputs.

    name: name of the network
    out: factor on the outputs, or one factor for each output
    states: order of the states
    outputs: order of the outputs
    """
    with np.load(TRAINED / f"{name}.npz") as stored:
        reasons = dict(stored)
    first, *_, weight, bias = reasons
    reasons[first] = reasons[first][:, states]
    factors = np.broadcast_to(np.asarray(out, dtype="float32"), reasons[bias].shape)
    reasons[weight], reasons[bias] = (
        (reasons[weight] * factors[:, None])[outputs],
        (reasons[bias] * factors)[outputs],
    )
    return reasons


#: Mistake -> (change of a network, how it is read, words of the reason).
MISTAKES: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "outputs swapped": (
        {"name": "policy", "outputs": [0, 2, 1, 4, 3]},
        {},
        "inputs are in the order 1, 3, 2, 5, 4",
    ),
    "slopes swapped": (
        {"name": "gradient", "outputs": [0, 2, 1, 4, 3, 5]},
        {},
        "slopes are in the order 1, 3, 2, 5",
    ),
    "no input scaling": (
        {"name": "policy"},
        {"scale": np.ones(6)},
        "the states look scaled by 6.9",
    ),
    "no input scaling, dV/dz": (
        {"name": "gradient"},
        {"scale": np.ones(6)},
        "the states look scaled by 6.9",
    ),
    "ReLU for tanh": (
        {"name": "policy"},
        {"activation": "relu"},
        "the activation is tanh, not relu",
    ),
    "ReLU for tanh, V": ({"name": "V"}, {"activation": "relu"}, "the activation is tanh, not relu"),
    "u = +K z": ({"name": "policy", "out": -1.0}, {}, "the gain has the wrong sign"),
    "gamma": ({"name": "gamma_120"}, {}, "this is the gain of another game, at delta = 1"),
    "degrees": (
        {"name": "policy"},
        {"scale": DEGREES / BOX},
        "states 2, 3, 4, 5 and 6 are in degrees",
    ),
    "degrees, dV/dz": (
        {"name": "gradient"},
        {"scale": DEGREES / BOX},
        "states 2, 3, 4, 5 and 6 are in degrees",
    ),
    "slopes per degree": (
        {"name": "gradient", "out": DEGREES},
        {},
        "slopes 2, 3, 4, 5 and 6 are in degrees",
    ),
    "discrete time": ({"name": "steps_of_0.1_s"}, {}, "in discrete time, a step of 0.1"),
    "sign of V": ({"name": "V", "out": -1.0}, {}, "the value has the wrong sign"),
    "half cost": ({"name": "V", "out": 0.5}, {}, "the value is half the exact one"),
    "states permuted": (
        {"name": "policy", "states": ORDER},
        {},
        "the states are in the order 1, 3, 2, 4, 6, 5",
    ),
    "no R": ({"name": "policy", "out": [100, 400, 400, 400, 50]}, {}, "R⁻¹ is missing"),
    "another angle": ({"name": "at_8_deg"}, {}, "this is the gain of another game, at dihedral 8."),
}


#: Mistakes that are planted above without a network, or here in another one.
RARE = ("discrete time", "another angle", "gamma", "ReLU for tanh, V")


@pytest.mark.parametrize(
    "mistake",
    [pytest.param(mistake, marks=[SLOW] if mistake in RARE else []) for mistake in MISTAKES],
)
def test_a_mistake_in_a_trained_network_is_named(game: Game, mistake: str) -> None:
    """A mistake planted in a trained network fails and is named."""
    changes, how, words = MISTAKES[mistake]
    path = network_files.torch_file("critic.pt", layers(**changes))
    candidate = networks.from_network(
        game, path, **({"activation": "tanh", "scale": 1.0 / BOX} | how)
    )
    assert wrong(game, candidate)
    assert words in named(game, candidate, game_at, BOX)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=SLOW) for name in ("policy", "V", "gradient")]
)
def test_networks_as_trained_have_no_cause(game: Game, name: str) -> None:
    """For the networks as trained, no mistake is named.

    For the network of V, the stated reason is that V is accurate but the policy of V is not.
    """
    candidate = networks.from_network(
        game,
        network_files.torch_file("critic.pt", layers(name)),
        activation="tanh",
        scale=1.0 / BOX,
    )
    reason = named(game, candidate, None, BOX)
    assert (
        reason.startswith("V is close, but its policy is off by") if name == "V" else reason == ""
    )


@pytest.mark.parametrize("names", [("V",), ("gradient", "policy"), ("V", "gradient"), ("policy",)])
def test_the_nearest_linear_critic_of_a_linear_one_is_itself(names: tuple[str, ...]) -> None:
    """Without constants, and with the gain that P implies where there is no policy."""
    z = ca.SX.sym("z", 2)
    P, K = np.array([[3.0, 0.5], [0.5, 0.2]]), np.array([[0.7, -0.4]])
    outputs = {
        "V": ca.bilin(ca.DM(P), z, z) + 2.0 * z[0] + 5.0,
        "gradient": 2.0 * ca.DM(P) @ z + 1.0,
        "policy": -ca.DM(K) @ z - 3.0,
    }
    critic = from_functions(SMALL, z, {name: outputs[name] for name in names}, "planted")
    found = nearest_linear(SMALL, critic, np.array([2.0, 30.0]))
    is_policy = "policy" in names
    assert pytest.approx(K if is_policy else SMALL.gain(P)) == found.K
    assert (found.P is None) is (names == ("policy",))
    assert found.P is None or pytest.approx(P) == found.P


def random_value(
    rng: np.random.Generator, hidden: int, gain: float, is_square: bool
) -> ca.Function:
    """Return V of an untrained network with two hidden layers.

    hidden: width of the hidden layers
    gain: factor on torch's initial weights
    is_square: whether V is the square of the output
    """
    z = ca.SX.sym("z", 6)
    h = z
    for width in (hidden, hidden, 1):
        reach = gain / np.sqrt(h.numel())
        W = rng.uniform(-reach, reach, (width, h.numel()))
        h = ca.DM(W) @ h + ca.DM(rng.uniform(-reach, reach, width))
        if width > 1:
            h = ca.tanh(h)
    return ca.Function("V", [z], [h**2 if is_square else h])


@pytest.mark.parametrize("draws", [1, pytest.param(100, marks=SLOW)])
def test_untrained_networks_have_no_cause(game: Game, draws: int) -> None:
    """For untrained networks, no mistake is named."""
    rng = np.random.default_rng(4)
    reasons = []
    for draw in range(draws):
        V = random_value(rng, (8, 32)[draw % 2], (1.0, 3.0, 10.0)[draw % 3], draw % 4 == 3)
        reasons.append(named(game, networks.from_network(game, V), None, BOX))
    assert not any(reasons), reasons


def test_only_a_plausible_discount_is_named(game: Game) -> None:
    """A discount is named as the mistake only for a plausible discount rate.

    P = Q / 5e4 would need a very large discount rate, and no discount is named.
    """
    assert named(game, from_value(game, game.Q / 5e4)) == ""
    P = value(discounted(game, 0.3))
    # z'Pz of a discounted cost satisfies A'P + P A + Q - P S P = 0.3 P; the largest entry is 2,500.
    assert game.residual(P) == pytest.approx(0.3 * P, abs=1e-8)
    assert "a discount of 0.3 1/s" in named(game, from_value(game, P))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["V", "policy", "gradient"])
def test_networks_trained_again_have_equal_errors(game: Game, name: str) -> None:
    """Training the stored networks again gives errors of equal size, to 50 %.

    A network with hidden layers of 64 is also checked.
    """
    again = fit(game, name, points=1500, steps=800)
    with np.load(TRAINED / f"{name}.npz") as kept:
        assert {key: entry.shape for key, entry in again.items()} == {
            key: entry.shape for key, entry in kept.items()
        }
    np.savez("again.npz", **again)
    searched = {"V": "value"}.get(name, name)
    errors = []
    for path in ("again.npz", TRAINED / f"{name}.npz"):
        critic = networks.from_network(game, path, activation="tanh", scale=1.0 / BOX)
        verdict = verify(game, critic, scope=Scope(ordinary_box(), flights=1))
        errors.append(verdict.value_of(f"searched_{searched}_error"))
    assert errors[0] == pytest.approx(errors[1], rel=0.5)
    np.savez("wide.npz", **fit(game, name, hidden=(64, 64), points=200, steps=20))
    data = answer("verify", *AT_15, "--weights", "wide.npz", *NETWORK, code=FAILED)
    assert (data["network"]["precision"], data["network"]["output"]) == ("float32", name)


@pytest.mark.parametrize(
    ("name", "points"), [("V", 3), *(pytest.param(x, 8, marks=SLOW) for x in ("V", "policy"))]
)
def test_the_search_finds_the_errors_of_grid(game: Game, name: str, points: int) -> None:
    """The search for errors of a network finds errors at least as large as those on a grid of
    states.

    points: number of values for each state
    """
    exact = solved(game)
    b = BOX
    z = np.array(np.meshgrid(*[np.linspace(-1.0, 1.0, points)] * 6)).reshape(6, -1) * b[:, None]
    largest = np.sqrt(game.R.diagonal()) * (np.abs(exact.K) @ b)
    u_size = np.maximum(largest, 1e-5 * largest.max()) / np.sqrt(game.R.diagonal())
    critic = networks.from_network(
        game, TRAINED / f"{name}.npz", activation="tanh", scale=1.0 / BOX
    )
    at = ca.SX.sym("z", 6)
    errors = {"policy": (critic.policy(at) + ca.DM(exact.K) @ at) / ca.DM(u_size)}
    if critic.value is not None:
        exact_V = ca.bilin(ca.DM(exact.P), at, at)
        errors["value"] = (critic.value(at) - critic.constant - exact_V) / (b @ np.abs(exact.P) @ b)
    reasons = {
        mistake.name: mistake.error
        for mistake in searches.search(
            searches.Comparison(critic, exact, np.sqrt(np.diag(game.R)), b)
        )[1]
    }
    for kind, error in errors.items():
        on_grid = np.array(ca.Function(kind, [at], [error])(z))
        assert reasons[kind] * (1.0 + 1e-9) >= np.abs(on_grid).max()


def test_several_critics_give_a_table_and_curve(game: Game) -> None:
    """Several critics and a folder of checkpoints give one table and a learning curve."""
    Path("runs").mkdir()
    for step, share in ((2, 3.0), (10, 1.5)):
        np.savez(f"runs/step_{step}.npz", K=share * gain(game))
    right = stored("right.npz", P=value(game))
    twice = stored("P.npz", P=2 * value(game))
    result = hfa(
        "verify",
        *AT_15,
        "--weights",
        "runs",
        right,
        twice,
        *("-o", "a.json", "--picture", "curve.png"),
    )
    assert result.code == FAILED
    data = json.loads(Path("a.json").read_text(encoding="utf-8"))["critics"]
    names = ["runs/step_2.npz", "runs/step_10.npz", right, twice]
    assert list(data) == names
    assert [mistake["ok"] for mistake in data.values()] == [False, False, True, False]
    assert data[names[0]]["K_rel_error"] > data[names[1]]["K_rel_error"]
    assert result.out.startswith("FAIL: 1 of 4 critics pass, on the aircraft at dihedral 15 deg")
    assert "\nP.npz: the value is twice the exact one" in result.out
    assert Path("curve.png").stat().st_size > 10_000
