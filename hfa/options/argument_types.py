"""Option types: functions that convert one word of a command line to a value in internal units.

An option type raises BadInputError for an invalid word. The message completes a sentence that
begins with the option, for example "--delay is 'short'; give a finite number". Numbers typed by the
user are converted only in this module. `quantity` converts degrees to radians.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, choice_of, shortened
from hfa_support.files import NUMBER, POSITIVE, Number, note_read
from hfa_support.reporting.text import shown_unit
from hfa_support.units import conversion_factor, split_unit

if TYPE_CHECKING:
    from trim.sweeps.sweep_plan import Steps


PICTURES = (".png", ".svg", ".pdf")
_LARGEST_WHOLE = 10**18
T = TypeVar("T")


def number(text: str, declared: Number = NUMBER) -> float:
    """Return the number that a word represents.

    declared: permitted range of the number

    Raises BadInputError for another text, and for a number outside the range.
    """
    try:
        value = None if "_" in text else declared.of(float(text))  # Python's 3_5 is no number
    except ValueError:
        value = None
    if value is None:
        truth = " (1 for true, 0 for false)" if text.lower() in ("true", "false") else ""
        raise BadInputError(f"is {shortened(text)!r}; give {declared}{truth}")
    return value


positive = partial(number, declared=POSITIVE)


def seconds(text: str, declared: Number = POSITIVE) -> float:
    """Return the time that a word states, s: a number in s, or with a unit, "20ms"."""
    value, unit = split_unit(text)
    factor = conversion_factor(unit or "s", "s")
    if factor is None:
        raise BadInputError(f"is {shortened(text)!r}; give a time in s, or with a unit: 20ms")
    return number(value, declared) * factor


def listed_numbers(text: str) -> list[float]:
    """Return the numbers in a text "a,b,...".

    Raises BadInputError if an entry is not a number.
    """
    try:
        return [number(word) for word in text.split(",")]
    except BadInputError as error:
        raise BadInputError(f"{error} for each entry, a,b,...") from None


def quantity(model: Model, name: str, text: str, declared: Number = NUMBER) -> float:
    """Return the value of a named variable, in internal units, from its text.

    Without a unit, angles and angular rates are typed in degrees and returned in radians, and all
    other values are in the unit that the model declares. A name without a declared unit is a plain
    number.

    name: a state, input, output or parameter, or the rate of a state
    text: the number as typed, with or without a unit: "100kt"
    declared: permitted range of the number

    Raises BadInputError if the text is no such number, or if its unit cannot be converted.
    """
    typed_number, typed_unit = split_unit(text)
    if typed_unit:
        if name not in model.signals:  # raises unless a trim imposes it, such as a rate
            model.refuse_unheld("is the unknown variable", name)
        return number(typed_number, declared) * model.factor_of(name, text, typed_unit)
    known = {**model.rates, **model.airspeeds, **model.signals}
    return number(text, declared) * typed_unit_of(known[name].unit if name in known else "")


def typed_unit_of(unit: str) -> float:
    """Return what 1 is that is typed for a quantity with this unit: a degree for angles."""
    return conversion_factor(shown_unit(unit), unit) or 1.0


@contextmanager
def option_errors(flag: str) -> Iterator[None]:
    """Put an option before the message of an error that is raised in the `with` block.

    flag: name of the option
    """
    try:
        yield
    except BadInputError as error:
        raise BadInputError(f"{flag} {error}") from error
    # For example, a file that contains only digits or brackets.
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{flag}: cannot be read ({shortened(str(error))})") from error


def each_of(
    flag: str, model: Model, texts: Mapping[str, str], kind: Callable[[Model, str, str], T]
) -> dict[str, T]:
    """Return name in the model -> value, from the texts of an option NAME=VALUE.

    flag: name of the option, for messages
    texts: name as typed, which may be an alias of the model -> text
    kind: function (model, name, text) -> value

    Raises BadInputError, with the option and the name, as `kind` does.
    """
    values: dict[str, T] = {}
    text_of: dict[str, str] = {}
    for typed, text in texts.items():
        name = model.about.name_of(typed)
        with option_errors(f"{flag} {shortened(name)}"):
            value = kind(model, name, text)
        if text_of.setdefault(name, text) != text:  # by its name and by an alias
            raise BadInputError(f"{flag} {shortened(name)} is given twice; give one value")
        values[name] = value
    return values


def among(
    names: tuple[str, ...], model: Model, name: str, text: str, declared: Number = NUMBER
) -> float:
    """Return the number typed for a variable, in the model's units.

    names: permitted variables
    name: the typed variable
    text: the typed number
    declared: permitted range of the number

    Raises BadInputError if the variable is not permitted.
    """
    if name not in names:
        raise BadInputError(f"is unknown; {choice_of(name, names)}")
    return quantity(model, name, text, declared)


def linear_state(model: Model, name: str, text: str, declared: Number = NUMBER) -> float:
    """Return the number typed for a state of the linear model, in the model's units.

    name: the typed state
    text: the typed number
    declared: permitted range of the number

    Raises BadInputError if the name is not a state of the linear model.
    """
    return among(model.linear, model, name, text, declared)


def span(model: Model, name: str, text: str) -> tuple[float, float]:
    """Return the limits (low, high) of a named variable, in internal units, from `LOW:HIGH`.

    Raises BadInputError if the text is not two numbers, or unless low < high.
    """
    low, colon, high = text.partition(":")
    if not colon or ":" in high:
        raise BadInputError(f"is {shortened(text)!r}; give LOW:HIGH")
    lowest = quantity(model, name, low)
    highest = quantity(model, name, high)
    if not lowest < highest:
        raise BadInputError(f"is {shortened(text)!r}; give two different limits, the lower first")
    return lowest, highest


def whole(lowest: int, highest: int = _LARGEST_WHOLE) -> Callable[[str], int]:
    """Return an option type that accepts whole numbers from `lowest` to `highest`."""

    def convert(text: str) -> int:
        value = number(text)
        # Convert digits directly, because a float would round large numbers.
        result = int(text) if text.strip().isdigit() else int(value)
        if value != int(value) or not lowest <= result <= highest:
            raise BadInputError(
                f"is {shortened(text)}; give a whole number from {lowest} to {highest:.6g}"
            )
        return result

    return convert


def one_of(*words: str) -> Callable[[str], str]:
    """Return an option type that accepts one of these words, in upper or lower case.

    The value is the word in lower case.
    """

    def convert(text: str) -> str:
        word = text.lower()
        if word not in words:
            raise BadInputError(f"is {shortened(text)!r}; choose from {', '.join(words)}")
        return word

    return convert


def listed_names(text: str) -> tuple[str, ...]:
    """Return the names in a text "a,b,...", each at most once."""
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        raise BadInputError(f"is {shortened(text)!r}; give names separated by commas")
    for name in names:
        if names.count(name) > 1:
            raise BadInputError(f"contains {name} twice; remove one {name}")
    return names


def input_file(*suffixes: str) -> Callable[[str], Path]:
    """Return an option type that accepts the path of an existing file and records it as input.

    suffixes: accepted suffixes, for example ".json"
    """

    def convert(text: str) -> Path:
        path = Path(text)
        if path.suffix.lower() not in suffixes:
            raise BadInputError(
                f"{text}: the suffix {path.suffix!r} is unknown; use {', '.join(suffixes)}"
            )
        if not path.is_file():
            fault = "not a regular file" if path.exists() else "no such file"
            raise BadInputError(f"{text}: {fault}; give an existing file")
        note_read(path)
        return path

    return convert


def output_file(
    *suffixes: str, folder: bool = False, stores: Sequence[str] = ()
) -> Callable[[str], Path]:
    """Return an option type for the path of an output file, checked before the computation.

    suffixes: accepted suffixes of files
    folder: True to also accept a folder, whose name has no suffix
    stores: accepted suffixes of stores, which are folders that may already exist
    """

    def convert(text: str) -> Path:
        path = Path(text)
        where = text or "''"  # in messages
        if folder and text and not path.suffix:
            if not path.is_dir() and (path.exists() or not path.parent.is_dir()):
                raise BadInputError(
                    f"{where}: the folder cannot be created; choose a path in an existing folder"
                )
            return path
        if path.suffix.lower() not in (*suffixes, *stores):
            kinds = ", ".join((*suffixes, *stores))
            if folder:
                kinds += ", or a folder name without suffix"
            raise BadInputError(f"{where}: the suffix {path.suffix!r} is unknown; use {kinds}")
        if not path.parent.is_dir():
            raise BadInputError(
                f"{where}: the folder {path.parent} does not exist; create this folder first"
            )
        store = path.is_dir() and path.suffix.lower() in stores
        if path.exists() and not path.is_file() and not store:
            kind = "a folder" if path.is_dir() else "not a regular file"
            raise BadInputError(f"{where} is {kind}; choose another name")
        return path

    return convert


#: Listed or evenly spaced values in internal units.
Range: TypeAlias = "tuple[float, ...] | Steps"


def value_range(model: Model, name: str, text: str) -> Range:
    """Return the values of a named variable, in internal units, from its text.

    text: `start:stop:step`, `a,b,c` or one number, each with or without a unit; the values of a
        range do not exceed `stop`

    Raises BadInputError for text of another form, for different units, for a step that is not
    positive, if stop < start, and for more than `MOST_POINTS` values of a range.
    """
    # "10,050 ft" has a comma of thousands: no number of a list begins with 0 and two digits.
    if re.fullmatch(r"[-+]?\d{1,3}(,\d{3})*,0\d\d(,\d{3})*\s*\D*", text):
        raise BadInputError(f"is {shortened(text)!r}; write {text.replace(',', '')}")
    parts = text.split(":")
    if len(parts) == 1:
        return tuple(quantity(model, name, word) for word in text.split(","))
    if len(parts) != 3:
        raise BadInputError(
            f"is {shortened(text)!r}; give start:stop:step, a list a,b,c or one number"
        )
    for part in parts:
        quantity(model, name, part)  # refuses what is not a number, and unknown units
    typed = [split_unit(part) for part in parts]
    # Whether there is a unit, and its size in that of the model.
    units = {(unit != "", quantity(model, name, f"1 {unit}")) for _, unit in typed}
    if len(units) > 1:
        raise BadInputError(f"is {shortened(text)!r}; give all three numbers in the same unit")
    ((_, unit),) = units
    start, stop, step = (number(typed_number) for typed_number, _ in typed)
    from trim.sweeps.sweep_plan import MOST_POINTS, Steps

    if step <= 0:
        raise BadInputError(f"has the step {step:g}; give a positive step")
    if stop < start:
        raise BadInputError(
            f"runs backwards from {start:g} to {stop:g}; give the lower number first"
        )
    count = _count(start, stop, step)
    if count > MOST_POINTS:
        raise BadInputError(
            f"is a range of {float(count):,.15g} points (maximum {MOST_POINTS:,}); choose a larger "
            "step"
        )
    spacing = step * unit
    if count > 1:
        spacing = min(spacing, (stop - start) * unit / (count - 1))
    # A rounded spacing must not lead beyond stop, which may be a limit of the variable.
    while start * unit + spacing * (count - 1) > stop * unit:
        spacing = np.nextafter(spacing, 0.0)
    return Steps(start * unit, float(spacing), count)


def _count(start: float, stop: float, step: float) -> int:
    """Return the number of values start, start + step, ... up to stop, of the typed decimals."""
    # Doubles would miss the last value of 35:35.3:0.1, because (35.3 - 35) / 0.1 is below 3 in
    # them.
    from fractions import Fraction

    first, last, width = (Fraction(repr(value)) for value in (start, stop, step))  # as typed
    return (last - first) // width + 1


def array_of(name: str, values: Range, most: int) -> np.ndarray:
    """Return the values of a variable as an array, (N,).

    name: name of the variable or its option, for the message
    values: the values, or start, spacing and count of a range

    Raises BadInputError if there are more than `most` values.
    """
    if len(values) > most:
        raise BadInputError(
            f"{name} has {len(values):,} points, but at most {most:,} are allowed; give fewer"
        )
    return np.asarray(values if isinstance(values, tuple) else values[np.arange(values.count)])
