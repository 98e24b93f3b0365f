"""Public names of packages."""

import pytest

import hfa
import trim


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    for package in (hfa, trim):
        with pytest.raises(AttributeError, match="'linearise'; did you mean linearize"):
            package.linearise  # noqa: B018
    assert set(dir(trim)) >= {"linearize", "sweep"}
