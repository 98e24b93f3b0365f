"""Checks of arguments against annotations: accepted values, and refusals in one line."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import pytest

from hfa import BadInputError
from hfa_support.arguments import checks_arguments
from hfa_support.progress import Progress

if TYPE_CHECKING:
    from fractions import Fraction


class Thing:
    how_to_make: ClassVar[str] = "Thing()"


class Unread(list[Any]):
    def __iter__(self) -> Any:
        raise RuntimeError("a fault of the list")


class Unreadable(dict[str, float]):
    def items(self) -> Any:
        raise KeyError("a fault of the dictionary")


@checks_arguments
def public(
    thing: Thing,
    number: float = 0.0,
    count: int = 0,
    flag: bool = False,
    word: str | Path = "",
    names: tuple[str, ...] = (),
    things: Sequence[Thing] = (),
    table: Mapping[str, float] | None = None,
    values: np.ndarray | None = None,
    called: Callable[..., Any] | None = None,
    progress: Progress | None = None,
    anything: Any = 0,
    unknown: Fraction | None = None,
    *,
    named: float = 1.0,
    texts: Sequence[str] = (),
    text_or_texts: str | Sequence[str] = (),
) -> str:
    return "done"


RIGHT = [
    {"number": 1},
    {"number": np.float32(1.5), "named": 2},
    {"number": float("inf")},
    {"count": np.int64(3)},
    {"flag": np.True_},
    {"word": Path("a")},
    {"names": ["a", "b"]},
    {"things": [Thing(), Thing()]},
    {"text_or_texts": "ab"},
    {"text_or_texts": ("a", "b")},
    {"table": {"a": 1.0}},
    {"table": None, "values": None, "called": None},
    {"values": [[1, 2], [3.0, 4.0]]},
    {"values": np.zeros((0, 3))},
    {"called": len, "anything": object(), "unknown": "not compared"},
]
WRONG = [
    ({"thing": None}, "public: thing is None; give a Thing, made by Thing()"),
    ({"thing": np.eye(2)}, "public: thing is an array of shape (2, 2); give a Thing"),
    ({"number": "1"}, "public: number is '1'; give a number"),
    ({"number": True}, "public: number is True; give a number"),
    ({"number": 1j}, "public: number is 1j; give a number"),
    ({"number": np.zeros(2)}, "public: number is an array of shape (2,); give a number"),
    ({"count": 1.0}, "public: count is 1.0; give a whole number"),
    ({"count": 10**400}, "give a whole number"),
    ({"flag": 1}, "public: flag is 1; give True or False"),
    ({"word": b"a"}, "public: word is b'a'; give a text or a path"),
    ({"names": "ab"}, "public: names is 'ab'; give a tuple in which each is a text"),
    ({"names": ["a", 1]}, "public: names is a list; give a tuple in which each is a text"),
    ({"things": [Thing(), None]}, "give a list or tuple in which each is a Thing"),
    ({"table": [("a", 1.0)]}, "public: table is a list; give a dictionary"),
    ({"values": ["a"]}, "public: values does not consist of rows of real numbers"),
    ({"values": [[1.0], [1.0, 2.0]]}, "row 2 has 2 numbers and row 1 has 1"),
    ({"values": np.array([1j])}, "public: values does not consist of rows of real numbers"),
    ({"values": "1 2"}, "public: values is '1 2'; give an array of numbers"),
    ({"texts": "ab"}, "public: texts is 'ab'; give a list or tuple in which each is a text"),
    ({"texts": Unread([1])}, "public: texts is an Unread; give a list or tuple"),
    ({"table": Unreadable(a=1.0)}, "public: table is an Unreadable; give a dictionary"),
    ({"values": Unread([1.0])}, "public: values is an Unread; give an array of numbers"),
    ({"text_or_texts": 3}, "text_or_texts is 3; give a text or a list or tuple in which each is"),
    ({"called": 3}, "public: called is 3; give a function"),
    ({"progress": [None]}, "public: progress is a list; give a function"),
    ({"named": None}, "public: named is None; give a number"),
]


@pytest.mark.parametrize("arguments", RIGHT)
def test_a_value_of_the_annotated_type_is_accepted(arguments: dict[str, Any]) -> None:
    """A value that matches the annotation is accepted."""
    assert public(**{"thing": Thing(), **arguments}) == "done"


@pytest.mark.parametrize(("arguments", "message"), WRONG)
def test_a_value_of_another_type_is_refused(arguments: dict[str, Any], message: str) -> None:
    """A value of another type is refused in one line that names the argument."""
    with pytest.raises(BadInputError) as refused:
        public(**{"thing": Thing(), **arguments})
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_positional_arguments_are_checked() -> None:
    """Positional arguments are checked as keyword arguments are."""
    with pytest.raises(BadInputError, match="number is 'x'"):
        public(Thing(), "x")


def test_missing_and_unknown_arguments_are_named() -> None:
    """The error for a missing or unknown argument lists the arguments of the function."""
    for call in (public, lambda: public(Thing(), other=1), lambda: public(*[Thing()] * 40)):
        with pytest.raises(BadInputError, match=r"^public: "):
            call()
    with pytest.raises(BadInputError, match=r"required .*: 'thing'; the arguments are thing,"):
        public()
    with pytest.raises(BadInputError, match="unexpected keyword argument 'other'"):
        public(Thing(), other=1)


def test_a_checked_function_keeps_its_name() -> None:
    """A checked function keeps its name and has the original as `__wrapped__`."""
    assert public.__name__ == "public"
    assert public.__wrapped__.__defaults__[0] == 0.0


@checks_arguments
@dataclass(frozen=True)
class Declared:
    thing: Thing
    number: float = 1.0


def test_the_constructor_of_a_class_is_checked() -> None:
    """Wrong arguments for the constructor of a checked class are refused under the class's name."""
    assert Declared(Thing(), 2).number == 2
    with pytest.raises(BadInputError, match="Declared: thing is 3; give a Thing, made by Thing"):
        Declared(3)
    with pytest.raises(BadInputError, match="Declared: number is 'x'; give a number"):
        Declared(Thing(), number="x")
    with pytest.raises(
        BadInputError, match=r"Declared: .*'thing'; the arguments are thing, number"
    ):
        Declared()


def test_a_typeerror_inside_a_function_is_unchanged() -> None:
    """A TypeError inside a function is not reported as a wrong argument."""

    @checks_arguments
    def failing(word: str) -> int:
        return len(word) + word

    with pytest.raises(TypeError, match="unsupported operand"):
        failing("a")
