"""The exact solution: as accurate as claimed, certified for the right reasons, refused for the right ones."""

from __future__ import annotations

import itertools
import json
import math

import control
import mpmath
import numpy as np
import pytest
from game_samples import game_models, random_game, regenerated_models
from reference_riccati import reference_solution, relative_error
from scipy.linalg import schur, solve_continuous_lyapunov

from controller.game.zero_sum import Game
from hfa_model.support.errors import NoSolutionError
from verification.riccati.balance import balanced
from verification.riccati.certificate import Certificate, certify, hamiltonian_checks, relative_residual
from verification.riccati.delta_min import DeltaMin, minimum_delta
from verification.riccati.derivations import certified_solution
from verification.riccati.gare import solve_game
from verification.riccati.gare_iteration import iterated_solution
from verification.riccati.gare_schur import schur_solution
from verification.riccati.units import balanced_units, in_units

MODELS = sorted(game_models())
OURS = regenerated_models()
I2 = np.eye(2)


@pytest.fixture(params=MODELS)
def game(request: pytest.FixtureRequest) -> Game:
    return game_models()[request.param]


def _failed(certificate: Certificate) -> set[str]:
    return {check.name for check in certificate.failures}


# Accuracy -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*MODELS, *OURS])
def test_P_and_K_are_exact_to_1e12(name: str) -> None:
    game = (game_models() | OURS)[name]
    reference, solution = reference_solution(game), solve_game(game)
    assert reference.exists
    assert relative_error(solution.P, reference.P) < 1e-12
    assert relative_error(solution.K, reference.K) < 1e-12
    units = 1.0 / np.sqrt(np.diag(reference.P))  # and so is every entry, in units that make them alike
    assert np.abs((solution.P - reference.P) * np.outer(units, units)).max() < 1e-12


def test_second_derivation_is_exact_to_1e12(game: Game) -> None:
    assert relative_error(iterated_solution(game), reference_solution(game).P) < 1e-12


def test_reference_agrees_with_eigenvectors_by_mpmath(game: Game) -> None:
    n = len(game.A)
    H = np.block([[game.A, -game.S], [-game.Q, -game.A.T]])
    with mpmath.workdps(40):
        values, vectors = mpmath.eig(mpmath.matrix(H.tolist()))
        stable = [i for i in range(2 * n) if values[i].real < 0]
        top = mpmath.matrix([[vectors[row, i] for i in stable] for row in range(n)])
        bottom = mpmath.matrix([[vectors[n + row, i] for i in stable] for row in range(n)])
        P = np.array((bottom * mpmath.inverse(top)).apply(mpmath.re).tolist(), dtype=float)
    assert relative_error(reference_solution(game).P, P) < 1e-13  # S was rounded to double on the way


def test_solution_satisfies_what_defines_it(game: Game) -> None:
    solution = solve_game(game)
    assert solution.certificate.ok
    assert not solution.certificate.failures
    P = solution.P
    residual = game.A.T @ P + P @ game.A + game.Q - P @ (game.B @ np.linalg.solve(game.R, game.B.T)) @ P
    residual += P @ game.E @ game.E.T @ P / game.delta**2
    assert np.abs(residual).max() < 1e-12 * np.abs(P @ game.A).max()
    np.testing.assert_allclose(solution.K, np.linalg.inv(game.R) @ game.B.T @ P, rtol=1e-12)
    np.testing.assert_allclose(solution.disturbance_gain, game.E.T @ P / game.delta**2, rtol=1e-12)
    flown = np.linalg.eigvals(game.A - game.B @ solution.K)
    np.testing.assert_allclose(np.sort(solution.closed_loop_eigenvalues.real), np.sort(flown.real), rtol=1e-9)
    assert solution.worst_case_eigenvalues.real.max() < 0.0


def test_delta_to_infinity_gives_lqr(game: Game) -> None:
    K, P, _ = control.lqr(game.A, game.B, game.Q, game.R)
    lqr = solve_game(game.with_delta(math.inf))
    assert relative_error(lqr.P, P) < 1e-11
    assert relative_error(lqr.K, K) < 1e-11
    assert not lqr.disturbance_gain.any()
    distances = [relative_error(solve_game(game.with_delta(delta)).P, lqr.P) for delta in (1e4, 1e5)]
    assert math.log10(distances[0] / distances[1]) == pytest.approx(2.0, abs=0.01)


def test_value_falls_as_the_disturbance_pays_more(game: Game) -> None:
    values = [solve_game(game.with_delta(delta)).P for delta in (130.0, 200.0, 500.0, math.inf)]
    for cheaper, dearer in itertools.pairwise(values):
        assert np.linalg.eigvalsh(cheaper - dearer)[0] > -1e-9


def test_scalar_game_in_closed_form() -> None:
    for a, s in ((-1.0, 0.75), (2.0, 0.75), (-1.0, -0.3), (-1.0, 0.0)):
        delta = 1.0 / math.sqrt(1.0 - s)
        exact = 1.5 if s == 0.0 else (a + math.sqrt(a * a + 3.0 * s)) / s
        game = Game([[a]], [[2.0]], [[1.0]], [[3.0]], [[4.0]], delta)
        assert solve_game(game).P[0, 0] == pytest.approx(exact, rel=1e-13)


# Invariance -----------------------------------------------------------------------------------------------------


def test_units_of_state_change_nothing(game: Game) -> None:
    units = np.array([1e3, 1e-4, 57.3, 1e-2, 1e5, 0.3])
    P, scaled = solve_game(game).P, solve_game(in_units(game, units)).P
    assert relative_error(scaled / np.outer(units, units), P) < 1e-12


def test_units_of_cost_and_time_change_nothing(game: Game) -> None:
    P = solve_game(game).P
    dearer = Game(game.A, game.B, game.E, 7.0 * game.Q, 7.0 * game.R, math.sqrt(7.0) * game.delta)
    assert relative_error(solve_game(dearer).P, 7.0 * P) < 1e-12
    slower = Game(
        60.0 * game.A, 60.0 * game.B, 60.0 * game.E, 60.0 * game.Q, 60.0 * game.R, math.sqrt(60.0) * game.delta
    )
    assert relative_error(solve_game(slower).P, P) < 1e-12


def test_balanced_units_make_numbers_alike(game: Game) -> None:
    units = np.array([1e6, 1.0, 1e-6, 1e3, 1e-3, 1.0])
    alike = in_units(in_units(game, units), balanced_units(in_units(game, units)))
    assert np.log2(balanced_units(game)) == pytest.approx(np.round(np.log2(balanced_units(game))))
    assert np.abs(np.log10(np.diag(solve_game(alike).P))).max() < 4.0


# Degenerate games -----------------------------------------------------------------------------------------------


def test_state_that_costs_nothing_is_no_obstacle() -> None:
    P = solve_game(Game(np.diag([-1.0, -2.0]), [[1.0], [1.0]], I2, np.diag([1.0, 0.0]), [[1.0]], 5.0)).P
    s = 1.0 - 1.0 / 25.0
    np.testing.assert_allclose(P, np.diag([(-1.0 + math.sqrt(1.0 + s)) / s, 0.0]), atol=1e-15)


def test_double_eigenvalue_and_no_cost_at_all() -> None:
    game = Game([[-0.5, 1.0], [0.0, -0.5]], [[1.0], [1.0]], I2, 0.0 * I2, [[1.0]], 0.01)
    assert not solve_game(game).P.any()
    assert minimum_delta(game) == DeltaMin(0.0, 0.0)


def test_unstable_mode_outside_the_cost_is_brought_to_rest() -> None:
    P = solve_game(Game([[0.5]], [[1.0]], [[1.0]], [[0.0]], [[1.0]], math.inf)).P
    assert P[0, 0] == pytest.approx(1.0, rel=1e-14)  # least energy: p = 2 a


def test_without_disturbance_matrix_every_delta_will_do(game: Game) -> None:
    quiet = Game(game.A, game.B, 0.0 * game.E, game.Q, game.R, 1e-3)
    assert relative_error(solve_game(quiet).P, solve_game(game.with_delta(math.inf)).P) < 1e-12
    assert minimum_delta(quiet).margin(quiet.delta) == math.inf


@pytest.mark.parametrize(
    ("A", "B", "Q", "message"),
    [
        (np.diag([0.5, -1.0]), [[0.0], [1.0]], I2, "not stabilizable: no input reaches the mode with eigenvalue +0.5;"),
        ([[0.5, 1.0], [-1.0, 0.5]], [[0.0], [0.0]], I2, "not stabilizable: .* eigenvalue +0.5+1j;"),
        ([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], 0.0 * I2, "not detectable: .* eigenvalue +0+1j costs nothing"),
        (np.diag([0.0, -1.0]), [[1.0], [1.0]], np.diag([0.0, 1.0]), "not detectable: .* eigenvalue +0 costs nothing"),
    ],
)
def test_problem_without_lqr_solution_names_the_mode(A: object, B: object, Q: object, message: str) -> None:
    game = Game(A, B, I2, Q, [[1.0]], 10.0)  # type: ignore[arg-type]
    pattern = message.replace("+", r"\+")
    for solve in (solve_game, minimum_delta):
        with pytest.raises(NoSolutionError, match=pattern) as refusal:
            solve(game)
        assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "change", [{"A": 1e90}, {"A": 1e-90}, {"B": 1e-90}, {"R": 1e-90}, {"R": 1e90}, {"Q": 1e90}, {"delta": 1e-49}]
)
def test_absurd_numbers_end_in_a_solution_or_in_one_line(change: dict[str, float]) -> None:
    parts = {"A": np.diag([1.0, -1.0]), "B": np.array([[1.0], [0.0]]), "E": I2, "Q": I2, "R": np.eye(1), "delta": 10.0}
    parts |= {name: parts[name] * factor for name, factor in change.items()}
    try:
        assert solve_game(Game(**parts)).certificate.ok
    except NoSolutionError as refusal:
        assert "\n" not in str(refusal)  # noqa: PT017


def test_balancing_says_nothing_about_large_scales() -> None:
    scaled, scaling = balanced(np.array([[1.0, 1e80], [1e-80, 2.0]]))
    assert scaling.max() / scaling.min() > 1e70
    assert np.abs(scaled).max() < 1e3


# Planted errors -------------------------------------------------------------------------------------------------


def _root_with_an_unstable_mode(game: Game) -> np.ndarray:
    """A symmetric root of the equation from an invariant subspace that takes one real mode from the wrong side."""
    n = len(game.A)
    H = np.block([[game.A, -game.S], [-game.Q, -game.A.T]])
    values = np.linalg.eigvals(H)
    fastest = values[np.abs(values.imag) == 0.0].real.max()

    def wanted(real: float, imaginary: float) -> bool:
        mirrored = imaginary == 0.0 and abs(abs(real) - fastest) < 1e-6 * fastest
        return (real > 0.0) if mirrored else (real < 0.0)

    _, vectors, size = schur(H, sort=wanted)
    assert size == n
    P = vectors[n:, :n] @ np.linalg.inv(vectors[:n, :n])
    P = (P + P.T) / 2.0
    for _ in range(3):
        correction = solve_continuous_lyapunov((game.A - game.S @ P).T, -game.residual(P))
        P = P + (correction + correction.T) / 2.0
    return P


def test_non_stabilizing_root_is_refused(game: Game) -> None:
    P = _root_with_an_unstable_mode(game)
    assert relative_residual(game, P) < 1e-13
    certificate = certify(game, P, P)
    assert not certificate.ok
    assert "game_loop_abscissa" in _failed(certificate)
    assert "residual" not in _failed(certificate)
    assert "is not Hurwitz" in certificate["game_loop_abscissa"].reason


def test_indefinite_root_is_refused(game: Game) -> None:
    below = game.with_delta(minimum_delta(game).value * (1.0 - 1e-5))
    P = schur_solution(below)
    certificate = certify(below, P, P)
    assert _failed(certificate) == {"positive_semidefinite", "control_loop_abscissa"}
    assert certificate["game_loop_abscissa"].ok
    assert certificate["residual"].value < 1e-14
    assert "P is indefinite" in certificate["positive_semidefinite"].reason


def test_indefinite_solutions_that_scipy_returns_are_refused() -> None:
    rng = np.random.default_rng(8)
    refused = 0
    while refused < 5:
        game = random_game(rng, scaled=False)
        if not all(check.ok for check in hamiltonian_checks(game)):
            continue
        P = schur_solution(game)
        if np.linalg.eigvalsh(P)[0] > -1e-6 * np.abs(P).max():
            continue
        certificate = certify(game, P, P)
        assert {"positive_semidefinite", "control_loop_abscissa"} <= _failed(certificate)
        assert certificate["residual"].ok
        with pytest.raises(NoSolutionError, match="Lanzon-Feng-Anderson"):
            iterated_solution(game)
        refused += 1


def test_lqr_solution_is_not_the_game_solution(game: Game) -> None:
    P = solve_game(game.with_delta(math.inf)).P
    assert _failed(certify(game, P, solve_game(game).P)) == {"residual", "second_derivation"}


def test_solution_of_another_game_is_refused(game: Game) -> None:
    P = solve_game(game).P
    other = Game(game.A + 1e-6, game.B, game.E, game.Q, game.R, game.delta)
    assert "residual" in _failed(certify(other, P, P))


@pytest.mark.parametrize(
    ("change", "failed"),
    [
        (lambda P: P * (1.0 + 1e-8), "residual"),
        (lambda P: P + 1e-9 * np.triu(np.abs(P).max() * np.ones_like(P), 1), "symmetry"),
        (lambda P: -P, "positive_semidefinite"),
        (lambda P: 0.0 * P, "residual"),
    ],
)
def test_changed_solution_is_refused(game: Game, change: object, failed: str) -> None:
    P = solve_game(game).P
    assert failed in _failed(certify(game, change(P), P))  # type: ignore[operator]


def test_disagreement_of_the_derivations_is_refused(game: Game) -> None:
    P = solve_game(game).P
    assert _failed(certify(game, P, P * (1.0 + 1e-7))) == {"second_derivation"}
    assert not certify(game, P, np.full_like(P, np.nan)).ok
    nowhere = certify(game, np.full_like(P, np.nan), P)
    assert not nowhere.ok
    assert nowhere["residual"].reason == "P has entries that are not finite"


def test_hamiltonian_on_the_axis_is_seen_through_rounding() -> None:
    """At this delta the double eigenvalue 0 of H is computed some 1e-8 off the axis: |Re| would mislead."""
    critical = Game([[-1.0]], [[0.0]], [[1.0]], [[1.0]], [[1.0]], 1.0)
    rotation = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    A = rotation @ np.diag([-1.0, -2.0, -3.0]) @ rotation.T
    Q = rotation @ np.diag([1.0, 1.0, 1.0]) @ rotation.T
    hidden = Game(A, np.zeros((3, 1)), np.eye(3), (Q + Q.T) / 2.0, [[1.0]], 1.0)
    for game in (critical, hidden):
        assert "hamiltonian_axis_distance" in {check.name for check in hamiltonian_checks(game) if not check.ok}
        with pytest.raises(NoSolutionError, match="delta_min"):
            solve_game(game)
        assert solve_game(game.with_delta(1.01)).certificate.ok


def test_schur_method_refuses_a_hamiltonian_on_the_axis(game: Game) -> None:
    rotor = Game([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [0.0]], I2, 0.0 * I2, [[1.0]], math.inf)
    with pytest.raises(NoSolutionError, match=r"stable subspace|multiple root"):
        schur_solution(rotor)


# The second derivation ------------------------------------------------------------------------------------------


def test_iteration_refuses_where_there_is_no_value(game: Game) -> None:
    for delta in (1.0, 50.0, 100.0, minimum_delta(game).value * 0.999):
        with pytest.raises(NoSolutionError, match="Lanzon-Feng-Anderson"):
            iterated_solution(game.with_delta(delta))


def test_iteration_refuses_what_no_input_can_stabilize() -> None:
    with pytest.raises(NoSolutionError, match="step 1 of the Lanzon-Feng-Anderson"):
        iterated_solution(Game(np.diag([0.5, -1.0]), [[0.0], [1.0]], I2, I2, [[1.0]], 10.0))


# Results --------------------------------------------------------------------------------------------------------


def test_results_are_plain_json(game: Game) -> None:
    content = json.loads(json.dumps(solve_game(game).to_dict(), allow_nan=False))
    assert np.array_equal(np.array(content["P"]), solve_game(game).P)
    assert content["delta"] == game.delta
    assert content["certificate"]["ok"] is True
    names = [check["name"] for check in content["certificate"]["checks"]]
    assert len(names) == len(set(names)) == 8
    lqr = json.loads(json.dumps(solve_game(game.with_delta(math.inf)).to_dict(), allow_nan=False))
    assert lqr["delta"] is None


def test_results_cannot_be_changed(game: Game) -> None:
    solution = solve_game(game)
    with pytest.raises(ValueError, match="read-only"):
        solution.P[0, 0] = 0.0
    P, certificate = certified_solution(game)
    assert np.array_equal(P, solution.P)
    with pytest.raises(KeyError):
        certificate["no_such_test"]
