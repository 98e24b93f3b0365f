"""Points at which trims are computed: a grid of the values of options, or a file of conditions."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa.options.argument_types import quantity
from hfa.options.option import option
from hfa.options.ranges import Range, array_of
from hfa.options.trims import SeveralTrims, TrimInput, trim_input
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, prefix_errors, shown
from hfa_support.files import regular_file
from trim.point.condition import TrimCondition


@dataclass(frozen=True, kw_only=True, eq=False)
class PointOptions(SeveralTrims):
    """The conditions of trims: a grid, or the rows of a file."""

    hold: Mapping[str, str] = option(
        "hold a variable or parameter at a value, a list or a range; repeatable",
        "NAME=RANGE",
        named=True,
    )
    conditions: Path | None = option(
        "a .csv file of conditions in place of a grid: a row of names, rows of values (degrees)",
        "FILE",
    )


class GivenPoints(NamedTuple):
    """The points of a request, in the units of the model.

    trims: what the options say about the trims
    constants: variable or parameter -> value of --hold, if it is the same at all points
    axes: variable or parameter -> its values; parameters, the variable of --at, and constants that
        an axis would replace are axes
    listed: whether the axes are the columns of a list, otherwise the points are all combinations
    """

    trims: TrimInput
    constants: Mapping[str, float]
    axes: Mapping[str, Range]
    listed: bool

    @property
    def size(self) -> int:
        """Number of points."""
        lengths = [len(values) for values in self.axes.values()]
        return lengths[0] if self.listed else math.prod(lengths)

    def condition(self) -> TrimCondition:
        """Return the condition of all points, without the values of the axes.

        Raises BadInputError if --free gives an axis.
        """
        for name in self.axes:
            if name in self.trims.free:
                raise BadInputError(f"{name} is free and swept; remove --free {name} or its values")
        return self.trims.common(self.constants)

    def source(self) -> dict[str, Any]:
        """Return the entries of the provenance on all points."""
        parameters = self.trims.parameters(self.constants)
        return self.trims.source(self.condition(), parameters)

    def rows(self, most: int) -> Iterator[dict[str, float]]:
        """Yield variable or parameter -> value of each point. The last axis varies fastest.

        Raises BadInputError for more than `most` points.
        """
        if self.size > most:
            raise BadInputError(f"{self.size:,} points are asked for (maximum {most}); give fewer")
        columns = [array_of(name, each, most).tolist() for name, each in self.axes.items()]
        points = zip(*columns, strict=True) if self.listed else product(*columns)
        for point in points:
            yield {**self.constants, **dict(zip(self.axes, point, strict=True))}


def given_points(request: PointOptions) -> GivenPoints:
    """Return the points of the options --at, --hold and --conditions.

    Raises BadInputError for a variable that two of them give, and as `listed_points` does.
    """
    given = trim_input(request)
    model = given.model
    listing = request.conditions
    values = given.hold if given.at is None else {model.schedule: given.at, **given.hold}
    columns = {} if listing is None else listed_points(listing, model)
    for name, each in values.items():
        if name in columns or (columns and len(each) > 1):
            raise BadInputError(
                f"give {name} either as a column of {listing} or by an option with one value"
            )
    constants = {name: each[0] for name, each in given.hold.items() if len(each) == 1}
    others = {name for name in (*values, *columns) if name not in constants}
    # An axis would replace a constant of its group, such as the speed the Mach number.
    beside_axes = {
        name for group in model.alternatives if others.intersection(group) for name in group
    }
    varied = {*others, *beside_axes, *model.parameters}
    axes: dict[str, Range] = {name: each for name, each in values.items() if name in varied}
    if not columns:
        single_first = dict(sorted(axes.items(), key=lambda axis: len(axis[1]) > 1))
        return GivenPoints(given, constants, single_first, listed=False)
    count = len(next(iter(columns.values())))
    repeated = {name: (each[0],) * count for name, each in axes.items()}
    return GivenPoints(given, constants, columns | repeated, listed=True)


def listed_points(path: Path, model: Model) -> dict[str, tuple[float, ...]]:
    """Return name -> value at each point, from a CSV file of trim points. A column may have a unit
    in its heading, "gamma [deg]" or "altitude [FL]". Lines that begin with # are comments.
    """
    try:
        lines = regular_file(path).read_text("utf-8-sig").splitlines()
        numbered_rows = [
            (number, row)
            for number, row in enumerate(csv.reader(lines), start=1)
            if any(cell.strip() for cell in row) and not row[0].strip().startswith("#")
        ]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInputError(
            f"{path} cannot be read ({error}); give a readable CSV file of conditions"
        ) from error
    header, title_row = numbered_rows[0] if numbered_rows else (1, [])
    for separator, word in ((";", "semicolon"), ("\t", "tab")):
        if any(separator in title for title in title_row):
            raise BadInputError(
                f"{path}: row {header} contains a {word}; separate the columns by commas, and "
                "write numbers with a decimal point"
            )
    headings = [name.strip().removesuffix("]").partition(" [") for name in title_row]
    names = [model.about.name_of(name) for name, _, _ in headings]
    point_rows = numbered_rows[1:]
    if not point_rows or len({*names}) < len(names):
        raise BadInputError(
            f"{path}: row {header} contains a name twice, or no values follow; give a row of "
            "different names, then a row of values for each point"
        )
    for number, row in point_rows:
        if len(row) != len(names):
            raise BadInputError(
                f"{path}: row {number} has {len(row)} cells, but row {header} has {len(names)}; "
                "correct the row"
            )
    for name, cell in zip(names, point_rows[0][1], strict=True):
        with prefix_errors(f"{path}: row {header}"):
            _refuse_heading(model, name, cell.strip())
    table = np.empty((len(point_rows), len(names)))
    for index, (number, row) in enumerate(point_rows):
        for column, ((_, _, unit), name, text) in enumerate(zip(headings, names, row, strict=True)):
            try:
                table[index, column] = quantity(model, name, _with_unit(text.strip(), unit))
            except BadInputError as error:
                raise BadInputError(f"{path}: row {number}, column {name} {error}") from error
    return {name: tuple(values.tolist()) for name, values in zip(names, table.T, strict=True)}


def _refuse_heading(model: Model, name: str, cell: str) -> None:
    """Raise BadInputError for an unknown column, which may have labels, or a unit without brackets.

    cell: text below the heading
    """
    known = (*model.holdable, *model.rates, *model.parameters)
    found = re.fullmatch(r"(\w+)[\s(]+([^()]+)\)?", name)
    if found and model.about.name_of(found[1]) in known:
        raise BadInputError(f"{shown(name)} has no brackets; write {found[1]} [{found[2]}]")
    if cell and name not in known and not re.match(r"[-+.\d]|FL\s*\d", cell):
        raise BadInputError(
            f"the column {shown(name)} has labels ({shown(cell)}), which are not read; remove it"
        )
    model.refuse_unheld("the column is unknown:", name, tuple(model.parameters))


def _with_unit(text: str, unit: str) -> str:
    """Return the text of a cell with the unit of its column: "250 kt", "FL100"."""
    return f"FL{text}" if unit.upper() == "FL" else f"{text} {unit}".strip()
