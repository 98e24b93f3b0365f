"""Files of trim conditions: a row for each condition, with its name, values, free variables and
limits."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from hfa.options.argument_types import option_errors, quantity, span
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, choice_of, prefix_errors, shown
from hfa_support.files import regular_file
from hfa_support.units import split_unit
from trim.point.status import FREE, HELD, LIMIT, NAME, RESULTS

#: What separates names in a cell.
_SEPARATORS = re.compile(r"[;\s]+")


class ListedCondition(NamedTuple):
    """Row of a file of conditions, in the units of the model.

    name: name of the condition, or ""
    values: variable, rate or parameter -> value; parameters come last
    free: variables that are set free
    limits: variable -> (lowest, highest)
    where: file, row and name, for messages, or ""
    """

    name: str
    values: Mapping[str, float]
    free: tuple[str, ...]
    limits: Mapping[str, tuple[float, float]]
    where: str = ""


def listed_conditions(path: str | Path, model: Model) -> list[ListedCondition]:
    """Return the rows of a CSV file of conditions.

    The first row has names of variables, rates and parameters, each with a unit if it is not that
    of the model or deg: "gamma", "altitude [FL]", "kcas [KT]". A cell may have a unit of its own. A
    blank cell imposes nothing. The column `name` has names of conditions, `free` the variables that
    are set free, `limit` limits NAME=LOW:HIGH, several separated by blanks or semicolons. A column
    `results` and those behind it are not read. Lines that begin with # are comments.

    path: the file
    model: model of the aircraft

    Raises BadInputError with the row, the column and the name of the condition for a wrong cell.
    """
    path = Path(path)
    header_row, titles, rows = _table_of(path)
    columns = [_Column.of(title, model) for title in titles]
    names = [column.name for column in columns]
    if repeated := [name for name in names if names.count(name) > 1]:
        raise BadInputError(f"{path}: row {header_row} has {repeated[0]} twice; remove one column")
    listed: list[ListedCondition] = []
    number_of: dict[str, int] = {}  # name of a condition -> number of its row
    for number, cells in rows:
        row = dict(zip(names, cells, strict=True))
        name = row.get(NAME, "")
        if name in number_of:
            raise BadInputError(
                f"{path}: row {number} has the name of row {number_of[name]}, {shown(name)}; "
                "rename one"
            )
        if not listed:  # the cells of the first row tell whether an unknown column has labels
            for column in columns:
                column.refuse_unknown(f"{path}: row {header_row}", model, row[column.name])
        if name:
            number_of[name] = number
        in_brackets = f" ({name})" if name else ""
        listed.append(_condition(f"{path}: row {number}{in_brackets}", model, columns, row))
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


class _Table(NamedTuple):
    """Table in a file of conditions, without the columns from `results` on, and without those that
    have neither a name nor a cell.

    header_row: number of the row of headings in the file
    titles: the headings
    rows: number of a row in the file, and its cells, without outer blanks
    """

    header_row: int
    titles: list[str]
    rows: list[tuple[int, list[str]]]


def _table_of(path: Path) -> _Table:
    """Return the table in a file of conditions."""
    try:
        lines = regular_file(path).read_text("utf-8-sig").splitlines()
        numbered = [
            (number, row)
            for number, row in enumerate(csv.reader(lines), start=1)
            if any(cell.strip() for cell in row) and not row[0].strip().startswith("#")
        ]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadInputError(
            f"{path} cannot be read ({reason}); give a readable CSV file of conditions"
        ) from error
    if len(numbered) < 2:
        raise BadInputError(
            f"{path} has no conditions; give a row of names, then a row of values for each one"
        )
    (header_row, titles), *rows = numbered
    for separator, word in ((";", "semicolon"), ("\t", "tab")):
        if any(separator in title for title in titles):
            raise BadInputError(
                f"{path}: row {header_row} contains a {word}; separate the columns by commas, and "
                "write numbers with a decimal point"
            )
    headings = [title.strip() for title in titles]
    # The columns from `results` on are not read.
    end = headings.index(RESULTS) if RESULTS in headings else len(headings)
    named = [place for place in range(end) if headings[place]]
    for number, row in rows:
        if len(row) < end:
            raise BadInputError(
                f"{path}: row {number} has {len(row)} cells, but row {header_row} has "
                f"{len(headings)}; correct the row"
            )
        for place, cell in enumerate(row):
            if cell.strip() and not (headings[place] if place < len(headings) else ""):
                raise BadInputError(
                    f"{path}: row {number}, column {place + 1} has {shown(cell.strip())}, but row "
                    f"{header_row} has no name there; name the column, or clear the cell"
                )
    kept = [(number, [row[place].strip() for place in named]) for number, row in rows]
    return _Table(header_row, [headings[place] for place in named], kept)


class _Column(NamedTuple):
    """Column of a file of conditions.

    title: its heading
    name: name of a variable, rate or parameter of the model, or `NAME`, `FREE`, `LIMIT`
    unit: unit in the heading, or ""
    """

    title: str
    name: str
    unit: str

    @classmethod
    def of(cls, title: str, model: Model) -> _Column:
        """Return the column with a heading such as "gamma", "KCAS [kt]" or "c.g. [%]"."""
        typed, _, unit = (part.strip() for part in title.removesuffix("]").partition("["))
        typed = typed.removeprefix(f"{HELD} ")  # of a file that `hfa trim` has written
        if unit.lower() in model.airspeeds:  # "speed [KCAS]"
            return cls(title, unit.lower(), "")
        return cls(title, _name_of(model, typed), unit)

    def refuse_unknown(self, where: str, model: Model, cell: str) -> None:
        """Raise BadInputError if the model has no variable of this name.

        The message says whether the unit lacks its brackets, or the column contains labels.

        where: file and row of the headings, for the message
        cell: first cell of the column
        """
        if self.name in (NAME, FREE, LIMIT):
            return
        known = _imposable(model)
        parts = re.fullmatch(r"(\w+)[\s(]+([^()]+)\)?", self.title)  # "speed kt", "speed (kt)"
        if parts and not self.unit and model.about.name_of(parts[1]) in known:
            title = shown(self.title)
            raise BadInputError(f"{where}: {title} has no brackets; write {parts[1]} [{parts[2]}]")
        is_number = re.match(r"[-+=.\d]|FL\s*\d", cell)  # or a formula, or a flight level
        if cell and self.name not in known and not is_number:
            raise BadInputError(
                f"{where}: the column {shown(self.title)} has labels ({shown(cell)}), which are "
                f"not read; remove it, or call it {NAME}"
            )
        with prefix_errors(where):
            model.refuse_unheld("the column is unknown:", self.name, tuple(model.parameters))

    def text(self, cell: str) -> str:
        """Return the text of a cell with its unit, or that of the column: "250 kt", "FL100".

        Commas may separate thousands: "20,000 ft".

        Raises BadInputError for a formula, whose value only a spreadsheet knows.
        """
        if cell.startswith("="):
            raise BadInputError(f"is the formula {shown(cell)}; write its value")
        if re.match(r"[-+]?\d{1,3}(,\d{3})+(?!\d)", cell):
            cell = cell.replace(",", "")
        if split_unit(cell)[1]:
            return cell
        return f"FL{cell}" if self.unit.upper() == "FL" else f"{cell} {self.unit}".strip()


def _imposable(model: Model) -> set[str]:
    """Return the names of what a condition may impose."""
    return {*model.holdable, *model.rates, *model.parameters}


def _name_of(model: Model, typed: str) -> str:
    """Return the name of a variable or column, also if typed in capitals, with points or blanks.

    "C.G." is "cg". An unknown word is returned unchanged.
    """
    name = model.about.name_of(typed)  # an alias is replaced
    respelled = model.about.name_of(re.sub(r"\W+", "_", name.replace(".", "")).lower())
    if name in _imposable(model):
        return name
    return respelled if respelled in {*_imposable(model), NAME, FREE, LIMIT} else name


def _condition(
    where: str, model: Model, columns: Sequence[_Column], row: Mapping[str, str]
) -> ListedCondition:
    """Return the condition of a row.

    where: file, row and name, for messages
    row: name of the column -> cell
    """
    values = {}
    for column in columns:
        cell = row[column.name]
        if not cell or column.name in (NAME, FREE, LIMIT):
            continue
        with option_errors(f"{where}, column {column.name}"):
            values[column.name] = quantity(model, column.name, column.text(cell))
    free = tuple(_name_of(model, name) for name in _words(row.get(FREE, "")))
    for name in free:
        if name in values:
            raise BadInputError(f"{where}: {name} is both free and held; clear one of its cells")
        with option_errors(f"{where}, column {FREE} has"):
            model.refuse_unheld("the unknown variable", name, tuple(model.parameters))
    # Reports name the values in this order: the flight condition, then the parameters.
    parameters_last = dict(sorted(values.items(), key=lambda entry: entry[0] in model.parameters))
    limits = _limits(where, model, row.get(LIMIT, ""))
    return ListedCondition(row.get(NAME, ""), parameters_last, free, limits, where)


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
