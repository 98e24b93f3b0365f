"""Checks of regenerated linear models against the printed ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hfa
from hfa_model import published_models
from trim import regenerate
from verification.regeneration import Regeneration, check_pair


def test_moved_eigenvalues_are_those_of_the_checks() -> None:
    """Each eigenvalue of the printed A is scaled by another factor."""
    published = published_models()[0]
    model = regenerate(hfa.aircraft(), published)
    assert check_pair(model, published).ok
    roots, modes = np.linalg.eig(published.A)
    shift = 1e-3 * np.abs(roots)  # equal for conjugate roots
    moved = (modes * (roots * (1.0 + shift))) @ np.linalg.inv(modes)
    checks = check_pair(replace(model, A=moved.real), published).checks
    slow = np.abs(roots) < 1.0
    assert [check.value for check in checks[1:]] == pytest.approx(
        [shift[~slow].max(), np.abs(shift * roots)[slow].max(), 0], rel=1e-6
    )
    unstable = check_pair(replace(model, A=-published.A), published).checks[3]
    assert unstable.value == abs(
        np.count_nonzero(roots.real < 0) - np.count_nonzero(roots.real > 0)
    )
    pair = check_pair(replace(model, A=moved.real), published)
    figure = Regeneration((pair,)).picture().draw()
    order = sorted(roots, key=lambda root: (-round(abs(root), 6), -root.imag))
    assert pair.printed_eigenvalues == pytest.approx(np.array(order))
    (axes,) = figure.axes
    bars = [patch.get_width() for patch in axes.containers[0]]
    off = [entry.half_units for entry in pair.entries if entry.printed]
    assert bars == pytest.approx(off)
    assert axes.get_xlim()[1] == pytest.approx(max(2.0, 1.1 * np.abs(off).max()))
    for size in (-1.0, 1.0):
        A = published.A.copy()
        A[0, 0] += size
        farther = check_pair(replace(model, A=A), published)
        sizes = [abs(entry.half_units) for entry in farther.entries]
        assert farther.checks[0].value == max(sizes) > 3.0
    slowed = replace(model, A=published.A + 2e-3 * np.eye(len(roots)))
    failed = [
        check.name.split()[0] for check in check_pair(slowed, published).checks if not check.ok
    ]
    assert "slow" in failed
    assert "fast" not in failed
