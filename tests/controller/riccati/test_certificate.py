"""The certificate of a solution, which refuses each planted wrong solution for the right reason."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cli import answer
from game_files import checks_of, stored
from game_samples import failed_names
from planted_critics import other_root
from reference_riccati import reference_solution, relative_error
from tolerances import SAME_SOLUTION

from controller.riccati.axis_distance import distance_to_instability
from controller.riccati.certificate import Certificate, agreement, gain_change
from controller.riccati.normal_form import NormalForm
from hfa import Game, NoSolutionError, solve
from hfa.extend import Check
from hfa.main import FAILED
from hfa_support.matrices import balanced

I2 = np.eye(2)
EPS = np.finfo(float).eps


def named(certificate: Certificate) -> dict[str, Check]:
    return {check.name: check for check in certificate.checks}


def _certify(game: Game, P: np.ndarray, second_P: np.ndarray) -> Certificate:
    """Return the certificate of a given P, with the checks of `carefully_certified`.

    second_P: result of the second derivation
    """
    form = NormalForm.of(game)
    X, second_X = form.of_value(P), form.of_value(second_P)
    return Certificate((*form.axis_checks(), *form.checks(X), agreement(X, second_X)))


def test_non_stabilizing_root_is_refused(game: Game) -> None:
    """A root of the Riccati equation with a tiny residual fails if A - S P is not Hurwitz."""
    P = other_root(game)
    certificate = _certify(game, P, P)
    assert named(certificate)["residual"].value < 1e-13
    assert not certificate.ok
    assert "game_loop_abscissa" in failed_names(certificate.checks)
    assert "residual" not in failed_names(certificate.checks)
    assert "is not Hurwitz" in named(certificate)["game_loop_abscissa"].reason


@pytest.mark.parametrize(
    ("change", "failed"),
    [
        (lambda P: P * (1.0 + 1e-8), "residual"),
        (lambda P: -P, "positive_semidefinite"),
        (lambda P: 0.0 * P, "residual"),
    ],
)
def test_changed_solution_is_refused(game: Game, change: object, failed: str) -> None:
    """Each change planted in P fails the check that it violates."""
    P = solve(game).P
    assert failed in failed_names(_certify(game, change(P), P).checks)  # type: ignore[operator]


def test_newtons_corrections_remove_an_error_of_a_solution(game: Game) -> None:
    """From an error of 1e-4, not symmetric, the corrected X is that of 60 digits, in all games."""
    for delta in (game.delta, math.inf):
        form = NormalForm.of(game.with_delta(delta))
        exact = form.of_value(reference_solution(game.with_delta(delta)).P)
        noise = np.random.default_rng(0).standard_normal(exact.shape)
        found = form.refined(exact + 1e-4 * np.abs(exact) * noise)
        assert relative_error(found, exact) < 1e-12


def test_disagreement_of_the_derivations_is_refused(game: Game) -> None:
    """Two derivations of P that differ by 1e-7 fail, as does one that is not finite."""
    P = solve(game).P
    assert failed_names(_certify(game, P, P * (1.0 + 1e-7)).checks) == {"second_derivation"}
    assert not _certify(game, P, np.full_like(P, np.nan)).ok
    nowhere = _certify(game, np.full_like(P, np.nan), P)
    assert not nowhere.ok
    assert "not finite" in named(nowhere)["residual"].reason


def test_a_hamiltonian_on_the_axis_is_detected() -> None:
    """A double eigenvalue 0 of the Hamiltonian is detected, although rounding moves it by 1e-8."""
    critical = Game([[-1.0]], [[0.0]], [[1.0]], [[1.0]], [[1.0]], 1.0)
    rotation = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    A = rotation @ np.diag([-1.0, -2.0, -3.0]) @ rotation.T
    Q = rotation @ np.diag([1.0, 1.0, 1.0]) @ rotation.T
    hidden = Game(A, np.zeros((3, 1)), np.eye(3), (Q + Q.T) / 2.0, [[1.0]], 1.0)
    for game in (critical, hidden):
        assert "hamiltonian_axis_distance" in failed_names(NormalForm.of(game).axis_checks())
        with pytest.raises(NoSolutionError, match="delta_min"):
            solve(game)
        assert solve(game.with_delta(1.01)).certificate.ok


STABLE: dict[str, Any] = {
    "A": np.array([[-1.0, 0.2], [0.1, -1.0]]),
    "B": np.array([[1.0], [1.0]]),
    "E": np.eye(2),
    "Q": np.zeros((2, 2)),
    "R": np.eye(1),
    "delta": 2.0,
}


pytestmark = pytest.mark.usefixtures("folder")


def test_a_costless_stable_plant_has_zero_value() -> None:
    """A stable plant without cost has the certified solution P = K = 0 and delta_min 0."""
    data = answer("solve", "--model", stored("plant.npz", **STABLE))
    assert np.array_equal(data["P"], np.zeros((2, 2)))
    assert np.array_equal(data["K"], np.zeros((1, 2)))
    assert data["certificate"]["ok"] is True
    assert (data["delta_min"], data["delta_margin"]) == (0.0, None)
    assert {"cost_lyapunov", "l2_gain"} <= {check["name"] for check in data["meaning"]}


@pytest.mark.parametrize("key", ["P", "K"])
def test_verify_accepts_only_0_for_zero_gains(key: str) -> None:
    """If the optimal P and K are 0, `hfa verify` accepts 0 and refuses entries of 0.001."""
    plant = stored("plant.npz", **STABLE)
    shape = (2, 2) if key == "P" else (1, 2)
    assert (
        answer(
            "verify", "--model", plant, "--weights", stored("zero.npz", **{key: np.zeros(shape)})
        )["ok"]
        is True
    )
    wrong = stored("wrong.npz", **{key: 1e-3 * np.eye(*shape)})
    assert {"policy_rel_error", "K_rel_error"} <= {
        name
        for name, check in checks_of(
            answer("verify", "--model", plant, "--weights", wrong, code=FAILED)
        ).items()
        if not check["ok"]
    }


def test_a_costless_unstable_plant_has_stabilizing_value() -> None:
    """For an unstable plant without cost, the certified solution is the stabilizing P = 2 a / s.

    P = 0 also satisfies the Riccati equation.
    """
    game = Game(np.eye(1), np.eye(1), Q=np.zeros((1, 1)), R=np.eye(1))
    assert solve(game).P[0, 0] == pytest.approx(2.0, rel=SAME_SOLUTION)


def hamiltonian(rng: np.random.Generator, n: int) -> np.ndarray:
    A, W, Q = (rng.standard_normal((n, n)) for _ in range(3))
    return np.block([[A - n * np.eye(n), -W @ W.T], [-Q @ Q.T / n, n * np.eye(n) - A.T]])


def jordan(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return a matrix whose distance to the imaginary axis is determined by defective eigenvalues.

    The defective eigenvalues, -1 ± i, are far from the axis. The simple eigenvalues, with
    frequencies above 2 rad/s, are near the axis.
    """
    block = np.kron(np.eye(n // 4), [[-1.0, 1.0], [-1.0, -1.0]]) + 3.0 * np.eye(n // 2, k=2)
    turns = np.kron(np.diag(rng.uniform(2.0, 9.0, n // 4)), [[0.0, 1.0], [-1.0, 0.0]])
    spread = turns - 0.01 * np.eye(n // 2)
    turn = np.linalg.qr(rng.standard_normal((n, n)))[0]
    zero = np.zeros((n // 2, n // 2))
    return turn @ np.block([[block, zero], [zero, spread]]) @ turn.T


@pytest.mark.slow
@pytest.mark.parametrize("make", [hamiltonian, jordan, lambda rng, n: rng.standard_normal((n, n))])
@pytest.mark.parametrize("is_discrete", [False, True])
def test_the_distance_to_instability_is_the_least_over_frequencies(
    make: Callable[[np.random.Generator, int], np.ndarray], is_discrete: bool
) -> None:
    """The distance equals the least of σ_min(A - s I) / ‖A‖₂ on the axis, or on the unit circle.

    A is balanced. The least is found on fine grids of the frequency. The tolerance is 2e-6.
    """
    for seed in range(2):
        matrix = balanced(make(np.random.default_rng(seed), 40))[0]
        if is_discrete:
            matrix = 0.9 * matrix / np.abs(np.linalg.eigvals(matrix)).max()
        values = np.linalg.eigvals(matrix)
        frequencies = np.unique(np.abs(np.angle(values) if is_discrete else values.imag))
        end = np.pi if is_discrete else 1.5 * frequencies.max()
        grid = np.unique(np.concatenate([frequencies, np.linspace(0.0, end, 200)]))
        for _ in range(3):
            sizes = [least_singular_value(matrix, each, is_discrete) for each in grid]
            best = int(np.argmin(sizes))
            least = sizes[best]
            grid = np.linspace(grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)], 30)
        found = distance_to_instability(matrix, is_discrete=is_discrete)
        # A singular value below 1e-16 times the norm is rounding.
        expected = least / np.linalg.norm(matrix, 2)
        assert found.distance == pytest.approx(expected, rel=2e-6, abs=2e-16)


def least_singular_value(matrix: np.ndarray, frequency: float, is_discrete: bool = False) -> float:
    value = np.exp(1j * frequency) if is_discrete else 1j * frequency
    return float(np.linalg.svd(matrix - value * np.eye(len(matrix)), compute_uv=False)[-1])


def test_the_distance_of_defective_eigenvalues_is_off_resonance() -> None:
    """The distance to the axis of three coupled oscillators of 1 rad/s is attained at 0.991 rad/s.

    At the frequencies of the eigenvalues the singular value is larger.
    """
    oscillators = np.kron(np.eye(3), [[-1.0, 1.0], [-1.0, -1.0]]) + 3.0 * np.eye(6, k=2)
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((6, 6)))[0]
    matrix = balanced(turn @ oscillators @ turn.T)[0]
    distance, frequency = distance_to_instability(matrix, is_discrete=False)
    size = distance * np.linalg.norm(matrix, 2)
    least = min(least_singular_value(matrix, w) for w in np.linspace(0.9, 1.1, 2001))
    values = np.linalg.eigvals(matrix)
    at_eigenvalues = min(least_singular_value(matrix, abs(value.imag)) for value in values)
    assert size == pytest.approx(least, rel=1e-6)  # the claimed accuracy; the grid adds 1e-8
    assert size < (1.0 - 5e-5) * at_eigenvalues
    assert frequency == pytest.approx(0.991, abs=1e-3)


def test_one_mode_on_the_axis_is_detected() -> None:
    """One mode on the imaginary axis among 29 damped ones is detected."""
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.standard_normal((60, 60)))[0]
    damped = np.kron(np.diag(rng.uniform(1.0, 9.0, 30)), [[-0.1, 1.0], [-1.0, -0.1]])
    damped[-2:, -2:] = [[0.0, 3.0], [-3.0, 0.0]]
    found = distance_to_instability(turn @ damped @ turn.T, is_discrete=False)
    assert found.distance <= 1e-15


@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi])
def test_a_damped_rotation_is_as_far_from_the_circle_as_its_radius(angle: float) -> None:
    """The distance of a normal matrix with eigenvalues r e^±jω is (1 - r) / r, at ω."""
    turn = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    found = distance_to_instability(0.8 * np.array(turn), is_discrete=True)
    assert found == pytest.approx((0.25, angle), rel=1e-12)


@pytest.mark.parametrize("reach", [1e-2, 1e-4])
def test_the_change_of_the_gain_is_that_of_changed_last_digits(reach: float) -> None:
    """The stated change of K is that of games with changed last digits, solved with 60 digits."""
    A, modes = np.array([[-0.04, 0.72], [0.72, -0.46]]), np.array([[0.8, 0.6], [-0.6, 0.8]])
    B = modes.T @ [[reach], [1.0]]
    game, rng = Game(A, B, Q=I2, R=[1.0]), np.random.default_rng(0)
    K = reference_solution(game).K
    changes = []
    for _ in range(12):
        A_signs, B_signs = (rng.choice([-1.0, 1.0], size=matrix.shape) for matrix in (A, B))
        changed = Game(A * (1.0 + EPS * A_signs), B * (1.0 + EPS * B_signs), Q=I2, R=[1.0])
        changes.append(relative_error(B @ reference_solution(changed).K, B @ K))
    stated = named(solve(game).certificate)["gain_change"].value
    assert 0.5 < stated / max(changes) < 2.0


@pytest.mark.parametrize(("percent", "is_refused"), [(0.95, False), (1.05, True)])
def test_a_gain_that_changes_is_refused(
    percent: float, is_refused: bool, monkeypatch: pytest.MonkeyPatch, game: Game
) -> None:
    """If the further game has a K that differs by more than 1 %, the game is refused."""
    form = NormalForm.of(game)
    changed = form.perturbed_by_rounding()
    assert gain_change(form, changed, form.by_schur()).value < 1e-10

    def with_A(factor: float) -> NormalForm:
        return replace(form, A=factor * form.A)

    loops = [form.inputs @ each.gains(each.by_schur())[0] for each in (form, with_A(1.01))]
    other = with_A(1.0 + 1e-4 * percent / relative_error(loops[1], loops[0]))
    monkeypatch.setattr(NormalForm, "perturbed_by_rounding", lambda form: other)
    if not is_refused:
        solve(game)
        return
    with pytest.raises(
        NoSolutionError, match=r"K changes by .* % if the entries of the game change"
    ):
        solve(game)
