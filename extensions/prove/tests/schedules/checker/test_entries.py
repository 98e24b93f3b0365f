"""Each reader of an entry returns what it describes, and refuses everything else."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hfa_prove.fields import Fields, Malformed, stored
from hfa_prove.problem import _not_narrower
from hfa_prove.statements.game import Plant
from hfa_prove.subject import Given, _same, close_to, within

Read = Callable[[Fields], Any]
TOO_LARGE = 2**53 + 1
NO_NUMBERS = [True, "1", None, [1.0], math.inf, math.nan, 1.1e300, -1.1e300, TOO_LARGE, -TOO_LARGE]
ONE = [[1.0, [2, 0]]]

#: Reader -> entries that it returns, and entries that it refuses.
READERS: list[tuple[Read, list[Any], list[Any]]] = [
    (lambda file: file.value("x", str), ["a"], [1, None, ["a"]]),
    (lambda file: file.flag("x"), [True, False], [0, 1, "true", None]),
    (lambda file: file.count("x", 5), [0, 5], [6, -1, 1.0, True, "1"]),
    (lambda file: file.number("x"), [0.0, -3, 1e300, 2**53], NO_NUMBERS),
    (lambda file: file.number("x", least=2.0), [2.0, 3.0], [1.9]),
    (lambda file: file.number("x", above=2.0), [2.1], [2.0, 1.0]),
    (lambda file: file.positive("x"), [0.5], [0.0, -1.0, "infinity"]),
    (lambda file: file.pair("x"), [(1.0, 2.0), (2.0, 2.0)], [[2.0, 1.0], [1.0], [1.0, 2.0, 3.0]]),
    (lambda file: file.pair("x", least=0.0), [(0.0, 1.0)], [[-0.1, 1.0]]),
    (lambda file: file.texts("x", ("a", "b")), [(), ("a", "b", "a")], [["c"], [1], "a", None]),
    (lambda file: file.numbers("x", ("a", "b")), [{}, {"a": 1.0}], [{"c": 1.0}, {"a": "1"}, []]),
    (
        lambda file: file.all_numbers("x", ("a", "b")),
        [{"a": 1.0, "b": 2.0}],
        [{}, {"a": 1.0}, {"a": 1.0, "b": 2.0, "c": 3.0}],
    ),
    (
        lambda file: [[value, list(powers)] for value, powers in file.terms("x", 2, 3)],
        [ONE, [[-2.0, [1, 2]], [0.5, [0, 2]]]],
        [[], ONE + ONE, {}, [[1.0, [2, 0], 0]], [[1.0, [2]]], [[1.0, [1, 0]]], [[1.0, [2, 2]]]],
    ),
    (
        lambda file: file.terms("x", 2, 3),
        [],
        [
            [1.0],
            [[1.0, [3, -1]]],
            [[1.0, [2.0, 0]]],
            [[1.0, [True, 1]]],
            [[1.0, 2]],
            [["1", [2, 0]]],
        ],
    ),
    (
        lambda file: stored(file.array("x", 2, None)),
        [[[1.0, 2.0, 3.0]] * 2, [[], []]],
        [[[1.0]], [[1.0], [1.0, 2.0]], [1.0, 2.0], [[1.0]] * 3, [[[1.0]], [[1.0]]]],
    ),
    (lambda file: file.array("x", 0, 2).shape == (0, 2), [], [[[1.0, 2.0]]]),
    (lambda file: stored(file.increasing("x")), [[1.0, 2.0]], [[1.0], [1.0, 1.0], [2.0, 1.0]]),
    (
        lambda file: stored(file.symmetric("x", 2)),
        [[[1.0, 2.0], [2.0, 3.0]]],
        [[[1.0, 2.0], [2.1, 3.0]], [[1.0]]],
    ),
    (
        lambda file: [float(ball) for ball in file.balls("x", 2)],
        [[0.5, -1.0]],
        [["1e301", 1.0], [" 1", 1.0], ["0x1", 1.0], ["nan", 1.0], [1.0], [1.0, True]],
    ),
    (lambda file: file.fields("x").close(), [], [{"y": 1.0}, [], 1.0]),
    (lambda file: file.items("x")[0].value("a"), [], [{}, [1.0], [{"b": 1.0}]]),
    (lambda file: file.same("x", 1.0), [], [2.0, None, True]),
]


@pytest.mark.parametrize("index", range(len(READERS)))
def test_each_reader_refuses_what_it_does_not_describe(index: int) -> None:
    """A reader returns an entry of its kind unchanged and refuses other and missing entries."""
    read, accepted, refused = READERS[index]
    for value in accepted:
        file = Fields("", {"x": stored(value)})
        assert file.has("x")
        assert read(file) == value
        assert not file.has("x")
        file.close()
    for value in refused:
        with pytest.raises(Malformed):
            read(Fields("", {"x": value}))
    with pytest.raises(Malformed, match="missing"):
        read(Fields("", {"y": 1.0}))


def test_infinity_and_empty_arrays_are_read() -> None:
    """ "inf" is read as infinity only by `positive`, and an empty array keeps its shape."""
    assert Fields("", {"x": "inf"}).positive("x") == math.inf
    assert Fields("", {"x": []}).array("x", 0, 2).shape == (0, 2)
    file = Fields("", {"x": 1.0})
    file.same("x", 1.0)
    file.close()


def test_a_decimal_is_enclosed() -> None:
    """A ball of a decimal contains the decimal, and a ball of a double is exact."""
    decimal, double = Fields("", {"x": ["0.1", 0.1]}).balls("x", 2)
    assert (10 * decimal).contains(1)
    assert double.rad() == 0
    assert Fraction(float(double)) == Fraction(0.1)


def test_values_are_compared_entry_by_entry() -> None:
    """Values agree if all names and entries are equal; lists of other lengths do not agree."""
    for stated, own in (
        ({"a": [1.0, 2.0], "b": "x"}, {"b": "x", "a": (1.0, 2.0)}),
        (np.eye(2), np.eye(2).tolist()),
        ("inf", math.inf),
        (math.inf, math.inf),
    ):
        assert _same(stated, own)
    for stated, own in (
        ({"a": 1.0}, {"a": 1.0, "b": 2.0}),
        ({"a": 1.0, "b": 2.0}, {"a": 1.0}),
        ({"a": 1.0}, {"a": 2.0}),
        ([1.0], [1.0, 2.0]),
        ([1.0, 2.0], [1.0, 3.0]),
        (1.0, [1.0]),
        (1.0, {"a": 1.0}),
        (1.0, math.inf),
        ("inf", 1.0),
    ):
        assert not _same(stated, own)
    assert Given(1.0, "--x").same(1.0, 1.0)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_tolerances_bound_each_difference(sign: float) -> None:
    """Matrices agree within a share of the largest entry, and names within widths of their own."""
    own = [[-4.0, 0.0], [1.0, 2.0]]
    same = close_to(0.25)
    assert same([[-4.0, 0.0], [1.0, 2.0 + sign]], own)
    assert not same([[-4.0, 0.0], [1.0, 2.0 + 1.01 * sign]], own)
    assert not same([-4.0, 0.0, 1.0, 2.0], own)
    assert not same({"a": 1.0}, own)
    near = within({"a": 0.5, "b": 0.0})
    assert near({"a": 1.0 + 0.5 * sign, "b": 2.0}, {"a": 1.0, "b": 2.0})
    assert not near({"a": 1.0 + 0.51 * sign, "b": 2.0}, {"a": 1.0, "b": 2.0})
    assert not near({"a": 1.0, "b": 2.0 + 1e-9 * sign}, {"a": 1.0, "b": 2.0})
    assert not near({"a": 1.0}, {"a": 1.0, "b": 2.0})
    assert not near({"a": 1.0, "b": 2.0, "c": 0.0}, {"a": 1.0, "b": 2.0})


@pytest.mark.parametrize(
    ("stated", "agrees"),
    [
        ((-1.0, 2.0), True),
        ((-1.5, 2.5), True),
        ((None, None), True),
        ((-0.9, 2.0), False),
        ((-1.0, 1.9), False),
        ((None, 1.9), False),
        ((-0.9, None), False),
    ],
)
def test_the_limits_of_a_bound_contain_the_users(stated: Any, agrees: bool) -> None:
    """A bound of the cost is about the user's flights if its limits are not narrower."""
    assert _not_narrower({"a": stated}, {"a": (-1.0, 2.0)}) is agrees
    assert _not_narrower({"a": stated}, {}) is (stated == (None, None))


@pytest.mark.parametrize(
    ("A", "B"), [([[1.0, 2.0]], [[1.0]]), ([[1.0]], [[]]), ([[1.0]], [[1.0], [2.0]]), ([], [])]
)
def test_a_plant_is_square_and_has_an_input(A: Any, B: Any) -> None:
    """A plant without states or inputs, or whose matrices do not fit, is refused."""
    Plant.read(Fields("", {"A": [[1.0]], "B": [[1.0, 2.0]]}), SimpleNamespace())
    with pytest.raises(Malformed):
        Plant.read(Fields("", {"A": A, "B": B}), SimpleNamespace())
