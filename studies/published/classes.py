"""Classification of printed answers by their digits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.progress import Progress
from studies.published.changed_entry import (
    ChangedEntry,
    changed_entries,
    edits_tried,
    not_searched,
)
from studies.published.comparison import Comparison, Position, change, compare, compare_answer
from studies.published.exact_answer import answer_of, certified_value
from studies.published.printed_file import TIMES, PrintedFile
from verification.critic_errors import relative_error

Class = Literal[
    "as printed",
    "cut off",
    "one entry of the answer",
    "the answer belongs to another plant",
    "close",
    "not decided",
    "cannot tell",
    "wrong",
]
#: Ratio of the error of one wrong entry to errors that the other entries may hide, for a learned
#: answer.
_ABOVE_NOISE = 10.0
#: An answer with a larger relative error is that of an unknown problem. The limit is a convention:
#: of 88 sources, unexplained answers have errors below 0.03 % or above 80 %.
_FAR = 0.5
#: Least evidence for a changed entry of the plant. Entries other than the worst must contribute to
#: it.
_EVIDENCE = 1.0
#: Part of the error of a learned answer that may be left without a mistake; of a smaller error than
#: `_SMALL_ERROR`, a smaller part.
_LEFT, _LEFT_OF_SMALL, _SMALL_ERROR = 0.15, 1e-3, 0.03
#: An earlier mistake is preferred if it leaves at most this many times the smallest error.
_AS_GOOD = 10.0
#: An entry above this fraction of its typical size is informative. A smaller entry than `_SMALL`
#: of the largest counts as this size.
_TOLD, _SMALL = 0.1, 1e-5


@dataclass(frozen=True, eq=False)
class Classified:
    """Class of a printed answer, with the reason.

    name: name of the class
    reason: reason, in one line
    comparison: comparison of every printed entry with the exact answer of the plant in the file
    P: matrix of the exact value x'P x of the plant in the file, (n, n)
    changed: changes of one entry of the plant for which every printed digit is right
    not_searched: reason why no changes were searched for, or "" if they were searched for or not
        needed
    """

    name: Class
    reason: str
    comparison: Comparison
    P: np.ndarray
    changed: tuple[ChangedEntry, ...] = ()
    not_searched: str = ""


def classify(file: PrintedFile, progress: Progress | None = None) -> Classified:
    """Return the class of a printed answer, with the reason and the comparison.

    progress: passed to `changed_entries`

    Raises NoSolutionError if the plant in the file has no certified answer. The message names the
    other kind of time, continuous or discrete, or changed entries, if they make every printed digit
    right. Raises BadInputError if the file does not state the time. The message names continuous or
    discrete time if one of these makes every printed digit right.
    """
    if not file.has_time:
        missing = 'time is missing; give time = "continuous" or "discrete"'
        raise BadInputError(fitting_time(file) or missing)
    try:
        P = certified_value(file.plant)
    except NoSolutionError as failure:
        raise NoSolutionError(_explained(failure, file, progress)) from failure
    comparison = compare(file, file.plant, P)
    by_digits = _by_digits(file, P, comparison)
    if by_digits is not None:
        name, reason = by_digits
        return Classified(name, reason, comparison, P)
    unsearched = not_searched(file)
    changed = tuple(changed_entries(file, progress))
    mistake = _known_mistake(file, P, comparison)
    by_search = _by_search(file, comparison, changed, mistake)
    if by_search is not None:
        name, reason = by_search
        return Classified(name, reason, comparison, P, changed, unsearched)
    if not file.plant_rounded:
        name, reason = _by_size(file, comparison)
    elif unsearched:
        name = "cannot tell"
        reason = "the rounding of so many entries of the plant is not tried"
    else:
        name, reason = _by_rounding(rounding_used(file, P, comparison))
    return Classified(name, reason, comparison, P, not_searched=unsearched)


def fitting_time(file: PrintedFile) -> str:
    """Return a question that proposes continuous or discrete time, or "".

    The proposed time makes every printed digit right. The result is "" if neither time does.
    """
    for time in TIMES:
        plant = replace(file.plant, is_discrete=time == "discrete")
        if "H" in file.answer and not plant.is_discrete:
            continue
        try:
            outside = compare(file, plant, certified_value(plant)).outside
        except (NoSolutionError, BadInputError):
            continue
        if not outside.any():
            return f'every printed digit fits time = "{time}"; did you mean that?'
    return ""


def _by_digits(
    file: PrintedFile, P: np.ndarray, comparison: Comparison
) -> tuple[Class, str] | None:
    """Return the class and its reason if they follow from the digits alone, or None."""
    if not comparison.outside.any():
        return "as printed", f"all {len(comparison.printed)} entries"
    if _is_cut_off(comparison):
        return "cut off", "the digits are cut off, not rounded"
    if file.assumption:
        return "cannot tell", file.assumption
    asymmetric = _asymmetric_block(file)
    if asymmetric:
        return "cannot tell", f"{asymmetric} is not symmetric within its digits"
    wrong = comparison.wrong_positions
    if len(wrong) != 1 or comparison.outside.all():
        return None
    if file.learned and not _exceeds_noise(comparison):
        return None
    if file.plant_rounded and (not_searched(file) or rounding_used(file, P, comparison) <= 1.0):
        return None
    return "one entry of the answer", _wrong_entry(file, comparison, wrong[0])


def _exceeds_noise(comparison: Comparison) -> bool:
    """Return whether the wrong entries are too far off to be noise of a learned answer."""
    outside = comparison.outside
    error = np.abs(comparison.printed - comparison.exact)[outside].min()
    relative = (np.abs(comparison.printed - comparison.exact) / _sizes(comparison))[outside].min()
    hidden = comparison.half_units[~outside]
    hidden_relative = (comparison.half_units / _sizes(comparison))[~outside]
    return bool(
        error > _ABOVE_NOISE * hidden.max() and relative > _ABOVE_NOISE * hidden_relative.max()
    )


def _sizes(comparison: Comparison) -> np.ndarray:
    """Return |exact| of each printed entry, but at least half a unit of its last digit, (N,)."""
    return np.maximum(np.abs(comparison.exact), comparison.half_units)


def _by_search(
    file: PrintedFile, comparison: Comparison, changed: tuple[ChangedEntry, ...], mistake: str
) -> tuple[Class, str] | None:
    """Return the class and its reason if a changed entry or a known mistake explains the answer."""
    is_evident = _is_evident(file, comparison)
    is_inexact = file.learned or file.plant_rounded
    explanations = [mistake] if mistake else []
    if is_evident or not is_inexact:
        explanations += [str(entry) for entry in changed]
    if not explanations:
        return None
    if len(explanations) > 1:
        return "wrong", "the answer does not determine which: " + "; or ".join(explanations)
    if mistake:
        return "wrong", mistake
    if is_evident:
        return "the answer belongs to another plant", explanations[0]
    return "wrong", f"perhaps {explanations[0]}, supported by too few other entries"


def _explained(failure: NoSolutionError, file: PrintedFile, progress: Progress | None) -> str:
    """Return the error message for a plant without a certified answer."""
    other_time = fitting_time(file)
    if other_time:
        return f"{failure}; {other_time}"
    unsearched = not_searched(file)
    if unsearched:
        return f"{failure}; {unsearched}"
    changed = changed_entries(file, progress)
    if not changed:
        return str(failure)
    changes = "; or with ".join(map(str, changed))
    return f"with {changes} every printed digit is right; as typed: {failure}"


def _is_evident(file: PrintedFile, comparison: Comparison) -> bool:
    """Return whether the wrong entries are sufficient evidence for a changed entry of the plant."""
    # An error of r half units occurs by chance in one of r cases. For a learned answer or a rounded
    # plant, noise or rounding may explain such errors. The chance over all edits tried must then
    # also be small.
    evidence = comparison.evidence()
    if evidence[1:].sum() < _EVIDENCE:
        return False
    if not (file.learned or file.plant_rounded):
        return True
    return bool(evidence.sum() >= _EVIDENCE + np.log10(edits_tried(file)))


def _by_rounding(used: float) -> tuple[Class, str]:
    """Return the class and the reason of an answer whose plant is printed with rounded entries."""
    if used <= 1.0:
        return "not decided", f"{used:.2g} of the rounding of the plant explains it"
    return "cannot tell", f"{used:.3g} times the rounding of the plant would explain it"


def rounding_used(file: PrintedFile, P: np.ndarray, comparison: Comparison) -> float:
    """Return the least s for which rounding of the plant by s half units explains every digit.

    Each entry of the plant with decimals may change by up to s half units of its last digit. The
    effect is computed to first order. The result is inf if no such changes explain the digits.

    P: matrix of the exact value x'P x, (n, n)
    """
    from scipy.optimize import linprog

    columns = []
    for name, block in file.typed.items():
        for (row, column), rounding in np.ndenumerate(block.roundings):
            is_mirror = name in ("Q", "R") and column < row
            if rounding > 0.0 and not is_mirror:
                position = Position(name, int(row), int(column))
                columns.append(rounding * change(file, file.plant, P, position))
    if not columns:
        return float("inf")
    slopes = np.column_stack(columns) / comparison.allowed[:, None]
    misfit = (comparison.printed - comparison.exact) / comparison.allowed
    size = slopes.shape[1]
    last = np.zeros((len(misfit), 1))
    fits = np.vstack([np.hstack([slopes, last]), np.hstack([-slopes, last])])
    moved = np.vstack(
        [
            np.hstack([np.eye(size), -np.ones((size, 1))]),
            np.hstack([-np.eye(size), -np.ones((size, 1))]),
        ]
    )
    cost = np.zeros(size + 1)
    cost[-1] = 1.0
    solution = linprog(
        cost,
        A_ub=np.vstack([fits, moved]),
        b_ub=np.concatenate([1.0 + misfit, 1.0 - misfit, np.zeros(2 * size)]),
        bounds=[*((None, None) for _ in range(size)), (0.0, None)],
    )
    return float(solution.fun) if solution.success else float("inf")


def _is_cut_off(comparison: Comparison) -> bool:
    """Return whether each wrong entry is the exact value, truncated instead of rounded."""
    outside = comparison.outside
    exact = comparison.exact[outside]
    short = np.sign(exact) * (exact - comparison.printed[outside])
    return bool(((short >= 0.0) & (short < 2.0 * comparison.half_units[outside])).all())


def _asymmetric_block(file: PrintedFile) -> str:
    """Return the name of the first asymmetric matrix, "P" or "H", or "" if none is asymmetric."""
    names = ("H",) if file.learned else ("P", "H")
    for name in names:
        if name in file.answer:
            block = file.answer[name]
            allowed = block.half_units + block.half_units.T + 1e-12 * np.abs(block.values).max()
            differ = np.triu(np.abs(block.values - block.values.T) > allowed)
            if np.count_nonzero(differ) > 1:
                return name
    return ""


def _wrong_entry(file: PrintedFile, comparison: Comparison, wrong: Position) -> str:
    """Return a sentence with the printed and the exact value of a wrong entry."""
    outside = [comparison.positions[index] for index in np.flatnonzero(comparison.outside)]
    position = next(position for position in outside if position.block == wrong.block)
    index = comparison.positions.index(position)
    printed = file.answer[position.block].texts[position.row][position.column]
    exact = comparison.exact[index]
    unit = 2.0 * comparison.allowed[index] or 1e-12  # a formula of an answer that is 0 has none
    digits = math.ceil(math.log10(max(abs(exact) / unit, 1.0))) + 2
    return f"{position} is printed {printed}, exact {exact:.{digits}g}"


def _known_mistake(file: PrintedFile, P: np.ndarray, comparison: Comparison) -> str:
    """Return the known mistake that explains the printed answer, or ""."""
    question = fitting_time(file)
    if question:
        return question
    undone = {}
    for mistake, answer in _mistaken_answers(file, P):
        mistaken = compare_answer(file, answer)
        if not mistaken.outside.any():
            return mistake
        undone[mistake] = comparison.exact + mistaken.printed - mistaken.exact
    return _named_with_noise(comparison, undone) if file.learned else ""


def _named_with_noise(comparison: Comparison, undone: Mapping[str, np.ndarray]) -> str:
    """Return the mistake that explains most of the error of a learned answer, or "".

    The error is first measured relative to each entry, then to all entries. Each entry of at least
    a tenth of its typical size must agree within half of this size without the mistake.

    undone: mistake -> answer without it, (entries,)
    """
    printed, exact = comparison.printed, comparison.exact
    sizes = _sizes(comparison) * np.linalg.norm(exact / _sizes(comparison))
    relative = 1.0 / np.maximum(np.abs(exact), _SMALL * np.abs(exact).max())
    for weights in (relative, np.ones_like(exact)):
        before = min(relative_error(printed * weights, exact * weights), 1.0)
        allowed = before * (_LEFT if before > _SMALL_ERROR else _LEFT_OF_SMALL)
        left = {}
        for mistake, answer in undone.items():
            told = np.maximum(np.abs(answer), np.abs(exact)) > _TOLD * sizes
            error = relative_error(answer * weights, exact * weights)
            if error <= allowed and (np.abs(answer - exact) <= 0.5 * sizes)[told].all():
                left[mistake] = error
        for mistake, error in left.items():
            if error <= _AS_GOOD * min(left.values()):
                return f"{mistake}; an error of {error:.2g} is left"
    return ""


def _mistaken_answers(
    file: PrintedFile, P: np.ndarray
) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """Yield (known mistake, answer with this mistake)."""
    exact = answer_of(file.plant, P)
    for name in ("K", "L"):
        if name in file.answer:
            yield f"{name} has the opposite sign", exact | {name: -exact[name]}
    row, column = np.triu_indices(len(P))
    if "W" in file.answer:
        yield "W lacks the factor 2 on products", exact | {"W": P[row, column][None, :]}
        by_column = np.lexsort((row, column))
        yield "W is stored column by column", exact | {"W": exact["W"][:, by_column]}
        squares_first = np.argsort(row != column, kind="stable")
        yield "W is stored with the squares first", exact | {"W": exact["W"][:, squares_first]}
    for name in ("P", "K", "W", "H"):
        if name in file.answer:
            yield f"{name} is twice the value", exact | {name: 2.0 * exact[name]}
            yield f"{name} is half the value", exact | {name: 0.5 * exact[name]}
    if not_searched(file):
        return
    n = len(P)
    for first in range(n):
        for second in range(first):
            order = np.arange(n)
            order[[first, second]] = order[[second, first]]
            swapped = P[np.ix_(order, order)]
            answer = dict(exact)
            answer["P"] = swapped
            answer["K"] = exact["K"][:, order]
            answer["L"] = exact["L"][:, order]
            answer["W"] = np.where(row == column, 1.0, 2.0)[None, :] * swapped[row, column]
            yield f"states {second + 1} and {first + 1} are interchanged", answer


def _by_size(file: PrintedFile, comparison: Comparison) -> tuple[Class, str]:
    """Return the class "close", "cannot tell" or "wrong" by the relative error, and the reason."""
    error = comparison.relative_error
    size = f"relative error {error:.2g}, worst entry {comparison.errors.max():.3g} half units"
    if error > _FAR:
        return "cannot tell", f"the problem of the answer is not known; {size}"
    if file.learned:
        return "close", size
    if not_searched(file):
        return "wrong", size
    return "wrong", f"{size}; no single entry of the plant explains it"
