"""Types of the results that this extension writes to files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from hfa_support.reporting.results import Matrix, Result, Stack, Vector


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerTable(Result):
    """A controller x' = A x + B y + W (applied - u), u = C x + D y at N scheduling values.

    feedback: feedback of the states or of outputs.
    dynamics: published or newton, or the name of another model.
    parameters: hash of the parameters of the aircraft.
    states: names of the controller states x.
    measurements: names of the first part of y, the first columns of B and D.
    commands: names of the second part of y, the last columns of B and D.
    inputs: names of the rows of C and D.
    dihedrals: dihedral angles of the table, rad, N.
    places: with --aircraft: scheduling values of the table, N.
    A: (N, n, n).
    B: (N, n, p).
    C: (N, m, n).
    D: (N, m, p).
    W: (N, n, m), gain of the applied minus the commanded u.
    command_filter: bandwidth rad/s and damping, empty without a filter.
    """

    feedback: Literal["state", "output"]
    dynamics: str
    parameters: str
    states: Sequence[str]
    measurements: Sequence[str]
    commands: Sequence[str]
    inputs: Sequence[str]
    dihedrals: Vector | None = None
    places: Vector | None = None
    A: Stack
    B: Stack
    C: Stack
    D: Stack
    W: Stack
    command_filter: Vector


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerData(ControllerTable):
    """A scheduled controller and its margins.

    signal_units: unit of each measurement, then of each command.
    state_units: unit of each state, empty if its name does not imply one.
    input_units: unit of each input.
    design: name or file of the design.
    schedule: name of the scheduling variable.
    delta: delta of the game, null for none.
    angles: for each scheduling value: dihedral or the scheduling variable, delta_min or gamma_min,
      checks.
    margins: ok, checks, and rows of scheduling value, actuators, abscissa and loops: gain dB, phase
      deg, crossover rad/s, delay s.
    """

    schema = "hfa.controller-design/1"
    made_by = "hfa design"

    signal_units: Sequence[str]
    state_units: Sequence[str]
    input_units: Sequence[str]
    design: str
    schedule: str
    delta: float
    angles: Sequence[Mapping[str, Any]]
    margins: Mapping[str, Any] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class ControllerFile(ControllerTable):
    """Content of a controller file.

    name: name of the design.
    trim_states: (N, states of the aircraft) X0.
    trim_inputs: (N, inputs of the aircraft) U0.
    about: JSON text: delta, angles with delta_min or gamma_min and checks, provenance.
    units: units of all numbers, if they are not those that the aircraft declares.
    """

    schema = "hfa.controller/1"
    made_by = "hfa design -o FILE.npz: the controller"

    about: str
    name: str
    trim_states: Matrix
    trim_inputs: Matrix
    units: Literal["si"] | None = None
