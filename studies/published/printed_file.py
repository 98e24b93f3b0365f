"""Reader of files with a printed answer.

Each number has a tolerance of half a unit of its last digit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from controller.critic.features import expressions
from hfa_support.errors import (
    BadInputError,
    file_faults,
    prefix_errors,
    refuse_unknown,
    refuse_unless_positive,
    shortened,
    shown,
)
from hfa_support.files import read_toml
from studies.published.exact_answer import Plant

TIMES = ("continuous", "discrete")
#: Keys of the file, of its plant and of its printed answer.
_KEYS = ("title", "source", "note", "time", "discount", "learned", "plant_rounded")
_PLANT = ("A", "B", "E", "N", "Q", "R", "gamma")
_MATRICES = ("P", "K", "L", "W", "H")
_ANSWER = (*_MATRICES, "K_sign", "L_sign", "basis", "scale")
#: Sign convention -> factor from K of u = -K x, or L of w = L x, to the printed gain.
_SIGNS = {
    "K_sign": {"u = -K x": 1.0, "u = K x": -1.0},
    "L_sign": {"w = L x": 1.0, "w = -L x": -1.0},
}
_DECIMAL = re.compile(
    r"[+-]?(\d+\.?(?P<decimals>\d*)|\.(?P<only>\d+))([eE](?P<exponent>[+-]?\d+))?"
)
#: Factor that MATLAB prints above a matrix.
_FACTOR = re.compile(r"1\.0+[eE](?P<exponent>[+-]\d+)")
#: Largest number of entries of "diag". No paper prints a larger matrix.
_LONGEST_DIAGONAL = 400
_FIRST_LINE = re.compile(rf"\s*({_FACTOR.pattern})\s*\*\s*\n")


@dataclass(frozen=True, eq=False)
class Block:
    """Printed matrix.

    texts: rows of numbers as in the file, including the exponent of a common factor
    values: values of the entries, (rows, columns)
    half_units: half a unit of the last digit of each entry, or 0 for a formula, (rows, columns)
    """

    texts: tuple[tuple[str, ...], ...]
    values: np.ndarray
    half_units: np.ndarray

    @property
    def roundings(self) -> np.ndarray:
        """Largest rounding error of each entry, (rows, columns): half a unit of its last digit.

        The rounding error of a number without decimals and of a formula is 0.
        """
        with_decimals = np.array([["." in text for text in row] for row in self.texts])
        return np.where(with_decimals, self.half_units, 0.0)


@dataclass(frozen=True, eq=False)
class PrintedFile:
    """Plant and its printed answer.

    title: title of the file
    source: place where the answer is printed, or ""
    note: notes for the reader, or ""
    plant: the plant in the file
    typed: name -> matrix of the plant, as printed
    answer: name -> printed matrix of P, K, L, W and H
    signs: name -> factor from the exact K or L to the printed sign convention
    learned: whether the answer results from learning or an iteration
    plant_rounded: whether the plant is printed with fewer digits than were used for the answer
    assumption: assumption on an incomplete plant, or "" if the plant is complete
    has_time: whether the file states continuous or discrete time. If not, `plant` has continuous
        time.
    """

    title: str
    source: str
    note: str
    plant: Plant
    typed: dict[str, Block]
    answer: dict[str, Block]
    signs: dict[str, float]
    learned: bool
    plant_rounded: bool
    assumption: str
    has_time: bool = True


def load_printed(path: Path) -> PrintedFile:
    """Return the plant and its printed answer from a TOML file.

    Raises BadInputError if the file cannot be read, for text that is not a number, for a wrong
    shape and for missing entries. The message on an entry names the matrix and the row.
    """
    with file_faults(path):
        content = read_toml(path)
    with prefix_errors(path):
        return _printed_file(content)


def read_block(
    name: str, text: Any, parameters: Mapping[str, float] | None = None, exponent: int = 0
) -> Block:
    r"""Return the matrix of the numbers in a text.

    Spaces, commas and & separate numbers. Line breaks, ; and \\ end rows. The first line may be a
    common factor, "1.0e+04 *". "diag 1 2" is a diagonal matrix.

    name: name of the matrix, for messages
    text: the text, or a whole number
    parameters: name -> value, for formulas such as m*g/l
    exponent: exponent of a power of ten that multiplies all numbers

    Raises BadInputError for text that is not a matrix of numbers.
    """
    if isinstance(text, int) and not isinstance(text, bool):
        text = str(text)
    if not isinstance(text, str):
        raise BadInputError(
            f"{name} is not text; write the numbers in quotes, with the printed digits"
        )
    factor = _FIRST_LINE.match(text)
    if factor is not None:
        text = text[factor.end() :]
        exponent += int(factor["exponent"])
    plain = re.sub(r"[\[\]]", " ", text.replace("\N{MINUS SIGN}", "-"))
    lines = [re.split(r"[\s,&]+", line.strip(" \t,&")) for line in re.split(r"[\n;\\]+", plain)]
    rows = [line for line in lines if line != [""]]
    if not rows:
        raise BadInputError(f"{name} is empty; give the printed numbers")
    first, *diagonal = [number for row in rows for number in row]
    if first == "diag":
        if len(diagonal) > _LONGEST_DIAGONAL:
            raise BadInputError(
                f"{name}: the diagonal after diag has {len(diagonal)} numbers; give at most "
                f"{_LONGEST_DIAGONAL}"
            )
        rows = [["0" for _ in diagonal] for _ in diagonal]
        for index, number in enumerate(diagonal):
            rows[index][index] = number
        if not rows:
            raise BadInputError(f"{name}: no numbers follow diag; give the diagonal entries")
    for index, row in enumerate(rows):
        if len(row) != len(rows[0]):
            raise BadInputError(
                f"{name}, row {index + 1}: the length is {len(row)}, but row 1 has length "
                f"{len(rows[0])}; give rows of equal length"
            )
    if exponent:
        rows = _multiplied(name, rows, exponent)
    numbers = []
    for index, row in enumerate(rows):
        with prefix_errors(f"{name}, row {index + 1}"):
            numbers.append([_number(word, parameters or {}) for word in row])
    table = np.array(numbers)
    return Block(tuple(map(tuple, rows)), table[:, :, 0], table[:, :, 1])


def _multiplied(name: str, rows: list[list[str]], exponent: int) -> list[list[str]]:
    """Return the rows of numbers times a power of ten, as text."""
    # A number "0" has as many decimals as the number with the most decimals.
    decimals = max(len(word.partition(".")[2]) for row in rows for word in row)
    multiplied = []
    for row in rows:
        for word in row:
            if not re.fullmatch(r"[+-]?\d*\.?\d*", word):
                raise BadInputError(
                    f"{name}: {shown(word)} is not a decimal number, as scale requires; write the "
                    "number without exponent or formula"
                )
        multiplied.append(
            [f"0e{exponent - decimals}" if word == "0" else f"{word}e{exponent}" for word in row]
        )
    return multiplied


def _value_of(text: str, parameters: Mapping[str, float]) -> float:
    """Return the value of a formula with named numbers, such as "m*g/l"."""
    symbols = {name: ca.SX(value) for name, value in parameters.items()}
    try:
        (formula,) = expressions(text, symbols, ", ".join(["numbers", *parameters]))
        value = float(ca.evalf(formula))
    except BadInputError:
        raise
    except Exception as error:
        raise BadInputError(
            f"{shortened(text)!r} is not a number or a formula of numbers; correct the entry"
        ) from error
    if not np.isfinite(value):
        raise BadInputError(
            f"the value of {shortened(text)!r} is {value}; give an entry with a finite value"
        )
    return value


def _number(word: str, parameters: Mapping[str, float]) -> tuple[float, float]:
    """Return the value of a number or formula, and half a unit of its last digit."""
    match = _DECIMAL.fullmatch(word)
    if match is None:
        lacks_space = not re.search(r"[*/(A-Za-z]", _DECIMAL.sub("", word))  # 0.1-0.2
        if lacks_space or re.search(r"(?<!\w)\d+[xXoObB_]", word):
            raise BadInputError(
                f"{shown(word)} is not a number; correct the digits, or separate "
                "two numbers by a space"
            )
        return _value_of(word, parameters), 0.0
    decimals = len(match["decimals"] or match["only"] or "")
    half = float(f"0.5e{int(match['exponent'] or 0) - decimals}")
    value = float(word)
    if not np.isfinite([value, half]).all():
        raise BadInputError(
            f"{shown(word)} exceeds the range of double precision; give a smaller exponent"
        )
    return value, half


def _printed_file(content: dict[str, Any]) -> PrintedFile:
    plant_texts = _table(content, "plant", _PLANT)
    answer_texts = _table(content, "printed", _ANSWER)
    for key in content:
        refuse_unknown("the file has no key", key, (*_KEYS, "parameters", "plant", "printed"))
    parameters = _parameters(content)
    time = content.get("time")
    if time is not None:
        refuse_unknown("time is", time, TIMES)
    typed = {name: read_block(name, text, parameters) for name, text in plant_texts.items()}
    for name in ("A", "B", "Q", "R"):
        if name not in typed:
            raise BadInputError(f"the plant has no {name}; add {name} to [plant]")
    assumption = _completed(typed, parameters)
    plant = _plant(typed, is_discrete=time == "discrete", discount=_discount(content))
    exponent = _exponent(answer_texts.get("scale", "1.0e+00"))
    answer = {
        name: read_block(name, answer_texts[name], parameters, exponent)
        for name in _MATRICES
        if name in answer_texts
    }
    if not answer:
        raise BadInputError("[printed] contains no matrix; give P, K, L, W or H")
    _check_answer(answer, answer_texts, plant)
    flags = {}
    for name in ("learned", "plant_rounded"):
        flags[name] = content.get(name, False)
        if not isinstance(flags[name], bool):
            raise BadInputError(f"{name} is {shown(flags[name])}; give true or false")
    signs = {"K": 1.0, "L": 1.0}
    for key, conventions in _SIGNS.items():
        convention = answer_texts.get(key, next(iter(conventions)))
        refuse_unknown(f"{key} is", convention, conventions)
        signs[key[0]] = conventions[convention]
    return PrintedFile(
        title=str(content.get("title", "printed answer")),
        source=str(content.get("source", "")),
        note=str(content.get("note", "")),
        plant=plant,
        typed=typed,
        answer=answer,
        signs=signs,
        learned=flags["learned"],
        plant_rounded=flags["plant_rounded"],
        assumption=assumption,
        has_time=time is not None,
    )


def _table(content: dict[str, Any], name: str, keys: tuple[str, ...]) -> dict[str, Any]:
    table = content.get(name)
    if not isinstance(table, dict):
        raise BadInputError(f"the table [{name}] is missing; add this table")
    for key in table:
        refuse_unknown(f"[{name}] has no", key, keys)
    return table


def _parameters(content: dict[str, Any]) -> dict[str, float]:
    """Return name -> value of the table [parameters], or {} if there is no such table."""
    if "parameters" not in content:
        return {}
    parameters: dict[str, float] = {}
    texts = content["parameters"]
    if not isinstance(texts, dict):
        raise BadInputError(
            'parameters is not a table; give [parameters] with lines such as g = "9.81"'
        )
    for name, text in texts.items():
        parameters[name] = _scalar(name, read_block(name, text, parameters))
    return parameters


def _exponent(scale: Any) -> int:
    """Return the exponent of a scale, a power of ten such as "1.0e+04"."""
    match = _FACTOR.fullmatch(str(scale))
    if match is None:
        raise BadInputError(f'scale is {shown(scale)}; give a power of ten such as "1.0e+04"')
    return int(match["exponent"])


def _discount(content: dict[str, Any]) -> float:
    if "discount" not in content:
        return 1.0
    if content.get("time") != "discrete":
        raise BadInputError(
            'discount applies only to discrete time; add time = "discrete", or remove discount'
        )
    return _scalar("discount", read_block("discount", content["discount"]))


def _scalar(name: str, block: Block) -> float:
    if block.values.shape != (1, 1):
        raise BadInputError(
            f"{name} is {block.values.shape[0]} x {block.values.shape[1]}; give one number"
        )
    return float(block.values[0, 0])


def _completed(typed: dict[str, Block], parameters: Mapping[str, float]) -> str:
    """Replace a single number for Q or R by a diagonal matrix with this number."""
    readings = []
    for name, size in (("Q", len(typed["A"].values)), ("R", typed["B"].values.shape[1])):
        block = typed[name]
        if block.values.size == 1 and size > 1:
            ((number,),) = block.texts
            typed[name] = read_block(name, " ".join(["diag", *([number] * size)]), parameters)
            readings.append(f"{name} is one number where {size} x {size} are needed")
    return "; ".join(readings)


def _plant(typed: dict[str, Block], *, is_discrete: bool, discount: float) -> Plant:
    n = len(typed["A"].values)
    m = typed["B"].values.shape[1]
    if ("E" in typed) != ("gamma" in typed):
        missing = "gamma" if "E" in typed else "E"
        raise BadInputError(f"the plant has no {missing}; give both E and gamma, or neither")
    shapes = {"A": (n, n), "B": (n, m), "N": (n, m), "Q": (n, n), "R": (m, m)}
    for name, (rows, columns) in shapes.items():
        if name in typed:
            _check_shape(name, typed[name], rows, columns)
    gamma = np.inf
    E = np.zeros((n, 0))
    if "E" in typed:
        E = typed["E"].values
        _check_shape("E", typed["E"], n, E.shape[1])
        gamma = _scalar("gamma", typed["gamma"])
        refuse_unless_positive("gamma", gamma)
    N = typed["N"].values if "N" in typed else np.zeros((n, m))
    return Plant(
        A=typed["A"].values,
        B=typed["B"].values,
        E=E,
        N=N,
        Q=typed["Q"].values,
        R=typed["R"].values,
        gamma=gamma,
        is_discrete=is_discrete,
        discount=discount,
    )


def _check_shape(name: str, block: Block, rows: int, columns: int) -> None:
    """Raise BadInputError if a matrix does not have the shape rows x columns."""
    actual_rows, actual_columns = block.values.shape
    if (actual_rows, actual_columns) == (rows, columns):
        return
    row = 1 if actual_columns != columns else min(actual_rows, rows) + 1
    raise BadInputError(
        f"{name}, row {row}: {name} is {actual_rows} x {actual_columns}; give {rows} x {columns}, "
        "as this plant requires"
    )


def _check_answer(answer: dict[str, Block], texts: dict[str, Any], plant: Plant) -> None:
    n, m = plant.B.shape
    k = plant.E.shape[1]
    size = n + m + k
    if "H" in answer and not plant.is_discrete:
        raise BadInputError('H applies only to discrete time; add time = "discrete", or remove H')
    if "L" in answer and not k:
        raise BadInputError(
            "L is given, but the plant has no E and gamma; add E and gamma to [plant]"
        )
    shapes = {"P": (n, n), "K": (m, n), "L": (k, n), "H": (size, size)}
    for name, block in answer.items():
        if name == "W":
            refuse_unknown("basis is", texts.get("basis", "quadratic"), ("quadratic",))
            if block.values.size != n * (n + 1) // 2:
                raise BadInputError(
                    f"W, row 1: W has {block.values.size} numbers; give {n * (n + 1) // 2}, one "
                    f"for each function of the quadratic basis of {n} states"
                )
        else:
            _check_shape(name, block, *shapes[name])
