"""Suggestions of known names in messages about unknown names."""

import pytest

from hfa_support.errors import choice_of


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("C172", ("c172p", "c172r", "c172x", "c182"), "c172p, c172r or c172x"),
        ("c172q", ("c172x", "c172p", "c182"), "c172x"),
        ("sped", ("speed", "spiral"), "speed"),
        ("MACH", ("mach", "machine"), "mach"),
    ],
)
def test_similar_names_are_suggested(name, known, meant):
    """For an unknown name, known names that begin with it (in any case) are suggested, else the most
    similar one. A known name that differs only in case is suggested alone.
    """
    assert choice_of(name, known).startswith(f"did you mean {meant}? choose from")
