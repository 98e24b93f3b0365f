"""Matrices of users are checked."""

import numpy as np
import pandas as pd
import pytest

from hfa_support import matrices
from hfa_support.errors import BadInputError


@pytest.mark.parametrize(
    ("value", "ndim", "said"),
    [
        ([[1.0, np.nan]], 2, r"M\[0\]\[1\] is nan; give finite entries"),
        ([1.0, -np.inf], 1, r"M\[1\] is -inf; give finite entries"),
        ([[1.0], [-101.0]], 2, r"M\[1\]\[0\] is -101; give entries of at most 100 in magnitude"),
        ([1.0], 2, "the number of dimensions of M is 1; give 2"),
        ([["a"]], 2, "M does not consist of rows of real numbers"),
        ([[1.0], [1.0, 2.0]], 2, "all of equal length"),
        ("1, 2", 2, r"M is '1, 2'; give numbers, as in \[1.0, 2.0\]"),
        (pd.DataFrame([[1.0]]), 2, "M has labels"),
        (np.ma.array([[1.0]], mask=[[True]]), 2, "M has masked entries"),
    ],
)
def test_a_wrong_matrix_is_refused_with_its_entry(value, ndim, said):
    """A matrix of a user has finite real entries in rows of equal length, none too large."""
    with pytest.raises(BadInputError, match=said):
        matrices.checked_matrix("M", value, 100.0, ndim)
    right = matrices.checked_matrix("M", [[100, -100]], 100.0)
    assert (right.tolist(), right.flags.writeable) == ([[100.0, -100.0]], False)
