"""Solutions of discounted discrete-time games.

They are compared with value iteration, closed forms and continuous time. Bad input is refused.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cli import answer, hfa
from game_files import stored
from pages import printed_matrices
from reference_riccati import relative_error
from reference_steps import reference_step_value

from controller import minimum_delta
from controller.discrete.solution import (
    DiscreteSolution,
    minimum_delta_discrete,
    quick_discrete,
    sampled,
    solve_discrete,
    value_checks,
)
from controller.discrete.step_form import StepForm
from controller.game.discrete_game import DiscreteGame
from hfa import BadInputError, Game, NoSolutionError, solve
from hfa.main import FAILED


def _game(seed: int = 0, n: int = 4, delta: float = 20.0) -> Game:
    rng = np.random.default_rng(seed)
    A, B, E = (rng.standard_normal((n, size)) for size in (n, 2, 2))
    return Game(0.6 * A, B, E, np.eye(n), np.diag([1.0, 3.0]), delta)


@pytest.mark.parametrize(
    ("seed", "discount", "delta"), [(0, 0.9, 20.0), (1, 0.99, 40.0), (2, 1.0, np.inf)]
)
def test_p_equals_the_result_of_value_iteration(seed, discount, delta):
    """P equals the result of 3000 steps of value iteration within 1e-12 of the largest entry."""
    game = _game(seed, delta=delta)
    solution = solve_discrete(DiscreteGame(game, discount))
    G = np.hstack([game.B, game.E / delta])
    W = np.diag([1.0, 3.0, -1.0, -1.0])
    P = np.zeros((4, 4))
    for _ in range(3000):
        P = (P + P.T) / 2.0
        crossed = discount * G.T @ P @ game.A
        P = (
            game.Q
            + discount * game.A.T @ P @ game.A
            - crossed.T @ np.linalg.solve(W + discount * G.T @ P @ G, crossed)
        )
    assert np.abs(solution.P - P).max() <= 1e-12 * np.abs(P).max()
    poles = np.linalg.eigvals(game.A - game.B @ solution.K)
    assert np.sort_complex(solution.closed_loop_eigenvalues) == pytest.approx(
        np.sort_complex(poles)
    )
    assert solution.radius == pytest.approx(np.abs(poles).max())
    assert solution.certificate.ok


def test_p_of_a_scalar_game_solves_a_quadratic():
    """P of a scalar game without disturbance is the positive root of a quadratic equation.

    K equals the closed form, and L is 0.
    """
    a = 1.02
    b = 0.01
    q = 2.0
    r = 0.5
    discount = 0.98
    solution = solve_discrete(
        DiscreteGame(Game([[a]], [[b]], [[1.0]], [[q]], [[r]], np.inf), discount)
    )
    root = np.roots([discount * b * b, r - discount * (a * a * r + b * b * q), -q * r]).max()
    assert solution.P[0, 0] == pytest.approx(root, rel=1e-13)
    assert solution.K[0, 0] == pytest.approx(
        discount * a * b * root / (r + discount * b * b * root), rel=1e-13
    )
    assert solution.disturbance_gain[0, 0] == 0.0


def test_a_discounted_gain_that_does_not_stabilize_is_named():
    """With expensive control, the gain of a discounted game leaves an eigenvalue at 1.2."""
    game = Game([[1.2]], [[1.0]], [[1.0]], [[1.0]], [[1e6]], np.inf)
    solution = solve_discrete(DiscreteGame(game, 0.5))
    assert solution.radius == pytest.approx(1.2, rel=1e-3)
    assert "does NOT stabilize" in str(solution.report())


def test_sampled_double_integrator_equals_the_textbook():
    """A sampled double integrator has the textbook A and B, weights times dt, and delta times
    √dt.
    """
    step = sampled(
        Game([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], np.eye(2), np.eye(2), [[2.0]], 3.0), 0.5
    ).step
    assert step.A.tolist() == [[1.0, 0.5], [0.0, 1.0]]
    assert step.B.ravel() == pytest.approx([0.125, 0.5], rel=1e-15)
    assert (step.Q[0, 0], step.R[0, 0], step.delta) == (0.5, 1.0, pytest.approx(3.0 * np.sqrt(0.5)))


def test_wrong_values_of_p_fail():
    """Wrong values of P, also by 1e-9, fail the checks."""
    game = _game(5)
    P = solve_discrete(DiscreteGame(game, 1.0)).P
    assert all(check.ok for check in value_checks(DiscreteGame(game), P))
    for wrong in (
        P * (1.0 + 1e-9),
        P + 1e-9 * np.eye(4),
        solve_discrete(DiscreteGame(game, 0.999999999)).P,
        -P,
    ):
        assert not all(check.ok for check in value_checks(DiscreteGame(game), wrong))
    attack = game.E.T @ solve_discrete(DiscreteGame(game.with_delta(np.inf))).P @ game.E
    below = game.with_delta(0.9 * np.sqrt(np.linalg.eigvalsh(attack)[-1]))
    failed = {check.name for check in value_checks(DiscreteGame(below), P) if not check.ok}
    assert "disturbance_pays" in failed


def test_games_without_a_solution_are_refused():
    """Games without a solution, and wrong discounts and sample times, are refused with the reason.

    An unstable mode that no input reaches has a solution with discount 0.6, and none with 0.9.
    """
    with pytest.raises(
        NoSolutionError,
        match=r"no certified value of .*; delta = 0\.5 is below delta_min",
    ):
        solve_discrete(DiscreteGame(_game(6, delta=0.5), 0.99))
    unreached = Game([[1.2]], [[0.0]], [[1.0]], [[1.0]], [[1.0]], np.inf)
    assert solve_discrete(DiscreteGame(unreached, 0.6)).P[0, 0] == pytest.approx(
        1.0 / (1.0 - 0.6 * 1.44), rel=1e-13
    )
    with pytest.raises(NoSolutionError):
        solve_discrete(DiscreteGame(unreached, 0.9))
    for discount, dt, name in (
        (0.0, 0.1, "discount"),
        (1.1, 0.1, "discount"),
        (0.9, -1.0, "dt"),
        (0.9, "1", "dt"),
    ):
        with pytest.raises(BadInputError, match=name):
            solve_discrete(sampled(unreached, dt, discount))


def test_refusals_of_lqr_problems_name_the_mode():
    """Without a disturbance, the refusal names the mode that prevents a solution, not delta."""
    unreached = Game([[1.2]], [[0.0]], [[1.0]], [[1.0]], [[1.0]], np.inf)
    with pytest.raises(NoSolutionError, match=r"no input reaches the mode with eigenvalue 1\.2 of"):
        solve_discrete(DiscreteGame(unreached, 1.0))
    for pole in (1.0, -1.0):
        unpaid = Game([[pole]], [[1.0]], [[1.0]], [[0.0]], [[1.0]], np.inf)
        with pytest.raises(NoSolutionError, match="neither decays nor grows and has no cost"):
            solve_discrete(DiscreteGame(unpaid, 1.0))


def test_smallest_delta_of_one_state_equals_closed_form():
    """If u has no effect and a = 1/2, the smallest delta is the gain 1/(1 - a) = 2.

    A solution exists for delta = 2.01. delta = 1.9 is refused.
    """
    game = Game([[0.5]], [[0.0]], [[1.0]], [[1.0]], [[1.0]], 5.0)
    smallest = minimum_delta_discrete(DiscreteGame(game))
    assert smallest.value == pytest.approx(2.0, rel=1e-5)
    assert solve_discrete(DiscreteGame(game.with_delta(2.01), 1.0)).certificate.ok
    with pytest.raises(NoSolutionError, match="choose a larger delta"):
        solve_discrete(DiscreteGame(game.with_delta(1.9), 1.0))


def test_a_discounted_solution_reports_its_stability():
    """For a discounted solution that does not stabilize, `radius` is above 1 and
    `discounted_radius` below 1.
    """
    solution = solve_discrete(
        DiscreteGame(Game([[1.01]], [[1e-3]], [[0.0]], [[1.0]], [[1e3]], np.inf), 0.9)
    )
    assert solution.certificate.ok
    assert solution.radius > 1.0 > solution.discounted_radius
    assert solution.discounted_radius == pytest.approx(np.sqrt(0.9) * solution.radius)
    text = str(solution.report())
    assert f"spectral radius {solution.radius:.7g}," in text
    assert f"sqrt(discount) (A - B K) {solution.discounted_radius:.7g}\n" in text
    (printed,) = printed_matrices(solution.report())["K"].ravel()
    assert f"{printed:.4f}" == f"{solution.K[0, 0]:.4f}"  # stable with the discount alone
    game = _game(2, delta=40.0)
    solution = solve_discrete(DiscreteGame(game, 0.98))
    ratio = 40.0 / solution.delta_min
    assert f", margin {ratio:.4g}, discount 0.98 a step" in str(solution.report())


@pytest.mark.parametrize("delta", [np.inf, 30.0])
@pytest.mark.parametrize("discount", [1.0, 0.95])
def test_cross_weights_satisfy_bellmans_equation(delta, discount):
    """With cross weights, the solution satisfies Bellman's equation.

    P, K and L also follow from the matrix H of the Q-function.
    """
    rng = np.random.default_rng(3)
    step = _game(1, delta=delta)
    problem = DiscreteGame(replace(step, N=0.2 * rng.standard_normal((4, 2))), discount)
    solution = solve_discrete(problem)
    H = solution.H
    parts = problem.of_q_function(H)
    P = parts["P"]
    assert pytest.approx(solution.P, rel=1e-10, abs=1e-11) == P
    assert pytest.approx(solution.K, rel=1e-10, abs=1e-11) == parts["K"]
    if np.isfinite(delta):
        L = solution.disturbance_gain
        assert pytest.approx(L, rel=1e-9, abs=1e-11) == parts["L"]
    K, L = problem.policies(solution.P)
    assert pytest.approx(solution.K, rel=1e-10, abs=1e-11) == K
    assert pytest.approx(solution.disturbance_gain, rel=1e-9, abs=1e-11) == L
    G = np.hstack([step.B, step.E]) if np.isfinite(delta) else step.B
    weights = H[4:, 4:]
    assert weights[:2, :2] == pytest.approx(step.R + discount * step.B.T @ P @ step.B)
    crossed = discount * G.T @ P @ step.A
    crossed[:2] += problem.step.N.T
    value = step.Q + discount * step.A.T @ P @ step.A
    assert pytest.approx(value - crossed.T @ np.linalg.solve(weights, crossed), rel=1e-10) == P


def test_a_game_without_cost_has_zero_value():
    """If Q = 0 and A is stable, P and the smallest delta are 0."""
    step = Game([[0.5, 1.0], [0.0, 0.9]], np.eye(2), np.eye(2), np.zeros((2, 2)), np.eye(2), 1.0)
    solution = solve_discrete(DiscreteGame(step, 1.0))
    assert not solution.P.any()
    assert minimum_delta_discrete(DiscreteGame(step)).value == 0.0


def test_wrong_cross_weights_are_refused():
    """Cross weights of wrong shape or sign and an asymmetric H are refused."""
    step = _game()
    with pytest.raises(BadInputError, match="N is 2 x 4; give 4 x 2, to match A and B"):
        replace(step, N=np.zeros((2, 4)))
    with pytest.raises(BadInputError, match="is not positive semidefinite"):
        replace(step, N=10.0 * np.ones((4, 2)))
    with pytest.raises(BadInputError, match="H is not symmetric"):
        DiscreteGame(step).of_q_function(np.triu(np.ones((6, 6))))


@pytest.mark.usefixtures("folder")
def test_commands_accept_discrete_plants():
    """`solve`, `learn` and `verify` work with a discrete-time plant in a file."""
    step = _game(2, delta=40.0)
    parts = {name: getattr(step, name) for name in ("A", "B", "E", "Q", "R", "delta")}
    plant = stored("plant.json", **parts, time="discrete", discount=0.98)
    solution = solve_discrete(DiscreteGame(step, 0.98))
    solved = answer("solve", "--model", plant)
    assert solved["P"] == pytest.approx(solution.P)
    assert solved["delta_min"] < 40.0
    assert solved["spectral_radius"] == pytest.approx(solution.radius)
    for key, matrix in (("P", solution.P), ("K", solution.K), ("H", solution.H)):
        critic = stored(f"{key}.npz", **{key: matrix})
        assert answer("verify", "--model", plant, "--weights", critic)["ok"] is True
    wrong = stored("wrong.npz", K=1.01 * solution.K)
    assert answer("verify", "--model", plant, "--weights", wrong, code=FAILED)["ok"] is False
    learned = hfa("learn", "--model", plant, "-o", "learned.npz")
    assert learned.code == 0, learned.err
    assert answer("verify", "--model", plant, "--weights", "learned.npz")["ok"] is True


@pytest.mark.usefixtures("folder")
def test_wrong_h_and_l_fail_with_reason():
    """A wrong matrix H of the Q-function and a wrong L fail.

    A K that solves a variant of the problem fails too, and the diagnosis names the variant.
    """
    step = _game(3, delta=20.0)
    N = 0.2 * np.random.default_rng(0).standard_normal((4, 2))
    problem = DiscreteGame(replace(step, N=N), 0.95)
    solution = solve_discrete(problem)
    H = solution.H
    over_x_and_u = H[:6, :6] - H[:6, 6:] @ np.linalg.solve(H[6:, 6:], H[6:, :6])
    wrong = H.copy()
    wrong[7, 7] *= 1.01
    plant = stored(
        "plant.json",
        **{name: getattr(step, name) for name in ("A", "B", "E", "Q", "R", "delta")},
        time="discrete",
        discount=0.95,
        N=N,
    )

    def verdict(code=0, **parts):
        return answer("verify", "--model", plant, "--weights", stored("c.npz", **parts), code=code)

    assert verdict(H=H)["ok"]
    assert verdict(H=over_x_and_u)["ok"]
    assert verdict(K=solution.K, L=solution.disturbance_gain)["ok"]
    assert not verdict(FAILED, H=wrong)["ok"]
    assert not verdict(FAILED, K=solution.K, L=-solution.disturbance_gain)["ok"]
    others = {
        "without disturbance (delta = inf)": DiscreteGame(replace(step, delta=np.inf, N=N), 0.95),
        "without discount": DiscreteGame(replace(step, N=N)),
        "without cross weights N": DiscreteGame(step, 0.95),
    }
    for says, variant in others.items():
        diagnosis = verdict(FAILED, K=solve_discrete(variant).K)["diagnosis"]
        assert diagnosis == f"this is the gain {says}"


@pytest.mark.usefixtures("folder")
def test_the_other_time_is_suggested():
    """If a critic is exact for the same plant in discrete time instead of continuous time, or vice
    versa, the diagnosis suggests this time.

    Options for the other time are refused.
    """
    step = Game([[1.0, 0.1], [0.0, 0.9]], [[0.0], [0.1]], np.eye(2), np.eye(2), [[1.0]], np.inf)
    parts = {name: getattr(step, name) for name in ("A", "B", "Q", "R")}
    plant = stored("plant.json", **parts)
    steps = stored("steps.json", **parts, time="discrete")
    solution = solve_discrete(DiscreteGame(step))
    for name, matrix in (("P", solution.P), ("K", solution.K)):
        critic = stored("critic.npz", **{name: matrix})
        verdict = answer("verify", "--model", plant, "--weights", critic, code=FAILED)
        assert verdict["diagnosis"].endswith('x⁺ = A x + B u; did you mean time = "discrete"?')
    critic = stored("critic.npz", K=solve(step).K)
    verdict = answer("verify", "--model", steps, "--weights", critic, code=FAILED)
    assert verdict["diagnosis"].endswith('x\' = A x + B u; did you mean time = "continuous"?')
    question = 'time = "discrete"'
    refused = hfa("verify", "--model", plant, "--weights", stored("H.npz", H=solution.H))
    assert question in refused.err
    refused = hfa("solve", "--model", stored("other.json", **parts, discount=0.9))
    assert "discount requires a discrete-time plant" in refused.err
    assert question in refused.err
    # No input reaches the second state. It decays in discrete time and would grow in continuous
    # time.
    decays = {"A": np.diag([0.5, 0.9]), "B": [[1.0], [0.0]], "Q": np.eye(2), "R": [[1.0]]}
    refused = hfa("solve", "--model", stored("decays.json", **decays))
    assert refused.code == FAILED
    assert "not stabilizable" in refused.err
    assert question not in refused.err


def test_smallest_delta_with_fast_sampling_approaches_continuous_time():
    """With fast sampling, the smallest delta is √dt times that in continuous time, within 0.5 %.

    The smallest delta is not marked as uncertain.
    """
    rng = np.random.default_rng(2)
    A, B, E = (rng.standard_normal((4, size)) for size in (4, 1, 1))
    game = Game(A, B, E, np.eye(4), [[1.0]], 10.0)
    smallest = minimum_delta_discrete(sampled(game, 1e-3))
    assert not smallest.uncertain
    assert smallest.value == pytest.approx(1e-3**0.5 * minimum_delta(game).value, rel=5e-3)


def _nearly_repeated(weight: float) -> DiscreteGame:
    """Return a game whose A has two eigenvalues 1 up to rounding: its last digits move them."""
    A = np.eye(2) + 0.125 * np.array([[1.0, 1.0], [-1.0, -1.0]])
    return DiscreteGame(Game(A, [[1e-8], [0.0]], np.zeros((2, 1)), weight * np.eye(2), np.eye(1)))


def test_a_gain_in_discrete_time_without_reliable_digits_is_refused() -> None:
    """The last digit of one entry changes K noticeably, and with less weight by more than 1 %."""
    with pytest.raises(NoSolutionError, match="last place"):
        solve_discrete(_nearly_repeated(1e-16))
    problem = _nearly_repeated(1e-10)
    solution = solve_discrete(problem)
    A = problem.A.copy()
    A[0, 0] = np.nextafter(A[0, 0], 2.0)
    moved = solve_discrete(replace(problem, step=replace(problem.step, A=A)))
    change = relative_error(moved.K, solution.K)
    assert change < _gain_change(solution) < 10.0 * change
    assert "WARNING" in str(solution.report())
    assert "WARNING" not in str(solve_discrete(DiscreteGame(_game())).report())


def _gain_change(solution: DiscreteSolution) -> float:
    (check,) = [each for each in solution.certificate.checks if each.name == "gain_change"]
    return check.value


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_the_bound_of_the_change_of_a_gain_in_discrete_time_is_true_and_tight(seed: int) -> None:
    """Changes of each entry alone add up to less than the bound, and to 20 % of it or more."""
    rng = np.random.default_rng(seed)
    weights = np.diag(rng.uniform(0.1, 2.0, 4)), np.diag(rng.uniform(0.5, 2.0, 2))
    step = replace(_game(seed, delta=np.inf if seed % 2 else 20.0), Q=weights[0])
    problem = DiscreteGame(step, 0.95)
    solution = solve_discrete(problem)
    form = StepForm.of_problem(problem)
    size = 1e-6
    total = np.zeros_like(solution.K)

    def add(**changed: Any) -> None:
        moved = quick_discrete(replace(problem, step=replace(step, **changed)))[1]
        total[:] += np.abs(form.root.T @ (moved - solution.K) / np.diag(form.T)) / size

    for name in ("A", "B", "E", "Q", "R"):
        entries = getattr(step, name)
        for place in np.ndindex(entries.shape):
            if name in ("A", "B", "E") or place[0] == place[1]:
                changed = entries.copy()
                changed[place] *= 1.0 + size
                add(**{name: changed})
    add(delta=step.delta * (1.0 + size))
    unit_gain = form.root.T @ solution.K / np.diag(form.T)
    largest = np.linalg.norm(total) / np.linalg.norm(unit_gain)
    bound = _gain_change(solution) / np.finfo(float).eps
    assert largest <= bound <= 5.0 * largest


def _hard_step(kind: str, seed: int) -> DiscreteGame:
    rng = np.random.default_rng([29, seed])
    A, B, E = (rng.standard_normal((4, size)) for size in (4, 2, 1))
    Q = np.eye(4)
    R = np.eye(2)
    if kind == "cheap":
        R = 1e-12 * R
    if kind == "barely reached":
        A = np.diag([1.4, 0.8, -0.7, 0.2])
        B[0] *= 1e-6
        turn = np.linalg.qr(rng.standard_normal((4, 4)))[0]
        A, B = turn @ A @ turn.T, turn @ B
    if kind == "both poles":
        A = np.array([[1.0, 1, 0, 0], [0, -1, 0, 1], [0, 0, -1, 0], [0, 0, 0, 1]])
    if kind == "fast":
        return sampled(Game(A, B, E, Q, R, 1e3), 1e-7, discount=1.0 - 1e-8)
    return DiscreteGame(Game(A, B, E, Q, R, np.inf), 0.99 if seed else 1.0)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("kind", ["cheap", "barely reached", "both poles", "fast"])
def test_ill_conditioned_games_agree_with_value_iteration(kind, seed):
    """P of ill-conditioned games agrees with value iteration in 90 digits within 1e-12.

    The limit is 1e-10 if an input affects a mode only by 1e-6. A change of the last bit of
    √discount B then changes P by 1e-10.
    """
    problem = _hard_step(kind, seed)
    error = relative_error(solve_discrete(problem).P, reference_step_value(problem))
    assert error <= (1e-10 if kind == "barely reached" else 1e-12)


def test_short_sample_times_keep_their_accuracy():
    """The difference of P from P(dt = 0) at dt = 2e-7 s is twice that at dt = 1e-7 s.

    At 1e-6 s, the smallest delta is √dt times that in continuous time, and is not marked as
    uncertain.
    """
    game = _game(3)
    exact = solve(game).P
    away = [solve_discrete(sampled(game, dt)).P - exact for dt in (1e-7, 2e-7)]
    assert 2.0 * away[0] == pytest.approx(away[1], rel=1e-5, abs=1e-12)
    smallest = minimum_delta_discrete(sampled(game, 1e-6))
    assert not smallest.uncertain
    assert smallest.value == pytest.approx(1e-3 * minimum_delta(game).value, rel=1e-5)


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_an_uncontrollable_mode_with_cross_weights_is_refused(turn: float) -> None:
    """A game with an eigenvalue of 5.3 that no input affects is refused.

    Rounding errors of A - B R⁻¹ N' couple this eigenvalue to the input.
    """
    cosine = np.cos(turn)
    sine = np.sin(turn)
    T = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    A = T @ np.array([[5.3, 0.0, 0.0], [0.4, 1.2, 0.3], [0.1, -0.2, 0.7]]) @ T.T
    B = T @ np.array([[0.0], [1.0], [0.6]])
    step = Game(A, B, np.zeros((3, 1)), np.eye(3), [[1.3]], 1e6)
    problem = DiscreteGame(replace(step, N=np.array([[0.3], [0.1], [-0.2]])))
    with pytest.raises(NoSolutionError, match=r"no input reaches the mode with eigenvalue 5\.3 "):
        solve_discrete(problem)


def test_a_gain_that_does_not_stabilize_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A solution whose gain does not stabilize is refused."""
    step = Game([[1.5]], [[1.0]], [[0.0]], [[1.0]], [[1.0]], 1e6)
    assert solve_discrete(DiscreteGame(step)).certificate.checks[-1].name == "gain_radius"
    # Planted fault: no known game has a certified P with such a gain.
    monkeypatch.setattr(StepForm, "gain", lambda *_: np.zeros((1, 1)))
    with pytest.raises(NoSolutionError, match=r"returned K has radius 1\.5"):
        solve_discrete(DiscreteGame(step))


@pytest.mark.parametrize(("slow", "is_refined"), [(1.00001, True), (0.999, False)])
def test_the_printed_gain_stabilizes(slow, is_refined):
    """If four decimals of K leave a slow mode unstable, more digits are printed."""
    modes = np.array([[0.8, 0.6], [-0.6, 0.8]])
    A = modes @ np.diag([1e3, slow]) @ modes.T
    B = modes @ [[1.0], [1.0]]
    step = Game(A, B, np.zeros((2, 1)), 1e-12 * np.eye(2), np.eye(1), np.inf)
    solution = solve_discrete(DiscreteGame(step))
    printed = printed_matrices(solution.report())["K"]
    four_decimals = solution.K.round(4)
    assert np.abs(np.linalg.eigvals(A - B @ printed)).max() < 1.0
    assert (np.abs(np.linalg.eigvals(A - B @ four_decimals)).max() > 1.0) == is_refined
    assert np.array_equal(printed, four_decimals) != is_refined


@pytest.mark.usefixtures("folder")
def test_no_other_time_is_suggested_for_a_mode_without_solution():
    """An unweighted integrator is refused with its remedy, not with a question about the time.

    The gain for discrete time exists and would leave the integrator unstable in continuous time.
    """
    A = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    B = np.array([[0.0], [1.0], [0.0]])
    step = Game(A, B, np.zeros((3, 1)), np.diag([1.0, 1.0, 0.0]), np.eye(1), np.inf)
    assert solve_discrete(DiscreteGame(step)).radius < 1.0
    plant = stored("integrator.json", A=A, B=B, Q=step.Q, R=step.R)
    refused = hfa("solve", "--model", plant)
    assert refused.code == FAILED
    assert "not detectable" in refused.err
    assert "weight in Q" in refused.err
    assert "discrete" not in refused.err
    weighted = stored("weighted.json", A=A, B=B, Q=np.eye(3), R=step.R)
    assert answer("solve", "--model", weighted)["certificate"]["ok"]
