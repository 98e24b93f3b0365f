"""Comparison of printed entries with exact ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from studies.published.comparison import Comparison, Position


def test_a_mirrored_pair_of_a_symmetric_matrix_is_one_piece_of_evidence() -> None:
    """Each entry counts log10 of its error in half units, a mirrored pair the larger of the two."""
    errors = np.array([1.0, 100.0, 1000.0, 0.1])
    positions = tuple(Position("P", row, column) for row in range(2) for column in range(2))
    exact = np.array([3.0, 2.0, 2.0, 1.0])
    half_units = np.full(4, 0.5)
    found = Comparison(positions, exact + 0.5 * errors, exact, half_units, half_units)
    assert found.evidence() == pytest.approx([3.0, 0.0, 0.0])
    assert [str(position) for position in found.wrong_positions] == ["P12"]
    relative = 0.5 * np.linalg.norm(errors) / np.linalg.norm(exact)
    assert found.relative("P") == pytest.approx(relative)
    more = (*positions, Position("K", 0, 0), Position("L", 0, 0))
    both = Comparison(
        more,
        np.append(found.printed, [3.0, 0.5]),
        np.append(exact, [2.0, 0.0]),
        np.full(6, 0.5),
        np.full(6, 0.5),
    )
    assert both.relative_error == pytest.approx(relative)
    assert [both.relative("K"), both.relative("L")] == [0.5, 0.5]
    turned = replace(found, printed=exact + 0.5 * errors[[0, 2, 1, 3]])
    assert turned.evidence() == pytest.approx([3.0, 0.0, 0.0])
