"""The certificate of a solution, which refuses each planted wrong solution for the right reason."""

from __future__ import annotations

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
from hfa.main import FAILED
from hfa_support.matrices import balanced

I2 = np.eye(2)
EPS = np.finfo(float).eps


def _certify(game: Game, P: np.ndarray, second_P: np.ndarray) -> Certificate:
    """Return the certificate of a given P, with the checks of `carefully_certified`.

    second_P: result of the second derivation
    """
    form = NormalForm.of(game)
    X, second_X = form.of_value(P), form.of_value(second_P)
    return Certificate((*form.axis_checks(), *form.checks(X), agreement(X, second_X)))


@pytest.mark.parametrize(
    ("change", "factor", "failed"),
    [
        (lambda game, _: other_root(game), None, "game_loop_abscissa"),
        (lambda _, P: P * (1.0 + 1e-8), 1.0, "residual"),
        (lambda _, P: -P, 1.0, "positive_semidefinite"),
        (lambda _, P: np.full_like(P, np.nan), 1.0, "residual"),
        (lambda _, P: P, 1.0 + 1e-7, "second_derivation"),
        (lambda _, P: P, np.nan, "second_derivation"),
    ],
)
def test_a_wrong_solution_is_refused(
    game: Game,
    change: Callable[[Game, np.ndarray], np.ndarray],
    factor: float | None,
    failed: str,
) -> None:
    """Each wrong P, and each second P that differs, fails the check that it violates."""
    P = change(game, solve(game).P)
    second = P if factor is None else factor * solve(game).P
    names = failed_names(_certify(game, P, second).checks)
    assert failed in names
    assert "residual" not in names or failed != "game_loop_abscissa"  # a root has no residual


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


def least_singular_value(matrix: np.ndarray, frequency: float) -> float:
    shifted = matrix - 1j * frequency * np.eye(len(matrix))
    return float(np.linalg.svd(shifted, compute_uv=False)[-1])


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


@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi])
def test_a_damped_rotation_is_as_far_from_the_circle_as_its_radius(angle: float) -> None:
    """The distance of a normal matrix with eigenvalues r e^±jω is (1 - r) / r, at ω."""
    turn = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    found = distance_to_instability(0.8 * np.array(turn), is_discrete=True)
    assert found == pytest.approx((0.25, angle), rel=1e-12)


def test_the_change_of_the_gain_is_that_of_changed_last_digits() -> None:
    """The stated change of K is that of games with changed last digits, solved with 60 digits."""
    A, modes = np.array([[-0.04, 0.72], [0.72, -0.46]]), np.array([[0.8, 0.6], [-0.6, 0.8]])
    B = modes.T @ [[1e-4], [1.0]]
    game, rng = Game(A, B, Q=I2, R=[1.0]), np.random.default_rng(0)
    K = reference_solution(game).K
    changes = []
    for _ in range(12):
        A_signs, B_signs = (rng.choice([-1.0, 1.0], size=matrix.shape) for matrix in (A, B))
        changed = Game(A * (1.0 + EPS * A_signs), B * (1.0 + EPS * B_signs), Q=I2, R=[1.0])
        changes.append(relative_error(B @ reference_solution(changed).K, B @ K))
    checks = {check.name: check.value for check in solve(game).certificate.checks}
    stated = checks["gain_change"]
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
