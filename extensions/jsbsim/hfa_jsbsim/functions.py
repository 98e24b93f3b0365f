"""Expressions of properties in <function> and <table> (`FGFunction`, `FGTable`)."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import reduce
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.rigid.tables import lines_of_cells
from hfa_jsbsim.properties import Properties, canonical
from hfa_jsbsim.xml_file import Element
from hfa_support.errors import shortened


def _sum(*values: Any) -> Any:
    return reduce(lambda one, other: one + other, values)


def _product(*values: Any) -> Any:
    return reduce(lambda one, other: one * other, values)


def _difference(first: Any, *values: Any) -> Any:
    """Return the first value minus all others."""
    return reduce(lambda one, other: one - other, values, first)


def _integer(value: Any) -> Any:
    """Return a value rounded toward 0."""
    return ca.if_else(value < 0, ca.ceil(value), ca.floor(value))


def _where_positive(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a logarithm that is minus infinity where the argument is not positive."""

    def value(argument: Any) -> Any:
        is_positive = argument > 0.0  # elsewhere the argument is 1: if_else evaluates both values
        return ca.if_else(is_positive, function(ca.if_else(is_positive, argument, 1.0)), -math.inf)

    return value


def _sqrt(argument: Any) -> Any:
    """Return the square root, minus infinity for a negative argument, as in JSBSim."""
    return ca.if_else(argument >= 0.0, ca.sqrt(ca.fabs(argument)), -math.inf)


def _unless_zero(function: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return a function of two arguments that is infinite if the second is 0, as in JSBSim."""

    def value(one: Any, other: Any) -> Any:
        is_zero = other == 0.0  # then the second is 1: if_else evaluates both values
        return ca.if_else(is_zero, math.inf, function(one, ca.if_else(is_zero, 1.0, other)))

    return value


def _is_true(value: Any) -> Any:
    """Return whether JSBSim considers a value as true: a magnitude of at least 1e-9."""
    return ca.fabs(value) >= _SMALLEST_TRUE


def _pow(base: Any, exponent: Any) -> Any:
    """Return a power; 0 to a varying power is 0, 1 or infinite, without a derivative."""
    if exponent.is_constant():
        return base**exponent
    of_zero = ca.if_else(exponent > 0.0, 0.0, ca.if_else(exponent < 0.0, math.inf, 1.0))
    is_zero = base == 0.0  # then the base is 1: if_else evaluates both values
    return ca.if_else(is_zero, of_zero, ca.if_else(is_zero, 1.0, base) ** exponent)


def _truth(compare: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return the function of two arguments that is 1 if their comparison is true, and else 0."""
    return lambda one, other: ca.if_else(compare(one, other), 1.0, 0.0)


def _all_true(*values: Any) -> Any:
    """Return 1 if JSBSim considers all values as true, else 0."""
    return reduce(ca.fmin, [ca.if_else(_is_true(value), 1.0, 0.0) for value in values])


def _any_true(*values: Any) -> Any:
    """Return 1 if JSBSim considers at least one value as true, else 0."""
    return reduce(ca.fmax, [ca.if_else(_is_true(value), 1.0, 0.0) for value in values])


#: Smallest magnitude that is true in a condition.
_SMALLEST_TRUE = 1e-9
#: A number in the data of a table.
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
#: Largest number of arguments of an operation without a limit.
_ANY_NUMBER = 9999
#: Operation -> its function, and the least and greatest number of arguments.
_OPERATIONS: dict[str, tuple[Callable[..., Any], int, int]] = {
    "sum": (_sum, 1, _ANY_NUMBER),
    "product": (_product, 1, _ANY_NUMBER),
    "difference": (_difference, 1, _ANY_NUMBER),
    "avg": (lambda *values: _sum(*values) / len(values), 1, _ANY_NUMBER),
    "min": (lambda *values: reduce(ca.fmin, values), 1, _ANY_NUMBER),
    "max": (lambda *values: reduce(ca.fmax, values), 1, _ANY_NUMBER),
    "quotient": (_unless_zero(lambda one, other: one / other), 2, 2),
    "pow": (_pow, 2, 2),
    "fmod": (_unless_zero(ca.fmod), 2, 2),
    "mod": (lambda one, other: ca.fmod(_integer(one), _integer(other)), 2, 2),
    "atan2": (ca.atan2, 2, 2),
    "abs": (ca.fabs, 1, 1),
    "sin": (ca.sin, 1, 1),
    "cos": (ca.cos, 1, 1),
    "tan": (ca.tan, 1, 1),
    "asin": (ca.asin, 1, 1),
    "acos": (ca.acos, 1, 1),
    "atan": (ca.atan, 1, 1),
    "exp": (ca.exp, 1, 1),
    "ln": (_where_positive(ca.log), 1, 1),
    "log2": (_where_positive(lambda value: ca.log(value) / math.log(2.0)), 1, 1),
    "log10": (_where_positive(ca.log10), 1, 1),
    "sqrt": (_sqrt, 1, 1),
    "floor": (ca.floor, 1, 1),
    "ceil": (ca.ceil, 1, 1),
    "integer": (_integer, 1, 1),
    "fraction": (lambda value: value - _integer(value), 1, 1),
    "sign": (lambda value: ca.if_else(value < 0, -1.0, 1.0), 1, 1),  # 0 counts as positive
    "toradians": (lambda value: value * (math.pi / 180.0), 1, 1),
    "todegrees": (lambda value: value * (180.0 / math.pi), 1, 1),
    "lt": (_truth(operator.lt), 2, 2),
    "le": (_truth(operator.le), 2, 2),
    "gt": (_truth(operator.gt), 2, 2),
    "ge": (_truth(operator.ge), 2, 2),
    "eq": (_truth(operator.eq), 2, 2),
    "nq": (_truth(operator.ne), 2, 2),
    "and": (_all_true, 2, _ANY_NUMBER),
    "or": (_any_true, 2, _ANY_NUMBER),
    "not": (lambda value: ca.if_else(_is_true(value), 0.0, 1.0), 1, 1),
    "ifthen": (lambda test, one, other: ca.if_else(_is_true(test), one, other), 3, 3),
}


def function_value(element: Element, properties: Properties, number: int | None = None) -> Any:
    """Return the value of a <function>, a number or an expression.

    number: index of the engine. It replaces # in names of properties

    Raises BadInputError for a function that is not supported.
    """
    arguments = [child for child in element.children if child.name != "description"]
    if len(arguments) != 1:
        raise element.error(
            f"the number of elements in <{element.name}> is {len(arguments)}; give one element"
        )
    return _value(arguments[0], properties, number)


def _value(element: Element, properties: Properties, number: int | None) -> Any:
    """Return the value of an element inside a function: property, number, table or operation."""
    name = element.name
    if name in ("property", "p"):
        if "apply" in element.attributes:
            fault = "template functions (attribute apply) are not supported"
            return properties.unknown(element.error(f"{fault}; write the function in full"))
        return properties.read(numbered(element, element.text, number), element.where)
    if name in ("value", "v"):
        return element.number()
    if name == "pi":
        return math.pi
    if name in ("table", "t"):
        return table_value(element, properties, number)
    if name not in _OPERATIONS:
        fault = f"the operation <{shortened(name)}> is not supported; use other operations"
        return properties.unknown(element.error(fault))
    operation, fewest, most = _OPERATIONS[name]  # numbers of arguments
    values = [
        _value(child, properties, number)
        for child in element.children
        if child.name != "description"
    ]
    if not fewest <= len(values) <= most:
        wanted = str(fewest) if fewest == most else f"{fewest} or more"
        raise element.error(f"the number of elements in <{name}> is {len(values)}; give {wanted}")
    # A CasADi expression does not keep the sign of -0.
    if name == "atan2" and any(repr(value) == "-0.0" for value in values):
        raise element.error("<atan2> with the argument -0 is not supported; write 0")
    return operation(*(ca.SX(value) for value in values))


def numbered(element: Element, name: str, number: int | None) -> str:
    """Return the name of a property with # replaced by the index of the engine.

    Raises BadInputError for a name with # outside an engine.
    """
    if "#" not in name:
        return name
    if number is None:
        raise element.error(
            f"{shortened(name)} contains #, which is replaced only in engine files; write the "
            "number of the engine"
        )
    return name.replace("#", str(number))


@dataclass(frozen=True)
class Table:
    """Values and breakpoints of a <table>.

    values: (n1, ..., nd), with the axes rows, columns and tables.
    breakpoints: breakpoints of each axis, d arrays.
    parts: one table for each breakpoint of the last axis, if these tables have different
        breakpoints, else (). With parts, `values` is not used, and `breakpoints` contains the last
        axis only.
    """

    values: np.ndarray
    breakpoints: list[np.ndarray]
    parts: tuple[Table, ...] = ()

    @property
    def dimensions(self) -> int:
        """Number of axes."""
        return len(self.breakpoints) + (self.parts[0].dimensions if self.parts else 0)

    def ends(self, axis: int) -> tuple[float, float]:
        """Return the first and the last breakpoint of an axis, of all parts of the table."""
        if not self.parts or axis == self.dimensions - 1:
            # With parts, the last axis is the only one in `breakpoints`.
            points = self.breakpoints[-1 if self.parts else axis]
            return float(points[0]), float(points[-1])
        ends = [table.ends(axis) for table in self.parts]
        return min(first for first, _ in ends), max(last for _, last in ends)

    def at(self, properties: Properties, arguments: list[Any]) -> Any:
        """Return the value of the table, interpolated at given arguments.

        arguments: arguments of the axes rows, columns and tables
        """
        interpolate = properties.interpolate
        if not self.parts:
            return interpolate(self.values, self.breakpoints, arguments)
        values_of_parts = [table.at(properties, arguments[:-1]) for table in self.parts]
        (points,) = self.breakpoints
        # Mask of the cell that contains the last argument, distance from its begin, and the value
        # and slope of each cell there.
        in_cell, offset = interpolate.cell(ca.SX(arguments[-1]), points)
        levels, slopes = lines_of_cells(ca.vertcat(*values_of_parts), points)
        return ca.dot(in_cell, levels) + offset * ca.dot(in_cell, slopes)


def read_table(element: Element) -> Table:
    """Return the content of a <table>, or of a <tableData> that contains <tableData> elements.

    Raises BadInputError for missing or faulty data, fewer than two rows or columns, or breakpoints
    that do not increase.
    """
    nested = list(element.all("tableData"))
    if not nested and element.name != "tableData":
        raise element.error("the table has no <tableData>; add <tableData>")
    if len(nested) > 1 or (element.name == "tableData" and nested):
        table = _stacked(nested)
    else:
        table = _rows(nested[0] if nested else element)
    for points in table.breakpoints:
        if len(points) < 2:
            raise element.error(
                "an axis of the table has only one breakpoint; give at least two breakpoints"
            )
        if not np.all(np.diff(points) > 0.0):
            raise element.error(
                "the breakpoints of the table do not increase; give breakpoints in increasing order"
            )
    return table


def _stacked(nested: list[Element]) -> Table:
    """Return the table that several <tableData> elements form along an additional axis."""
    # The attribute breakPoint of an element is its breakpoint on this axis.
    tables = tuple(read_table(child) for child in nested)
    points = np.array([child.as_number(child.attributes.get("breakPoint", "")) for child in nested])
    first = tables[0]
    if first.dimensions < 2:
        raise nested[0].error(
            "a <tableData> of a table with three axes has no row of column values; add this row"
        )
    if any(table.dimensions != first.dimensions for table in tables):
        raise nested[0].error(
            "the <tableData> elements have different numbers of axes; give the same axes in all "
            "<tableData>"
        )
    have_same_points = all(
        np.array_equal(one, other)
        for table in tables
        for one, other in zip(table.breakpoints, first.breakpoints, strict=True)
    )
    if have_same_points and not any(table.parts for table in tables):
        values = np.stack([table.values for table in tables], axis=-1)
        return Table(values, [*first.breakpoints, points])
    return Table(values=np.zeros(0), breakpoints=[points], parts=tables)  # values are not used


def _rows(data: Element) -> Table:
    """Return the table in the text of an element, with one axis or two."""
    # - If all rows have two numbers, each is a pair (breakpoint, value).
    # - Otherwise the first row contains the breakpoints of the columns. Each further row contains a
    #   breakpoint and the values.
    rows = []
    for line, text in data.lines:
        # As in C++, a number ends where the next character cannot continue it: 0.870.87 are two.
        words = _NUMBER.findall(text)
        numbers = [float(word) for word in words]
        if "".join(words) != "".join(text.split()) or not all(map(math.isfinite, numbers)):
            raise data.error_at(
                line,
                f"{shortened(text)!r} is not a row of numbers; give numbers separated by spaces",
            )
        rows.append(numbers)
    if {len(row) for row in rows} == {2}:
        pairs = np.array(rows)
        return Table(pairs[:, 1], [pairs[:, 0]])
    if len(rows) < 2 or {len(row) for row in rows[1:]} != {len(rows[0]) + 1}:
        raise data.error(
            "a row of the table has the wrong length; after the row of column values, give one "
            "number more in each row"
        )
    body = np.array(rows[1:])
    columns = np.array(rows[0])
    if len(columns) == 1:  # the table does not depend on the second argument
        body = np.column_stack([body, body[:, 1]])
        columns = np.array([columns[0], columns[0] + 1.0])
    return Table(body[:, 1:], [body[:, 0], columns])


#: Attribute lookup of an <independentVar> -> axis of the table.
_AXES = {"": 0, "row": 0, "axis1": 0, "column": 1, "axis2": 1, "table": 2, "axis3": 2, "axis4": 3}


def table_value(element: Element, properties: Properties, number: int | None = None) -> Any:
    """Return the value of a <table> at its independent variables.

    number: index of the engine. It replaces # in names of properties

    Raises BadInputError if the table or its independent variables are wrong.
    """
    if "type" in element.attributes:
        raise element.error(
            "a table with the attribute type cannot contain <independentVar> in this place; "
            "remove the attribute type"
        )
    table = read_table(element)
    arguments: dict[int, Any] = {}
    for variable in element.all("independentVar"):
        axis = variable.attributes.get("lookup", "")
        if axis not in _AXES:
            raise variable.error(
                f"the lookup {shortened(axis)} of <independentVar> is unknown; use row, column or "
                "table"
            )
        name = numbered(variable, variable.text, number)
        place = _AXES[axis]
        arguments[place] = properties.read(name, variable.where)
        if place < table.dimensions:  # the range of an argument spans those of all its tables
            low, high = table.ends(place)
            before = properties.ranges.get(canonical(name), (low, high))
            properties.ranges[canonical(name)] = min(low, before[0]), max(high, before[1])
    if sorted(arguments) != list(range(table.dimensions)):
        fault = f"the table has {table.dimensions} axes and {len(arguments)} independentVar"
        raise element.error(f"{fault}; give one independentVar for each axis")
    return table.at(properties, [arguments[axis] for axis in range(table.dimensions)])


def property_definitions(section: Element) -> Iterator[Element]:
    """Yield the functions and tables in a section, at any depth, whose names define properties.

    Components of channels are omitted.
    """
    pending = [section]
    while pending:
        part = pending.pop()
        if part.name == "channel":
            continue
        pending += reversed(part.children)
        defines_property = part.name == "function"
        if part.name in ("table", "t"):
            # JSBSim defines no property for a table directly in a section, except of an engine.
            is_direct = any(part is child for child in section.children)
            has_arguments = any(child.name == "independentVar" for child in part.children)
            is_of_engine = section.name.endswith("_engine")
            defines_property = has_arguments and (is_of_engine or not is_direct)
        if defines_property and "name" in part.attributes:
            yield part
