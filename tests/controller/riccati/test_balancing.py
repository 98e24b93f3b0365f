"""Eigenvalues at the axis."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from controller.riccati.balancing import FEW, is_hurwitz, spectrum


@pytest.mark.parametrize(("entry", "stable"), [(-1e-300, True), (0.0, False), (1e-300, False)])
def test_a_mode_on_the_axis_is_not_stable(entry: float, stable: bool) -> None:
    assert is_hurwitz(np.diag([-1.0, entry])) is stable


def hamiltonian(rng: np.random.Generator, n: int) -> np.ndarray:
    A, W, Q = (rng.standard_normal((n, n)) for _ in range(3))
    return np.block([[A - n * np.eye(n), -W @ W.T], [-Q @ Q.T / n, n * np.eye(n) - A.T]])


def jordan(rng: np.random.Generator, n: int) -> np.ndarray:
    """Eigenvalues far from the axis at 1 rad/s, near it beyond 2; the far ones count, because they are defective."""
    block = np.kron(np.eye(n // 4), [[-1.0, 1.0], [-1.0, -1.0]]) + 3.0 * np.eye(n // 2, k=2)
    turns = np.kron(np.diag(rng.uniform(2.0, 9.0, n // 4)), [[0.0, 1.0], [-1.0, 0.0]])
    spread = turns - 0.01 * np.eye(n // 2)
    turn = np.linalg.qr(rng.standard_normal((n, n)))[0]
    zero = np.zeros((n // 2, n // 2))
    return turn @ np.block([[block, zero], [zero, spread]]) @ turn.T


@pytest.mark.parametrize("make", [hamiltonian, jordan, lambda rng, n: rng.standard_normal((n, n))])
@pytest.mark.parametrize("n", [40])
def test_the_distance_to_the_axis_is_the_least_over_all_frequencies(
    make: Callable[[np.random.Generator, int], np.ndarray], n: int
) -> None:
    """Of many frequencies few are tried, and the nearest to an undamped mode is one of them."""
    for seed in range(3):
        found = spectrum(make(np.random.default_rng(seed), n))
        shifts = np.abs(found.eigenvalues.imag)
        each = [np.linalg.svd(found.balanced - 1j * w * np.eye(len(found.balanced)), compute_uv=False) for w in shifts]
        least = min(values[-1] for values in each) / np.linalg.norm(found.balanced, 2)
        assert len(np.unique(shifts)) > FEW
        assert found.axis_distance() == pytest.approx(least, rel=1e-9, abs=1e-16)


def test_a_mode_on_the_axis_among_many_is_seen() -> None:
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.standard_normal((60, 60)))[0]
    damped = np.kron(np.diag(rng.uniform(1.0, 9.0, 30)), [[-0.1, 1.0], [-1.0, -0.1]])
    damped[-2:, -2:] = [[0.0, 3.0], [-3.0, 0.0]]
    assert spectrum(turn @ damped @ turn.T).axis_distance() <= 1e-15


def test_the_frequency_is_that_of_the_distance_and_not_of_the_eigenvalue_of_least_damping() -> None:
    found = spectrum(jordan(np.random.default_rng(0), 40))
    least_damped = found.eigenvalues[np.argmax(found.eigenvalues.real)]
    distance, frequency = found.nearest_to_axis()
    assert distance == found.axis_distance()
    assert frequency < 2.0 < abs(least_damped.imag)
