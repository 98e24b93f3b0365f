"""A linear model at an operating point: how it is made, and what it says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.reporting.fields import ByValue
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result, Roots, Vector
from hfa_support.reporting.text import Table, degrees, matrix_table
from hfa_support.reporting.unit_system import unit_in_force
from trim.linear.frequency import Transfer
from trim.linear.kinks import with_means_at_kinks
from trim.linear.modes import Mode, modes_of, modes_table
from trim.point.condition import usual_condition
from trim.point.operating_point import OperatingPoint, PointData, at_scheduled, scheduled_data
from trim.point.solve import find_operating_point

if TYPE_CHECKING:
    import control
    from matplotlib.figure import Figure

    from trim.hfa.printed import Bands


#: Condition number, in nominal units, from which a matrix counts as singular.
_SINGULAR = 1e12


@dataclass(frozen=True, eq=False, repr=False)
class LinearModel(ByValue, Reported):
    """x' = A x + B u + E w, y - Y0 = C x + D u + F w with x = X - X0, u = U - U0 (paper Eq. 9).

    A: (n, n), B: (n, m). states, inputs: names, in order; units in `state_units`, `input_units`.
    point: the operating point, whose values are the offsets X0, U0. outputs: names y, in order; the
    states unless others were asked for, with C (k, n) the identity and D (k, m) zero.
    output_offsets: Y0, (k,). disturbances: names w; without any E (n, l) and F (k, l) have no
    columns. kinks: entries of A and B whose one-sided slopes differ, in words."""

    A: np.ndarray
    B: np.ndarray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    point: OperatingPoint
    outputs: tuple[str, ...]
    C: np.ndarray
    D: np.ndarray
    E: np.ndarray
    F: np.ndarray
    output_offsets: np.ndarray
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
    def warnings(self) -> list[str]:
        """What to know before trusting it: of the operating point, and of entries at a kink."""
        return [*self.point.warnings, *self.kinks]

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Modes of A, fastest first, named as the model has it."""
        return modes_of(self.A, self.states, self.point.model.modes)

    @property
    def state_offsets(self) -> np.ndarray:
        """X0 of the model's states, (n,)."""
        return np.array([getattr(self.point.states, name) for name in self.states])

    @property
    def input_offsets(self) -> np.ndarray:
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
        rows, columns = (
            _positions("state", states, self.states),
            _positions("input", inputs, self.inputs),
        )
        left = _positions("state", (*states, *residualize), self.states)[len(rows) :]
        if not rows:
            raise BadInputError(
                "no state is left in the model; leave at least one out of residualize"
            )
        seen = rows if self.outputs == self.states else list(range(len(self.outputs)))
        A22 = self.A[np.ix_(left, left)]
        sizes = np.array([self.point.model.states[name].nominal for name in residualize])
        if left and np.linalg.cond(A22 * sizes / sizes[:, None]) > _SINGULAR:
            raise BadInputError(
                f"{', '.join(residualize)} cannot follow the other states: their rates do not determine them (A22 is "
                "singular); residualize fewer"
            )
        kept: dict[str, Any] = {}
        winds = list(range(len(self.disturbances)))
        for of_rates, of_outputs, by in (("A", "C", rows), ("B", "D", columns), ("E", "F", winds)):
            rates, shown = (
                getattr(self, of_rates)[:, by],
                getattr(self, of_outputs)[np.ix_(seen, by)],
            )
            kept |= {of_rates: rates[rows], of_outputs: shown}
            if left:
                follow = -np.linalg.solve(A22, rates[left])
                kept[of_rates] = rates[rows] + self.A[np.ix_(rows, left)] @ follow
                kept[of_outputs] = shown + self.C[np.ix_(seen, left)] @ follow
        return replace(
            self,
            states=tuple(self.states[i] for i in rows),
            inputs=tuple(self.inputs[i] for i in columns),
            outputs=tuple(self.outputs[i] for i in seen),
            output_offsets=self.output_offsets[seen],
            **kept,
        )

    def zeros(self) -> np.ndarray:
        """Transmission zeros from all inputs to all outputs, 1/s."""
        from trim.linear.frequency import scaled, transmission_zeros

        return transmission_zeros(*scaled(self))[0]

    def transfers(self) -> list[Transfer]:
        """The transfer function of each output and input, outputs first."""
        from trim.linear.frequency import transfers

        return transfers(self)

    def frequency_response(self, omega: Any = None) -> control.FrequencyResponseData:
        """C (iω - A)⁻¹ B + D at ω, rad/s, (outputs, inputs, N); python-control chooses ω unless
        given."""
        import control

        return control.frequency_response(self.to_control(), omega)

    def bode(self) -> Figure:
        """Its magnitude and phase, a column an output and a line an input."""
        from trim.linear.frequency import bode_figure

        return bode_figure(self)

    def report(self) -> Report:
        """A, B, offsets and modes."""
        return linear_model_report(self)

    def to_control(self) -> control.StateSpace:
        """The same model as python-control's `StateSpace`, names kept."""
        import control

        names = {
            "states": list(self.states),
            "inputs": list(self.inputs),
            "outputs": list(self.outputs),
        }
        return control.ss(self.A, self.B, self.C, self.D, **names)


def reduction_note(
    model: LinearModel, whole: LinearModel, residualized: tuple[str, ...] = ()
) -> str:
    """What a model of fewer states does to the eigenvalues of the whole one; "" where no state of
    it is missing."""
    left = tuple(name for name in whole.states if name not in (*model.states, *residualized))
    kinds = (left, "left out (truncated)"), (residualized, "residualized (at rest at every moment)")
    said = [
        f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} {how}"
        for names, how in kinds
        if names
    ]
    found, known = np.linalg.eigvals(model.A), np.linalg.eigvals(whole.A)
    off = max(
        float(np.min(np.abs(each - known) / np.maximum(np.abs(known), 1e-12))) for each in found
    )
    more = "" if residualized else " (--residualize names states that follow instead)"
    apart = f"the eigenvalues lie up to {100 * off:.2g} % from those of all {len(whole.states)} states{more}"
    return f"{'; '.join(said)}; {apart}" if said else ""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModelData(Result):
    """A linear model as data; angles in radians.

    dihedral_deg: dihedral angle, degrees; null of other models than the HFA.
    scheduled: of other models the scheduling variable.
    dynamics: published or newton, or the name of another model.
    operating_point: X0, U0 and residuals.
    states: names of the states, in order.
    inputs: names of the inputs, in order.
    state_units: unit of each state.
    input_units: unit of each input.
    state_offsets: (n,) X0 of the states.
    input_offsets: (m,) U0.
    A: (n, n) of x' = A x + B u, deviations from the trim; unit of a row's rate per column's unit.
    B: (n, m) of the same.
    outputs: names of the outputs, in order.
    output_units: unit of each output.
    C: (k, n) of y = C x + D u.
    D: (k, m) of the same.
    disturbances: what w is, where the model has some.
    disturbance_units: unit of each w.
    E: (n, l) of x' = A x + B u + E w.
    F: (k, l) of y = C x + D u + F w.
    output_offsets: (k,) Y0.
    A_band: (n, n) two standard errors of each entry of A from the rounding of the printed matrices.
    B_band: (n, m) the same of B.
    other_dynamics: the dynamics that the model is compared with: newton for published, and the
        other way round.
    A_difference: (n, n) A with the other dynamics at the same condition minus A.
    B_difference: (n, m) the same of B.
    printed: A and B as the paper prints them, at its angles.
    warnings: what to know before trusting the result.
    modes: eigenvalues with damping, frequency, times and participation.
    handling_qualities: name -> value, unit: short period, phugoid, n/alpha, CAP, lateral modes,
        where the model declares them.
    zeros: with --bode the transmission zeros, (re, im) each, 1/s.
    transfers: with --bode the transfer function of each output and input."""

    schema = "hfa.linear-model/1"
    made_by = "hfa linearize"

    dihedral_deg: float
    scheduled: Mapping[str, float] | None = None
    dynamics: str
    operating_point: PointData
    states: Sequence[str]
    inputs: Sequence[str]
    state_units: Sequence[str]
    input_units: Sequence[str]
    state_offsets: Vector
    input_offsets: Vector
    A: Matrix
    B: Matrix
    outputs: Sequence[str]
    output_units: Sequence[str]
    C: Matrix
    D: Matrix
    disturbances: Sequence[str] | None = None
    disturbance_units: Sequence[str] | None = None
    E: Matrix | None = None
    F: Matrix | None = None
    output_offsets: Vector | None = None
    A_band: Matrix | None = None
    B_band: Matrix | None = None
    other_dynamics: str | None = None
    A_difference: Matrix | None = None
    B_difference: Matrix | None = None
    printed: Mapping[str, Any] | None = None
    warnings: Sequence[str]
    modes: Sequence[Mode]
    handling_qualities: Mapping[str, Any] | None = None
    zeros: Roots | None = None
    transfers: Sequence[Transfer] | None = None


def linear_model_report(
    model: LinearModel,
    bands: Bands | None = None,
    trust: str = "",
    *,
    other: LinearModel | None = None,
) -> Report:
    """A, B, offsets and modes; the bands of the entries, and a sentence on them, where they are
    asked for; in the data E and F too. other: the model of the other dynamics at the same
    condition, for the differences."""
    point, own, blocks = model.point, model.point.model, _blocks(model)
    shown, units = [name for name, *_ in blocks], {*model.state_units, *model.input_units}
    unit = ", ".join(sorted(units - {"1"}))
    if any("ft" in each for each in units):
        unit = f"rad, {unit_in_force('ft')}, s"
    places = (
        (*model.states, *model.inputs),
        (*model.state_offsets.tolist(), *model.input_offsets.tolist()),
    )
    offsets = [(name, *degrees(value, own.unit(name))) for name, value in zip(*places, strict=True)]
    warnings = model.warnings
    data = LinearModelData(
        **scheduled_data(point),
        dynamics=point.dynamics,
        operating_point=PointData.of(point),
        states=model.states,
        inputs=model.inputs,
        state_units=model.state_units,
        input_units=model.input_units,
        state_offsets=model.state_offsets,
        input_offsets=model.input_offsets,
        A=model.A,
        B=model.B,
        outputs=model.outputs,
        output_units=own.units(model.outputs),
        C=model.C,
        D=model.D,
        modes=model.modes,
        warnings=warnings,
    )
    if model.disturbances:
        data = replace(
            data,
            disturbances=model.disturbances,
            disturbance_units=own.units(model.disturbances),
            E=model.E,
            F=model.F,
            output_offsets=model.output_offsets,
        )
    if bands is not None:
        data = replace(data, A_band=bands.A, B_band=bands.B)
    if other is not None:
        data = replace(
            data,
            other_dynamics=other.point.dynamics,
            A_difference=other.A - model.A,
            B_difference=other.B - model.B,
        )
    records: list[tuple[Any, ...]] = []
    for name, down, across, values in blocks:
        band = getattr(bands, name) if bands is not None and name in "AB" else None
        for (i, row), (j, column) in product(enumerate(down), enumerate(across)):
            of = f"({own.rate_unit(row) if name in 'AB' else own.unit(row)})/({own.unit(column)})"
            records.append(
                (name, row, column, values[i, j], of, "" if band is None else band[i, j])
            )
    kinds = ["X0"] * len(model.states) + ["U0"] * len(model.inputs)
    records += [
        (kind, name, "", value, own.unit(name), "")
        for kind, name, value in zip(kinds, *places, strict=True)
    ]
    return Report(
        title=f"Linear model {at_scheduled(point)}, {point.called} "
        f"(x' = A x + B u,{' y = C x + D u,' * ('C' in shown)} x = X - X0, u = U - U0)\n"
        f"{', '.join(shown[:-1])} and {shown[-1]} in {unit}; the offsets X0 and U0 in the units next to them",
        parts=[
            *matrices(model),
            *filter(None, [trust]),
            Table(("offset", "value", "unit"), offsets),
            modes_table(model.modes),
        ],
        notes=warnings,
        data=data.to_dict(),
        records=Table(("matrix", "row", "column", "value", "unit", "band"), records),
    )


def matrices(model: LinearModel) -> tuple[Table, ...]:
    """A and B with their names, C and D where the outputs are not the states."""
    units = model.point.model.units
    return tuple(
        matrix_table(name, rows, columns, values, (units(rows), 1), (units(columns), -1))
        for name, rows, columns, values in _blocks(model)
    )


def _blocks(model: LinearModel) -> list[tuple[str, tuple[str, ...], tuple[str, ...], np.ndarray]]:
    """The matrices of the text and of the records: name, names of rows and of columns, values."""
    rows = [model.states] if model.outputs == model.states else [model.states, model.outputs]
    return [
        (names[i], each, across, getattr(model, names[i]))
        for i, each in enumerate(rows)
        for across, names in ((model.states, "AC"), (model.inputs, "BD"))
    ]


def _positions(what: str, names: tuple[str, ...] | None, known: tuple[str, ...]) -> list[int]:
    """Where the names stand among the known ones; None names all."""
    chosen = known if names is None else names
    for name in chosen:
        refuse_unknown(f"unknown {what}", name, known)
        if chosen.count(name) > 1:
            raise BadInputError(f"{what} {name} is named twice; name it once")
    return [known.index(name) for name in chosen]


def linearize(
    aircraft: Model,
    point: OperatingPoint,
    *,
    full: bool = False,
    outputs: tuple[str, ...] | None = None,
    disturbances: tuple[str, ...] | None = None,
) -> LinearModel:
    """A = ∂f/∂X, B = ∂f/∂U, C = ∂y/∂X, D = ∂y/∂U, E = ∂f/∂w, F = ∂y/∂w at (X0, U0) at w = 0, by
    algorithmic differentiation (exact to rounding).

    Returns the model's linear states, of the HFA the paper's six (Section 2.2), or all of them when
    `full`. outputs: names of outputs or of states; None for the states of the model. disturbances:
    names; None for the first one where outputs are asked for. The HFA's are winds, ft/s.
    BadInputError when the point is of another model or other dynamics, or a name is unknown."""
    own = aircraft
    point.refuse_other(own)
    plain = outputs is None and disturbances is None
    seen = tuple(own.states) if plain else tuple(outputs or (own.states if full else own.linear))
    winds = tuple(
        disturbances if disturbances is not None else [*own.disturbances][: outputs is not None]
    )
    _positions("output", seen, (*own.states, *own.outputs))
    _positions("disturbance", winds, tuple(own.disturbances))
    found = own.at(point.states, point.inputs, seen, winds)
    x, u = np.array([point.states]), np.array([point.inputs])
    smoothed = with_means_at_kinks(own, x, u, own.p[None], found.A[None], found.B[None])
    A, B, kinks = smoothed.A[0], smoothed.B[0], smoothed.notes.get(0, ())
    names = tuple(own.states), tuple(own.inputs)
    model = LinearModel(A, B, *names, point, seen, *found[4:], found.y, winds, kinks)
    return model if full else model.select(own.linear)


def level_model(aircraft: Model, scheduled: float) -> LinearModel:
    """A, B at the model's own trim with this value of its scheduling variable, of the HFA the
    paper's level flight with this dihedral, rad. Raises TrimError when there is no such trim."""
    model = aircraft
    return linearize(
        aircraft,
        find_operating_point(aircraft, usual_condition(model).at(hold={model.schedule: scheduled})),
    )
