"""The spectra of a pair, in the order in which they are compared and shown."""

from __future__ import annotations

import numpy as np

from hfa_model import Aircraft
from hfa_support.reporting.text import Table, eigenvalue_text
from verification import regenerate_all
from verification.regeneration import _spectrum


def test_a_spectrum_begins_with_the_fastest_and_the_upper_half() -> None:
    slow, fast = np.array([[-0.1, 0.5], [-0.5, -0.1]]), np.array([[-2.0, 3.0], [-3.0, -2.0]])
    A = np.zeros((5, 5))
    A[:2, :2], A[2:4, 2:4], A[4, 4] = slow, fast, 1.0
    np.testing.assert_allclose(_spectrum(A), [-2 + 3j, -2 - 3j, 1, -0.1 + 0.5j, -0.1 - 0.5j], atol=1e-12)


def test_the_report_shows_each_eigenvalue_or_pair_once(published_aircraft: Aircraft) -> None:
    for pair in regenerate_all(published_aircraft).pairs:
        (table,) = [each for each in pair.report().parts if isinstance(each, Table) and "regenerated A" in each.header]
        assert [row[2] for row in table.rows] == [eigenvalue_text(one) for one in pair.eigenvalues if one.imag >= 0.0]
        assert len(table.rows) == 4
