"""The search for one entry of the plant with which the printed answer is right."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hfa_support.errors import BadInputError, NoSolutionError
from verification.printed.comparison import Comparison, Position, change, compare
from verification.printed.exact_answer import Plant, certified_value, quick_value
from verification.printed.printed_file import PrintedFile

#: Steps of Gauss-Newton from a start, and the relative step that ends them.
_STEPS = 12
_SETTLED = 1e-13
#: Where a step promises to remove less than this part of the misfit, no better value is near.
_STATIONARY = 1e-3
#: A step may change the entry by this factor of its size.
_LONGEST_STEP = 3.0
#: Least evidence for a name: entries beside the worst must be off too.
EVIDENCE = 1.0


@dataclass(frozen=True, eq=False)
class ChangedEntry:
    """An entry of the plant, with another value of which every printed digit is right.

    position: of the entry
    typed: its text in the file
    lowest: of the interval of such values
    highest: of it
    value: text of the value within it that is one slip of the pen away
    slip: what happened to the text
    """

    position: Position
    typed: str
    lowest: float
    highest: float
    value: str
    slip: str

    def __str__(self) -> str:
        return f"{self.position} = {self.value}, not {self.typed} ({self.slip})"


def changed_entries(file: PrintedFile) -> list[ChangedEntry]:
    """Every interval of one entry of A, B, E, N, Q, R or gamma that makes all digits right and
    holds an edit of the typed text. More than one: the answer does not decide between them."""
    entries = []
    for position, text in _positions(file):
        edits = dict(_edits(text))
        for lowest, highest in _intervals(file, position):
            entry = _edit_within(file, position, text, edits, (lowest, highest))
            if entry is not None:
                entries.append(entry)
    return entries


def _positions(file: PrintedFile) -> Iterator[tuple[Position, str]]:
    """Entries of the plant and their texts; of Q and R the upper triangle."""
    for name, block in file.typed.items():
        for row, texts in enumerate(block.texts):
            for column, text in enumerate(texts):
                is_number = block.half_units[row, column] > 0.0
                if is_number and (name not in ("Q", "R") or column >= row):
                    yield Position(name, row, column), text


def _intervals(file: PrintedFile, position: Position) -> list[tuple[float, float]]:
    """Disjoint intervals of the entry, found from four starts."""
    typed = _entry(file.plant, position)
    starts = (typed, -typed, 10.0 * typed, typed / 10.0) if typed else (0.0,)
    intervals: list[tuple[float, float]] = []
    for start in starts:
        value = _least_squares(file, position, start)
        interval = None if value is None else _interval(file, position, value)
        if interval is None:
            continue
        lowest, highest = interval
        if all(highest < before[0] or lowest > before[1] for before in intervals):
            intervals.append(interval)
    return intervals


def _least_squares(file: PrintedFile, position: Position, start: float) -> float | None:
    """The entry at the least Σ ((printed - exact)/h)², by Gauss-Newton; None where the plant has no
    answer, and where the least leaves the numbers outside their digits."""
    value = start
    for _ in range(_STEPS):
        try:
            comparison, slopes = _linear(file, position, value)
        except NoSolutionError:
            return None
        scaled = slopes / np.maximum(comparison.allowed, 1e-300)
        misfit = (comparison.printed - comparison.exact) / np.maximum(comparison.allowed, 1e-300)
        square = float(scaled @ scaled)
        if not (math.isfinite(square) and square > 0.0):
            return None
        reduction = float(scaled @ misfit) ** 2 / square
        before = float(misfit @ misfit)
        if reduction < _STATIONARY * before and before - reduction > len(misfit):
            return None
        step = float(scaled @ misfit) / square
        longest = _LONGEST_STEP * max(abs(value), abs(start), 1.0)
        step = min(max(step, -longest), longest)
        value += step
        if abs(step) <= _SETTLED * abs(value) or abs(step) * math.sqrt(square) < 1e-3:
            return value
    return value


def _interval(file: PrintedFile, position: Position, value: float) -> tuple[float, float] | None:
    """Values near this one with which every |printed - exact| is allowed; None where none is."""
    for _ in range(2):
        try:
            comparison, slopes = _linear(file, position, value)
        except NoSolutionError:
            return None
        misfit = comparison.printed - comparison.exact
        moves = slopes != 0.0
        if (np.abs(misfit[~moves]) > comparison.allowed[~moves]).any() or not moves.any():
            return None
        centers = misfit[moves] / slopes[moves]
        widths = comparison.allowed[moves] / np.abs(slopes[moves])
        lowest = float((centers - widths).max())
        highest = float((centers + widths).min())
        if lowest > highest:
            return None
        interval = (value + lowest, value + highest)
        value += (lowest + highest) / 2.0
    try:
        middle = _with(file.plant, position, value)
        confirmed = not compare(file, middle, quick_value(middle)).outside.any()
    except NoSolutionError:
        return None
    return interval if confirmed else None


def _linear(file: PrintedFile, position: Position, value: float) -> tuple[Comparison, np.ndarray]:
    """The comparison at a value of the entry, and the derivatives of the exact numbers."""
    plant = _with(file.plant, position, value)
    P = quick_value(plant)
    try:
        return compare(file, plant, P), change(file, plant, P, position)
    except np.linalg.LinAlgError as error:
        raise NoSolutionError("the policies are not unique") from error


def _edit_within(
    file: PrintedFile,
    position: Position,
    text: str,
    edits: dict[str, str],
    interval: tuple[float, float],
) -> ChangedEntry | None:
    """The edit nearest to the middle that a certified solve confirms; None where there is none."""
    lowest, highest = interval
    within = [edit for edit in edits if lowest <= float(edit) <= highest]
    middle = (lowest + highest) / 2.0
    for edit in sorted(within, key=lambda word: abs(float(word) - middle)):
        plant = _with(file.plant, position, float(edit))
        try:
            confirmed = not compare(file, plant, certified_value(plant)).outside.any()
        except (NoSolutionError, BadInputError):
            continue
        if confirmed:
            return ChangedEntry(position, text, lowest, highest, edit, edits[edit])
    return None


def _entry(plant: Plant, position: Position) -> float:
    if position.block == "gamma":
        return plant.gamma
    return float(getattr(plant, position.block)[position.row, position.column])


def _with(plant: Plant, position: Position, value: float) -> Plant:
    return plant.with_entry(position.block, position.row, position.column, value)


def _edits(text: str) -> Iterator[tuple[str, str]]:
    """Texts that one slip away became this one, and the slip: the likely ones last, which win."""
    match = re.fullmatch(r"([+-]?)([\d.]+)(.*)", text)
    if match is None:
        return
    sign, digits, exponent = match.groups()
    typed = float(text)
    for edited, slip in _edited_digits(digits):
        if not edited.strip("."):
            continue
        word = f"{sign}{_without_leading_zeros(edited)}{exponent}"
        if float(word) != typed:
            yield word, slip
    if typed:
        opposite = "" if sign == "-" else "-"
        yield f"{opposite}{digits}{exponent}", "the sign"


def _without_leading_zeros(digits: str) -> str:
    """0.5 of 00.5 and of .5."""
    stripped = digits.lstrip("0")
    if not stripped or stripped.startswith("."):
        return f"0{stripped}"
    return stripped


def _edited_digits(digits: str) -> Iterator[tuple[str, str]]:
    for index in range(len(digits) + 1):
        for digit in "0123456789":
            yield f"{digits[:index]}{digit}{digits[index:]}", "a digit is missing"
    for index, old in enumerate(digits):
        if old == ".":
            continue
        yield digits[:index] + digits[index + 1 :], "a digit too many"
        for digit in "0123456789":
            yield f"{digits[:index]}{digit}{digits[index + 1 :]}", "another digit"
    plain = digits.replace(".", "")
    point = digits.find(".") if "." in digits else len(digits)
    for moved in range(len(plain) + 1):
        if moved != point:
            yield f"{plain[:moved]}.{plain[moved:]}", "the decimal point"
    padded = plain + "0"
    if point == len(plain):
        yield padded, "the decimal point"
    yield (
        f"0.0{plain}" if point == 0 or digits.startswith("0.") else f"0.{plain}",
        "the decimal point",
    )
    for first in range(len(plain) - 1):
        swapped = list(plain)
        swapped[first] = plain[first + 1]
        swapped[first + 1] = plain[first]
        word = "".join(swapped)
        if "." in digits:
            word = f"{word[:point]}.{word[point:]}"
        yield word, "digits interchanged"
