"""What the paper prints, read as printed: each entry a whole number of units of its last digit."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_model import published_models
from hfa_model.printed_matrices import PublishedModel


@pytest.mark.parametrize("model", published_models(), ids=lambda model: f"{model.dihedral_deg:g}")
@pytest.mark.parametrize("name", ["A", "B"])
def test_the_half_units_are_those_of_the_last_printed_digit(model: PublishedModel, name: str) -> None:
    """Whole multiples of the unit, and not all of ten of them."""
    units = getattr(model, name) / (2 * getattr(model, f"half_unit_{name}"))
    np.testing.assert_allclose(units, np.round(units), rtol=0, atol=1e-6)
    assert np.any(np.round(units) % 10 != 0)
    assert np.abs(units).max() > 1000


def test_one_entry_is_printed_with_fewer_digits_than_the_others() -> None:
    for model in published_models():
        assert np.unique(model.half_unit_A).tolist() == [0.5e-4, 0.05]
        assert model.A[model.half_unit_A == 0.05] == pytest.approx(-32.2)
        assert not model.A.flags.writeable
