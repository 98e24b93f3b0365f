"""Types of options: one word of a command line becomes a value in internal units, or the reason why not.

A reason is the rest of a sentence that begins with the option: "--delay" and "is 'short'; give a number". `quantity`
and `numbers` convert degrees and SI; no other module converts typed numbers.
"""

from __future__ import annotations

import math
from argparse import ArgumentTypeError
from collections.abc import Callable
from contextvars import ContextVar
from pathlib import Path
from typing import TypeVar

from hfa_support.errors import BadInputError, shortened
from hfa_support.model import Model
from hfa_support.reporting.unit_system import typed

Parsed = TypeVar("Parsed")
#: The user's own aircraft that --aircraft names; None is the HFA.
OWN: ContextVar[Model | None] = ContextVar("own", default=None)
PICTURES = (".png", ".svg", ".pdf")
_LARGEST_WHOLE = 10**18


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        raise ArgumentTypeError(f"is {shortened(text)!r}; give a number") from None
    if not math.isfinite(value):
        raise ArgumentTypeError(f"is {shortened(text)}; give a finite number")
    return value


def positive(text: str) -> float:
    """A finite number above zero."""
    value = number(text)
    if value <= 0:
        raise ArgumentTypeError(f"is {value:g}; it must be positive")
    return value


def model() -> Model:
    """Whose names and units options have."""
    if (own := OWN.get()) is not None:
        return own
    from hfa_model.aircraft import HFA

    return HFA


def quantity(name: str, text: str) -> float:
    """What was typed for a name of the model, in the shown unit of the one that it declares: degrees of rad, m of
    ft with --units si; a plain number where there is none."""
    known = {**model().rates, **model().signals}
    unit = known[name].unit if name in known else "1"
    return math.radians(number(text)) if unit.startswith("rad") else typed(number(text), unit)


def place(text: str) -> float:
    """The value of the scheduling variable of one trim; a list or range is refused with the command that takes it."""
    if "," in text or ":" in text:
        raise ArgumentTypeError(f"is {shortened(text)!r}; give one number: `hfa sweep` takes lists and ranges")
    return quantity(model().schedule, text)


def places(text: str) -> tuple[float, ...]:
    """`LOW:HIGH` or one place, as written: a proof is about these numbers."""
    ends = tuple(number(part) for part in text.split(":"))
    if len(ends) > 2 or (len(ends) == 2 and not ends[0] < ends[1]):
        raise ArgumentTypeError(f"is {shortened(text)!r}; give LOW:HIGH, the lower end first")
    return ends


def span(name: str, text: str) -> tuple[float, float]:
    """`LOW:HIGH` of a named variable, low < high."""
    low, colon, high = text.partition(":")
    if not colon or ":" in high:
        raise ArgumentTypeError(f"is {shortened(text)!r}; give LOW:HIGH")
    lowest, highest = quantity(name, low), quantity(name, high)
    if not lowest < highest:
        raise ArgumentTypeError(f"is {shortened(text)!r}; the first limit must be the lower one")
    return lowest, highest


def whole(lowest: int, highest: int = _LARGEST_WHOLE) -> Callable[[str], int]:
    """The type of whole numbers from `lowest` to `highest`."""

    def convert(text: str) -> int:
        value = number(text)
        # From the digits where there are only digits: a float would round the large ones.
        result = int(text) if text.strip().isdigit() else int(value)
        if value != int(value) or not lowest <= result <= highest:
            raise ArgumentTypeError(f"is {shortened(text)}; give a whole number from {lowest} to {highest:.6g}")
        return result

    return convert


def one_of(*words: str) -> Callable[[str], str]:
    """The type of a word among those named."""

    def convert(text: str) -> str:
        if text not in words:
            raise ArgumentTypeError(f"is {shortened(text)!r}; use one of {', '.join(words)}")
        return text

    return convert


def some_of(*known: str) -> Callable[[str], tuple[str, ...]]:
    """The type of names with commas between them, each one known and named once."""

    def convert(text: str) -> tuple[str, ...]:
        names = tuple(text.split(","))
        for name in names:
            if name not in known:
                raise ArgumentTypeError(f"names {shortened(name)!r}; choose from {', '.join(known)}")
            if names.count(name) > 1:
                raise ArgumentTypeError(f"names {name} twice; name it once")
        return names

    return convert


def parsed(parse: Callable[[str], Parsed]) -> Callable[[str], Parsed]:
    """The type of what a function makes of a word; its BadInputError is the reason."""

    def convert(text: str) -> Parsed:
        try:
            return parse(text)
        except BadInputError as error:
            raise ArgumentTypeError(str(error)) from error
        except (ValueError, RecursionError) as error:  # a file of digits, or of brackets, without end
            raise ArgumentTypeError(f"{text}: cannot be read ({shortened(str(error))})") from error

    return convert


def input_file(*suffixes: str) -> Callable[[str], Path]:
    """The type of files that are there, with one of the suffixes."""

    def convert(text: str) -> Path:
        path = Path(text)
        if path.suffix.lower() not in suffixes:
            raise ArgumentTypeError(f"{text}: the suffix {path.suffix!r} is not known; use {', '.join(suffixes)}")
        if not path.is_file():
            raise ArgumentTypeError(f"{text}: there is no such file")
        return path

    return convert


def output_file(*suffixes: str) -> Callable[[str], Path]:
    """The type of files that can be written, with one of the suffixes."""
    return parsed(lambda text: check_target(text, suffixes))


def check_target(path: str, suffixes: tuple[str, ...], also: str = "") -> Path:
    """The output file of a command, refused before anything is computed when it cannot be written.

    also: another choice than one of the suffixes.
    """
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        known = f"use one of {', '.join(suffixes)}{also}"
        raise BadInputError(f"{path or repr(path)}: unknown suffix {target.suffix!r}; {known}")
    if not target.parent.is_dir():
        raise BadInputError(f"{path}: the folder {target.parent} does not exist; create it first")
    if target.is_dir() and target.suffix.lower() != ".zarr":  # a Zarr store is a folder
        raise BadInputError(f"{path}: it is a folder; name a file")
    if target.exists() and not target.is_dir() and not target.is_file():
        raise BadInputError(f"{path}: it is not a regular file; name another")
    return target


def check_folder(path: str) -> Path:
    """A folder that exists or can be made; made only when there is something to put in."""
    folder = Path(path)
    if not path or (not folder.is_dir() and (folder.exists() or not folder.parent.is_dir())):
        raise BadInputError(f"{path or repr(path)}: cannot make the folder; choose another, in a folder that exists")
    return folder


def folder_or_file(*suffixes: str) -> Callable[[str], Path]:
    """The type of files that can be written, with one of the suffixes, and of folders, which have none."""
    folder = ", or a folder, whose name has no suffix"
    return parsed(lambda text: check_target(text, suffixes, folder) if Path(text).suffix else check_folder(text))


def numbers(form: str, least: int, *units: str) -> Callable[[str], tuple[float, ...]]:
    """The type of numbers between colons: as many as `units`, the internal unit of each, but at least `least`."""

    def convert(text: str) -> tuple[float, ...]:
        parts = text.split(":")
        if not least <= len(parts) <= len(units):
            raise ArgumentTypeError(f"is {text!r}; give {form}")
        return tuple(typed(number(part), unit) for part, unit in zip(parts, units, strict=False))

    return convert
