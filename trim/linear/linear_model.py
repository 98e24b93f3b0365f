"""A linear model at an operating point: how it is made, and what it says."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.reporting.by_value import ByValue
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result, Vector
from hfa_support.reporting.text import Table, degrees, matrix_table
from trim.linear.kinks import with_means_at_kinks
from trim.linear.modes import Mode, fastest_first, modes_of, modes_table
from trim.point.condition import usual_condition
from trim.point.operating_point import OperatingPoint, at_scheduled
from trim.point.solve import find_operating_point

if TYPE_CHECKING:
    import control

#: Condition number, in nominal units, from which a matrix counts as singular.
_SINGULAR = 1e12
#: Units of length.
_LENGTHS = ("ft", "m", "km", "nmi", "mi", "in", "cm", "mm")


class _Kept(NamedTuple):
    """What is kept of a model of fewer states, by number: states, states that follow the others at
    once, outputs."""

    rows: list[int]
    following: list[int]
    outputs: list[int]


@dataclass(frozen=True, eq=False, repr=False)
class LinearModel(ByValue, Result, Reported):
    """x' = A x + B u + E w, y - Y0 = C x + D u + F w with x = X - X0, u = U - U0 (paper Eq. 9).

    A: (n, n), ∂f/∂X; unit of a row's rate per column's unit.
    B: (n, m), ∂f/∂U.
    states: names of the states, in order.
    inputs: names of the inputs, in order.
    point: the operating point, whose values are the offsets X0, U0.
    outputs: names y of the outputs, in order; the states unless others were asked for.
    C: (k, n), the identity where the outputs are the states.
    D: (k, m).
    E: (n, l), no columns without disturbances.
    F: (k, l).
    output_offsets: Y0, (k,).
    disturbances: names of w, where the model has some.
    kinks: notes on entries of A and B that are means of two slopes, or of rates that jump.
    """

    how_to_make: ClassVar[str] = "linearize(model, point)"
    schema = "hfa.linear-model/1"
    made_by = "hfa linearize"
    keys = (
        "dihedral_deg?=point.dihedral_deg scheduled?=point.scheduled dynamics=point.dynamics "
        "operating_point=point states inputs state_units input_units state_offsets input_offsets "
        "A B outputs output_units C D disturbances? disturbance_units? E? F? output_offsets "
        "warnings modes"
    )

    A: Matrix
    B: Matrix
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    point: OperatingPoint
    outputs: tuple[str, ...]
    C: Matrix
    D: Matrix
    E: Matrix
    F: Matrix
    output_offsets: Vector
    disturbances: tuple[str, ...]
    kinks: tuple[str, ...] = ()

    @property
    def state_units(self) -> tuple[str, ...]:
        """Unit of each state, in order."""
        return self.point.model.units(self.states)

    @property
    def input_units(self) -> tuple[str, ...]:
        """Unit of each input, in order."""
        return self.point.model.units(self.inputs)

    @property
    def output_units(self) -> tuple[str, ...]:
        """Unit of each output, in order."""
        return self.point.model.units(self.outputs)

    @property
    def disturbance_units(self) -> tuple[str, ...]:
        """Unit of each w."""
        return self.point.model.units(self.disturbances)

    @property
    def warnings(self) -> list[str]:
        """What to know before trusting it: of the operating point, and of entries at a kink."""
        return [*self.point.warnings, *self.kinks]

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Modes of A, fastest first, named as the model has it."""
        return modes_of(self.A, self.states, self.point.model.modes)

    @property
    def state_offsets(self) -> Vector:
        """X0 of the model's states, (n,)."""
        return np.array([getattr(self.point.states, name) for name in self.states])

    @property
    def input_offsets(self) -> Vector:
        """U0, (m,)."""
        return np.array([getattr(self.point.inputs, name) for name in self.inputs])

    def select(
        self,
        states: tuple[str, ...] | None = None,
        inputs: tuple[str, ...] | None = None,
        *,
        residualize: tuple[str, ...] = (),
    ) -> LinearModel:
        """The model of the named states and inputs alone; None keeps all.

        States and inputs left out stay at their offsets. States in `residualize` follow the others
        at once: x2 = -A22⁻¹ (A21 x1 + B2 u + E2 w), so that values at rest stay as they were.
        BadInputError when the model has no such name, it comes twice, or A22 is singular."""
        if states is None:
            states = tuple(name for name in self.states if name not in residualize)
        rows = _positions("state", states, self.states)
        columns = _positions("input", inputs, self.inputs)
        following = _positions("state", (*states, *residualize), self.states)[len(rows) :]
        if not rows:
            raise BadInputError(
                "no state is left in the model; leave at least one out of residualize"
            )
        outputs = list(range(len(self.outputs)))
        if self.outputs == self.states:
            outputs = rows
        disturbances = list(range(len(self.disturbances)))
        kept = _Kept(rows, following, outputs)
        A, C = self._reduced(self.A, self.C, kept, rows)
        B, D = self._reduced(self.B, self.D, kept, columns)
        E, F = self._reduced(self.E, self.F, kept, disturbances)
        return replace(
            self,
            A=A,
            B=B,
            C=C,
            D=D,
            E=E,
            F=F,
            states=tuple(self.states[i] for i in rows),
            inputs=tuple(self.inputs[i] for i in columns),
            outputs=tuple(self.outputs[i] for i in outputs),
            output_offsets=self.output_offsets[outputs],
        )

    def _reduced(
        self, of_rates: np.ndarray, of_outputs: np.ndarray, kept: _Kept, columns: list[int]
    ) -> tuple[np.ndarray, np.ndarray]:
        """The rows and columns that are kept of A and C, of B and D or of E and F, with what the
        states that follow at once add. BadInputError when their rates do not determine them."""
        rows, following, outputs = kept
        rates = of_rates[:, columns]
        shown = of_outputs[np.ix_(outputs, columns)]
        if not following:
            return rates[rows], shown
        A22 = self.A[np.ix_(following, following)]
        names = [self.states[i] for i in following]
        nominal = np.array([self.point.model.states[name].nominal for name in names])
        if np.linalg.cond(A22 * nominal / nominal[:, None]) > _SINGULAR:
            raise BadInputError(
                f"{', '.join(names)} cannot follow the other states: their rates do not determine "
                "them (A22 is singular); residualize fewer"
            )
        followed = -np.linalg.solve(A22, rates[following])
        return (
            rates[rows] + self.A[np.ix_(rows, following)] @ followed,
            shown + self.C[np.ix_(outputs, following)] @ followed,
        )

    def frequency_response(self, omega: Any = None) -> control.FrequencyResponseData:
        """C (iω - A)⁻¹ B + D at ω, rad/s, (outputs, inputs, N); python-control chooses ω unless
        given."""
        import control

        return control.frequency_response(self.to_control(), omega)

    def poles(self) -> np.ndarray:
        """The eigenvalues of A, (n,) complex, 1/s, fastest first."""
        return np.asarray(fastest_first(np.linalg.eigvals(self.A)))

    def bode(self) -> np.ndarray:
        """Draw the Bode plots of the inputs in a figure of pyplot; returns its Axes.

        BadInputError where no input reaches an output.
        """
        from matplotlib import pyplot

        from trim.linear.frequency import draw_bode

        return np.array(draw_bode(self, pyplot.figure(layout="constrained")).axes)

    def report(self) -> Report:
        """A, B, offsets and modes."""
        return linear_model_report(self)

    def to_control(self) -> control.StateSpace:
        """The same model as python-control's `StateSpace`, names kept."""
        import control

        return control.ss(
            self.A,
            self.B,
            self.C,
            self.D,
            states=list(self.states),
            inputs=list(self.inputs),
            outputs=list(self.outputs),
        )

    def to_xarray(self) -> Any:
        """The same model as an `xarray.Dataset`: A, B, C, D, the offsets X0, U0 and Y0, with names
        and units. Needs xarray."""
        import xarray

        states = ("state", list(self.states), {"units": list(self.state_units)})
        inputs = ("input", list(self.inputs), {"units": list(self.input_units)})
        outputs = ("output", list(self.outputs), {"units": list(self.output_units)})
        return xarray.Dataset(
            {
                "A": (("rate", "state"), self.A),
                "B": (("rate", "input"), self.B),
                "C": (("output", "state"), self.C),
                "D": (("output", "input"), self.D),
                "X0": ("state", self.state_offsets),
                "U0": ("input", self.input_offsets),
                "Y0": ("output", self.output_offsets),
            },
            coords={
                "state": states,
                "input": inputs,
                "output": outputs,
                "rate": ("rate", list(self.states)),
            },
            attrs={"model": self.point.called},
        )


def reduction_note(
    model: LinearModel, whole: LinearModel, residualized: tuple[str, ...] = ()
) -> str:
    """What a model of fewer states does to the eigenvalues of the whole one; "" where no state of
    it is missing."""
    truncated = tuple(name for name in whole.states if name not in (*model.states, *residualized))
    clauses = []
    for names, how in (
        (truncated, "left out (truncated)"),
        (residualized, "residualized (at rest at every moment)"),
    ):
        if names:
            clauses.append(f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} {how}")
    if not clauses:
        return ""
    eigenvalues = np.linalg.eigvals(whole.A)
    sizes = np.maximum(np.abs(eigenvalues), 1e-12)
    apart = [np.min(np.abs(value - eigenvalues) / sizes) for value in np.linalg.eigvals(model.A)]
    advice = "" if residualized else " (--residualize names states that follow instead)"
    return (
        f"{'; '.join(clauses)}; the eigenvalues lie up to {100 * float(max(apart)):.2g} % from "
        f"those of all {len(whole.states)} states{advice}"
    )


class Block(NamedTuple):
    """One of A, B, C, D with the names and units of its rows and columns, as it is printed."""

    name: str
    rows: tuple[str, ...]
    row_units: tuple[str, ...]
    columns: tuple[str, ...]
    column_units: tuple[str, ...]
    values: np.ndarray


def linear_model_report(model: LinearModel) -> Report:
    """A, B, offsets and modes; in the data E and F too."""
    point = model.point
    signals = point.model
    blocks = _blocks(model)
    names = (*model.states, *model.inputs)
    offsets = (*model.state_offsets.tolist(), *model.input_offsets.tolist())
    offset_rows = [
        (name, *degrees(value, signals.unit(name)))
        for name, value in zip(names, offsets, strict=True)
    ]
    matrix_names = [block.name for block in blocks]
    equations = "x' = A x + B u, "
    if "C" in matrix_names:
        equations += "y = C x + D u, "
    where = ", ".join(word for word in (at_scheduled(point), point.called) if word)
    title = (
        f"Linear model {where} ({equations}x = X - X0, u = U - U0)\n"
        f"{', '.join(matrix_names[:-1])} and {matrix_names[-1]} in {units_in_words(model)}; the "
        "offsets X0 and U0 in the units next to them"
    )
    return Report(
        title=title,
        parts=[
            *matrices(model),
            Table(("offset", "value", "unit"), offset_rows),
            modes_table(model.modes, signals.time_unit),
        ],
        notes=model.warnings,
        data=model.as_data(),
        records=_records(model, blocks),
    )


def _records(model: LinearModel, blocks: list[Block]) -> Table:
    """A row an entry of the matrices and an offset: matrix, row, column, value, unit."""
    rows: list[tuple[Any, ...]] = []
    for block in blocks:
        for i, row in enumerate(block.rows):
            for j, column in enumerate(block.columns):
                unit = f"({block.row_units[i]})/({block.column_units[j]})"
                rows.append((block.name, row, column, block.values[i, j], unit))
    unit_of = model.point.model.unit
    for name, value in zip(model.states, model.state_offsets.tolist(), strict=True):
        rows.append(("X0", name, "", value, unit_of(name)))
    for name, value in zip(model.inputs, model.input_offsets.tolist(), strict=True):
        rows.append(("U0", name, "", value, unit_of(name)))
    return Table(("matrix", "row", "column", "value", "unit"), rows)


def units_in_words(model: LinearModel) -> str:
    """The units that the entries of the matrices are made of, and which names have others: "rad,
    ft, s, but elevator, aileron in deg"."""
    units = model.point.model.units
    length = next(
        (unit for state in model.state_units for unit in _base_units(state) if unit in _LENGTHS), ""
    )
    names = dict.fromkeys((*model.states, *model.inputs, *model.outputs))
    time = model.point.model.time_unit
    common = {"rad", length, time}
    others: dict[str, list[str]] = {}
    present = {time}
    for name, unit in zip(names, units(tuple(names)), strict=True):
        bases = _base_units(unit)
        if bases <= common:
            present |= bases
        else:
            others.setdefault(unit, []).append(name)
    words = ", ".join(unit for unit in ("rad", length, time) if unit in present)
    if others:
        listed = [f"{', '.join(names)} in {unit}" for unit, names in others.items()]
        words += f", but {'; '.join(listed)}"
    return words


def _base_units(unit: str) -> set[str]:
    """The units that a unit is made of: ft and s of ft/s^2."""
    return {*re.findall(r"[A-Za-z%]+", unit)}


def matrices(model: LinearModel) -> tuple[Table, ...]:
    """A and B with their names, C and D where the outputs are not the states."""
    return tuple(
        matrix_table(block.name, block.rows, block.columns, block.values)
        for block in _blocks(model)
    )


def _blocks(model: LinearModel) -> list[Block]:
    """The matrices of the text and of the records."""
    signals = model.point.model
    of_states = (model.states, model.state_units)
    of_inputs = (model.inputs, model.input_units)
    rates = (model.states, tuple(signals.rate_unit(name) for name in model.states))
    blocks = [Block("A", *rates, *of_states, model.A), Block("B", *rates, *of_inputs, model.B)]
    if model.outputs != model.states:
        outputs = (model.outputs, signals.units(model.outputs))
        blocks.append(Block("C", *outputs, *of_states, model.C))
        blocks.append(Block("D", *outputs, *of_inputs, model.D))
    return blocks


def _positions(what: str, names: tuple[str, ...] | None, known: tuple[str, ...]) -> list[int]:
    """Where the names stand among the known ones; None names all."""
    chosen = known if names is None else names
    positions = {name: index for index, name in enumerate(known)}
    for index, name in enumerate(chosen):
        if name not in positions:
            refuse_unknown(f"unknown {what}", name, known)
        if name in chosen[:index]:
            raise BadInputError(f"{what} {name} is named twice; name it once")
    return [positions[name] for name in chosen]


@checks_arguments
def linearize(
    model: Model,
    point: OperatingPoint,
    *,
    full: bool = False,
    outputs: tuple[str, ...] | None = None,
    disturbances: tuple[str, ...] | None = None,
) -> LinearModel:
    """The linear model at an operating point, exact to rounding.

    A = ∂f/∂X, B = ∂f/∂U, C = ∂y/∂X, D = ∂y/∂U, E = ∂f/∂w, F = ∂y/∂w at (X0, U0) and w = 0, by
    algorithmic differentiation; at a kink the means of two slopes.

    model: the aircraft
    point: its operating point
    full: all states; otherwise the model's linear states, of the HFA the paper's six (Section 2.2).
    outputs: names of outputs or of states; None for the states of the model.
    disturbances: names; None for the first one where outputs are asked for, else for none.

    BadInputError when the point is of another model, or a name is unknown.

    >>> import hfa
    >>> point = hfa.find_operating_point(hfa.aircraft(), hfa.paper.level_flight(0.2))
    >>> hfa.linearize(hfa.aircraft(), point).A.shape
    (6, 6)
    """
    point.refuse_other(model)
    every_state = tuple(model.states)
    states = every_state if full else model.linear
    rows = np.array([every_state.index(name) for name in states])
    shown = tuple(outputs or states)
    if outputs:
        _positions("output", shown, (*every_state, *model.outputs))
    if disturbances is None:
        disturbances = tuple(model.disturbances)[: 0 if outputs is None else 1]
    else:
        _positions("disturbance", disturbances, tuple(model.disturbances))
    x = np.array([point.states])
    u = np.array([point.inputs])
    exact = model.at(x[0], u[0], shown, disturbances)
    smoothed = with_means_at_kinks(model, x, u, model.p[None], exact.A[None], exact.B[None])
    return LinearModel(
        A=smoothed.A[0].take(rows, axis=0).take(rows, axis=1),
        B=smoothed.B[0].take(rows, axis=0),
        states=states,
        inputs=tuple(model.inputs),
        point=point,
        outputs=shown,
        C=exact.C.take(rows, axis=1),
        D=exact.D,
        E=exact.E.take(rows, axis=0),
        F=exact.F,
        output_offsets=exact.y,
        disturbances=tuple(disturbances),
        kinks=smoothed.notes.get(0, ()),
    )


@checks_arguments
def level_model(model: Model, scheduled: float) -> LinearModel:
    """The linear model at the model's own trim, of the HFA the paper's level flight.

    model: the aircraft
    scheduled: value of its scheduling variable, of the HFA the dihedral, rad

    TrimError when there is no such trim.

    >>> import hfa
    >>> hfa.paper.level_model(hfa.aircraft(), 0.2).states
    ('speed', 'alpha', 'pitch', 'pitch_rate', 'dihedral', 'dihedral_rate')
    """
    condition = usual_condition(model).at(hold={model.schedule: scheduled})
    return linearize(model, find_operating_point(model, condition))
