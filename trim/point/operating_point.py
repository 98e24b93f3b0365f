"""Operating points, trimmed or not: state, input and the residual of each equation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_aircraft.signals import StatesAndInputs, record
from hfa_support.errors import BadInputError, file_faults, refuse_unknown, shortened
from hfa_support.files import NUMBER, checked, read_json, write_text
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Record, Result, json_text
from hfa_support.reporting.text import in_degrees
from hfa_support.units import conversion_factor
from trim.point.status import Status

if TYPE_CHECKING:
    from hfa_support.reporting.rows import ByName, Sheet
    from trim import LinearModel, Mode
    from trim.point.margins import Margin
    from trim.point.problem import TrimProblem, Undetermined


SCHEMA = "hfa.operating-point/1"

#: Entries of a saved point, those with * required; files of later versions may contain more (...).
_FILE: dict[Any, Any] = {
    "schema*": (SCHEMA,),
    "dynamics*": str,
    "status*": tuple(Status),
    "state_units": {str: str},
    "input_units": {str: str},
    "residuals*": {str: NUMBER},
    ...: None,
}


@dataclass(frozen=True, repr=False)
class OperatingPoint(StatesAndInputs, Result, Reported):
    """State X0 and input U0, with the residual of each equation.

    A residual is dX/dt(X0, U0) - imposed rate, or y(X0, U0) - imposed output.

    states: X0, by name, in the units of the model.
    inputs: U0, by name.
    residuals: state or output -> residual of its equation, in the unit of the equation.
    status: "trimmed", "beyond limits" or "no trim"; "failed" if the point belongs to a `TrimError`,
        which states the reason.
    model: the model that was trimmed.
    initial_point: 0 if the search began at the default initial point, otherwise the number of
        another one (of `STARTS`).
    found_by: the problem whose search found the point, or None for one that was loaded or computed.

    >>> import hfa
    >>> point = hfa.trim(hfa.aircraft())
    >>> type(point) is hfa.OperatingPoint, point.status.value
    (True, 'trimmed')
    """

    schema = SCHEMA

    states: Record
    inputs: Record
    residuals: dict[str, float]
    status: Status
    model: Model = field(compare=False)
    initial_point: int = field(default=0, compare=False)
    found_by: TrimProblem | None = field(default=None, compare=False)

    @classmethod
    def _of(
        cls, problem: TrimProblem, z: np.ndarray, status: Status, initial_point: int = 0
    ) -> OperatingPoint:
        """Return the operating point of a trim problem for scaled unknowns z, (k,)."""
        at = problem.at(z)
        scaled = zip(problem.system.equations.rows, at.residual.tolist(), strict=True)
        by_name = {row.name: residual * row.scale for row, residual in scaled}
        # in the order of the states and outputs, whichever equations the unknowns affect
        residuals = {row.name: by_name[row.name] for row in problem.system.structure.rows}
        return cls(
            states=at.x,
            inputs=at.u,
            residuals=residuals,
            status=status,
            model=problem.model,
            initial_point=initial_point,
            found_by=problem,
        )

    @cached_property
    def trim_problem(self) -> TrimProblem:
        """The solved problem, or that of the declared trim for a point not found by a search."""
        if self.found_by is not None:
            return self.found_by
        from trim.point.condition import usual_condition
        from trim.point.problem import TrimProblem

        return TrimProblem(self.model, usual_condition(self.model), self.values)

    @property
    def ok(self) -> bool:
        """True if the point is trimmed within the limits."""
        return self.status == Status.TRIMMED

    @property
    def scaled_residuals(self) -> dict[str, float]:
        """Residual of each equation divided by the scale of the equation, state or output ->
        number.
        """
        return {name: value / self.scale(name) for name, value in self.residuals.items()}

    @property
    def residual(self) -> float:
        """Largest magnitude of the scaled residuals, at most 1e-10 for a trim."""
        return max(map(abs, self.scaled_residuals.values()), default=0.0)

    @cached_property
    def values(self) -> dict[str, float]:
        """Values of the states, inputs, and outputs that replace states, name -> value."""
        names = [*self.model.replaced.values()]
        replacing = self.model.outputs_at(self.states, self.inputs, names) if names else {}
        return self.states._asdict() | self.inputs._asdict() | replacing

    @cached_property
    def _outputs(self) -> dict[str, float]:
        """Values of the outputs, name -> value."""
        return self.model.outputs_at(self.states, self.inputs)

    def __getitem__(self, name: str) -> float:
        """Return the value of a state, an input or an output, in the units of the model.

        Raises BadInputError if the model does not have such a name.
        """
        if name in self.values:
            return self.values[name]
        if name not in self.model.outputs:
            refuse_unknown("unknown variable", name, self.keys())
        return self._outputs[name]

    def __iter__(self) -> Iterator[str]:
        """Yield the names of the states, the inputs and the outputs."""
        yield from self.keys()

    def keys(self) -> tuple[str, ...]:
        """Return the names of the states, inputs and outputs, the keys of dict(point)."""
        return (*self.model.states, *self.model.inputs, *self.model.outputs)

    @property
    def x(self) -> np.ndarray:
        """State X0 as an array, (n,)."""
        return np.array(self.states)

    @property
    def u(self) -> np.ndarray:
        """Input U0 as an array, (m,)."""
        return np.array(self.inputs)

    @property
    def dynamics(self) -> str:
        """Name of the model. That of the flexible aircraft names its equations: "published"."""
        return self.model.name

    @property
    def state_units(self) -> dict[str, str]:  # type: ignore[override]  # by name
        """Unit of each state, name -> unit."""
        return {name: self.model.unit(name) for name in self.model.states}

    @property
    def input_units(self) -> dict[str, str]:  # type: ignore[override]  # by name
        """Unit of each input, name -> unit."""
        return {name: self.model.unit(name) for name in self.model.inputs}

    @property
    def dihedral_deg(self) -> float | None:
        """Dihedral angle of the flexible aircraft, degrees, or None for other models."""
        is_flexible_aircraft = self.model.about.names_schedule  # of this model alone
        return in_degrees(self.values[self.model.schedule]) if is_flexible_aircraft else None

    @property
    def scheduled(self) -> dict[str, float] | None:
        """Value of the scheduling variable, name -> value, as files contain it.

        The mapping is {} if the model has no scheduling variable, or if that is a parameter. It is
        None for the paper's flexible aircraft, whose files contain `dihedral_deg` instead.
        """
        name = self.model.schedule
        if self.model.about.names_schedule:  # of the flexible aircraft alone
            return None
        return {name: self.values[name]} if name in self.values else {}

    @property
    def at_scheduled(self) -> str:
        """Text with the scheduling variable and its value, "at dihedral 15 deg", or "" if the
        variable is not in `values`.
        """
        name = self.model.schedule
        if name not in self.values:
            return ""
        return f"at {name} {self.model.describe(name, self.values[name])}"

    @property
    def warnings(self) -> list[str]:
        """Notes on the point.

        The notes are those of the model, those on angles in degrees, and those on states beyond the
        range of validity.
        """
        notes = [*self.model.about.notes]
        in_declared_units = self.model.native
        if any(signal.unit == "deg" for signal in in_declared_units.signals.values()):
            from hfa_aircraft.units import notes_on_degrees

            notes += notes_on_degrees(self.model)
        return notes + beyond_range(
            self.model, {name: self[name] for name in self.model.domain.range}
        )

    @cached_property
    def margins(self) -> dict[str, Margin]:
        """Margins of each state, input and relevant output, name -> `Margin` (`all_margins`)."""
        from trim.point.margins import all_margins

        problem = self.trim_problem
        undetermined = (*problem.idle, *problem.kept)
        return all_margins(self.model, problem.asked, self.states, self.inputs, undetermined)

    @cached_property
    def _undetermined(self) -> Undetermined:
        """The free variables that the equations do not determine at this trim."""
        from trim.point.problem import Undetermined, undetermined

        if self.found_by is None or not self.ok:
            return Undetermined([], 0)
        return undetermined(self.found_by, self.found_by.system.scaled(self.values))

    @property
    def _large_angles(self) -> list[str]:
        """Texts on free angles without limits that exceed 90 deg, such as "bank 154 deg"."""
        if self.found_by is None:
            return []
        system = self.found_by.system
        far = np.abs(system.scaled(self.values)) > system.quarter_turn
        return [
            f"{name} {self.model.describe(name, self.values[name])}"
            for name, is_far in zip(self.found_by.free, far, strict=True)
            if is_far
        ]

    def _refuse_other_model(self, model: Model) -> None:
        """Raise BadInputError if the point was not trimmed with this model's units and dynamics."""
        # `native` is the original of a model that was converted to SI units.
        if bool(self.model.source.native) != bool(model.source.native):
            raise BadInputError(
                "the operating point and the model have different units; trim this model"
            )
        if self.model.name != model.name:
            raise BadInputError(
                f"the operating point was trimmed with {self.model.name!r} dynamics, but the"
                f" aircraft has {model.name!r}; trim the aircraft again"
            )

    def scale(self, equation: str) -> float:
        """Return the scale of an equation's residual, in the unit of the equation.

        equation: name of a state or an output
        """
        model = self.model
        if equation in model.states:
            return model.rate_scale(equation)
        return model.signal(equation).nominal

    def equation_unit(self, equation: str) -> str:
        """Return the unit of an equation's residual: the unit of a rate, or of an imposed output.

        equation: name of a state or an output
        """
        model = self.model
        return model.rate_unit(equation) if equation in model.states else model.unit(equation)

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "states": self.states,
            "inputs": self.inputs,
            "residuals": self.residuals,
            "status": self.status,
            "state_units": self.state_units,
            "input_units": self.input_units,
            "dynamics": self.dynamics,
        }

    @cached_property
    def in_coherent_units(self) -> OperatingPoint:
        """The point in radians and coherent units (`hfa_aircraft.units.coherent`), from which the
        figures of reports are computed.
        """
        from hfa_aircraft.units import coherent

        model = coherent(self.model)
        if model is self.model:
            return self
        values = {}
        for name in (*model.states, *model.inputs):
            # None for a unit that is not known, and is therefore not converted
            factor = conversion_factor(self.model.unit(name), model.unit(name)) or 1.0
            values[name] = self.values[name] * factor
        return _point_at(model, values, status=self.status)

    # Functions of a point, which the package `trim` offers.

    @cached_property
    def sheet(self) -> Sheet:
        """Figures of the trim, found by name: sheet["static margin"].value (`trim.sheet_of`)."""
        import trim

        return trim.sheet_of(self)

    def report(self) -> Report:
        """Return the report of the trim that `hfa trim` prints (`trim.trim_report`)."""
        import trim

        return trim.trim_report(self)

    @cached_property
    def modes(self) -> ByName[Mode]:
        """Modes of the linear model at the point, fastest first, found by number or name."""
        return self.linearize().modes

    def linearize(self, **options: Any) -> LinearModel:
        """Return the linear model at the point.

        options: keyword arguments of `hfa.linearize`
        """
        import trim

        return trim.linearize(self.model, self, **options)

    def save(self, path: str | Path, document: str = "") -> None:
        """Write the point as .json, from which `load` restores the exact numbers, or its sheet.

        The sheet is written as `Report.save` does.

        document: number and revision of the document, in the head of a sheet
        """
        if Path(path).suffix.lower() == ".json":
            write_text(path, json_text(self.to_dict()))
        else:
            self.report().save(path, document)

    @staticmethod
    def load(path: str | Path, model: Model) -> OperatingPoint:
        """Return an operating point of a model from a file.

        path: file of the point, of a trim, or of a linear model
        model: model of the point

        Raises BadInputError, which names the file and the fault, if the file contains no point of
        the model.
        """
        with file_faults(path):
            data = read_json(path)
        if isinstance(data, dict):
            data = data.get("operating_point", data)
        if not isinstance(data, dict) or data.get("schema") != SCHEMA:
            raise BadInputError(
                f"{path} is not an operating point of schema {SCHEMA}; save the operating point "
                "again"
            )
        entries = {
            **_FILE,
            "states*": {f"{name}*": NUMBER for name in model.states},
            "inputs*": {f"{name}*": NUMBER for name in model.inputs},
        }
        stored = checked(str(path), data, entries)
        units = stored.get("state_units", {}) | stored.get("input_units", {})
        values = {}
        for name, value in (stored["states"] | stored["inputs"]).items():
            unit = model.unit(name)
            factor = conversion_factor(units.get(name, unit), unit)
            if factor is None:
                raise BadInputError(f"{path}: {name} is in {shortened(units[name])}; use {unit}")
            values[name] = value * factor
        return _point_at(model, values, stored["residuals"], Status(stored["status"]))


def _point_at(
    model: Model,
    values: Mapping[str, float],
    residuals: dict[str, float] | None = None,
    status: Status = Status.TRIMMED,
) -> OperatingPoint:
    """Return the point with given values of the states and inputs, by name."""
    states, inputs = (
        record(tuple(names))(*(values[name] for name in names))
        for names in (model.states, model.inputs)
    )
    return OperatingPoint(states, inputs, residuals or {}, status, model)


def point_of_plant(model: Model) -> OperatingPoint:
    """Return the operating point of a linear plant, the start values of its states and inputs."""
    return _point_at(model, {name: signal.start for name, signal in model.signals.items()})


def beyond_range(model: Model, values: Mapping[str, float]) -> list[str]:
    """Return a sentence for every value beyond the model's range of validity (`Domain.range`).

    values: name -> value; a missing name counts as within the range
    """
    sentences = []
    for name, (lowest, highest, range_name) in model.domain.range.items():
        value = values.get(name, lowest)
        if not Limits.of(model, (name,), {name: (lowest, highest)}).within([value]).all():
            end = model.describe(name, lowest if value < lowest else highest)
            text = model.describe(name, value)
            sentences.append(f"{name} {text} is beyond {range_name}, which ends at {end}")
    return sentences
