"""Bases of a critic given as a text that lists functions of the states."""

from __future__ import annotations

import pytest

from controller.critic.features import listed_functions
from hfa import BadInputError


@pytest.mark.parametrize(
    "text", ["__import__('os')", "x7", "x1.real", "x1 if x1 else x2", "[x1]", "x1**", ""]
)
def test_a_wrong_basis_is_refused_and_not_run(text: str) -> None:
    """An invalid list of functions is refused by one line, and its text is not executed."""
    with pytest.raises(BadInputError, match="basis") as caught:
        listed_functions(text, 6)
    assert "\n" not in str(caught.value)
