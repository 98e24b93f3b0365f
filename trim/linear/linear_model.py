"""Linear model at an operating point."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hfa_aircraft.control_systems import (
    plant_model,
)
from hfa_aircraft.signals import PlantNames, StatesAndInputs
from hfa_support.arguments import ArrayLike
from hfa_support.errors import BadInputError, numbers_in, prefix_errors
from hfa_support.matrices import LARGEST, balanced, checked_matrix, in_order, labels_of, shape_text
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import ByValue, Matrix, Result, Vector, without_empty
from hfa_support.reporting.rows import ByName, with_names
from hfa_support.reporting.text import numbered
from trim.linear.modes import Mode, fastest_first, modes_of
from trim.point.operating_point import OperatingPoint, point_of_plant

if TYPE_CHECKING:
    import control
    import xarray

    from hfa_aircraft.model import Model
    from trim.linear.reduction import Matrices


#: Array -> its axes, and the attribute of a linear model that has it. Rates are those of states.
MATRICES = {
    "A": (("rate", "state"), "A"),
    "B": (("rate", "input"), "B"),
    "C": (("output", "state"), "C"),
    "D": (("output", "input"), "D"),
    "E": (("rate", "disturbance"), "E"),
    "F": (("output", "disturbance"), "F"),
}
OFFSETS = {
    "X0": (("state",), "state_offsets"),
    "U0": (("input",), "input_offsets"),
    "Y0": (("output",), "output_offsets"),
}


@dataclass(frozen=True, eq=False, repr=False)
class LinearModel(StatesAndInputs, ByValue, Result, Reported):
    """Linear model x' = A x + B u + E w, y - Y0 = C x + D u + F w (Eq. 9 of the paper).

    The deviations are x = X - X0 and u = U - U0.

    A: (n, n), ∂f/∂X, in units of the row's rate per unit of the column; can be indexed by names:
        A["pitch_rate", "alpha"].
    B: (n, m), ∂f/∂U, can be indexed by names.
    C: (k, n), ∂y/∂X.
    D: (k, m), ∂y/∂U.
    states: names of the states, in order.
    inputs: names of the inputs, in order.
    point: operating point, whose values are the offsets X0, U0.
    outputs: names of the outputs y, in order.
    E: (n, l), ∂f/∂w; without columns if there are no disturbances.
    F: (k, l), ∂y/∂w.
    output_offsets: Y0, (k,).
    disturbances: names of the disturbances w.
    nonsmooth_points: notes on entries that are means of both sides, and on rates that
        jump.
    reduction: note on the states that were omitted by choice, or "".

    >>> import hfa
    >>> model = hfa.aircraft()
    >>> linear = hfa.linearize(model, hfa.trim(model))
    >>> type(linear) is hfa.LinearModel, linear.A.shape, linear.B.shape
    (True, (6, 6), (6, 5))
    """

    schema = "hfa.linear-model/1"

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    point: OperatingPoint
    outputs: tuple[str, ...]
    E: Matrix
    F: Matrix
    output_offsets: Vector
    disturbances: tuple[str, ...]
    nonsmooth_points: tuple[str, ...]
    reduction: str = ""

    def __post_init__(self) -> None:
        """Make A and B indexable by names."""
        vars(self).update(
            A=with_names(numbers_in("A", self.A), self.states, self.states),
            B=with_names(numbers_in("B", self.B), self.states, self.inputs),
        )

    @classmethod
    def of(
        cls,
        A: ArrayLike | control.StateSpace,
        B: ArrayLike | None = None,
        C: ArrayLike | None = None,
        D: ArrayLike | None = None,
        *,
        states: Sequence[str] = (),
        inputs: Sequence[str] = (),
        outputs: Sequence[str] = (),
        name: str = "linear plant",
    ) -> LinearModel:
        """Return x' = A x + B u, y = C x + D u about the origin.

        A: (n, n), or a `StateSpace` of python-control or SciPy in continuous time, alone
        B: (n, m)
        C: (k, n), by default the identity
        D: (k, m), by default 0
        states, inputs: names in order, by default the labels of A and B if these are tables of
            pandas, otherwise x1, x2, ... and u1, u2, ...
        outputs: names in order, by default the states, or y1, y2, ... if C is given
        name: name of the plant in reports

        Rows and columns of labelled tables are put into the order of the names.

        Raises BadInputError if a matrix does not consist of finite numbers, or if shapes, labels or
        numbers of names disagree.

        >>> import hfa
        >>> A, B = [[0.0, 1.0], [-4.0, -0.4]], [[0.0], [1.0]]
        >>> hfa.LinearModel.of(A, B, states=("x", "v")).A["v", "x"]
        np.float64(-4.0)
        """
        if is_state_space(A):
            return _of_state_space(A, name)
        states = tuple(states) or _labels_along(A, axis=0)
        inputs = tuple(inputs) or _labels_along(B, axis=1)
        A = _checked_in_order("A", A, states, states)
        B = _checked_in_order("B", B, states, inputs)
        n, m = len(A), B.shape[1]
        for matrix_name, matrix, shape in (("A", A, (n, n)), ("B", B, (n, m))):
            if matrix.shape != shape or not matrix.size:
                raise BadInputError(
                    f"{matrix_name} is {shape_text(matrix.shape)}; give {shape_text(shape)}, with "
                    "at least one state and one input"
                )
        names = PlantNames(states, inputs).completed(n, m)  # by x1, ..., and u1, ...
        output = _output_equation(C, D, tuple(outputs), names)
        rows = dict(zip(output.names, zip(output.C, output.D, strict=True), strict=True))
        return cls(
            A=A,
            B=B,
            C=output.C,
            D=output.D,
            states=names.states,
            inputs=names.inputs,
            point=point_of_plant(plant_model(name, names, A, B, rows)),
            outputs=output.names,
            E=np.zeros((n, 0)),
            F=np.zeros((len(rows), 0)),
            output_offsets=np.zeros(len(rows)),
            disturbances=(),
            nonsmooth_points=(),
        )

    @staticmethod
    def load(path: str | Path) -> LinearModel:
        """Return the linear model in a .json, .npz or .mat file that `save` or `hfa linearize -o`
        wrote.

        The result has the matrices, names, units, offsets and warnings of the file. Its model is a
        linear plant, whose signals have neither limits nor nominal values.

        Raises BadInputError if the file is not a linear model.
        """
        from hfa_aircraft.readers.matrices_file import words
        from hfa_support.arrays.read import read_arrays

        stored = read_arrays(path)
        if words(stored, "schema") != (LinearModel.schema,) or not {"A", "B"} <= {*stored}:
            raise BadInputError(
                f"{path} is not a linear model of schema {LinearModel.schema}; write it with "
                "hfa linearize -o FILE.json"
            )
        with prefix_errors(path):
            linear = LinearModel.of(
                stored["A"],
                stored["B"],
                stored.get("C"),
                stored.get("D"),
                states=words(stored, "states"),
                inputs=words(stored, "inputs"),
                outputs=words(stored, "outputs"),
            )
            return _with_all(linear, stored, f"linear model of {Path(path).name}")

    @property
    def model(self) -> Model:
        """Model of the aircraft."""
        return self.point.model

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states, equal to `states`."""
        return self.states

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, equal to `inputs`."""
        return self.inputs

    @property
    def dynamics(self) -> str:
        """Name of the model; that of the flexible aircraft is the name of its equations, such as
        "published".
        """
        return self.point.dynamics

    @property
    def dihedral_deg(self) -> float | None:
        """Dihedral angle of the flexible aircraft, degrees, or None for other models."""
        return self.point.dihedral_deg

    @property
    def output_units(self) -> tuple[str, ...]:
        """Units of the outputs, in order."""
        return self.model.units(self.outputs)

    @property
    def disturbance_units(self) -> tuple[str, ...]:
        """Units of the disturbances, in order."""
        return self.model.units(self.disturbances)

    @property
    def warnings(self) -> list[str]:
        """Notes on the operating point, omitted input dynamics, nonsmooth points, rates
        that jump, and omitted states.
        """
        signals = self.model.inputs
        omitted = filter(None, (signals[name].omitted_dynamics for name in self.inputs))
        reduction = [self.reduction] if self.reduction else []
        # `nonsmooth_points` also notes rates that jump; `reduction` is the note on omitted states.
        return [*self.point.warnings, *omitted, *self.nonsmooth_points, *reduction]

    @property
    def modes(self) -> ByName[Mode]:
        """Modes of A, fastest first, which can be indexed by number or name: modes["phugoid"]."""
        return ByName(modes_of(self.A, self.states, self.model.modes))

    @property
    def state_offsets(self) -> Vector:
        """Offsets X0 of the states, (n,)."""
        return np.array([self.point.values[name] for name in self.states])

    @property
    def input_offsets(self) -> Vector:
        """Offsets U0 of the inputs, (m,)."""
        return np.array([self.point.values[name] for name in self.inputs])

    def select(
        self,
        states: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
        *,
        residualize: Sequence[str] = (),
    ) -> LinearModel:
        """Return the linear model with only the named states and inputs.

        Omitted states and inputs are constant at their offsets.

        states: names; by default all except `residualize`
        inputs: names; by default all
        residualize: states that follow the other states without delay, x2 = -A22⁻¹ (A21 x1 + B2 u +
            E2 w). Static gains are unchanged.

        Raises BadInputError if the model does not have such a name, a name is repeated, no state
        remains, or A22 is singular.
        """
        from trim.linear.reduction import reduced

        kept = reduced(self.matrices, states, inputs, residualize)
        return replace(self, **kept._asdict())

    def __getitem__(self, names: tuple[Any, Any]) -> LinearModel:
        """Return the linear model from named inputs to named outputs.

        The outputs are named first, as in linear["pitch_rate", "elevator_center"]. Inputs and
        outputs are each a name or a list of names.

        Raises BadInputError if the index is not a pair, the model does not have such a name, or a
        name is repeated.
        """
        from trim.linear.reduction import with_outputs

        match names:
            case (str() | list() | tuple() as outputs, str() | list() | tuple() as inputs):
                shown = with_outputs(self.matrices, outputs)
                return replace(self, **shown._asdict()).select(inputs=inputs)
        raise BadInputError("the index is not a pair of names; write linear[outputs, inputs]")

    def __iter__(self) -> Iterator[np.ndarray]:
        """Yield A, B, C and D, for A, B, C, D = linear and control.ss(*linear)."""
        return map(np.asarray, (self.A, self.B, self.C, self.D))

    @property
    def matrices(self) -> Matrices:
        """Matrices A to F and the names of their signals."""
        from trim.linear.reduction import Matrices

        return Matrices(*(getattr(self, name) for name in Matrices._fields))

    @property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of A, (n,) complex, 1/s, fastest first."""
        return fastest_first(np.linalg.eigvals(self.A))

    @property
    def is_stable(self) -> bool:
        """True if every mode of A is stable."""
        return all(mode.stable for mode in self.modes)

    def bode(self) -> np.ndarray:
        """Draw the Bode plots from all inputs to all outputs with pyplot, and return the Axes.

        Raises BadInputError if no input affects an output.
        """
        from matplotlib import pyplot

        import trim

        return np.array(trim.draw_bode(self, pyplot.figure(layout="constrained")).axes)

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "A": self.A,
            "B": self.B,
            "C": self.C,
            "D": self.D,
            "states": self.states,
            "inputs": self.inputs,
            "operating_point": self.point,
            "outputs": self.outputs,
            "output_offsets": self.output_offsets,
            "state_units": self.state_units,
            "input_units": self.input_units,
            "dynamics": self.dynamics,
            "output_units": self.output_units,
            "warnings": self.warnings,
            "modes": self.modes,
            "state_offsets": self.state_offsets,
            "input_offsets": self.input_offsets,
        } | without_empty(
            E=self.E,
            F=self.F,
            disturbances=self.disturbances,
            dihedral_deg=self.dihedral_deg,
            scheduled=self.point.scheduled,
            disturbance_units=self.disturbance_units,
        )

    def report(self) -> Report:
        """Return a report of the linear model, with A, B, the offsets and the modes."""
        import trim

        return trim.linear_model_report(self)

    def to_control(self, *, balance: bool = False) -> control.StateSpace:
        """Return the linear model as a python-control `StateSpace`, with the same signal names.

        balance: whether the states are in units of powers of two in which A is balanced, in place
            of their own; responses are then accurate whatever the units of the states are
        """
        import control

        A, B, C, D = self
        if balance:
            A, units = balanced(A)
            B, C = B / units[:, None], C * units
        return control.ss(
            A,
            B,
            C,
            D,
            states=list(self.states),
            inputs=list(self.inputs),
            outputs=list(self.outputs),
        )

    def to_xarray(self) -> xarray.Dataset:
        """Return A, B, C, D, X0, U0 and Y0 with the names and units of signals. Requires xarray."""
        from trim.tables import dataset

        arrays = {
            name: (axes, getattr(self, attribute))
            for name, (axes, attribute) in (MATRICES | OFFSETS).items()
            if "disturbance" not in axes
        }
        names = {
            "state": ("state", list(self.states), {"units": list(self.state_units)}),
            "input": ("input", list(self.inputs), {"units": list(self.input_units)}),
            "output": ("output", list(self.outputs), {"units": list(self.output_units)}),
            "rate": ("rate", list(self.states)),
        }
        return dataset(arrays, names, self.model.title)


class _OutputEquation(NamedTuple):
    """Output equation y = C x + D u, with C (k, n), D (k, m) and the names of the outputs."""

    C: np.ndarray
    D: np.ndarray
    names: tuple[str, ...]


def _output_equation(
    C: ArrayLike | None, D: ArrayLike | None, outputs: tuple[str, ...], names: PlantNames
) -> _OutputEquation:
    """Return the output equation of a plant; the arguments are those of `LinearModel.of`.

    C and D may be tables of pandas, of which the labels name and order the signals.
    """
    n, m = len(names.states), len(names.inputs)
    if C is None:
        C = np.eye(n)
        outputs = outputs or names.states
    else:
        labels = outputs or _labels_along(C, axis=0)
        C = _checked_in_order("C", C, labels, names.states)
        outputs = labels or numbered("y", len(C))
    D = np.zeros((len(C), m)) if D is None else _checked_in_order("D", D, outputs, names.inputs)
    for matrix_name, matrix, width in (("C", C, n), ("D", D, m)):
        if matrix.shape != (len(C), width):
            needed = shape_text((len(C), width))
            raise BadInputError(f"{matrix_name} is {shape_text(matrix.shape)}; give {needed}")
    if len(outputs) != len(C):
        raise BadInputError(
            f"outputs has {len(outputs)} names, but C has {len(C)} rows; give a name for each row"
        )
    return _OutputEquation(C, D, outputs)


def is_state_space(system: object) -> bool:
    """Return whether a value is a state-space system of another package."""
    matrices = all(hasattr(system, matrix) for matrix in ("A", "B", "C", "D", "dt"))
    return matrices and not isinstance(system, LinearModel)


def _of_state_space(system: Any, name: str) -> LinearModel:
    """Return the linear model of a `StateSpace`, with its names where these are identifiers."""
    if system.dt not in (None, 0):
        raise BadInputError(
            f"the system is in discrete time, dt = {system.dt}; write hfa.Game(A=system.A, "
            "B=system.B, Q=Q, R=R, dt=system.dt)"
        )
    labels = {}
    for kind in ("state", "input"):
        given_labels = tuple(getattr(system, f"{kind}_labels", None) or ())
        labels[f"{kind}s"] = given_labels if all(map(str.isidentifier, given_labels)) else ()
    return LinearModel.of(system.A, system.B, system.C, system.D, name=name, **labels)


def _labels_along(matrix: Any, axis: int) -> tuple[str, ...]:
    """Return the labels of a table of pandas along an axis, () for another matrix."""
    labels = labels_of(matrix)
    return labels[axis] if axis < len(labels) else ()


def _checked_in_order(name: str, matrix: Any, *orders: tuple[str, ...]) -> np.ndarray:
    """Return a matrix as checked numbers, with labelled rows and columns in the given orders."""
    return checked_matrix(name, in_order(name, matrix, *orders), LARGEST)


def _with_all(linear: LinearModel, stored: Mapping[str, Any], name: str) -> LinearModel:
    """Return the model of A to D in a file with all other entries that `save` wrote."""
    from hfa_aircraft.readers.matrices_file import numbers_of_shape, words, written_plant

    names = PlantNames(linear.states, linear.inputs, (), ())
    model = written_plant(stored, name, names, linear.outputs, linear.A, linear.B)
    n, k, disturbances = len(linear.states), len(linear.outputs), words(stored, "disturbances")
    return replace(
        linear,
        E=numbers_of_shape("E", stored, (n, len(disturbances))),
        F=numbers_of_shape("F", stored, (k, len(disturbances))),
        disturbances=disturbances,
        output_offsets=numbers_of_shape("output_offsets", stored, (k,)),
        point=point_of_plant(model),
    )
