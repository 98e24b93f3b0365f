"""A basis given as functions of the states in a user's file."""

from __future__ import annotations

import pytest

from controller.critic.features import features_of
from hfa import BadInputError


@pytest.mark.parametrize(
    "text", ["__import__('os')", "x7", "x1.real", "x1 if x1 else x2", "[x1]", "x1**", ""]
)
def test_a_wrong_basis_is_refused_and_not_run(text: str) -> None:
    """A file without a valid basis is refused, and its text is not executed."""
    with pytest.raises(BadInputError, match="features") as caught:
        features_of(text, 6)
    assert "\n" not in str(caught.value)
