"""Reasons of verdicts."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from cli import answer
from game_files import small, stored
from game_samples import failed_names
from planted_critics import gain, other_root, value, weights_of

from controller import critic_in, load_game
from controller.critic.critic import from_q_function
from hfa import Critic, Game, from_gain, from_network, from_value, from_weights, solve, verify
from hfa.main import DONE, FAILED

pytestmark = pytest.mark.usefixtures("folder")


def test_a_value_inaccurate_for_its_gain_is_named():
    """The reason states that a P with eight right digits is not accurate enough for its gain.

    The input moves both states equally. This motion costs almost nothing (Q is near singular along
    it), and K = B'P is a small difference of large numbers.
    """
    A = np.array([[-1.0, 0.1], [0.1, -1.0]])
    Q = np.array([[1.0, -0.999], [-0.999, 1.0]])
    game = Game(A, [[1.0], [1.0]], E=np.zeros((2, 1)), Q=Q, R=[[1.0]], delta=np.inf)
    P = np.vectorize(lambda entry: float(f"{entry:.8g}"))(value(game))
    verdict = verify(game, from_value(game, P))
    failed = failed_names(verdict.checks)
    assert failed == {"K_rel_error", "K_balanced_error", "K_entry_error", "policy_rel_error"}
    assert verdict.reason.startswith(
        "P is right within the limit; the K that follows from it is off by "
        f"{verdict.K_rel_error:.2g}"
    )


# Planted mistakes.

TWO_INPUTS = Game(
    [[-1.0, 0.4, 0.0], [0.1, 0.5, 1.0], [0.3, 0.0, -2.0]],
    [[1.0, 0.0], [0.5, 1.0], [0.0, 0.3]],
    E=[[0.3], [0.1], [0.2]],
    Q=np.eye(3),
    R=[1.0, 0.5],
    delta=6.0,
)

ANGLES = np.array([1.0, np.pi / 180.0, np.pi / 180.0])
ORDER = [0, 2, 1]
ROW, COLUMN = np.triu_indices(3)
#: Changes the sign of the third state.
FLIPPED = np.array([1.0, 1.0, -1.0])


def at(*places, rows, factor):
    """Return factors (rows, 3) on the entries of a matrix: `factor` at the places, and 1 elsewhere."""
    factors = np.ones((rows, 3))
    for place in places:
        factors[place] = factor
    return factors


#: Function exact P -> what is stored as P (below: as W, as K), and words of the reason.
OF_P = [
    (lambda P: np.triu(P), "P is not symmetric: the value"),
    (lambda P: np.triu(P) + np.triu(P, 1), "P is not symmetric; its symmetric part is exact"),
    (lambda P: -P, "the value has the wrong sign"),
    (lambda P: P / 2, "the value is half the exact one"),
    (lambda P: P * (2.0 - np.eye(3)), "are 2 times too large"),
    (lambda P: P * np.where(np.eye(3) == 1.0, 1.0, 2.0**0.5), "√2 times too large"),
    (lambda P: P[ORDER][:, ORDER], "the states are in the order 1, 3, 2"),
    (lambda P: P * np.outer(ANGLES, ANGLES), "states 2 and 3 are in degrees"),
    (lambda P: P * np.outer(FLIPPED, FLIPPED), "state 3 has the wrong sign"),
    (lambda P: P * at((1, 2), (2, 1), rows=3, factor=10.0), "only P(2, 3) differs"),
]
OF_W = [
    (lambda P: P[ROW, COLUMN], "the weights lack the factor 2 of products z_i z_j"),
    (
        lambda P: P[ROW, COLUMN] / 2,
        "lack the factor 2 of products z_i z_j and are of half the cost",
    ),
    (
        lambda P: P[ROW, COLUMN] * np.where(ROW == COLUMN, 1.0, 2.0**0.5),
        "those of products √2 z_i z_j (svec)",
    ),
    (lambda P: P.T[np.tril_indices(3)], "stored column by column and lack the factor 2"),
    (lambda P: weights_of(P)[np.argsort(ROW != COLUMN, kind="stable")], "with the squares first"),
]
OF_K = [
    (lambda K: -K, "the gain has the wrong sign: the policy is u = -K z"),
    (lambda K: 2.0 * K, "the gain is twice the exact one"),
    (lambda K: K[:, ORDER], "the states are in the order 1, 3, 2"),
    (lambda K: K[[1, 0]], "the inputs are in the order 2, 1"),
    (lambda K: K * ANGLES, "states 2 and 3 are in degrees"),
    (lambda K: -K * ANGLES, "wrong sign, and states 2 and 3 are in degrees"),
    (lambda K: K / [1.0, 1.0, np.pi / 180.0], "state 3 is off by 180/pi"),
    (lambda K: K / [0.3048, 1.0, 1.0], "state 1 is in metres in place of feet"),
    (lambda K: K / ANGLES[:2, None], "input 2 is in degrees"),
    (lambda K: K * FLIPPED, "state 3 has the wrong sign"),
    (lambda K: K * FLIPPED[1:, None], "input 2 has the wrong sign"),
    (lambda K: K.T.reshape(2, 3), "but its entries are stored column by column"),
    (lambda K: K * at((1, 0), rows=2, factor=-1.0), "only K(2, 1) differs"),
]


@pytest.mark.parametrize(
    ("make", "exact", "mistaken", "words"),
    [
        *((from_value, value, *each) for each in OF_P),
        *((from_weights, value, *each) for each in OF_W),
        *((from_gain, gain, *each) for each in OF_K),
        (from_gain, lambda game: np.diag(np.diag(game.R)) @ gain(game), np.copy, "R⁻¹ is missing"),
    ],
)
def test_a_planted_mistake_fails_and_is_named(make, exact, mistaken, words):
    """A critic of the exact P or K with a mistake fails, and its reason names the mistake.

    make, exact: functions of the game: the critic of a matrix, and the exact P or K
    mistaken: function exact matrix -> matrix with the mistake
    """
    verdict = verify(TWO_INPUTS, make(TWO_INPUTS, mistaken(exact(TWO_INPUTS))))
    assert not verdict.ok
    assert words in verdict.reason


@pytest.mark.parametrize(
    "critic",
    [
        lambda game: from_value(game, other_root(game)),
        lambda game: from_value(game, value(replace(game, A=game.A * 1.01))),
        lambda game: from_gain(game, np.zeros_like(game.B.T)),
        lambda game: from_value(game, np.zeros_like(game.A)),
    ],
)
def test_a_critic_of_another_plant_or_root_fails_without_a_reason(critic):
    """Another root of the Riccati equation, the value of another plant, and zeros fail without a
    reason, and the report says what to compare with the training. The reports on an exact gain and
    on twice the gain, a mistake that is named, do not say so.
    """
    verdict = verify(TWO_INPUTS, critic(TWO_INPUTS))
    assert (verdict.ok, verdict.reason) == (False, "")
    assert "Compare signs, units and order" in str(verdict)
    for factor in (1.0, 2.0):
        explained = verify(TWO_INPUTS, from_gain(TWO_INPUTS, factor * gain(TWO_INPUTS)))
        assert "Compare signs" not in str(explained)


SAMPLED = TWO_INPUTS.sampled(0.02, 0.99)
UNSTABLE = Game(
    [[0.0, 1.0], [2.0, -0.5]], [[0.0], [1.0]], Q=np.eye(2), R=[1.0], E=[[0.0], [1.0]], delta=5.0
)
#: Both inputs move the states along one direction, so that all rows of the exact K are multiples.
ALONG_ONE = replace(TWO_INPUTS, B=np.outer([1.0, 0.5, 0.2], [1.0, 2.0]))


def rounded(game):
    """Return the critic of the exact gain with three digits."""
    return from_gain(game, np.vectorize(lambda entry: float(f"{entry:.3g}"))(gain(game)))


def noisy(game):
    """Return the critic of the exact P with relative noise of 1e-6, a little above the limit."""
    noise = np.random.default_rng(0).normal(0.0, 6e-7, (3, 3))
    return from_value(game, value(game) * (1.0 + noise + noise.T))


def with_wrong_entry_of_H(game):
    """Return the critic of the exact H with one entry that is off by 1 %."""
    H = solve(game).H
    H[1, 1] *= 1.01
    return from_q_function(game, H)


@pytest.mark.parametrize(
    ("game", "critic", "limit", "reason"),
    [
        (UNSTABLE, rounded, 8e-4, ""),  # with R = 1, K and R K are the same: no missing R⁻¹
        (
            TWO_INPUTS,
            lambda game: from_value(game, 0.99999 * value(game)),
            1e-6,
            "0.99999 times the exact",
        ),
        (TWO_INPUTS, noisy, 1e-6, ""),
        (TWO_INPUTS, lambda game: from_value(game, np.linalg.cholesky(value(game))), 1e-6, ""),
        (
            TWO_INPUTS,
            lambda game: Critic(gain(game), 1.1 * np.eye(3) + value(game)),
            1e-6,
            "P implies",
        ),
        # Any K along the exact one has columns that are multiples of those of the exact K.
        (ALONG_ONE, lambda game: from_gain(game, gain(game) * [0.2, 3.0, 7.0]), 1e-6, ""),
        (SAMPLED, with_wrong_entry_of_H, 1e-6, ""),
    ],
)
def test_a_reason_is_given_only_if_a_mistake_explains_the_errors(game, critic, limit, reason):
    """A wrong critic whose errors no mistake explains has the reason "": a K with three digits, noise,
    the Cholesky factor of P, columns of K in a game with a K of rank 1, one entry of H. Mistakes in
    the same games have their reason.
    """
    verdict = verify(game, critic(game), limit=limit)
    assert not verdict.ok
    assert reason in verdict.reason
    assert bool(verdict.reason) == bool(reason)


#: Game of which the gain is exact, on which game it is judged, and the reason.
OTHER_GAMES = {
    "delta": (TWO_INPUTS.with_delta(9.0), TWO_INPUTS, "K is exact for delta 9, not 6"),
    "no disturbance": (TWO_INPUTS.with_delta(np.inf), TWO_INPUTS, "without disturbance"),
    "R": (replace(TWO_INPUTS, R=4.0 * TWO_INPUTS.R), TWO_INPUTS, "exact for R 4 times as large"),
    "sampled": (TWO_INPUTS.sampled(0.05), TWO_INPUTS, "sampled with dt 0.05 s"),
    "discount": (TWO_INPUTS.sampled(0.02, 0.97), SAMPLED, "for discount 0.97, not 0.99"),
    "continuous": (TWO_INPUTS, SAMPLED, "K is exact for the game in continuous time"),
}


@pytest.mark.parametrize("number", OTHER_GAMES)
def test_the_game_of_which_a_gain_is_exact_is_named(number):
    """The reason of a wrong gain names the number by which the game of its training differs."""
    trained, game, says = OTHER_GAMES[number]
    assert says in verify(game, from_gain(game, gain(trained))).reason


def test_other_games_are_found_in_all_units():
    """A gain that is exact for three times R is recognized in a game whose states and inputs have
    units that differ by factors of 1e-3 to 1e3.
    """
    x, u = np.array([1e-3, 1.0, 50.0]), np.array([1e3, 0.01])  # sizes of the new units in the old
    A, B, E = (M / x[:, None] for M in (TWO_INPUTS.A * x, TWO_INPUTS.B * u, TWO_INPUTS.E))
    game = Game(A, B, E=E, Q=x**2, R=TWO_INPUTS.R * np.outer(u, u), delta=22.8)
    K = gain(replace(game, R=3.0 * game.R))
    assert verify(game, from_gain(game, K)).reason == "K is exact for R 3 times as large"


def test_a_gain_only_near_that_of_another_game_is_not_called_exact_for_it():
    """A gain whose entries are off by 2 % from the exact gain of another game is not said to be exact
    for that game.
    """
    trained, game, _ = OTHER_GAMES["delta"]
    K = gain(trained) * (1.0 + 0.02 * np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, 1.0]]))
    assert "exact for" not in verify(game, from_gain(game, K)).reason


@pytest.mark.parametrize("delta", [6.0, np.inf])
def test_the_order_of_an_action_value_is_named(delta):
    """An exact H whose blocks are in the order (u, x, w) fails, and the reason names both orders; half
    of H fails with its factor, and H itself passes. Without disturbance (delta inf), H has no w.
    """
    game = SAMPLED.with_delta(delta)
    H = solve(game).H
    first = [*range(3, 5), *range(3), *range(5, len(H))]  # the two inputs before the three states
    order = "(u, x, w)" if delta == 6.0 else "(u, x)"
    for matrix, says in (
        (H[np.ix_(first, first)], f"H is in the order {order}; it must be in the order"),
        (H / 2.0, "the action value is half the exact one"),
    ):
        verdict = verify(game, critic_in(stored("H.npz", H=matrix), game))
        assert not verdict.ok
        assert verdict.reason.startswith(says)
    assert verify(game, critic_in(stored("H.npz", H=H), game)).ok


ONE_INPUT = Game([[-1.0, 0.4], [0.1, -2.0]], [[1.0], [0.5]], Q=np.eye(2), R=[[1.0]])
Z = ca.SX.sym("z", 2)


SQUARE = Game(ONE_INPUT.A, np.eye(2), Q=np.eye(2), R=[1.0, 3.0], delta=5.0)
SAMPLED_ONE = ONE_INPUT.sampled(0.05, 0.99)


def scaled(factors):
    """Return a game and the critic of its exact gain times factors."""
    return TWO_INPUTS, from_gain(TWO_INPUTS, gain(TWO_INPUTS) * factors)


def function(game, name, output):
    """Return a game and the critic of the function `output` of z, the exact u and the exact V.

    name: name of the function, by which its output is read: "V", else a policy
    """
    z = ca.SX.sym("z", len(game.A))
    u, V = -ca.DM(gain(game)) @ z, ca.bilin(ca.DM(value(game)), z, z)
    return game, from_network(game, ca.Function(name, [z], [ca.densify(output(z, u, V))]))


@pytest.mark.parametrize(
    ("case", "says"),
    [
        ((SQUARE, from_gain(SQUARE, gain(SQUARE).T)), "K is transposed"),
        # of a training whose costs were not multiplied by dt
        (
            (SAMPLED_ONE, Critic(gain(SAMPLED_ONE), 20.0 * value(SAMPLED_ONE), "P and K")),
            "every entry of P is 1/dt times",
        ),
        (scaled([[0.2], [0.7]]), "each row of K is a multiple of the exact one (u1 0.2, u2 0.7)"),
        (scaled([0.2, 3.0, 7.0]), "(x1 0.2, x2 3, x3 7), as of a state that is normalized"),
        (scaled([[0.0], [1.0]]), "u1 is never moved; the other rows of K are exact"),
        (
            function(TWO_INPUTS, "f", lambda z, u, V: ca.vertcat(0.0, u[1])),
            "u1 is never moved; the other rows of K are exact",
        ),
        # the one output of a network on a plant with one input is read as u
        (function(ONE_INPUT, "f", lambda z, u, V: V), "if it is V: --network V=NAME"),
        (
            function(TWO_INPUTS, "f", lambda z, u, V: 0.01 - u),
            "not 0: a bias; the gain has the wrong sign",
        ),
        (
            function(ONE_INPUT, "V", lambda z, u, V: ca.sum1(ca.tanh(z))),
            "V of the network has no curvature at the trim",
        ),
    ],
)
def test_what_is_wrong_with_a_policy_or_a_value_is_named(case, says):
    """Each critic of a game has the reason `says`, and no nonsmooth point is found in it."""
    game, critic = case
    assert "nonsmooth point" not in critic.origin
    assert says in verify(game, critic, flights=1).reason


@pytest.mark.parametrize(
    ("formula", "words"),
    [
        (lambda A, B, P, R, c: c * np.linalg.solve(R + c * B.T @ P @ B, B.T @ P), "A is missing"),
        (lambda A, B, P, R, c: c * np.linalg.solve(R + c * B.T @ B, B.T @ A), "P is missing"),
        (
            lambda A, B, P, R, c: np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A),
            "the discount is missing",
        ),
        (lambda A, B, P, R, c: c * np.linalg.solve(R, B.T @ P @ A), "R⁻¹ is in place of"),
    ],
)
def test_a_wrong_formula_of_a_gain_in_steps_is_named(formula, words):
    """A gain by a wrong formula of A, B, the exact P, R and the discount c has its reason."""
    game = replace(SQUARE.sampled(0.1, 0.95), delta=np.inf)
    K = formula(game.A, game.B, value(game), game.R, game.discount)
    assert words in verify(game, from_gain(game, K)).reason


def test_a_nonsmooth_point_at_the_trim_is_the_first_finding():
    """A policy with two slopes at the trim has the nonsmooth point in the first line and in the
    reason. One with 1.5 times the exact slope on both sides has not.
    """
    exact = ca.DM(gain(ONE_INPUT)) @ Z
    for above, below, is_nonsmooth in ((2.0, 0.5, True), (1.5, 1.5, False)):
        u = -ca.if_else(exact > 0.0, above * exact, below * exact)
        verdict = verify(ONE_INPUT, from_network(ONE_INPUT, ca.Function("policy", [Z], [u])))
        assert ("nonsmooth point" in verdict.reason) == is_nonsmooth
        assert ("nonsmooth point" in verdict.report().title.partition("\n")[0]) == is_nonsmooth


# A file that holds more than one of W, P and K: each is judged, none hides another.


@pytest.mark.parametrize(
    ("in_file", "factors", "said"),
    [
        ("WPK", {}, ""),
        ("PK", {"K": -1.0}, "the gain has the wrong sign"),
        ("WK", {"K": 2.0}, "the gain is twice the exact one"),
        ("WK", {"W": 10.0}, "every entry of P is 10 times the exact one"),
        ("PK", {"P": 10.0}, "every entry of P is 10 times the exact one"),
    ],
)
def test_each_part_of_a_file_is_checked(in_file, factors, said):
    """Each of W, P and K in a file is checked, and a wrong one is named. The file has the letters
    `in_file`, with the exact matrices times `factors`.

    The errors of P, which is computed from W where the file has no P, and of K are printed.
    """
    plant = small("plant.json")
    game = load_game(plant)
    parts = {"W": weights_of(value(game)), "P": value(game), "K": gain(game)}
    file = stored("all.npz", **{key: factors.get(key, 1.0) * parts[key] for key in in_file})
    data = answer("verify", "--model", plant, "--weights", file, code=FAILED if said else DONE)
    assert data["diagnosis"].startswith(said)
    assert bool(data["diagnosis"]) == bool(said)
    for name, key in (("P", "P" if "P" in in_file else "W"), ("K", "K")):
        error = abs(factors.get(key, 1.0) - 1.0)
        assert data[f"{name}_rel_error"] == pytest.approx(error, rel=1e-6, abs=1e-12)
