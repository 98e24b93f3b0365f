"""Zero-sum games and bases: invalid input, policies, ψ(z) and its gradient, and W and P."""

import math
import re
from functools import partial

import numpy as np
import pytest
from cli import refused
from game_files import SMALL
from scipy.linalg import block_diag, expm

from controller.game.basis import q_extremum
from controller.game.zero_sum import q_function, rates_of_step
from hfa import BadInputError, Game


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"A": [[1.0, 2.0]]}, "A is 1 x 2; give a square matrix"),
        ({"A": [[1.0, 2.0], [3.0]]}, "A does not consist of rows of real numbers"),
        ({"A": np.ma.masked_equal(np.eye(2), 0.0)}, "A has masked entries"),
        ({"A": [[1.0, math.nan], [0.0, 1.0]]}, r"A\[0\]\[1\] is nan; give finite entries"),
        (
            {"A": [[1e150, 0.0], [0.0, 1.0]]},
            r"A\[0\]\[0\] is 1e\+150; give entries of at most 1e\+100",
        ),
        ({"A": np.zeros((0, 0))}, "a game needs at least one state and one input"),
        ({"B": [[1.0]]}, "B is 1 x 1; give 2 x 1, to match A and B"),
        ({"R": 1.0}, "the number of dimensions of R is 0"),
        ({"Q": [[1.0, 0.1], [0.0, 1.0]]}, "Q is not symmetric"),
        ({"B": np.eye(2), "R": [[1.0, 3.0], [3.0, 9.0]]}, "R is not positive definite"),
        ({"B": np.eye(2), "R": [[1e20, 1e10], [1e10, 1.0]]}, "R is not positive definite"),
        ({"R": None}, "Q or R is missing"),
        ({"E": np.zeros((2, 0))}, "A, B or E is empty"),
        ({"dt": -0.1}, "give the sample time"),
        ({"delta": 0.0}, "delta is 0.0; give a number from"),
        ({"delta": 1e-60}, "delta is 1e-60; give a number from"),
        ({"delta": 1e300}, r"delta is 1e\+300; .* from 1e-50 to 1e\+50, or inf"),
    ],
)
def test_ill_posed_games_are_refused(change, message):
    """A game with a wrong shape, sign or number is refused by one line."""
    assert re.search(message, refused(Game, **(SMALL | change)))


@pytest.mark.parametrize("delta", [1.5, math.inf])
@pytest.mark.parametrize("dt", [None, 0.1])
def test_policies_are_stationary_points_of_the_game(dt, delta):
    """(u, d) = (-K z, L z) is the stationary point of the cost of a step and z'P z afterwards, or of the
    Hamiltonian, with cross weights N. Without N, the input v = u + F z has the gain K - F.
    """
    random = np.random.default_rng(2)
    A, B, E, N = (random.normal(size=(3, columns)) for columns in (3, 2, 1, 2))
    Q, P, R, N = 9.0 * np.eye(3), np.diag([3.0, 2.0, 1.0]), np.diag([2.0, 1.0]), 0.1 * N
    discount = 0.9 if dt else 1.0
    game = Game(A, B, E=E, Q=Q, R=R, N=N, delta=delta, dt=dt, discount=discount)
    players = [B, E] if delta < math.inf else [B]
    plant, n = np.hstack([A, *players]), 3
    weights = block_diag(np.block([[Q, N], [N.T, R]]), *[[[-(delta**2)]]] * (len(players) - 1))
    J = plant if dt else np.eye(*plant.shape)
    H = weights + (plant.T @ P @ plant if dt else J.T @ P @ plant + plant.T @ P @ J) * discount
    K, L = game.gain(P), game.disturbance_gain(P)
    assert (L == 0.0).all() == (delta == math.inf)
    np.testing.assert_allclose((H @ np.vstack([np.eye(n), -K, L])[: len(H)])[n:], 0.0, atol=1e-12)
    if dt:
        np.testing.assert_allclose(q_function(game, P), H, rtol=1e-12)
    other = game.without_cross_weights
    np.testing.assert_allclose(other.policies(P)[0], K - np.linalg.solve(R, N.T), atol=1e-12)
    assert not other.N.any()
    loop, both = A - B @ K + E @ L, {True: "(x, u, w)", False: "(x, u)"}[delta < math.inf]
    np.testing.assert_allclose(game.worst_case_loop(P), loop, atol=1e-12)
    np.testing.assert_allclose(other.worst_case_loop(P), loop, atol=1e-12)
    weight = R + discount * B.T @ P @ B if dt else R
    np.testing.assert_allclose(game.suboptimality_weight(P), weight, rtol=1e-12)
    if dt:  # the extremum over (u, w), and over u alone
        found = q_extremum(game, H)
        np.testing.assert_allclose(found["K"], K, atol=1e-12)
        assert ("L" in found) == (delta < math.inf)
        np.testing.assert_allclose(found.get("L", L), L, atol=1e-12)
        policies = np.vstack([np.eye(n), -K, L])[: len(H)]
        np.testing.assert_allclose(found["P"], policies.T @ H @ policies, atol=1e-12)
        assert "L" not in q_extremum(game, H[:5, :5])
        for wrong, said in (
            (H[:4, :4], f"H is 4 x 4; give .*{re.escape(both)}$"),
            (H + np.eye(len(H), k=1), "H is not symmetric"),
            (H * (np.arange(len(H)) < n), "not symmetric"),
            (np.diag(np.arange(5) < n) * 1.0, "H over the inputs is singular"),
        ):
            assert re.search(said, refused(q_extremum, game, wrong))
    with pytest.raises(BadInputError, match="at least one state and one input"):
        game.select([])


@pytest.mark.parametrize(("dt", "R"), [(None, [2.0, 1.0]), (0.1, [2.0, 1.0]), (0.1, [2.0, 0.0])])
def test_the_game_without_cross_weights_costs_the_same(dt, R):
    """With v = u + F z, the rates of the states and the cost rate of any z and u are the same, also
    where an input has no weight.
    """
    random = np.random.default_rng(5)
    A, B, N = (random.normal(size=(3, columns)) for columns in (3, 2, 2))
    R = np.diag(R)
    game = Game(A, B, Q=9.0 * np.eye(3), R=R, N=N @ R, dt=dt)
    other = game.without_cross_weights
    np.testing.assert_array_equal(other.Q, other.Q.T)
    for _ in range(3):
        z, u = random.normal(size=3), random.normal(size=2)
        v = u + game.F @ z
        np.testing.assert_allclose(other.A @ z + B @ v, A @ z + B @ u, atol=1e-12)
        cost = np.r_[z, u] @ game.weights @ np.r_[z, u]
        assert np.r_[z, v] @ other.weights @ np.r_[z, v] == pytest.approx(cost)
    assert other.without_cross_weights is other


def test_a_sample_is_the_flight_with_held_inputs():
    """A, B and E of a sample are those of the exponential, in other units too, and `rates_of_step`
    finds the rates again. Weights are times dt, delta times its root.
    """
    random = np.random.default_rng(6)
    A, B, E = (random.normal(size=(3, columns)) for columns in (3, 2, 1))
    given = {"Q": np.eye(3), "R": np.eye(2), "N": np.full((3, 2), 0.1), "delta": 3.0}
    for units in (np.ones(3), np.array([1e-7, 1.0, 1e6])):
        game = Game(A * units[:, None] / units, B * units[:, None], E=E * units[:, None], **given)
        step = game.sampled(0.2, 0.9)
        whole = expm(0.2 * np.block([[A, B, E], [np.zeros((3, 6))]]))[:3]
        found = np.hstack(
            [step.A * units / units[:, None], np.hstack([step.B, step.E]) / units[:, None]]
        )
        np.testing.assert_allclose(found, whole, atol=1e-12)
        assert (step.dt, step.discount, step.delta) == (0.2, 0.9, pytest.approx(3.0 * 0.2**0.5))
        for each in "QRN":
            np.testing.assert_allclose(getattr(step, each), 0.2 * given[each])
    np.testing.assert_allclose(rates_of_step(whole, 0.2), np.hstack([A, B, E]), atol=1e-12)
    for pole in (-0.5, 0.0):
        assert rates_of_step(np.array([[pole, 1.0]]), 0.2) is None
    said = refused(game.sampled, 1e-20)
    advised = float(re.search(r"at least (\S+) s", said)[1])
    assert "too short" in said
    assert "too short" in refused(game.sampled, 0.9 * advised)
    game.sampled(1.1 * advised)
    assert "dt is 0" in refused(game.sampled, 0.0)
    assert "in discrete time there are" in refused(step.sampled, 0.1)


def test_games_with_other_inputs_and_what_they_refuse():
    """`select` keeps the columns of the named inputs in their order; refusals say what to do."""
    game = Game(
        np.eye(2), [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], Q=[1.0, 0.0], R={"u1": 1, "u2": 2, "u3": 3}
    )
    chosen = game.select(["u3", "u1"])
    assert chosen.names.inputs in (("u3", "u1"), ("u1", "u3"))
    order = [int(name[1]) - 1 for name in chosen.names.inputs]
    np.testing.assert_array_equal(chosen.B, game.B[:, order])
    np.testing.assert_array_equal(chosen.R, np.diag([1.0, 2.0, 3.0])[np.ix_(order, order)])
    assert "P is 3 x 3; give 2 x 2" in refused(game.gain, np.eye(3))
    assert "such as the transpose of K" in refused(game.checked_gain, np.ones((2, 3)))
    assert "K is 1 x 2; give 3 x 2, inputs x states" in refused(game.checked_gain, np.ones((1, 2)))
    np.testing.assert_array_equal(chosen.select(["u1"]).checked_gain([1.0, 2.0]), [[1.0, 2.0]])


@pytest.mark.parametrize("discount", [0.0, -0.5, 1.0 + 2**-52, 1.5, 2.0, np.nan])
def test_a_discount_is_above_0_and_at_most_1(discount):
    """Costs of later steps count at most as much: another discount is refused."""
    game = partial(Game, [[0.5]], [[1.0]], Q=[1.0], R=[1.0], dt=0.1)
    assert game(discount=1.0).discount == 1.0
    with pytest.raises(BadInputError, match="discount is"):
        game(discount=discount)
