"""A sweep: trims and linear models over a grid of conditions, and what it says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_model.reporting.report import Block, Picture, Report, Reported
from hfa_model.reporting.text import RowsMade, Table, eigenvalue_text, shown_unit, shown_value
from hfa_model.support.by_value import ByValue
from hfa_model.vectors import INPUT_UNITS, INPUTS, STATE_UNITS, STATES, UNITS, entry_unit
from trim.point.named_condition import LEVEL_FLIGHT, NamedCondition
from trim.point.operating_point import Status
from trim.sweeps.root_locus import RootLocus
from trim.sweeps.sweep_plan import range_warnings

SCHEMA = "hfa.sweep/1"


@dataclass(frozen=True, eq=False, repr=False)
class Sweep(ByValue, Reported):
    """N points in the order of the grid, the last variable running fastest.

    axes: variable -> its values. values: (N, variables), all combinations of them. reasons: "" where trimmed, else
    why not. states: (N, 7), inputs: (N, 5), A: (N, n, n), B: (N, n, 5), eigenvalues: (N, n), a column following one
    mode through the sweep; nan where the trim failed. mode_names: name of each column where the sweep begins.
    condition: what the trims impose beside the values.
    Units: rad, ft, s as in `vectors.py`, entries of A and B as in `entry_unit`, eigenvalues 1/s.
    """

    axes: Mapping[str, tuple[float, ...]]
    values: np.ndarray
    reasons: tuple[str, ...]
    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    eigenvalues: np.ndarray
    model_states: tuple[str, ...]
    mode_names: tuple[str, ...]
    dynamics: str
    condition: NamedCondition = LEVEL_FLIGHT

    @property
    def variables(self) -> tuple[str, ...]:
        """Names of what varies, in order."""
        return tuple(self.axes)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each variable, in order."""
        return tuple(UNITS[name] for name in self.axes)

    @property
    def trimmed(self) -> np.ndarray:
        """(N,) true where a trim was found."""
        return np.array([reason == "" for reason in self.reasons])

    @property
    def root_locus(self) -> RootLocus:
        """The eigenvalues over the last variable."""
        return RootLocus(self.variables[-1], self.values[:, -1], self.eigenvalues, self.mode_names, self.dynamics)

    @property
    def warnings(self) -> list[str]:
        """What a user should know before trusting the sweep."""
        if "dihedral" not in self.variables:
            return []
        return range_warnings(self.values[:, self.variables.index("dihedral")])

    def report(self) -> Report:
        """One line a point: the varied values and the eigenvalues of each mode, or why there is no trim.

        A conjugate pair has one column; where it splits into two real eigenvalues, both stand in it.
        """
        modes = tuple(dict.fromkeys(self.mode_names))
        members = [[i for i, each in enumerate(self.mode_names) if each == name] for name in modes]

        def varied(i: int) -> tuple[str, ...]:
            return tuple(map(shown_value, self.values[i], self.units))

        def row(i: int) -> tuple[str, ...]:
            if self.reasons[i]:
                return *varied(i), *("-" for _ in modes)
            return *varied(i), *(_mode_text(self.eigenvalues[i, columns]) for columns in members)

        count, warnings = len(self.reasons), self.warnings
        header = (
            *(f"{name} {shown_unit(unit)}" for name, unit in zip(self.variables, self.units, strict=True)),
            *(f"{name} 1/s" for name in modes),
        )
        failures = [f"{', '.join(varied(i))}: {reason}" for i, reason in enumerate(self.reasons) if reason]
        return Report(
            title=f"Sweep, {self.dynamics} dynamics: {int(self.trimmed.sum())} of {count} points trimmed",
            parts=(Block((Table(header, RowsMade(count, row)), *failures)), *self._picture()),
            notes=warnings,
            data=self.to_dict() | {"warnings": warnings},
            records=_records(self),
        )

    def _picture(self) -> tuple[Picture, ...]:
        """The picture of a sweep in one variable."""
        moving = np.ptp(self.values, axis=0) > 0
        if not self.mode_names or moving.sum() != 1 or not moving[-1]:
            return ()
        text = f"Eigenvalues over {self.variables[-1]}"
        return (Picture("root_locus.png", text, self.root_locus.figure),)

    def to_dict(self) -> dict[str, Any]:
        """Names, units and arrays; complex eigenvalues as [real, imaginary]."""
        return {
            "schema": SCHEMA,
            "dynamics": self.dynamics,
            "variables": list(self.variables),
            "variable_units": list(self.units),
            "grid": {name: {"values": list(axis), "unit": UNITS[name]} for name, axis in self.axes.items()},
            "condition": self.condition.to_dict(),
            "values": self.values,
            "reasons": list(self.reasons),
            "states": list(self.model_states),
            "state_units": [getattr(STATE_UNITS, name) for name in self.model_states],
            "inputs": list(INPUTS),
            "input_units": list(INPUT_UNITS),
            "operating_states": self.states,
            "operating_inputs": self.inputs,
            "A": self.A,
            "B": self.B,
            "mode_names": list(self.mode_names),
            "eigenvalues": np.stack([self.eigenvalues.real, self.eigenvalues.imag], axis=-1),
        }


def _records(result: Sweep) -> Table:
    """One row a point: the varied values, status, reason, operating point, eigenvalues, entries of A and B."""
    n = len(result.model_states)
    header = (
        *(f"{name} [{unit}]" for name, unit in zip(result.variables, result.units, strict=True)),
        "status",
        "reason",
        *(f"state {name} [{getattr(STATE_UNITS, name)}]" for name in STATES),
        *(f"input {name} [{getattr(INPUT_UNITS, name)}]" for name in INPUTS),
        *(f"{part} eigenvalue {i + 1} [1/s]" for i in range(n) for part in ("real", "imaginary")),
        *(
            f"{matrix}({row}, {column}) [{entry_unit(row, column)}]"
            for matrix, names in (("A", result.model_states), ("B", INPUTS))
            for row in result.model_states
            for column in names
        ),
    )

    def row(i: int) -> tuple[Any, ...]:
        return (
            *result.values[i],
            str(Status.FAILED if result.reasons[i] else Status.TRIMMED),
            result.reasons[i],
            *result.states[i],
            *result.inputs[i],
            *(part for value in result.eigenvalues[i] for part in (value.real, value.imag)),
            *result.A[i].ravel(),
            *result.B[i].ravel(),
        )

    return Table(header, RowsMade(len(result.reasons), row))


def _mode_text(eigenvalues: np.ndarray) -> str:
    first = eigenvalues[0]
    # A pair says both its members at once.
    others = [value for value in eigenvalues[1:] if not (value.imag and value == first.conjugate())]
    return ", ".join(eigenvalue_text(value) for value in (first, *others))
