"""Checks of regenerated linear models against the printed ones."""

import numpy as np
import pytest

import hfa
from verification import regenerate_all


@pytest.mark.parametrize("mass", [1.0, 1.02])
def test_errors_of_eigenvalues_and_entries_are_those_of_the_matrices(mass):
    """The identified aircraft agrees with the printed models, a heavier one does not.

    Fast eigenvalues are compared relative to their size, slow ones (below 1 rad/s) as they are.
    """
    known = hfa.paper.default_parameters().values
    aircraft = hfa.aircraft(parameters=known._replace(panel_mass=mass * known.panel_mass))
    found = regenerate_all(aircraft)
    assert found.ok == (mass == 1.0)
    assert len(found.pairs) == 2
    for pair in found.pairs:
        assert len(pair.entries) == 6 * 6 + 6 * 5
        printed, computed = (np.linalg.eigvals(A) for A in (pair.published.A, pair.model.A))
        places = np.abs(printed[:, None] - computed).argmin(axis=1)
        assert sorted(places) == list(range(len(printed)))
        off = np.abs(computed[places] - printed)
        slow = np.abs(printed) < 1.0
        values = [check.value for check in pair.checks]
        largest = max(abs(entry.half_units) for entry in pair.entries)
        assert values[0] == pytest.approx(largest)
        expected = [(off / np.abs(printed))[~slow].max(), off[slow].max()]
        assert values[1:3] == pytest.approx(expected, rel=1e-6)
        unstable = np.count_nonzero(printed.real > 0) - np.count_nonzero(computed.real > 0)
        assert values[3] == abs(unstable)
