"""The check of critics. The exact critic passes, and each planted error is found, in any units."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cli import assert_refused, hfa
from game_files import AT_15, stored
from game_samples import failed_names, game_in
from planted_critics import gain, solved, value, weights_of

from controller import basis, load_game
from hfa import (
    BadInputError,
    Critic,
    Game,
    Model,
    NoSolutionError,
    Signal,
    TrimCondition,
    from_gain,
    from_value,
    from_weights,
    game as game_on,
    learn,
    linearize,
    read_critic,
    trim,
    verify,
)
from hfa.main import BAD_INPUT
from hfa_model import INPUTS, LINEAR_STATES
from verification import Box, Scope, relative_error

QUADRATIC = basis("quadratic", 6)
RICHER = pytest.mark.parametrize(
    "name",
    [
        *(pytest.param(f"quadratic+{x}", marks=pytest.mark.slow) for x in ("linear", "quartic")),
        "paper",
    ],
)
BOX = np.array([7.0, 0.1, 0.1, 0.1, 0.1, 0.1])
FEW = Scope(flights=1)
pytestmark = pytest.mark.usefixtures("folder")


def failed(game: Game, candidate: Critic, **how: Any) -> set[str]:
    return failed_names(verify(game, candidate, **how).checks)


def over_the_box(game: Game, candidate: Critic, scope: Scope = FEW) -> dict[str, float]:
    checks = verify(game, candidate, scope=scope).checks
    return {check.name: check.value for check in checks}


@pytest.mark.parametrize("name", ["quadratic", "quadratic+quartic", "paper", "cubic"])
def test_the_exact_weights_pass_in_every_basis(game: Game, name: str) -> None:
    """The weights of the exact V pass in each basis, with the disk margin of the exact solution."""
    functions = basis(name, 6)
    check = verify(game, from_weights(game, functions.weights(value(game)), functions))
    assert check.ok, failed_names(check.checks)
    assert max(check.P_rel_error, check.K_rel_error) <= 1e-12
    assert check.reason == ""
    data = check.to_dict()
    assert data["disk_margin"] == pytest.approx(data["disk_margin_exact"], rel=1e-6)


def rank_deficient_weights(game: Game) -> tuple[np.ndarray, float, int]:
    """Return weights with a Bellman residual of 0 on 15 samples, the largest relative residual, and
    the rank of the samples.

    Newton steps of least norm, beginning at the LQR, lead to these weights.
    """
    z = np.random.default_rng(3).standard_normal((15, 6)) / np.sqrt(np.diag(value(game)))
    weights = weights_of(value(game.with_delta(math.inf)) * 1.2)
    for _ in range(30):
        P = QUADRATIC.matrix(weights)
        residual = np.einsum("ni,ij,nj->n", z, game.residual(P), z)
        sigma = np.einsum("nmi,ni->nm", QUADRATIC.gradient(z), z @ (game.A - game.S @ P).T)
        weights = weights - np.linalg.pinv(sigma) @ residual
    size = np.abs(np.einsum("ni,ij,nj->n", z, game.Q, z)).max()
    return weights, float(np.abs(residual).max() / size), int(np.linalg.matrix_rank(sigma))


def result_of(game: Game, weights: np.ndarray, rank: int) -> Any:
    run = learn(game, seed=0)
    K = game.gain(QUADRATIC.matrix(weights))
    return replace(run, W=weights, K=K, excitation=replace(run.excitation, rank=rank))


def test_a_critic_of_poor_data_is_refused(game: Game) -> None:
    """A critic learned from too few samples fails, although the residual on these samples is tiny."""
    weights, residual, rank = rank_deficient_weights(game)
    assert residual < 1e-10
    run = result_of(game, weights, rank)
    check = verify(game, run)
    assert {"P_rel_error", "riccati_residual", "data_rank"} <= failed_names(check.checks)
    assert "rank 15 of 21" in check.reason


# Numbers of extreme size, wrong shapes, games without a solution.


@pytest.mark.filterwarnings(
    "ignore:Input"
)  # SciPy warns of a Lyapunov equation that is singular within rounding
def test_critics_that_overflow_or_are_nan_fail(game: Game) -> None:
    """Critics of size 1e40 to 1e300, and weights with nan or inf, fail without an exception."""
    for size in (1e40, 1e60, 1e300):  # finite, but P S P is not
        for candidate in (
            from_value(game, size * value(game)),
            from_gain(game, -size * gain(game)),
        ):
            assert "K_rel_error" in failed(game, candidate)
    for number in (np.nan, np.inf):
        weights = weights_of(value(game))
        weights[2] = number
        with np.errstate(invalid="ignore"):
            assert {"K_rel_error", "control_loop_abscissa"} <= failed(
                game, from_weights(game, weights)
            )


def test_wrong_shapes_and_numbers_are_named(
    game: Game,
) -> None:
    """W, P and K with wrong shapes or entries that are not real numbers are refused by name.

    A critic of a game without a solution is refused, too.
    """
    makers = {
        "W": (from_weights, np.ones(21)),
        "P": (from_value, np.eye(6)),
        "K": (from_gain, np.ones((5, 6))),
    }
    shapes = {
        "W": (np.ones(20), "20 weights"),
        "P": (np.eye(5), "P is 5 x 5"),
        "K": (np.ones((6, 5)), "K is 6 x 5"),
    }
    for held, (make, right) in makers.items():
        wrong, message = shapes[held]
        with pytest.raises(BadInputError, match=message):
            make(game, wrong)
        for wrong in (right + 1j, [[1.0], [1.0, 2.0]], right.astype(str)):
            with pytest.raises(
                BadInputError, match=f"({held}|weights) does not consist of rows of real numbers"
            ):
                make(game, wrong)
    with pytest.raises(NoSolutionError, match="delta_min"):
        verify(game.with_delta(50.0), from_gain(game, np.zeros((5, 6))))
    with pytest.raises(BadInputError, match=r"K is 6 x 5.*such as the transpose of K"):
        from_gain(game, np.zeros((6, 5)))


def test_only_a_critic_of_a_game_is_checked(game: Game) -> None:
    """An array of another shape is refused."""
    K = gain(game)
    for given, named in (
        (np.ones((2, 3)), "shape .2, 3."),
        (np.ones(3).tolist(), "3 weights"),
    ):
        with pytest.raises(BadInputError, match=named):
            verify(game, given)
    assert verify(game, K.tolist()).grade == "exact"
    assert verify(game, from_gain(game, (1.01 * K).tolist())).grade == "near"


def test_solutions_and_runs_are_critics(game: Game) -> None:
    """`verify` accepts a solution and a training run as critics."""
    exact = solved(game)
    assert verify(game, exact).ok
    run = learn(game, seed=0)
    of_run = verify(game, run)
    assert of_run.ok
    names = {check.name for check in of_run.checks}
    of_critic = verify(game, run.critic(game))
    assert {check.name for check in of_critic.checks} == names - {"data_rank"}


def test_a_file_is_read_for_its_game(game: Game) -> None:
    """A gain can be read from a file without a game. For a value, or a gain with units, a game is
    required.
    """
    np.savez("K.npz", K=gain(game))
    np.savez("P.npz", P=value(game))
    for file in ("K.npz", "P.npz"):
        assert verify(game, read_critic(file, game)).ok
    assert np.array_equal(read_critic("K.npz").K, gain(game))
    np.savez("in_SI.npz", K=gain(game), state_units=["m/s", *game.names.state_units[1:]])
    for file in ("P.npz", "in_SI.npz"):
        with pytest.raises(BadInputError, match=f"{file} cannot be read without"):
            read_critic(file)
    with pytest.raises(BadInputError, match="no such file"):
        read_critic("none.npz", game)


def test_wrong_limits_and_constants_are_named(game: Game) -> None:
    """An error limit or constant that is not a number is refused by name, as is nan."""
    weights = weights_of(value(game))
    with pytest.raises(BadInputError, match=r"constant is nan; give a finite number"):
        from_weights(game, weights, constant=math.nan)
    for constant in ("x", None):
        with pytest.raises(BadInputError, match=r"constant is .*; give a finite number"):
            from_weights(game, weights, constant=constant)  # type: ignore[arg-type]
    with pytest.raises(BadInputError, match="limit is -1; give"):
        verify(game, from_gain(game, gain(game)), limit=-1)


@pytest.mark.parametrize(("speed", "half_width"), [(120.0, 20.0), (150.0, None), (200.0, None)])
def test_the_box_extends_to_the_nearer_limit(speed: float, half_width: float | None) -> None:
    """The box about a trim extends to the nearer limit of each state.

    If a state is at or beyond a limit, no box exists.
    """

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"speed": u.throttle - x.speed, "alpha": -x.alpha}, {}

    states = {"speed": Signal("ft/s", min=100.0, max=150.0), "alpha": Signal("", min=-1.0, max=1.0)}
    inputs = {"throttle": Signal("", min=0.0, max=500.0)}
    model = Model("toy", states, inputs, equations, trim={"speed": 120.0})
    condition = TrimCondition(model, {"speed": speed}, limits={"speed": (0.0, 300.0)})
    linear = linearize(model, trim(model, condition))
    game = game_on(linear, np.eye(2), np.eye(1))
    box = verify(game, from_gain(game, np.ones((1, 2)))).box
    if half_width is None:
        assert box.name == "balanced box"
    else:
        assert box.name == "box of limits"
        assert box.half_widths == pytest.approx([half_width, 1.0])


# The verdict does not depend on the units of the states and inputs.


@pytest.mark.parametrize(
    ("state", "of_input", "factors", "count"),
    [
        (1e-8, 1e3, [1.0 + 1e-4], 1),
        pytest.param(1e-8, 1e3, [-1.0, 0.0, 1.0 + 1e-4], 4, marks=pytest.mark.slow),
        pytest.param(1e8, 1e-3, [-1.0, 0.0, 1.0 + 1e-4], 4, marks=pytest.mark.slow),
    ],
)
def test_a_wrong_row_or_column_is_detected(
    state: float, of_input: float, factors: list[float], count: int
) -> None:
    """A wrong factor on any row or column of K, and a wrong entry of P, are detected.

    count: number of factors and entries to be tested
    """
    game = game_in(state, of_input)
    assert verify(game, from_gain(game, gain(game))).ok
    for factor in factors:
        parts = ([1.0, factor], [factor, 1.0], [[1.0], [factor]], [[factor], [1.0]])
        for change in parts[:count]:
            assert failed(game, from_gain(game, gain(game) * change)) >= {
                "K_balanced_error",
                "policy_rel_error",
            }
    for i, j in ((0, 1), (0, 0), (1, 1))[:count]:
        wrong = value(game).copy()
        wrong[i, j] = wrong[j, i] = wrong[i, j] * (1.0 + 1e-3)
        assert "P_balanced_error" in failed(game, from_value(game, wrong))


def test_contradicting_parts_are_refused(game: Game) -> None:
    """W and P that differ by 1e-4 are refused, and those that differ by 1e-7 are accepted."""
    P = value(game)
    words = ("verify", *AT_15, "--weights")
    apart, near = ((1.0 + error) * weights_of(P) for error in (1e-4, 1e-7))
    assert_refused(hfa(*words, stored("wp.npz", W=apart, P=P)), BAD_INPUT, "wp.npz", "W and P")
    assert hfa(*words, stored("wp.npz", W=near, P=P)).code == 0


# Errors in weights that are not quadratic, in directions without inputs, and in small entries are
# found.


@RICHER
def test_every_wrong_nonquadratic_weight_is_detected(game: Game, name: str) -> None:
    """Every wrong weight of a basis function that is not quadratic is detected, even without
    effect.

    B has zero rows for pitch and dihedral. A weight of the dihedral therefore changes neither P, K
    nor the policy.
    """
    functions = basis(name, 6)
    exact = functions.weights(value(game))
    at_corner = functions.scaling(BOX)
    for index in (21, functions.size - 1):
        weights = exact.copy()
        weights[index] = 1e-5 * np.abs(weights * at_corner).sum() / at_corner[index]
        assert (
            over_the_box(game, from_weights(game, weights, functions))["value_rel_error"] > 1e-6
        ), index
    exact[24 if name == "paper" else 25] = 1e12
    unseen = from_weights(game, exact, functions)
    assert over_the_box(game, unseen)["policy_rel_error"] <= 1e-12
    assert failed(game, unseen) >= {"gradient_rel_error", "disturbance_rel_error"}


def test_errors_are_those_of_their_definitions() -> None:
    """With an R that is not diagonal: norms, norms in balanced units, entries, and in a box."""
    rng = np.random.default_rng(8)
    A, B, E = (rng.standard_normal((3, size)) for size in (3, 2, 1))
    R = np.array([[4.0, 1.0], [1.0, 9.0]])
    game = Game(A, B, E, np.diag([1.0, 1e4, 1e-3]), R, 1e3)
    exact = solved(game)
    units = verify(game, exact).box.half_widths
    K = exact.K + 0.1 * rng.standard_normal((2, 3))
    change = rng.uniform(0.1, 0.2, (3, 3)) * np.abs(exact.P)
    part = exact.P + change + change.T  # z'Pz depends on the symmetric part alone
    P = part + 0.1 * (change - change.T)
    box = np.array([2.0, 0.5, 3.0])

    def measured(matrix: np.ndarray) -> float:
        return float(np.sqrt(np.trace(units[:, None] * (matrix.T @ R @ matrix) * units)))

    def entry(difference: np.ndarray, right: np.ndarray) -> float:
        return float(
            (np.abs(difference) / np.maximum(np.abs(right), 1e-5 * np.abs(right).max())).max()
        )

    both = np.outer(units, units)
    of_rows = np.sqrt(np.diag(R))[:, None] * units
    norm = np.linalg.norm
    expected = {
        "K_rel_error": norm(K - exact.K) / norm(exact.K),
        "K_balanced_error": measured(K - exact.K) / measured(exact.K),
        "K_entry_error": entry((K - exact.K) * of_rows, exact.K * of_rows),
        "P_rel_error": norm(P - exact.P) / norm(exact.P),
        "P_balanced_error": norm((P - exact.P) * both) / norm(exact.P * both),
        "P_entry_error": entry((P - exact.P) * both, exact.P * both),
        "policy_rel_error": entry(
            np.sqrt(np.diag(R)) * (np.abs(K - exact.K) @ box),
            np.sqrt(np.diag(R)) * (np.abs(exact.K) @ box),
        ),
        "value_rel_error": (box @ (part - exact.P) @ box) / (box @ np.abs(exact.P) @ box),
        "gradient_rel_error": entry(box * ((part - exact.P) @ box), box * (np.abs(exact.P) @ box)),
        "disturbance_rel_error": entry(
            np.abs(E.T @ (part - exact.P)) @ box, np.abs(E.T @ exact.P) @ box
        ),
    }
    critic = Critic(K, P, "P and K")
    scope = Scope(Box(box, "planted"), flights=1)
    found = over_the_box(game, critic, scope)
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-9)
    quartic = basis("quadratic+quartic", 3)
    weights = quartic.weights(exact.P)
    weights[-1] = 1e-3  # of the last state to the fourth
    found = over_the_box(game, from_weights(game, weights, quartic), scope)
    slopes = 4e-3 * 3.0**3 * 10.0**2 * np.eye(3)[2]  # in a box ten times as large, over its size
    expected = {
        "policy_rel_error": entry(
            np.sqrt(np.diag(R)) * np.abs(np.linalg.solve(R, B.T) @ slopes) / 2.0,
            np.sqrt(np.diag(R)) * (np.abs(exact.K) @ box),
        ),
        "value_rel_error": 0.1 * 3.0**4 / (box @ np.abs(exact.P) @ box),
        "gradient_rel_error": entry(box * slopes, 2.0 * box * (np.abs(exact.P) @ box)),
        "disturbance_rel_error": entry(np.abs(E.T @ slopes) / 2.0, np.abs(E.T @ exact.P) @ box),
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-9)
    linear = basis("quadratic+linear", 3)
    weights = linear.weights(exact.P)
    weights[-1] = 1e-3  # of the last state; in a box a tenth as large, it counts ten times
    found = over_the_box(game, from_weights(game, weights, linear), scope)
    assert found["value_rel_error"] == pytest.approx(
        1e-2 * 3.0 / (box @ np.abs(exact.P) @ box), rel=1e-9
    )
    assert relative_error(np.zeros(2), np.zeros(2)) == 0.0
    assert relative_error(np.ones(2), np.zeros(2)) == math.inf
    assert relative_error(np.array([1.0, np.nan]), np.ones(2)) == math.inf
    with pytest.raises(BadInputError, match="give equal shapes"):
        relative_error(np.ones(2), np.ones(3))


@RICHER
@pytest.mark.parametrize("disturbances", [6, 2])
def test_bounds_are_valid_in_the_whole_box(game: Game, name: str, disturbances: int) -> None:
    """Sampled errors of V, ∂V/∂z and both policies in the box do not exceed their computed
    bounds.
    """
    game = replace(game, E=game.E[:, :disturbances])
    functions = basis(name, 6)
    rng = np.random.default_rng(0)
    solution = solved(game)
    exact = functions.weights(solution.P)
    weights = exact * (1.0 + 0.1 * rng.standard_normal(exact.shape)) + rng.standard_normal(
        exact.shape
    )
    errors = over_the_box(game, from_weights(game, weights, functions))
    z = rng.choice([-1.0, 1.0, 0.3], size=(2000, 6)) * BOX
    change = weights - exact
    V = functions.psi(z) @ change
    slopes = np.swapaxes(functions.gradient(z), -1, -2) @ change
    sizes = np.abs(exact) * functions.scaling(BOX)
    assert np.abs(V).max() <= errors["value_rel_error"] * sizes.sum()
    assert np.all(
        np.abs(slopes * BOX).max(axis=0)
        <= errors["gradient_rel_error"] * (sizes @ functions.exponents)
    )
    u = -0.5 * slopes @ game.R_inverse_B_transposed.T
    d = 0.5 * slopes @ game.E / game.delta**2
    assert np.all(np.abs(u).max(axis=0) <= errors["policy_rel_error"] * (np.abs(solution.K) @ BOX))
    largest = np.abs(solution.disturbance_gain) @ BOX
    assert np.all(np.abs(d).max(axis=0) <= errors["disturbance_rel_error"] * largest)


# The box: that of the aircraft if the plant has its names, otherwise a stated convention.


def test_a_plant_like_the_aircraft_has_its_box() -> None:
    """For a plant of the aircraft's size without signal names, the default box is used.

    The half-widths of the default box are the balanced units of the game, in which P is of size 1.
    """
    Q = np.diag([1.0, 1e6, 1.0, 1.0, 1.0, 1.0])
    game = Game(-np.diag(np.arange(1.0, 7.0)), np.ones((6, 5)), np.eye(6), Q, np.eye(5), 5.0)
    data = verify(game, from_gain(game, gain(game))).to_dict()
    assert data["box"]["name"] == "balanced box"
    sizes = np.array(data["box"]["half_widths"]) * np.sqrt(np.diag(value(game)))
    assert sizes.max() < 3.0 * sizes.min()


@pytest.mark.parametrize(
    ("change", "speed"),
    [
        ({}, 7.0),
        ({"state_units": ["m/s", "rad", "rad", "rad/s", "rad", "rad/s"]}, 7.0 * 0.3048),
        ({"state_units": ["km/h", "rad", "rad", "rad/s", "rad", "rad/s"]}, None),
        ({"states": list("abcdef")}, None),
        ({"inputs": list("abcde")}, None),
    ],
)
def test_the_typical_box_requires_equal_names_and_units(
    game: Game, change: dict[str, Any], speed: float | None
) -> None:
    """Typical deviations are used only for a plant with the aircraft's names and units."""
    matrices = {name: getattr(game, name) for name in "ABEQR"} | {"delta": 1e4}
    named = {"states": LINEAR_STATES, "inputs": INPUTS} | change
    plant = load_game(stored("plant.npz", **matrices, **named))
    box = verify(plant, from_gain(plant, gain(plant))).box
    assert (box.name == "typical box") == (speed is not None)
    if speed is not None:
        assert box.half_widths == pytest.approx([speed, *BOX[1:]])
