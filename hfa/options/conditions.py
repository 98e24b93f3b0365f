"""Files of trim conditions: a row for each condition, with its name, values, free variables and
limits."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from hfa.options.argument_types import one_of, option_errors, quantity, span
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, choice_of, prefix_errors, shown, warn
from hfa_support.units import STANDARD_GRAVITY, conversion_factor, split_unit
from trim.point.status import CATEGORY, CLASS, FREE, HELD, LIMIT, NAME, RESULTS
from trim.reports.levels import CATEGORIES, CLASSES, Airplane

if TYPE_CHECKING:
    from hfa_support.arrays.columns import Column

#: Columns of texts.
_TEXTS = (NAME, FREE, LIMIT, CLASS, CATEGORY)
#: What separates names in a cell.
_SEPARATORS = re.compile(r"[;\s]+")


class ListedCondition(NamedTuple):
    """Row of a file of conditions, in the units of the model.

    name: name of the condition, or ""
    values: variable, rate or parameter -> value; parameters come last
    free: variables that are set free
    limits: variable -> (lowest, highest)
    where: file, row and name, for messages, or ""
    in_degrees: angles without a unit, other than 0, which are read in degrees
    class_, category: airplane class and flight phase category of MIL-F-8785C, or ""
    """

    name: str
    values: Mapping[str, float]
    free: tuple[str, ...]
    limits: Mapping[str, tuple[float, float]]
    where: str = ""
    in_degrees: tuple[str, ...] = ()
    class_: str = ""
    category: str = ""

    def airplane(self, class_: str, category: str) -> Airplane:
        """Return class and category of the condition, with these where it states none."""
        return Airplane(self.class_ or class_, self.category or category)


_ROMAN = {"1": "i", "2": "ii", "3": "iii", "4": "iv"}


def airplane_class(text: str) -> str:
    """Return the class of an airplane, typed as "iii", "III" or "3": "III"."""
    number, dash, letter = text.partition("-")  # "2-C" is II-C, of airplanes on carriers
    word = f"{_ROMAN.get(number, number)}{dash}{letter}"
    if word.lower() == "ii":
        word = "ii-l"  # on land
    return one_of(*(name.lower() for name in CLASSES))(word).upper()


def flight_category(text: str) -> str:
    """Return the flight phase category, in upper case."""
    return one_of(*(name.lower() for name in CATEGORIES))(text).upper()


def listed_conditions(path: str | Path, model: Model) -> list[ListedCondition]:
    """Return the rows of a table of conditions, in a CSV file or any that `read_source` reads.

    The first row has names of variables, rates and parameters, each with a unit if it is not that
    of the model or deg: "gamma", "altitude [FL]", "kcas [KT]". A cell may have a unit of its own. A
    blank cell imposes nothing. The column `name` has names of conditions, `free` the variables that
    are set free, `limit` limits NAME=LOW:HIGH, several separated by blanks or semicolons, `class`
    and `category` those of MIL-F-8785C. A weight sets the parameter `mass`, if there is one. A
    column `results` and those behind it are not read. Lines that begin with # are comments.

    path: the file
    model: model of the aircraft

    Raises BadInputError with the row, the column and the name of the condition for a wrong cell.
    """
    from hfa_support.arrays.columns import matched  # not for every trim
    from hfa_support.arrays.tables import read_source

    given = takewhile(lambda column: column.name != RESULTS, read_source(path).columns)
    columns = [_named(column, model) for column in given]
    names = dict.fromkeys(_TEXTS, "") | {
        name: model.signals[name].unit if name in model.signals else ""
        for name in _imposable(model)
    }
    by_name = matched(columns, names)
    for name in [name for name in by_name if name not in names]:
        with prefix_errors(by_name[name].heading):
            model.refuse_unheld("the column is unknown:", name, tuple(model.parameters))
    numbers = columns[0].rows if columns else ()
    if not numbers:
        raise BadInputError(
            f"{path} has no conditions; give a row of names, then a row of values for each one"
        )
    listed: list[ListedCondition] = []
    number_of: dict[str, int] = {}  # name of a condition -> number of its row
    for place, number in enumerate(numbers):
        row = {name: _text(column, place) for name, column in by_name.items()}
        name = row.get(NAME, "")
        if name in number_of:
            raise BadInputError(
                f"{path}: row {number} has the name of row {number_of[name]}, {shown(name)}; "
                "rename one"
            )
        if name:
            number_of[name] = number
        in_brackets = f" ({name})" if name else ""
        listed.append(_condition(f"{path}: row {number}{in_brackets}", model, by_name, row))
    if in_degrees := dict.fromkeys(name for row in listed for name in row.in_degrees):
        warn(f"{path}: {', '.join(in_degrees)} without a unit, read in degrees")
    return listed


def chosen_row(rows: Sequence[ListedCondition], name: str, path: Path) -> ListedCondition:
    """Return the condition with a name.

    Raises BadInputError if none has it.
    """
    for row in rows:
        if row.name == name:
            return row
    known = [row.name for row in rows if row.name]
    choice = choice_of(name, known) if known else "add a column name"
    raise BadInputError(f"{path} has no condition {shown(name)}; {choice}")


def _named(column: Column, model: Model) -> Column:
    """Return a column under the name that the model has for it, such as kcas for "speed [KCAS]"."""
    airspeed = (column.unit or "").lower()
    if airspeed in model.airspeeds:
        return column._replace(name=airspeed, unit="")
    typed = column.name.removeprefix(f"{HELD} ")  # of a file that `hfa trim` has written
    return column._replace(name=_name_of(model, typed))


def _text(column: Column, place: int) -> str:
    """Return a cell of a column as text, "" for an empty one or for nan."""
    cell = column.cells[place]
    return "" if cell != cell else str(cell)


def _with_unit(cell: str, unit: str) -> str:
    """Return the text of a cell with its unit, or that of the column: "250 kt", "FL100".

    Raises BadInputError for a formula, whose value only a spreadsheet knows.
    """
    if cell.startswith("="):
        raise BadInputError(f"is the formula {shown(cell)}; write its value")
    if split_unit(cell)[1]:
        return cell
    return f"FL{cell}" if unit.upper() == "FL" else f"{cell} {unit}".strip()


def _imposable(model: Model) -> set[str]:
    """Return the names of what a condition may impose."""
    return {*model.holdable, *model.rates, *model.parameters}


def _name_of(model: Model, typed: str) -> str:
    """Return the name of a variable or column, also if typed in capitals, with points or blanks.

    "C.G." is "cg". An unknown word is returned unchanged.
    """
    from hfa_support.arrays.columns import plain_name

    name = model.about.name_of(typed)  # an alias is replaced
    respelled = model.about.name_of(plain_name(name))
    is_known = name in _imposable(model) or respelled not in {*_imposable(model), *_TEXTS}
    return name if is_known else respelled


def _condition(
    where: str, model: Model, columns: Mapping[str, Column], row: Mapping[str, str]
) -> ListedCondition:
    """Return the condition of a row.

    where: file, row and name, for messages
    row: name of the column -> cell
    """
    values, in_degrees = {}, []
    for name, cell in row.items():
        if not cell or name in _TEXTS:
            continue
        with option_errors(f"{where}, column {name}"):
            text = _with_unit(cell, columns[name].unit or "")
            values[name] = quantity(model, name, text)
        if not split_unit(text)[1] and values[name] != float(text):
            in_degrees.append(name)
    if "weight" in values and "mass" in model.parameters:
        if "mass" in values:
            raise BadInputError(f"{where}: weight and mass are one; clear one of the cells")
        newtons = values.pop("weight") * (conversion_factor(model.unit("weight"), "N") or math.nan)
        per_kg = conversion_factor("kg", model.unit("mass")) or math.nan
        values["mass"] = newtons / STANDARD_GRAVITY * per_kg
    airplane = []
    for name, kind in ((CLASS, airplane_class), (CATEGORY, flight_category)):
        with option_errors(f"{where}, column {name}"):
            airplane.append(kind(row[name]) if row.get(name) else "")
    free = tuple(_name_of(model, name) for name in _words(row.get(FREE, "")))
    for name in free:
        if name in values:
            raise BadInputError(f"{where}: {name} is both free and held; clear one of its cells")
        with option_errors(f"{where}, column {FREE} has"):
            model.refuse_unheld("the unknown variable", name, tuple(model.parameters))
    # Reports name the values in this order: the flight condition, then the parameters.
    parameters_last = dict(sorted(values.items(), key=lambda entry: entry[0] in model.parameters))
    limits = _limits(where, model, row.get(LIMIT, ""))
    return ListedCondition(
        row.get(NAME, ""), parameters_last, free, limits, where, tuple(in_degrees), *airplane
    )


def _limits(where: str, model: Model, text: str) -> dict[str, tuple[float, float]]:
    """Return variable -> (lowest, highest), of a cell "elevator=-10:10 thrust=0:500"."""
    limits = {}
    for word in _words(text):
        typed, equals, ends = word.partition("=")
        name = _name_of(model, typed)
        with option_errors(f"{where}, column {LIMIT}"):
            if not equals or name not in model.limits:
                raise BadInputError(f"is {shown(word)}; give NAME=LOW:HIGH of a variable")
            limits[name] = span(model, name, ends)
    return limits


def _words(text: str) -> Iterator[str]:
    """Yield the words of a cell."""
    return (word for word in _SEPARATORS.split(text.replace(",", " ")) if word)
