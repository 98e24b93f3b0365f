"""Search for one entry of the plant that, when changed, makes every printed digit right.

Every text that differs from an entry by one misprint is tried. The plants with these texts are
solved together to low accuracy. Plants with the right digits are solved again with a certificate.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.progress import Progress, with_progress
from hfa_support.reporting.results import Result
from studies.published.comparison import Position, change, compare, in_signs
from studies.published.exact_answer import answer_of, certified_value, rough_values
from studies.published.printed_file import PrintedFile

#: Accuracy of an approximate answer, relative to the largest entry of its block.
_ROUGH = 1e-9
#: Largest number of values times the cube of the number of states that is searched. With 38 states,
#: this takes about five minutes on one processor.
_MOST = 1e10


@dataclass(frozen=True, eq=False)
class ChangedEntry(Result):
    """Change of one entry of the plant that makes every printed digit right.

    position: position of the entry
    typed: text of the entry in the file
    lowest: lower end of an interval of values that make every printed digit right, to first order
    highest: upper end of this interval
    value: text of a value in this interval that differs from `typed` by one misprint
    slip: the misprint
    """

    position: Position
    typed: str
    lowest: float
    highest: float
    value: str
    slip: str

    @property
    def entry(self) -> str:
        """Position of the entry as text, such as "A12" for row 1 and column 2 of A."""
        return str(self.position)

    def __str__(self) -> str:
        return f"{self.position} = {self.value}, not {self.typed} ({self.slip})"

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "typed": self.typed,
            "lowest": self.lowest,
            "highest": self.highest,
            "value": self.value,
            "slip": self.slip,
            "entry": self.entry,
        }


class _Edit(NamedTuple):
    """Text of an entry for which the approximate answer has every printed digit."""

    text: str
    slip: str  # misprint that turns the text into the text in the file
    value: float  # number that the text represents
    lowest: float  # lowest value of the entry for which the answer has every digit, to first order
    # highest value of the entry for which the answer has every digit, to first order
    highest: float


def changed_entries(file: PrintedFile, progress: Progress | None = None) -> list[ChangedEntry]:
    """Return changes of one entry of the plant that make every printed digit right.

    The list contains one change for each interval of values that make every printed digit right.
    The new value differs from the text in the file by one misprint. The entry is one of A, B, E, N,
    Q, R or gamma. The list is empty if the search would take too long (`not_searched`).

    progress: called with the number of entries searched so far and the total number, or None
    """
    if not_searched(file):
        return []
    entries = []
    for position, text in with_progress(list(_positions(file)), progress):
        for edits in _by_interval(_fitting(file, position, text)):
            entry = _likeliest(file, position, text, edits)
            if entry is not None:
                entries.append(entry)
    return entries


@lru_cache(maxsize=1)
def not_searched(file: PrintedFile) -> str:
    """Return the reason why `changed_entries` does not search a file's plant, or "" if it does."""
    states = len(file.plant.A)
    count = edits_tried(file)
    if count * states**3 <= _MOST:
        return ""
    return (
        "changed entries of the plant and interchanged states were not searched for: "
        f"{count} values with {states} states exceed the limit, {_MOST / states**3:.0f}"
    )


def edits_tried(file: PrintedFile) -> int:
    """Return the number of changed values that `changed_entries` tries for a file."""
    return sum(len(_edits(text)) for _, text in _positions(file))


def _positions(file: PrintedFile) -> Iterator[tuple[Position, str]]:
    """Yield the position and the text of each number of the plant, except formulas."""
    for name, block in file.typed.items():
        for row, texts in enumerate(block.texts):
            for column, text in enumerate(texts):
                is_number = block.half_units[row, column] > 0.0
                if is_number and (name not in ("Q", "R") or column >= row):
                    yield Position(name, row, column), text


def _fitting(file: PrintedFile, position: Position, text: str) -> list[_Edit]:
    """Return the texts of an entry for which the approximate answer has every printed digit."""
    slips = _edits(text)
    values = np.array([float(edit) for edit in slips])
    blocks = file.answer.values()
    printed = np.concatenate([block.values.ravel() for block in blocks])
    allowed = np.concatenate(
        [(block.half_units + _ROUGH * np.abs(block.values).max()).ravel() for block in blocks]
    )
    plants = file.plant.stacked(*position, values)
    with np.errstate(all="ignore"):
        P = rough_values(plants)
        misfits = printed - in_signs(file, answer_of(plants, P))
        fits = (np.abs(misfits) <= allowed).all(axis=-1)
    edits = []
    for index, (edit, slip) in enumerate(slips.items()):
        if fits[index]:
            plant = file.plant.with_entry(*position, values[index])
            slopes = change(file, plant, P[index], position)
            if slopes.any():  # otherwise the answer does not depend on this entry
                lowest, highest = _moves(misfits[index], slopes, allowed)
                value = float(values[index])
                edits.append(_Edit(edit, slip, value, value + lowest, value + highest))
    return edits


def _moves(misfits: np.ndarray, slopes: np.ndarray, allowed: np.ndarray) -> tuple[float, float]:
    """Return the smallest and the largest x with |misfits - slopes x| <= allowed."""
    depends = slopes != 0.0
    centers = misfits[depends] / slopes[depends]
    widths = allowed[depends] / np.abs(slopes[depends])
    return float((centers - widths).max()), float((centers + widths).min())


def _by_interval(edits: list[_Edit]) -> list[list[_Edit]]:
    """Return the edits of an entry in groups."""
    groups: list[list[_Edit]] = []
    for edit in sorted(edits, key=lambda edit: edit.lowest):
        if groups and edit.lowest <= max(before.highest for before in groups[-1]):
            groups[-1].append(edit)
        else:
            groups.append([edit])
    return groups


def _likeliest(
    file: PrintedFile, position: Position, text: str, edits: list[_Edit]
) -> ChangedEntry | None:
    """Return the first edit that the certified answer confirms, or None if no edit is confirmed."""
    lowest = min(edit.lowest for edit in edits)
    highest = max(edit.highest for edit in edits)
    middle = (lowest + highest) / 2.0
    order = [_SIGN, *_SLIPS]
    for edit in sorted(edits, key=lambda edit: (order.index(edit.slip), abs(edit.value - middle))):
        plant = file.plant.with_entry(*position, edit.value)
        try:
            confirmed = not compare(file, plant, certified_value(plant)).outside.any()
        except (NoSolutionError, BadInputError):
            continue
        if confirmed:
            return ChangedEntry(position, text, lowest, highest, edit.text, edit.slip)
    return None


def _edits(text: str) -> dict[str, str]:
    """Return right text -> misprint that turns the right text into the given text."""
    match = re.fullmatch(r"([+-]?)([\d.]+)(.*)", text)
    assert match is not None  # every number has this form
    sign, digits, exponent = match.groups()
    opposite = "" if sign == "-" else "-"
    slips = {f"{opposite}{digits}{exponent}": _SIGN}
    for slip, digits_before in _SLIPS.items():
        for before in digits_before(digits):
            if before.strip("."):
                word = f"{sign}{_without_leading_zeros(before)}{exponent}"
                slips.setdefault(word, slip)
    return {word: slip for word, slip in slips.items() if float(word) != float(text)}


def _without_leading_zeros(digits: str) -> str:
    """Return a number without leading zeros, but with at least one digit before the point."""
    stripped = digits.lstrip("0")
    if not stripped or stripped.startswith("."):
        return f"0{stripped}"
    return stripped


def _without_one(digits: str) -> Iterator[str]:
    for index in _places(digits):
        yield digits[:index] + digits[index + 1 :]


def _with_one_more(digits: str) -> Iterator[str]:
    for index in range(len(digits) + 1):
        for digit in "0123456789":
            yield f"{digits[:index]}{digit}{digits[index:]}"


def _with_another(digits: str) -> Iterator[str]:
    for index in _places(digits):
        for digit in "0123456789":
            yield f"{digits[:index]}{digit}{digits[index + 1 :]}"


def _with_neighbours_interchanged(digits: str) -> Iterator[str]:
    places = _places(digits)
    for first, second in pairwise(places):
        swapped = list(digits)
        swapped[first] = digits[second]
        swapped[second] = digits[first]
        yield "".join(swapped)


def _with_the_point_elsewhere(digits: str) -> Iterator[str]:
    """Yield the same digits with the decimal point at each position."""
    plain = digits.replace(".", "")
    yield f"0.0{plain}"
    for moved in range(len(plain) + 1):
        yield f"{plain[:moved]}.{plain[moved:]}"
    yield f"{plain}0"


def _places(digits: str) -> list[int]:
    """Return the indices of the digits in a text of digits and a decimal point."""
    return [index for index, digit in enumerate(digits) if digit != "."]


_SIGN = "the sign"
#: Misprint -> function from the typed digits to the right digits. A misprint with fewer
#: possibilities is likelier. The likeliest come first, after the sign.
_SLIPS: Mapping[str, Callable[[str], Iterator[str]]] = {
    "digits interchanged": _with_neighbours_interchanged,
    "a digit too many": _without_one,
    "the decimal point": _with_the_point_elsewhere,
    "a digit is missing": _with_one_more,
    "another digit": _with_another,
}
