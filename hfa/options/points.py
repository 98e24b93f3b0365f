"""Points at which trims are computed: a grid of the values of options, or a file of conditions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from hfa.options.argument_types import Range, array_of
from hfa.options.conditions import ListedCondition
from hfa.options.parser import option
from hfa.options.trims import SeveralTrims, TrimInput
from hfa_support.errors import BadInputError
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
        "a .csv file of conditions, in place of a grid: names, then a row of values each", "FILE"
    )


class GivenPoints(NamedTuple):
    """The points of a request, in the units of the model.

    trims: what the options say about the trims
    constants: variable or parameter -> its single value of --hold, for a list without axes also of
        --at; the values of an axis take precedence
    axes: variable or parameter -> its values; parameters, the variable of --at, and alternatives to
        an axis, such as a speed to a Mach number, are axes even if they are constant
    listed: whether the axes are the columns of a list, otherwise the points are all combinations. A
        list whose rows have different columns has no axes, and only `conditions`.
    """

    trims: TrimInput
    constants: Mapping[str, float]
    axes: Mapping[str, Range]
    listed: bool

    def condition(self) -> TrimCondition:
        """Return the condition of all points, without the values of the axes.

        Raises BadInputError if --free gives an axis.
        """
        for name in self.axes:
            if name in self.trims.free:
                raise BadInputError(f"{name} is free and swept; remove --free {name} or its values")
        return self.trims.common_condition(self.constants)

    def source(self) -> dict[str, Any]:
        """Return the entries of the provenance on all points."""
        return self.trims.source(self.condition(), self.constants)

    def conditions(self, most: int) -> Iterator[ListedCondition]:
        """Yield the condition of each point, those of a grid with the last axis varying fastest.

        Raises BadInputError for more than `most` points.
        """
        rows = self.trims.rows
        size = len(rows) if rows else math.prod(len(values) for values in self.axes.values())
        if size > most:
            raise BadInputError(f"{size:,} points are asked for (maximum {most}); give fewer")
        if rows:
            yield from rows
            return
        columns = [array_of(name, values, most).tolist() for name, values in self.axes.items()]
        for point in product(*columns):
            values = {**self.constants, **dict(zip(self.axes, point, strict=True))}
            yield ListedCondition("", values, (), {})


def given_points(request: PointOptions, given: TrimInput) -> GivenPoints:
    """Return the points of the options --at, --hold and --conditions.

    given: what the options say about trims

    Raises BadInputError for a variable that two of them give.
    """
    model, rows = given.model, given.rows
    of_options = given.hold if given.at is None else {model.schedule: given.at, **given.hold}
    for row in rows:
        given.for_row(row)  # raises where an option gives the same variable
    several = [name for name, values in of_options.items() if len(values) > 1]
    if rows and several:
        raise BadInputError(
            f"give {several[0]} either as a column of {request.conditions} or by an option with "
            "one value"
        )
    constants = {name: values[0] for name, values in given.hold.items() if len(values) == 1}
    columns: dict[str, Range] = {}  # of a file of conditions
    if rows:
        names = [*rows[0].values]
        is_mixed = any(row.free or row.limits or {*row.values} != {*names} for row in rows)
        if is_mixed or not names:  # the rows have no common columns of numbers, and so no axes
            if given.at is not None:  # it has one value, as several are refused above
                constants[model.schedule] = given.at[0]
            return GivenPoints(given, constants, {}, listed=True)
        columns = {name: tuple(row.values[name] for row in rows) for name in names}

    # A constant is an axis, too, if the condition common to all points cannot state it: an
    # alternative to a swept variable, such as a speed to a Mach number, would be replaced by this
    # variable, and a parameter is no part of a condition.
    swept = {*of_options, *columns} - {*constants}
    alternatives = {name for group in model.alternatives if swept & {*group} for name in group}
    axis_names = {*swept, *alternatives, *model.parameters}
    axes = {name: values for name, values in of_options.items() if name in axis_names}
    if rows:
        repeated = {name: (values[0],) * len(rows) for name, values in axes.items()}
        return GivenPoints(given, constants, columns | repeated, listed=True)
    # Figures of a sweep have a line along the last axis: axes with a single value come first.
    single_first = dict(sorted(axes.items(), key=lambda axis: len(axis[1]) > 1))
    return GivenPoints(given, constants, single_first, listed=False)
