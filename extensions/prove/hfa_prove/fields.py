"""Entries of a certificate: their declaration, and a reader that refuses wrong and unread ones."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import field, fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, Self

import numpy as np

from hfa_support.errors import BadInputError, NoSolutionError, shown

#: Larger numbers are refused, because their squares overflow.
_LARGEST_NUMBER = 1e300
#: Larger integers are refused, because not all of them are doubles.
_LARGEST_INTEGER = 2**53


class Malformed(NoSolutionError):
    """Raised if a certificate has an invalid entry."""


class Rejected(NoSolutionError):
    """Raised if a witness does not prove its statement."""


def require(holds: bool, where: str, value: Any = None) -> None:
    """Raise Malformed unless the condition is true.

    where: name of the entry, with the defect if it is not obvious
    value: value of the entry for the message, or None to omit it
    """
    if not holds:
        shown_value = "" if value is None else f" ({shown(value)})"
        raise Malformed(f"invalid entry: {where}{shown_value}")


#: Errors of reading and checking for a wrong entry, or for evidence that does not prove the claim.
NOT_PROVED = (
    NoSolutionError,
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
    ArithmeticError,
)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Add the name of a file to the errors that are raised in the block.

    A BadInputError is raised again. An error in `NOT_PROVED` is raised as Rejected.
    """
    try:
        yield
    except BadInputError as error:
        raise BadInputError(f"{path}: {error}") from error
    except NOT_PROVED as error:
        raise Rejected(f"{path}: not proved: {error or type(error).__name__}") from error


class Fields:
    """The entries of a JSON object, each of which is read once.

    where: name of the object in messages

    The reading methods raise Malformed if an entry is missing or invalid.
    """

    def __init__(self, where: str, content: Any) -> None:
        require(isinstance(content, dict), where, content)
        self.where = where
        self._remaining: dict[str, Any] = dict(content)

    def has(self, name: str) -> bool:
        """Return whether the entry with the given name exists and has not been read."""
        return name in self._remaining

    def close(self) -> None:
        """Raise Malformed if an entry was not read."""
        require(
            not self._remaining, f"{self.where}: unknown entry", sorted(self._remaining, key=str)
        )

    def value(self, name: str, kind: Any = object) -> Any:
        """Return the entry with the given name if it is of the given kind.

        kind: type in Python, or a tuple of types
        """
        require(name in self._remaining, f"{self._called(name)}: missing entry")
        value = self._remaining.pop(name)
        require(isinstance(value, kind), self._called(name), value)
        return value

    def same(self, name: str, expected: Any) -> None:
        """Raise Malformed unless an entry equals `expected`."""
        # Read as numbers by `array`, which refuses true and false: in Python they equal 1 and 0.
        are_numbers = np.asarray(expected).dtype.kind in "if"
        value = self.array(name, *np.shape(expected)).tolist() if are_numbers else self.value(name)
        require(value == expected, self._called(name), value)

    def fields(self, name: str) -> Fields:
        """Return a reader of an entry that is a JSON object."""
        return Fields(self._called(name), self.value(name, dict))

    def count(self, name: str, most: int) -> int:
        """Return an entry that is a whole number from 0 to `most`."""
        value = self.value(name, int)
        require(type(value) is int and 0 <= value <= most, self._called(name), value)
        return int(value)

    def number(self, name: str, least: float = -math.inf, above: float = -math.inf) -> float:
        """Return an entry that is a finite number, at least `least` and larger than `above`."""
        value = float(self.array(name))
        require(value >= least and value > above, self._called(name), value)
        return value

    def positive(self, name: str) -> float:
        """Return an entry that is a positive number, or infinity if the entry is "inf"."""
        if self._remaining.get(name) == "inf":
            del self._remaining[name]
            return math.inf
        return self.number(name, above=0.0)

    def pair(self, name: str) -> tuple[float, float]:
        """Return an entry that is two numbers (low, high) with low <= high."""
        low, high = self.array(name, 2).tolist()
        require(low <= high, self._called(name), [low, high])
        return low, high

    def numbers(self, name: str, allowed: Any) -> dict[str, float]:
        """Return name -> number of an entry that is an object whose names must be in `allowed`."""
        entries = self.fields(name)
        values = {}
        for key in list(entries._remaining):
            require(key in allowed, f"{entries.where}: unknown entry", key)
            values[key] = entries.number(key)
        return values

    def all_numbers(self, name: str, names: Sequence[str]) -> dict[str, float]:
        """Return name -> number of an entry that is an object with exactly the given names."""
        numbers = self.numbers(name, names)
        require(set(numbers) == set(names), self._called(name), sorted(numbers))
        return {name: numbers[name] for name in names}

    def array(self, name: str, *shape: int | None) -> np.ndarray:
        """Return an entry of nested lists of finite numbers as an array.

        shape: length of each level of lists, or None alone for a list of any length
        """
        nested = _nested_doubles(self._called(name), self.value(name), list(shape))
        values = np.array(nested, dtype=float)
        return values.reshape([len(values) if length is None else length for length in shape])

    def _called(self, name: str) -> str:
        """Return the name of an entry in messages, with that of its object."""
        return f"{self.where}: {name}" if self.where else name


def _nested_doubles(where: str, part: Any, shape: list[int | None]) -> Any:
    """Return a nested list of doubles. Raises Malformed for another shape (None: any length)."""
    if not shape:
        return _double(where, part)
    require(isinstance(part, list), where, part)
    require(shape[0] in (None, len(part)), where, part)
    return [_nested_doubles(where, entry, shape[1:]) for entry in part]


def _double(where: str, value: Any) -> float:
    """Return a number of a file. Raises Malformed unless it is finite and exact as a double."""
    require(type(value) in (int, float), where, value)
    require(math.isfinite(value) and abs(value) <= _LARGEST_NUMBER, where, value)
    require(type(value) is float or abs(value) <= _LARGEST_INTEGER, where, value)
    return float(value)


class Entry(NamedTuple):
    """How an entry of a certificate's object is read, stored and reported.

    read: (reader of the object, name of the entry, values read before) -> value, or None if the
        entry is optional and missing
    store: value -> the form stored in a file
    subject: name of the entry in the first line of a report if the user does not give a value, or
        "" for a claim, which is not compared
    """

    read: Callable[[Fields, str, Any], Any]
    store: Callable[[Any], Any]
    subject: str


def entry(
    read: Callable[[Fields, str, Any], Any],
    *,
    store: Callable[[Any], Any] | None = None,
    subject: str = "",
    **default: Any,
) -> Any:
    """Return the declaration of a field of a `Stored` object, see `Entry`."""
    declared = Entry(read, store or stored, subject)
    return field(metadata={"entry": declared}, **default)


def part(kind: type[Stored]) -> Any:
    """Return the declaration of a field that is an object with entries of its own."""
    return entry(lambda file, name, known: kind.read(file.fields(name), known))


class Stored:
    """Object of a certificate. The fields of the dataclass are the entries of the object."""

    @classmethod
    def read(cls, file: Fields, known: Any) -> Self:
        """Return the object in a file.

        file: reader of the object
        known: namespace of values that the entries depend on: the user's `aircraft`, and the
            entries of the objects around this one

        Raises Malformed for the first wrong entry. Raises BadInputError if the statement concerns
        another aircraft than the user's.
        """
        known = SimpleNamespace(**vars(known))  # a copy: entries of this object stay inside it
        values = {}
        for attribute in fields(cls):  # type: ignore[arg-type]  # a dataclass
            declared: Entry = attribute.metadata["entry"]
            values[attribute.name] = declared.read(file, attribute.name, known)
            setattr(known, attribute.name, values[attribute.name])
        file.close()
        made = cls(**values)
        made.check_consistent()
        return made

    def check_consistent(self) -> None:
        """Raise Malformed if entries contradict each other."""

    def content(self) -> dict[str, Any]:
        """Return the object in the form that is stored in a file and that `read` accepts."""
        content = {}
        for attribute in fields(self):  # type: ignore[arg-type]  # a dataclass
            value = getattr(self, attribute.name)
            if value is not None:
                content[attribute.name] = attribute.metadata["entry"].store(value)
        return content

    def entries(self, before: str = "") -> Iterator[tuple[str, Entry, Any]]:
        """Yield path, declaration and stored value of every entry.

        before: beginning of every path, such as "flight."
        """
        for attribute in fields(self):  # type: ignore[arg-type]  # a dataclass
            declared: Entry = attribute.metadata["entry"]
            path = f"{before}{attribute.name}"
            value = getattr(self, attribute.name)
            if isinstance(value, Stored):
                yield from value.entries(f"{path}.")
            elif value is not None:
                yield path, declared, declared.store(value)


def stored(value: Any) -> Any:
    """Return a value in the form that is stored in a file."""
    if isinstance(value, Stored):
        return value.content()
    if isinstance(value, Mapping):
        return {name: stored(item) for name, item in value.items()}
    if isinstance(value, np.ndarray):
        return value.astype(float).tolist()
    if isinstance(value, (tuple, list)):
        return [stored(item) for item in value]
    return value


class Given(NamedTuple):
    """A value from the user's data that is compared with an entry of a statement.

    value: the value
    same: (value in the certificate, user's value), both in the form of a file -> whether they
        agree, exact equality by default
    """

    value: Any
    same: Callable[[Any, Any], bool] = operator.eq


def close_to(relative: float, sizes: Any) -> Callable[[Any, Any], bool]:
    """Return a comparison of matrices.

    The comparison has the arguments (value in the certificate, user's value). Two matrices agree if
    their shapes are equal and no difference exceeds `relative` times the largest absolute entry of
    the user's matrix, all in units of `sizes`.

    sizes: typical sizes of the entries
    """

    def same(stated: Any, own: Any) -> bool:
        claimed, values = np.array(stated), np.array(own)
        if claimed.shape != values.shape:
            return False
        size = np.max(np.abs(values / sizes), initial=0.0)
        return bool(np.all(np.abs((claimed - values) / sizes) <= relative * size))

    return same


def within(widths: Mapping[str, float]) -> Callable[[Any, Any], bool]:
    """Return a comparison of objects with numbers.

    The comparison has the arguments (value in the certificate, user's value). Two objects agree if
    their names are equal and no difference exceeds the permitted difference.

    widths: name -> largest permitted difference
    """

    def same(stated: Any, own: Any) -> bool:
        return set(stated) == set(own) and all(
            abs(stated[name] - value) <= widths[name] for name, value in own.items()
        )

    return same


def compare(statement: Stored, given: Mapping[str, Given]) -> list[str]:
    """Return the subjects (`Entry.subject`) that the user did not give, in the statement's order.

    given: path of an entry -> the user's value

    Raises NoSolutionError if an entry differs from the user's value.
    """
    entries = list(statement.entries())
    stated = {path: value for path, _, value in entries}
    for path, own in given.items():
        name = path.rpartition(".")[2]
        in_file = own._replace(value=stored(own.value))
        if not own.same(stated[path], in_file.value):
            different = _first_difference(name, stated[path], in_file)
            what = f"limit of {different}" if name == "limits" else different
            raise NoSolutionError(
                f"{what} in the certificate differs from the value of the options; give the "
                "options of the proof"
            )
    not_given = [declared.subject for path, declared, _ in entries if path not in given]
    return [subject for subject in dict.fromkeys(not_given) if subject]


def _first_difference(name: str, stated: Any, own: Given) -> str:
    """Return the first name in an object whose values differ, or the name of another entry."""
    if isinstance(stated, Mapping) and isinstance(own.value, Mapping):
        for key in (*own.value, *stated):
            # The comparison is one of whole objects: of all names, only this one is as stated.
            with_stated = {other: value for other, value in own.value.items() if other != key}
            if key in stated:
                with_stated[key] = stated[key]
            if not own.same(with_stated, own.value):
                return str(key)
    return name
