"""Suggestions of known names for an unknown one."""

import pytest

from hfa_support.errors import choice_of
from hfa_support.other_words import MEANINGS


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("C172", ("c172p", "c172r", "c172x", "c182"), "c172p, c172r or c172x"),
        ("c172q", ("c172x", "c172p", "c182"), "c172x or c172p"),
        ("sped", ("speed", "spiral"), "speed"),
        ("MACH", ("mach", "machine"), "mach"),
        ("theta", ("pitch", "pitch_rate"), "pitch"),
        ("gamma", ("delta", "alpha"), "delta"),
        ("--angle", ("--at", "--dihedral"), "--dihedral"),
    ],
)
def test_names_alike_are_all_offered(name, known, meant):
    """A name that differs in case only is offered alone. Otherwise names with the same beginning
    are offered, or else the most similar ones.
    """
    assert choice_of(name, known).startswith(f"did you mean {meant}? choose from")


def test_words_of_other_tools_are_other_names():
    """Each word of another tool differs from its translation and is stored in the compared
    spelling.
    """
    for word, meanings in MEANINGS.items():
        assert word == word.lower()
        assert word not in meanings


def test_names_without_likeness_are_listed_alone():
    """Without a similar name the message only lists the known names."""
    assert choice_of("xyz", ("alpha", "beta")) == "choose from alpha, beta"
