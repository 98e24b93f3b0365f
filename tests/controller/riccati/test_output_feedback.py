"""The game from measured outputs: against closed forms, 60 digits, LQG and the state-feedback game; errors are seen."""

from __future__ import annotations

import math
from dataclasses import replace

import control
import numpy as np
import pytest
from known_models import model_at
from reference_riccati import reference_solution, relative_error
from servo_cases import simvfa_design

from controller import Game, design_model
from controller.riccati import generalized_plant
from hfa_model import Aircraft
from hfa_support import BadInputError, NoSolutionError
from verification import OutputGame, minimum_delta, minimum_output_delta, solve_game, solve_output_feedback

MEASURED = ("pitch_rate", "dihedral_integral", "vertical_acceleration_short_period_integral")


@pytest.fixture(scope="module", params=["simvfa-1", pytest.param("simvfa-2", marks=pytest.mark.slow)])
def servo(request: pytest.FixtureRequest, published_aircraft: Aircraft) -> OutputGame:
    """The peer's servo at 11 deg from its three measurements, with a disturbance in every aircraft state."""
    built = design_model(published_aircraft, model_at(11.0), simvfa_design(request.param))
    C = np.array([[float(state == name) for state in built.states] for name in MEASURED])
    return OutputGame(built.game().with_delta(200.0), C, np.zeros((3, 2)), np.diag([1e-4, 1e-4, 1e-2]))


@pytest.fixture(scope="module")
def smallest(servo: OutputGame) -> float:
    """The smallest delta of the servo from its measurements."""
    return minimum_output_delta(servo)[0]


def scalar(delta: float, c: float = 1.0, d: float = 0.0) -> OutputGame:
    one = np.eye(1)
    game = Game(A=0.5 * one, B=2.0 * one, E=0.7 * one, Q=3.0 * one, R=0.4 * one, delta=delta)
    return OutputGame(game, c * one, d * one, 0.25 * one)


def larger_root(a: float, s: float, q: float) -> float:
    """Of 2 a p + q - s p² = 0."""
    return (a + math.sqrt(a * a + s * q)) / s


def test_a_scalar_plant_by_hand() -> None:
    delta = 3.0
    X = larger_root(0.5, 4 / 0.4 - 0.49 / 9, 3.0)
    Y = larger_root(0.5, 1 / 0.25 - 3.0 / 9, 0.49)
    found = solve_output_feedback(scalar(delta))
    assert found.X[0, 0] == pytest.approx(X, rel=1e-13)
    assert found.Y[0, 0] == pytest.approx(Y, rel=1e-13)
    assert found.coupling == pytest.approx(X * Y / 9, rel=1e-12)
    gain = Y / 0.25 / (1 - X * Y / 9)
    assert found.Bk[0, 0] == pytest.approx(gain, rel=1e-12)
    assert found.Ak[0, 0] == pytest.approx(0.5 + 0.49 / 9 * X - 2 * 2 / 0.4 * X - gain, rel=1e-12)


def test_the_smallest_delta_of_a_scalar_plant() -> None:
    smallest, refused, condition = minimum_output_delta(scalar(1.0))
    assert refused < smallest <= refused * (1 + 1e-6)
    assert condition == "coupling condition"

    def excess(delta: float) -> float:
        X = larger_root(0.5, 4 / 0.4 - 0.49 / delta**2, 3.0)
        Y = larger_root(0.5, 1 / 0.25 - 3.0 / delta**2, 0.49)
        return X * Y - delta**2

    assert excess(smallest * (1 - 2e-6)) > 0 > excess(smallest * (1 + 2e-6))
    assert solve_output_feedback(scalar(smallest * 1.001)).coupling < 1.0
    with pytest.raises(NoSolutionError, match="the coupling condition fails: rho"):
        solve_output_feedback(scalar(smallest * 0.999))


def test_both_equations_to_sixty_digits(servo: OutputGame) -> None:
    found = solve_output_feedback(servo)
    control_side, filter_side = reference_solution(servo.game), reference_solution(servo.dual)
    assert control_side.exists
    assert relative_error(found.X, control_side.P) < 1e-10
    # Its sign is lost in the rows of actuators and integrals, which no disturbance reaches: they are 0 in Y.
    assert relative_error(found.Y, filter_side.P) < 1e-10
    assert all(check.ok for check in found.checks)


def test_without_disturbance_it_is_lqg(servo: OutputGame) -> None:
    game = servo.game
    found = solve_output_feedback(servo.with_delta(math.inf))
    K = control.lqr(game.A, game.B, game.Q, game.R)[0]
    L = control.lqe(game.A, np.eye(len(game.A)), servo.C, game.S_disturbance, servo.V)[0]
    assert relative_error(-found.Ck, K) < 1e-9
    assert relative_error(found.Bk, L) < 1e-9
    assert relative_error(found.Ak, game.A - game.B @ K - L @ servo.C) < 1e-9
    assert found.coupling == 0.0


def test_with_every_state_measured_well_it_is_the_state_feedback_game(game: Game) -> None:
    """As the noise falls the filter's share of the coupling falls, and the smallest delta becomes that of the game."""
    n, m = game.B.shape
    smallest = minimum_delta(game).value
    excess = [
        minimum_output_delta(OutputGame(game, np.eye(n), np.zeros((n, m)), noise * np.eye(n)))[0] / smallest - 1
        for noise in (1e-6, 1e-8, 1e-10)
    ]
    assert excess == sorted(excess, reverse=True)
    assert -2e-6 < excess[-1] < 1e-3
    seen = solve_output_feedback(OutputGame(game, np.eye(n), np.zeros((n, m)), 1e-10 * np.eye(n)))
    assert relative_error(seen.X, solve_game(game).P) < 1e-12


def hinfsyn(problem: OutputGame) -> tuple[float, float]:
    """python-control's answer: the gain that it states, and the gain of the loop that it returns."""
    pytest.importorskip("slycot")
    game = problem.game
    (n, m), p, k = game.B.shape, len(problem.C), game.E.shape[1]
    paid = np.vstack([generalized_plant.square_root(game.Q), np.zeros((m, n)), problem.C])
    through = np.zeros((n + m + p, k + p + m))
    through[n : n + m, k + p :], through[n + m :, k : k + p] = np.sqrt(game.R), np.sqrt(problem.V)
    into = np.hstack([game.E, np.zeros((n, p)), game.B])
    _, loop, stated, _ = control.hinfsyn(control.ss(game.A, into, paid, through), p, m)
    resolvents = (1j * w * np.eye(len(loop.A)) - loop.A for w in np.geomspace(1e-4, 1e4, 1000))
    gains = [np.linalg.norm(loop.C @ np.linalg.solve(each, loop.B) + loop.D, 2) for each in resolvents]
    return float(stated), max(gains)


def random_problem(seed: int) -> OutputGame:
    rng = np.random.default_rng(seed)
    A, B, E, C = (rng.standard_normal(shape) for shape in ((3, 3), (3, 1), (3, 2), (2, 3)))
    return OutputGame(Game(A=A, B=B, E=E, Q=np.eye(3), R=np.eye(1), delta=1.0), C, np.zeros((2, 1)), np.eye(2))


@pytest.mark.parametrize("decades", [8])
@pytest.mark.parametrize("seed", [0, 2])
def test_units_of_the_states_over_16_decades_change_nothing(seed: int, decades: int) -> None:
    """z = u y: delta_min, the coupling, the response; X and Y in the new units."""
    problem, u = random_problem(seed), 10.0 ** (decades * np.array([1.0, -1.0, 0.0]))
    g, smallest = problem.game, minimum_output_delta(problem)
    game = Game(
        A=g.A * u / u[:, None], B=g.B / u[:, None], E=g.E / u[:, None], Q=g.Q * np.outer(u, u), R=g.R, delta=g.delta
    )
    other = OutputGame(game, problem.C * u, problem.D, problem.V)
    found = minimum_output_delta(other)
    assert found.refused < found.value <= found.refused * (1 + 2e-6)
    assert found.value == pytest.approx(smallest.value, rel=2e-6)
    assert found.condition == smallest.condition
    delta = 1.01 * smallest.value
    one, two = solve_output_feedback(problem.with_delta(delta)), solve_output_feedback(other.with_delta(delta))
    assert two.coupling == pytest.approx(one.coupling, rel=1e-8)
    np.testing.assert_allclose(two.X / np.outer(u, u), one.X, atol=1e-8 * np.abs(one.X).max())
    np.testing.assert_allclose(two.Y * np.outer(u, u), one.Y, atol=1e-8 * np.abs(one.Y).max())
    np.testing.assert_allclose(two.Ck / u, one.Ck, rtol=1e-6, atol=1e-8 * np.abs(one.Ck).max())


@pytest.mark.parametrize("problem", [scalar(1.0), *map(random_problem, range(4))])
def test_python_control_agrees_where_it_succeeds(problem: OutputGame) -> None:
    stated, reached = hinfsyn(problem)
    smallest = minimum_output_delta(problem).value
    assert reached == pytest.approx(stated, rel=1e-3)
    assert smallest <= stated * (1 + 1e-6)
    assert stated == pytest.approx(smallest, rel=0.02)


def test_python_control_fails_on_the_servo_and_no_loop_of_its_goes_below(servo: OutputGame, smallest: float) -> None:
    """It states a gain of 3; the loop that it returns has one of hundreds."""
    stated, reached = hinfsyn(servo)
    assert stated < 4.0 < smallest
    assert reached >= smallest * (1 - 1e-6)


def test_an_unstable_mode_that_is_not_measured_is_named() -> None:
    with pytest.raises(NoSolutionError, match=r"the sensors do not see the mode with eigenvalue 0\.5000"):
        solve_output_feedback(scalar(3.0, c=0.0))
    with pytest.raises(NoSolutionError, match="measure more"):
        minimum_output_delta(scalar(3.0, c=0.0))


def test_an_integral_that_no_disturbance_drives_is_named(servo: OutputGame) -> None:
    calm = replace(servo, game=replace(servo.game, E=servo.game.E[:, [1]]))
    with pytest.raises(NoSolutionError, match=r"the disturbance does not reach the mode with eigenvalue -?0\.0000, "):
        solve_output_feedback(calm)


def test_wrong_shapes_are_refused(servo: OutputGame) -> None:
    with pytest.raises(BadInputError, match=r"C has shape \(3, 4\); with these outputs and states it must be \(3, 1"):
        replace(servo, C=np.zeros((3, 4)))
    with pytest.raises(BadInputError, match="no output is measured"):
        replace(servo, C=servo.C[:0], D=servo.D[:0], V=servo.V[:0, :0])
    with pytest.raises(BadInputError, match="V is not positive definite"):
        replace(servo, V=np.zeros((3, 3)))
