"""The content of a DAVE-ML file: variables, tables, functions and check cases."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from hfa_aircraft.rigid.tables import Interpolator
from hfa_support.errors import BadInputError, shortened
from hfa_support.files import regular_file, xml_root

if TYPE_CHECKING:
    from xml.etree import ElementTree


@dataclass(frozen=True)
class GriddedTable:
    """A table on a grid, linear in each argument between breakpoints.

    breakpoints: an increasing array for each argument
    values: array with one dimension for each argument
    """

    breakpoints: tuple[np.ndarray, ...]
    values: np.ndarray

    @property
    def ends(self) -> list[tuple[float, float]]:
        """First and last breakpoint of each argument."""
        return [(float(points[0]), float(points[-1])) for points in self.breakpoints]

    def value(self, arguments: Sequence[Any], interpolator: Interpolator) -> Any:
        """Return the interpolated value of the table.

        arguments: number or expression for each dimension of the table
        interpolator: interpolator shared by the tables of an aircraft
        """
        return interpolator(self.values, self.breakpoints, arguments)


_Definition = TypeVar("_Definition")
#: Elements that change the meaning of a variable and are not supported.
_UNREAD = ("uncertainty", "array", "isState", "isStateDeriv")


@dataclass(frozen=True)
class Variable:
    """A variable of a DAVE-ML file.

    key: varID
    name: standard name
    units: units, as spelled in the file
    initial: value if no table, formula or input defines the variable, or None
    least, most: limits, infinite if the file gives none
    formula: MathML element of the calculation, or None
    is_input, is_output: whether the file marks the variable as an input or an output
    """

    key: str
    name: str
    units: str
    initial: float | None
    least: float
    most: float
    formula: ElementTree.Element | None
    is_input: bool
    is_output: bool


@dataclass(frozen=True)
class Axis:
    """An independent variable of a function.

    key: varID
    least, most: values beyond which the function is constant, infinite if the file gives none
    """

    key: str
    least: float
    most: float


@dataclass(frozen=True)
class Function:
    """A variable that is defined by a table.

    result: varID of the variable
    axes: independent variables, in the order of the table's arguments
    table: table with piecewise linear interpolation
    """

    result: str
    axes: tuple[Axis, ...]
    table: GriddedTable


@dataclass(frozen=True)
class Signal:
    """The value of a variable in a check case.

    name: name or varID of the variable
    units: units, as spelled in the file, or "" if none are given
    value: the printed value
    tolerance: largest permitted difference of an output; 0 for inputs
    """

    name: str
    units: str
    value: float
    tolerance: float


@dataclass(frozen=True)
class CheckCase:
    """A check case.

    name: name of the check case
    inputs: values of the inputs
    outputs: values of the outputs, as printed in the file
    """

    name: str
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]


@dataclass(frozen=True)
class Document:
    """The content of a DAVE-ML file.

    path: path of the file
    title: title in the header
    variables: varID -> variable
    functions: varID of the result -> function
    cases: check cases
    """

    path: str
    title: str
    variables: Mapping[str, Variable]
    functions: Mapping[str, Function]
    cases: tuple[CheckCase, ...]

    def error(self, place: str, fault: str) -> BadInputError:
        """Return a BadInputError that names the file, the place in the file and the fault."""
        return BadInputError(f"{self.path}, {place}: {fault}")

    def by_name(self, name: str) -> Variable | None:
        """Return the variable whose varID is `name`, else the first whose standard name is `name`.

        Returns None if no variable has this varID or standard name.
        """
        if name in self.variables:
            return self.variables[name]
        return next(
            (variable for variable in self.variables.values() if variable.name == name), None
        )

    def range_of_tables(self, variable: Variable) -> tuple[float, float]:
        """Return the range of a variable that is within every table that depends on it.

        The range is in the units of the file. It is infinite if no table depends on the variable.
        """
        low = -math.inf
        high = math.inf
        for function in self.functions.values():
            for axis, (first, last) in zip(function.axes, function.table.ends, strict=True):
                if axis.key == variable.key:
                    low = max(low, axis.least, first)
                    high = min(high, axis.most, last)
        return low, high


def read_document(path: str) -> Document:
    """Return the content of a DAVE-ML file, version 1 or 2.

    Raises BadInputError if the file is not a valid DAVE-ML file in UTF-8 or uses an unsupported
    feature. Raises OSError if the file cannot be read.
    """
    root = xml_root(regular_file(path).read_bytes(), path)
    for element in root.iter():  # without prefixes: apply of mathml2:apply
        element.tag = element.tag.rpartition(":")[2]
    if root.tag != "DAVEfunc":
        raise BadInputError(
            f"{path}: the root element is <{shortened(root.tag)}>; give a DAVE-ML file"
        )
    return _Reader(path, root).document()


class _Breakpoints(NamedTuple):
    """Breakpoints of one argument of a table, with the bpID or varID that messages name."""

    key: str
    points: np.ndarray


class _Reader:
    """Converts the XML elements of one file to a `Document`."""

    def __init__(self, path: str, root: ElementTree.Element) -> None:
        """Read the breakpoints and the table elements that functions refer to by their IDs."""
        self._path = path
        self._root = root
        self._breakpoints = self._by_key(
            "breakpoints",
            (
                (self._attribute(element, "bpID"), self._numbers(element, "bpVals"))
                for element in root.iter("breakpointDef")
            ),
        )
        self._tables = self._by_key(
            "table",
            (
                (table.get("gtID", ""), table)
                for table in root.iterfind(".//griddedTableDef[@gtID]")
            ),
        )

    def document(self) -> Document:
        """Return the content of the file."""
        header = self._root.find("fileHeader")
        functions = [self._function(element) for element in self._root.iter("function")]
        variables = [self._variable(element) for element in self._root.iter("variableDef")]
        document = Document(
            path=self._path,
            title="" if header is None else header.get("name", ""),
            variables=self._by_key(
                "variable", ((variable.key, variable) for variable in variables)
            ),
            functions=self._by_key(
                "function for", ((function.result, function) for function in functions)
            ),
            cases=tuple(self._case(shot) for shot in self._root.iter("staticShot")),
        )
        for function in functions:
            for key in (function.result, *(axis.key for axis in function.axes)):
                if key not in document.variables:
                    place = f"function for {function.result}"
                    raise document.error(
                        place, f"variable {key} is not defined; add a <variableDef>"
                    )
            if document.variables[function.result].formula is not None:
                place = f"variable {function.result}"
                raise document.error(
                    place,
                    "the variable has both a table and a formula; remove the table or the formula",
                )
        return document

    def _by_key(
        self, kind: str, definitions: Iterable[tuple[str, _Definition]]
    ) -> dict[str, _Definition]:
        """Return ID -> definition. Raises BadInputError for an ID with two definitions."""
        by_key: dict[str, _Definition] = {}
        for key, definition in definitions:
            if key in by_key:
                raise self._error(
                    f"{kind} {key}", "there are two definitions; remove one definition"
                )
            by_key[key] = definition
        return by_key

    def _variable(self, element: ElementTree.Element) -> Variable:
        """Return the variable of a <variableDef>."""
        key = self._attribute(element, "varID")
        place = f"variable {key}"
        for tag in _UNREAD:
            if element.find(tag) is not None:
                raise self._error(place, f"<{tag}> is not supported; remove the element")
        calculation = element.find("calculation")
        formula = None
        if calculation is not None:
            math_element = calculation.find("math")
            if math_element is None or len(math_element) != 1:
                raise self._error(
                    place,
                    "<calculation> does not contain one <math> with one formula; correct "
                    "<calculation>",
                )
            formula = math_element[0]
        initial = element.get("initialValue")
        has_input_mark = element.find("isInput") is not None
        return Variable(
            key=key,
            name=element.get("name", key),
            units=element.get("units", ""),
            initial=None if initial is None else self._number(initial, place),
            least=self._number_or(element.get("minValue"), place, -math.inf),
            most=self._number_or(element.get("maxValue"), place, math.inf),
            formula=formula,
            is_input=has_input_mark or element.find("isControl") is not None,
            is_output=element.find("isOutput") is not None,
        )

    def _function(self, element: ElementTree.Element) -> Function:
        """Return a function given by points, or by a table with references to its variables."""
        points = list(element.iterfind("independentVarPts"))
        values = element.find("dependentVarPts")
        if points or values is not None:
            return self._function_of_points(points, values, element.get("name", ""))
        result = element.find("dependentVarRef")
        if result is None:
            raise self._error(
                f"function {element.get('name', '')}",
                "<dependentVarRef> is missing; add <dependentVarRef> with the varID of the "
                "variable that the function defines",
            )
        key = self._attribute(result, "varID")
        axes = tuple(self._axis(reference, key) for reference in element.iter("independentVarRef"))
        definition = element.find("functionDefn")
        table_element = None if definition is None else self._table_of(definition)
        if table_element is None:
            raise self._error(
                f"function for {key}",
                "the table of the function is missing, or ungridded, which is not supported; add "
                "<griddedTableDef>",
            )
        table = self._gridded(table_element, key)
        if len(axes) != len(table.ends):
            raise self._error(
                f"function for {key}",
                f"the function has {len(axes)} arguments, but the table has {len(table.ends)} "
                "axes; correct the function or the table",
            )
        return Function(key, axes, table)

    def _function_of_points(
        self, points: list[ElementTree.Element], values: ElementTree.Element | None, name: str
    ) -> Function:
        """Return the function whose breakpoints and values its own elements contain."""
        # The values are in the order of a gridded table: the last argument varies fastest.
        if values is None or not points:
            tag = "independentVarPts" if values is not None else "dependentVarPts"
            raise self._error(f"function {name}", f"<{tag}> is missing; add <{tag}>")
        key = self._attribute(values, "varID")
        place = f"function for {key}"
        axes = tuple(self._axis(point, key) for point in points)
        breakpoints = [
            _Breakpoints(axis.key, self._numbers_in(point, place))
            for axis, point in zip(axes, points, strict=True)
        ]
        table = self._table_on_grid(breakpoints, self._numbers_in(values, place), place)
        return Function(key, axes, table)

    def _axis(self, element: ElementTree.Element, result: str) -> Axis:
        """Return an argument of the function for the variable `result`."""
        place = f"function for {result}"
        way = element.get("interpolate", "linear")
        if way != "linear":
            raise self._error(
                place, f'interpolate="{shortened(way)}" is not supported; use "linear"'
            )
        extrapolate = element.get("extrapolate", "neither")
        if extrapolate != "neither":
            raise self._error(
                place, f'extrapolate="{shortened(extrapolate)}" is not supported; use "neither"'
            )
        return Axis(
            self._attribute(element, "varID"),
            self._number_or(element.get("min"), place, -math.inf),
            self._number_or(element.get("max"), place, math.inf),
        )

    def _table_of(self, definition: ElementTree.Element) -> ElementTree.Element | None:
        """Return the element of a function's table, or None.

        It is a child of <functionDefn>, or a table elsewhere that a child names by its ID.
        """
        for tag in ("griddedTableDef", "griddedTable"):  # in version 2 and in version 1
            child = definition.find(tag)
            if child is not None:
                return child
        reference = definition.find("griddedTableRef")
        return None if reference is None else self._tables.get(reference.get("gtID", ""))

    def _gridded(self, element: ElementTree.Element, result: str) -> GriddedTable:
        """Return the table in an element of the function for the variable `result`."""
        place = f"function for {result}"
        keys = [self._attribute(reference, "bpID") for reference in element.iter("bpRef")]
        missing = [key for key in keys if key not in self._breakpoints]
        if not keys:
            raise self._error(place, "the table has no <bpRef>; add a <bpRef> for each argument")
        if missing:
            raise self._error(
                place,
                f"breakpoints {', '.join(missing)} are not defined; add a <breakpointDef> for each",
            )
        values = self._numbers(element, "dataTable")
        breakpoints = [_Breakpoints(key, self._breakpoints[key]) for key in keys]
        return self._table_on_grid(breakpoints, values, place)

    def _table_on_grid(
        self, breakpoints: Sequence[_Breakpoints], values: np.ndarray, place: str
    ) -> GriddedTable:
        """Return a table of values (N,), of which the last argument varies fastest.

        Raises BadInputError if the breakpoints do not increase or do not fit the values.
        """
        for key, points in breakpoints:
            if points.size < 2 or not (np.diff(points) > 0.0).all():
                raise self._error(
                    f"breakpoints {key}",
                    "the breakpoints are not two or more increasing numbers; correct the "
                    "breakpoints",
                )
        shape = tuple(axis.points.size for axis in breakpoints)
        if values.size != math.prod(shape):
            raise self._error(
                place,
                f"the table has {values.size} values, but the breakpoints require "
                f"{math.prod(shape)}; correct the table or the breakpoints",
            )
        return GriddedTable(tuple(axis.points for axis in breakpoints), values.reshape(shape))

    def _case(self, element: ElementTree.Element) -> CheckCase:
        """Return the check case of a <staticShot>."""
        name = element.get("name", "")
        inputs = tuple(self._signals(element, "checkInputs", name))
        outputs = tuple(self._signals(element, "checkOutputs", name))
        if not outputs:
            raise self._error(
                f"check case {name}", "<checkOutputs> has no <signal>; add the outputs to check"
            )
        return CheckCase(name, inputs, outputs)

    def _signals(self, shot: ElementTree.Element, tag: str, case: str) -> Iterator[Signal]:
        """Yield the signals in <checkInputs> or <checkOutputs> of a check case."""
        group = shot.find(tag)
        if group is None:
            raise self._error(f"check case {case}", f"<{tag}> is missing; add <{tag}>")
        for signal in group.iter("signal"):
            texts = {child.tag: (child.text or "").strip() for child in signal}
            name = texts.get("signalName") or texts.get("varID") or texts.get("signalID", "")
            place = f"check case {case}, {name}"
            if "signalValue" not in texts:
                raise self._error(place, "<signalValue> is missing; add <signalValue>")
            value = self._number(texts["signalValue"], place)
            tolerance = self._number_or(texts.get("tol"), place, 0.0)
            yield Signal(name, texts.get("signalUnits", ""), value, tolerance)

    def _numbers(self, element: ElementTree.Element, tag: str) -> np.ndarray:
        """Return the numbers in the child element `tag` (`_numbers_in`)."""
        child = element.find(tag)
        place = f"<{element.tag}> {element.get('bpID') or element.get('gtID') or ''}".rstrip()
        if child is None:
            raise self._error(place, f"<{tag}> is missing; add <{tag}>")
        return self._numbers_in(child, place)

    def _numbers_in(self, child: ElementTree.Element, place: str) -> np.ndarray:
        """Return the numbers in an element, separated by commas or blanks, (N,)."""
        words = [word for word in re.split(r"[,\s]+", "".join(child.itertext())) if word]
        try:
            values = np.array([float(word) for word in words])
        except ValueError as error:
            raise self._error(
                place,
                f"<{child.tag}> contains a word that is not a number ({error}); correct the word",
            ) from error
        if not np.isfinite(values).all():
            raise self._error(
                place, f"<{child.tag}> contains a number that is not finite; correct the number"
            )
        return values

    def _number_or(self, text: str | None, place: str, default: float) -> float:
        """Return the number in a text, or the default without a text."""
        return default if text is None else self._number(text, place)

    def _number(self, text: str, place: str) -> float:
        """Return the number in a text. Raises BadInputError unless it is finite."""
        try:
            value = float(text)
        except ValueError as error:
            raise self._error(
                place, f"{shortened(text)!r} is not a number; give a number"
            ) from error
        if not math.isfinite(value):
            raise self._error(place, f"{text} is not finite; give a finite number")
        return value

    def _attribute(self, element: ElementTree.Element, name: str) -> str:
        """Return an attribute of an element. Raises BadInputError if it is missing or empty."""
        value = element.get(name)
        if not value:
            raise self._error(
                f"<{element.tag}>", f"the attribute {name} is missing; add this attribute"
            )
        return value

    def _error(self, place: str, fault: str) -> BadInputError:
        """Return the error of a fault at a place of the file, as `Document.error` does."""
        return BadInputError(f"{self._path}, {place}: {fault}")
