"""The two exceptions of the project, and the texts of error messages.

Every message is one line that states the remedy. Words typed by the user and values from the user's
files are shortened in messages, and control characters are escaped.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from numbers import Integral
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

_LONGEST = 60
_LONGEST_LINE = 1000
#: Beginnings of the names of the project's modules.
OWN = ("hfa", "controller.", "trim.", "verification.")


class BadInputError(ValueError):
    """Exception for an invalid request: a wrong name, number, unit, shape or file (exit code 2).

    options: command-line words that would supply a missing value, or ()
    """

    def __init__(self, message: str, options: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.options = options


class NoSolutionError(RuntimeError):
    """Exception for a valid request without a certifiable solution (exit code 1).

    found: report of what was found in place of a solution, or None
    source: entries of the provenance of this report
    """

    found: Any = None
    source: Mapping[str, Any] = MappingProxyType({})


class NotFiniteError(NoSolutionError, FloatingPointError):
    """Exception for a rate, output or derivative that is not a number at a point (exit code 1)."""


def missing_package(use: str, *packages: str) -> BadInputError:
    """Return the error that a package is not installed, with the command that installs it.

    use: subject and verb, such as "ONNX files require"
    packages: the names that pip installs
    """
    noun = "package" if len(packages) == 1 else "packages"
    command = f"python -m pip install {' '.join(packages)}"
    return BadInputError(f"{use} the {noun} {', '.join(packages)}; type {command}")


def imported(package: str, use: str) -> Any:
    """Return an optional package.

    use: subject and verb, such as "data frames require"

    Raises BadInputError, with the command that installs the package, if it is missing.
    """
    try:
        return import_module(package)
    except ImportError:
        raise missing_package(use, package) from None


@contextmanager
def prefix_errors(what: str | Path) -> Iterator[None]:
    """Put a file name before the message of a BadInputError that is raised in the `with` block.

    A message that already begins with this name is not changed.

    what: the file, or another subject of the message
    """
    try:
        yield
    except BadInputError as error:
        text = str(error)
        if not text.startswith(str(what)):
            text = f"{what}: {text}"
        raise BadInputError(text, error.options) from error


@contextmanager
def file_faults(file: str | Path) -> Iterator[None]:
    """Convert an OSError or ValueError raised in the `with` block to a BadInputError that names the
    file.

    A BadInputError is not changed.
    """
    try:
        yield
    except BadInputError:
        raise
    except OSError as error:
        raise BadInputError(
            f"{file} cannot be read ({error.strerror or error}); give a readable file"
        ) from error
    except (ValueError, EOFError) as error:
        raise BadInputError(f"{file}: {error}; correct the file") from error


def refuse_unknown(what: str, name: object, known: Iterable[str]) -> None:
    """Raise BadInputError unless a name is one of the known names, which the message lists.

    what: beginning of the message, for example "unknown state"
    name: the name
    known: the known names
    """
    choices = tuple(known)
    # An array, which has no hash, cannot be compared with a name.
    if type(name).__hash__ is None or name not in choices:
        raise BadInputError(f"{what} {shown(name)}; {choice_of(str(name), choices)}")


def choice_of(name: str, known: Iterable[str]) -> str:
    """Return advice for an error message on an unknown name.

    The advice lists the nearest known names, if any, and then the known names, of more than
    `_MOST_LISTED` the first ones.
    """
    choices = [*known]
    suggestion = advice(name, choices).removeprefix("; ")
    listed = ", ".join(choices[:_MOST_LISTED]) or "none"
    if len(choices) > _MOST_LISTED:
        listed += f" and {len(choices) - _MOST_LISTED} more"
    return f"{suggestion} choose from {listed}".lstrip()


def advice(name: str, known: Iterable[str]) -> str:
    """Return a suggestion such as "; did you mean speed?", or "" if no known name is near."""
    *others, last = nearest(name, known) or [""]
    names = f"{', '.join(others)} or {last}" if others else last
    return f"; did you mean {names}?" if last else ""


def nearest(name: str, known: Iterable[str]) -> list[str]:
    """Return the known names nearest to a name, regardless of case, or [] if none is near.

    The first nonempty of these lists is returned:
    - the name itself
    - known names that begin with the name, if it has at least `_SHORTEST_BEGINNING` characters
    - known names that contain the name, under the same condition
    - the most similar known name
    """
    # Spelling, in which names are compared -> name. All options have leading dashes.
    name_of = {each.lower().replace("-", "_").lstrip("_"): each for each in known}
    typed = name.lower().replace("-", "_").lstrip("_")
    if typed in name_of:
        return [name_of[typed]]
    if len(typed) >= _SHORTEST_BEGINNING:
        longer = [spelling for spelling in name_of if spelling.startswith(typed)] or [
            spelling for spelling in name_of if typed in spelling
        ]
        if longer:
            return [name_of[spelling] for spelling in longer[:_MOST_SUGGESTIONS]]
    from difflib import get_close_matches  # an error is rare

    return [name_of[each] for each in get_close_matches(typed, name_of, 1, _LEAST_LIKENESS)]


#: Least number of letters that are completed to a longer name, and largest number of suggestions.
_SHORTEST_BEGINNING = 3
_MOST_SUGGESTIONS = 4
#: Largest number of known names that a message lists.
_MOST_LISTED = 12
#: Least share of equal letters of two similar names.
_LEAST_LIKENESS = 0.75


def is_finite(value: object) -> bool:
    """Return whether a value is a finite number.

    The result is False for values that are not numbers.
    """
    try:
        return math.isfinite(value)  # type: ignore[arg-type]  # TypeError below
    except (TypeError, ValueError, OverflowError, RuntimeError):  # RuntimeError is raised by CasADi
        return False


def refuse_unless_positive(what: str, value: float, unit: str = "") -> None:
    """Raise BadInputError unless the value is a finite positive number.

    what: name of the value, for the message
    unit: text that follows the value in the message
    """
    if not (is_finite(value) and value > 0.0):
        text = f"{value}{unit}" if isinstance(value, float) else shown(value)
        raise BadInputError(f"{what} is {text}; give a positive number")


def refuse_unless_whole(what: str, value: object, least: int) -> None:
    """Raise BadInputError unless the value is an integer of at least `least`.

    what: name of the value, for the message
    """
    if not isinstance(value, Integral) or int(value) < least:
        raise BadInputError(f"{what} is {shown(value)}; give a whole number of at least {least}")


def pair_of(what: str, ends: Any) -> tuple[float, float]:
    """Return the limits (lowest, highest) as floats, which may be infinite.

    what: name of the limits, for the message
    ends: value given by the user

    Raises BadInputError unless `ends` consists of two numbers.
    """
    try:
        lowest, highest = ends
        # The sum refuses a text, which float() would convert.
        return float(lowest + 0.0), float(highest + 0.0)
    except (TypeError, ValueError) as error:
        raise BadInputError(
            f"{what} is {shown(ends)}; give two numbers, (lowest, highest)"
        ) from error


def numbers_in(what: str, values: Any) -> np.ndarray:
    """Return values as an array of floats.

    what: name of the values, for the message
    values: nested lists or an array of any shape

    Raises BadInputError unless the values are real numbers in rows of equal length, without masked
    entries, and for an array of pandas or xarray, whose labels would be ignored.
    """
    import numpy as np  # loaded after the command has set the number of threads

    if hasattr(type(values), "loc"):  # a frame or series
        raise BadInputError(
            f"{what} has labels; give {what}.to_numpy() in the order of the states and inputs"
        )
    if isinstance(values, str):
        raise BadInputError(f"{what} is {shown(values)}; give numbers, as in [1.0, 2.0]")
    try:  # a tensor of PyTorch may have gradients, or be in the memory of a GPU
        array = np.asarray(values.detach().cpu() if hasattr(values, "detach") else values)
    except (ValueError, TypeError, RuntimeError):  # rows that differ in length; CasADi
        array = np.empty(0, dtype=object)
    if array.dtype.kind not in "iuf":
        if hasattr(values, what):  # as a Solution that is given for K has an attribute K
            raise BadInputError(f"{what} is a {type(values).__name__}; give its {what}")
        raise BadInputError(f"{what} does not consist of rows of real numbers, all of equal length")
    mask = getattr(values, "_mask", None)  # importing numpy.ma would take 10 ms
    if mask is not None and np.any(mask):
        raise BadInputError(f"{what} has masked entries; give a number for each entry")
    return array.astype(float)


def shortened(text: str, longest: int = _LONGEST) -> str:
    """Return a text unchanged, or its first `longest` characters and "..." if it is longer."""
    return text if len(text) <= longest else f"{text[:longest]}..."


def shown(value: Any) -> str:
    """Return the repr of a value on one line, truncated if it is long."""
    return shortened(" ".join(repr(value).split("\n")))


def printable(text: object, lines: bool = False) -> str:
    r"""Return a text with blanks for other white space, and control characters escaped: \x1b.

    text: a text, a table cell or the path of a file
    lines: whether line breaks are kept
    """
    plain = str(text)
    for letter in {*plain}:
        if not (letter.isprintable() or (lines and letter == "\n")):
            plain = plain.replace(letter, " " if letter.isspace() else ascii(letter)[1:-1])
    return plain


def on_one_line(message: str) -> str:
    """Return a message as one line.

    Control characters are escaped, and a long message is truncated.
    """
    words = message[: 4 * _LONGEST_LINE].split()
    return shortened(printable(" ".join(words)), _LONGEST_LINE)


def warn(text: str) -> None:
    """Issue a warning at the nearest caller outside the packages of the project."""
    level = 1
    while sys._getframe(level).f_globals.get("__name__", "").startswith(OWN):
        level += 1
    warnings.warn(text, stacklevel=level + 1)
