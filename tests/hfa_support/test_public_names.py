"""Public names of packages."""

import pytest

import hfa
import trim
from hfa_support.version import VERSION


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    for package in (hfa, trim):
        with pytest.raises(AttributeError, match="'linearise'; did you mean linearize"):
            package.linearise  # noqa: B018
    assert set(dir(trim)) >= {"linearize", "sweep"}


def test_names_of_the_paper_answer_at_their_old_place_for_one_version() -> None:
    for name in ("default_parameters", "level_flight", "level_model", "published_game"):
        with pytest.warns(DeprecationWarning, match=f"hfa.{name} is hfa.paper.{name} now"):
            old = getattr(hfa, name)
        assert old is getattr(hfa.paper, name)


def test_the_version_and_the_packages_within_are_public_too() -> None:
    assert hfa.__version__ == VERSION
    assert hfa.paper.__name__ == "hfa.paper"
