"""A trimmed (or failed) flight condition: state, input, and how well each equation balances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_model.variants import Variant
from hfa_model.vectors import (
    INPUT_UNITS,
    INPUTS,
    RATE_SCALES,
    RATE_UNITS,
    STATE_UNITS,
    STATES,
    UNITS,
    Input,
    State,
)
from hfa_support.errors import BadInputError, said_of
from hfa_support.files import read_json, write_text
from hfa_support.jsonable import json_text
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Cell, Table, angle_text, degrees
from hfa_support.reporting.unit_system import english, in_force, unit_in_force
from hfa_support.schema import NUMBER, checked
from trim.point.condition import PAPER_LIMIT, PAPER_RANGE

if TYPE_CHECKING:
    import control

SCHEMA = "hfa.operating-point/1"
#: An equation balances when its residual, in units of `RATE_SCALES`, is no larger.
BALANCE = 1e-10


class Status(StrEnum):
    """What became of a point: balanced within the limits, balanced beyond them, or not balanced at all."""

    TRIMMED = "trimmed"
    BEYOND_LIMITS = "beyond limits"
    NO_TRIM = "no trim"
    FAILED = "failed"


#: What a saved point holds; later versions may add to it.
_FILE: dict[Any, Any] = {
    "schema*": (SCHEMA,),
    "dynamics*": str,
    "status*": tuple(Status),
    "states*": {f"{name}*": NUMBER for name in STATES},
    "state_units": {str: str},
    "inputs*": {f"{name}*": NUMBER for name in INPUTS},
    "residuals*": {str: NUMBER},
    ...: None,
}


@dataclass(frozen=True, repr=False)
class OperatingPoint(Reported):
    """X0, U0 with dX/dt(X0, U0) - imposed rate = residual, equation by equation.

    states, inputs: in the units of `vectors.py`. residuals: balanced equation -> residual, in its own unit.
    dynamics: name of the variant. status: `TRIMMED`, or `FAILED` when it comes with a
    `TrimError`, which says why.
    """

    states: State
    inputs: Input
    residuals: dict[str, float]
    dynamics: str
    status: Status

    @property
    def scaled_residuals(self) -> dict[str, float]:
        """Equation -> residual in units of `RATE_SCALES`."""
        return {name: value / getattr(RATE_SCALES, name) for name, value in self.residuals.items()}

    @property
    def gamma(self) -> float:
        """γ = θ - α, flight-path angle, rad."""
        return float(self.states.pitch - self.states.alpha)

    @property
    def values(self) -> dict[str, float]:
        """State or input, and gamma -> its value."""
        return {**self.states._asdict(), **self.inputs._asdict(), "gamma": self.gamma}

    @property
    def title(self) -> str:
        """Which dynamics, and what became of the point."""
        return f"Trim, {self.dynamics} dynamics: {self.status}"

    @property
    def warnings(self) -> list[str]:
        """What a user should know before trusting a model at this point."""
        if abs(self.states.dihedral) <= PAPER_LIMIT:
            return []
        return [
            f"dihedral {angle_text(self.states.dihedral)} lies beyond the paper's range, "
            f"which ends at {angle_text(PAPER_RANGE)}"
        ]

    def refuse_other(self, variant: Variant) -> None:
        """BadInputError when the point was trimmed with other dynamics."""
        if self.dynamics != variant.name:
            raise BadInputError(
                f"the operating point was trimmed with {self.dynamics!r} dynamics, the aircraft has {variant.name!r}; "
                "trim it again"
            )

    def balances(self, equation: str) -> bool:
        """Whether the residual of an equation is small enough."""
        return abs(self.scaled_residuals[equation]) <= BALANCE

    def report(self) -> Report:
        """State, inputs and residuals: what a point holds, without the aircraft and the condition."""
        parts = _values("state", self.states._asdict()), _values("input", self.inputs._asdict()), self.equations()
        return Report(self.title, parts, self.warnings, self.to_dict(), self.records())

    def equations(self, imposed: Mapping[str, float] | None = None) -> Table:
        """One row an equation, those that do not balance first; without the imposed rates where all are zero."""
        rates = imposed if imposed and any(imposed.values()) else {}
        failing_first = sorted(self.residuals.items(), key=lambda item: self.balances(item[0]))
        rows = [
            (
                f"rate of {name}",
                *((f"{in_force(rates[name], getattr(RATE_UNITS, name)):.6g}",) if rates else ()),
                f"{in_force(value, getattr(RATE_UNITS, name)):.2e}",
                f"{in_force(tolerance(name), getattr(RATE_UNITS, name)):.2e}",
                unit_in_force(getattr(RATE_UNITS, name)),
                f"{self.scaled_residuals[name]:.2e}",
                Cell("PASS", "good") if self.balances(name) else Cell("FAIL", "bad"),
            )
            for name, value in failing_first
        ]
        header = ("equation", *("imposed",) * bool(rates), "residual", "tolerance", "unit", "scaled", "verdict")
        return Table(header, rows)

    def records(self) -> Table:
        """Header and rows (kind, name, value, unit), angles in radians."""
        rows: list[tuple[Any, ...]] = [
            *(("state", name, getattr(self.states, name), getattr(STATE_UNITS, name)) for name in STATES),
            *(("input", name, getattr(self.inputs, name), getattr(INPUT_UNITS, name)) for name in INPUTS),
            *(("residual", name, value, getattr(RATE_UNITS, name)) for name, value in self.residuals.items()),
        ]
        return Table(("kind", "name", "value", "unit"), rows)

    def to_control(self) -> control.OperatingPoint:
        """The same point as python-control's `OperatingPoint` (seven states, five inputs)."""
        import control

        return control.OperatingPoint(np.array(self.states), np.array(self.inputs), outputs=np.array(self.states))

    def to_dict(self) -> dict[str, Any]:
        """Names, units and values, ready for JSON; floats keep all 17 digits."""
        return {
            "schema": SCHEMA,
            "dynamics": self.dynamics,
            "status": str(self.status),
            "states": self.states._asdict(),
            "state_units": STATE_UNITS._asdict(),
            "inputs": self.inputs._asdict(),
            "input_units": INPUT_UNITS._asdict(),
            "residuals": self.residuals,
        }


def tolerance(equation: str) -> float:
    """The residual that an equation may have, in its own unit."""
    return float(BALANCE * getattr(RATE_SCALES, equation))


def save_operating_point(point: OperatingPoint, path: Path) -> None:
    """Write a point as JSON that `load_operating_point` reads back bit for bit."""
    write_text(path, json_text(point.to_dict()) + "\n")


def load_operating_point(path: Path) -> OperatingPoint:
    """Read a saved point, alone or inside a saved trim or linear model; BadInputError says what is wrong."""
    try:
        data = read_json(path)
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror}); give a saved operating point") from error
    if isinstance(data, dict):
        data = data.get("operating_point", data)
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise BadInputError(f"{path}: is not an operating point of schema {SCHEMA}")
    found = checked(str(path), data, _FILE)
    units, stated = STATE_UNITS._asdict(), found.get("state_units", {})
    with said_of(path):
        given = found["states"]
        states = State(**{name: english(given[name], stated.get(name, unit), unit) for name, unit in units.items()})
    inputs = Input(**{name: found["inputs"][name] for name in INPUTS})
    return OperatingPoint(states, inputs, found["residuals"], found["dynamics"], Status(found["status"]))


def _values(kind: str, values: Mapping[str, float]) -> Table:
    return Table((kind, "value", "unit"), [(name, *degrees(value, UNITS[name])) for name, value in values.items()])
