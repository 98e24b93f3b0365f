"""Validation of users' files against declarations. The error names the first invalid entry.

A declaration is one of the following:
- `Number`
- `str`
- a tuple of allowed words
- [declaration], for a list
- {str: declaration}, for a mapping with arbitrary names
- {name: declaration}, for a table. A name that ends in `*` declares a required entry. The key
  `...` permits further entries, which are not checked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hfa_support.errors import BadInputError, choice_of, shortened, shown
from hfa_support.files import read_toml


class Number(NamedTuple):
    """Declaration of a number in a file, from `lowest` to `highest`.

    lowest, highest: limits
    above: whether `lowest` itself is excluded
    infinite: whether an infinite number is allowed
    """

    lowest: float = -math.inf
    highest: float = math.inf
    above: bool = False
    infinite: bool = False

    def __str__(self) -> str:
        """Return the requirement in words, for example "a finite number above 0"."""
        form = "a number" if self.infinite else "a finite number"
        if self.lowest > -math.inf:
            lowest = f"{self.lowest:g}"
            form += f" above {lowest}" if self.above else f" of at least {lowest}"
        return form if self.highest == math.inf else f"{form}, at most {self.highest:g}"

    def of(self, value: Any) -> float | None:
        """Return the value as a float, or None if it is not a number within the declared limits."""
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return None
        try:
            number = float(value)
        except OverflowError:  # integers in TOML may exceed the range of floats
            return None
        if not self.lowest <= number <= self.highest:
            return None
        if self.above and number == self.lowest:
            return None
        return number if self.infinite or math.isfinite(number) else None


NUMBER = Number()
POSITIVE = Number(0.0, above=True)


def checked(where: str, value: Any, declared: Any, entry: str = "") -> Any:
    """Return a value of a user's file, with numbers converted to floats.

    where: the file, for the message
    value: the value
    declared: declaration of the value
    entry: name of the entry, for the message

    Raises BadInputError, with the file, the entry and the requirement, if the value does not match
    its declaration.
    """
    if isinstance(declared, Number):
        number = declared.of(value)
        if number is None:
            raise BadInputError(f"{where}: {entry} is {shown(value)}; give {declared}")
        return number
    if declared is str or isinstance(declared, tuple):
        words = declared if isinstance(declared, tuple) else ()
        if not isinstance(value, str) or (words and value not in words):
            wanted = ", ".join(words) or "a text in quotes"
            if len(words) > 1:
                wanted = f"one of {wanted}"
            raise BadInputError(f"{where}: {entry} is {shown(value)}; give {wanted}")
        return value
    if isinstance(declared, list):
        if not isinstance(value, list):
            raise BadInputError(
                f"{where}: {entry} is {shown(value)}; give a list of {_words(declared[0])}"
            )
        return [
            checked(where, item, declared[0], f"{entry}[{index}]")
            for index, item in enumerate(value)
        ]
    if isinstance(declared, dict):
        return _table(where, value, declared, entry)
    return value


def _table(where: str, value: Any, declared: dict[Any, Any], entry: str) -> dict[str, Any]:
    """Return a table of a file, with each entry checked.

    declared: {str: declaration} or {name: declaration}, as in the docstring of this module
    """
    if not isinstance(value, dict):
        wanted = f"a table [{entry}]" if entry else "a table"
        raise BadInputError(f"{where}: {entry or 'file'} is {shown(value)}; give {wanted}")
    prefix = f"{entry}." if entry else ""
    of_other_names = declared.get(str)
    takes_other_names = str in declared or ... in declared
    of_names = {
        name.removesuffix("*"): kind for name, kind in declared.items() if isinstance(name, str)
    }
    entries = {}
    for name, each in value.items():
        if not (name in of_names or takes_other_names):
            unknown = shortened(ascii(name)[1:-1])
            raise BadInputError(
                f"{where}: unknown entry {prefix}{unknown}; {choice_of(name, of_names)}"
            )
        kind = of_names.get(name, of_other_names)
        entries[name] = checked(where, each, kind, f"{prefix}{shortened(name)}")
    for name, kind in of_names.items():
        if f"{name}*" in declared and name not in entries:
            what = "the table" if isinstance(kind, dict) else "this entry"
            raise BadInputError(f"{where}: {prefix}{name} is missing; add {what}")
    return entries


def _words(declared: Any) -> str:
    """Return what the entries of a list are called: "lists of numbers"."""
    if isinstance(declared, list):
        return f"lists of {_words(declared[0])}"
    return "numbers" if isinstance(declared, Number) else "names in quotes"


def read_named(what: str, name: str, packaged: Mapping[str, Path], declared: dict[Any, Any]) -> Any:
    """Return the entries of a TOML file that belongs to a package or to the user.

    what: kind of file, for messages
    name: a key of `packaged`, or the path of the user's file
    packaged: name -> path of a file of the package
    declared: declaration of the entries

    Raises BadInputError if the file cannot be read, is not valid TOML, or has invalid entries.
    """
    try:
        data = read_toml(packaged.get(name, name))
    except OSError as error:
        raise BadInputError(
            f"{name}: no {what} and no readable file of this name; choose from "
            f"{', '.join(packaged)}"
        ) from error
    return checked(name, data, declared)
