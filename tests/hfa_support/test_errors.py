"""Messages of errors: one line with the name, the value and what to give."""

import math

import casadi as ca
import numpy as np
import pytest

import hfa_support.errors as module
from hfa_support.errors import BadInputError


@pytest.mark.parametrize(
    ("name", "known", "meant"),
    [
        ("C172", ("c172p", "c172r", "c172x", "c182"), "c172p, c172r or c172x"),
        ("c172q", ("c172x", "c172p", "c182"), "c172x"),
        ("sped", ("speed", "spiral"), "speed"),
        ("MACH", ("mach", "machine"), "mach"),
        ("rate", ("pitch_rate", "yaw-rate", "mass"), "pitch_rate or yaw-rate"),
        ("a12", ("a121", "a122", "a123", "a124", "a125"), "a121, a122, a123 or a124"),
    ],
)
def test_similar_names_are_suggested(name, known, meant):
    """For an unknown name, known names that begin with it (in any case) are suggested, else those
    that contain it, from three letters on, else the most similar one; one that differs only in case
    alone.
    """
    listed = f"choose from {', '.join(known)}"
    expected = f"did you mean {meant}? {listed}" if meant else listed
    assert module.choice_of(name, known) == expected


def test_long_lists_of_names_are_cut():
    """Of more than twelve known names, the first are listed, and the number of the others."""
    assert module.choice_of("zzz", map(str, range(12))).endswith("10, 11")
    assert module.choice_of("zzz", map(str, range(14))).endswith("10, 11 and 2 more")
    assert module.choice_of("zzz", ()) == "choose from none"


@pytest.mark.parametrize(
    ("refuse", "right", "wrong", "said"),
    [
        (
            lambda value: module.refuse_unless_positive("x", value, " s"),
            [1e-300, 5],
            [0.0, -1.0, math.inf, math.nan],
            "x is {value} s; give a positive number",
        ),
        (
            lambda value: module.refuse_unless_positive("x", value, " s"),
            [],
            ["1", None],
            "x is {value!r}; give a positive number",
        ),
        (
            lambda value: module.refuse_unless_whole("x", value, 2),
            [2, np.int64(3)],
            [1, 2.0, "2"],
            "x is {value!r}; give a whole number of at least 2",
        ),
        (
            lambda value: module.pair_of("x", value),
            [(1, 2), (-math.inf, np.float64(3.0))],
            [1.0, (1.0,), ("1", "2"), (1.0, 2.0, 3.0)],
            "x is {value!r}; give two numbers, (lowest, highest)",
        ),
        (
            lambda value: module.refuse_unknown("unknown state", value, ("a", "b")),
            ["a", "b"],
            ["c", 1, [1.0]],
            "unknown state {value!r}; choose from a, b",
        ),
        (
            lambda value: module.numbers_in("x", value),
            [1, [[1, 2]], np.ones(3)],
            [[[1], [1, 2]], ["a"], [1j], ca.SX.sym("x"), [True], True],
            "x does not consist of rows of real numbers, all of equal length",
        ),
    ],
)
def test_only_values_of_a_kind_are_accepted(refuse, right, wrong, said):
    """A wrong value is refused with its name, itself and the kind."""
    for value in right:
        refuse(value)
    for value in wrong:
        with pytest.raises(BadInputError) as refused:
            refuse(value)
        assert str(refused.value) == said.format(value=value)


def test_texts_of_users_are_printed_on_one_short_line():
    """Control characters are escaped, white space becomes a blank, long texts are cut."""
    assert module.printable("a\tb\x1b\nc\u00e9") == "a b\\x1b cé"
    assert module.printable("a\nb\x00", lines=True) == "a\nb\\x00"
    assert module.on_one_line("a\n  b\x07") == "a b\\x07"
    assert module.on_one_line("x" * 1000) == "x" * 1000
    assert module.on_one_line("x" * 1001) == "x" * 1000 + "..."
    assert module.shortened("x" * 60) == "x" * 60
    assert module.shortened("x" * 61) == "x" * 60 + "..."
    assert module.shown(np.eye(2)) == "array([[1., 0.],        [0., 1.]])"
