"""Types of the results that this extension writes to files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hfa_support.reporting.results import Result, Vector


@dataclass(frozen=True, kw_only=True, eq=False)
class MemberSummary(Result):
    """Outcomes of the members of a Monte Carlo simulation.

    dynamics: published or newton, or the name of another model.
    plant: nonlinear or linear.
    law: name of the policy.
    members: number of flights.
    seed: seed of all random numbers.
    duration: s.
    within_limits: number of flights inside the envelope and control limits, without limit cycle.
    held: number of flights that stayed inside the envelope.
    first_left: time of the first departure, s, or null if there is none.
    left: state -> number of flights in which it left the envelope first.
    exceeded: input -> number of flights in which it exceeded its control limit.
    limit_cycle: input or state -> number of flights that end in its limit cycle.
    quantiles: levels of the quantiles below.
    rms_error: quantiles of the rms error of each state, over the flight.
    peak_error: quantiles of the largest error of each state.
    effort: quantiles of the rms deviation of each input.
    peak_deviation: quantiles of the largest deviation of the angle of attack relative to the air.
    store: path of the store of members, null if there is none.
    warnings: notes on the result.
    final: quantiles of each state at the end.
    drawn: parameters that differ between the members' aircraft.
    """

    schema = "hfa.monte-carlo-summary/1"

    dynamics: str
    plant: str
    law: str
    members: int
    seed: int
    duration: float
    within_limits: int
    held: int
    first_left: float | None
    left: Mapping[str, int]
    exceeded: Mapping[str, float]
    limit_cycle: Mapping[str, float]
    quantiles: Vector
    rms_error: Mapping[str, Vector | None]
    peak_error: Mapping[str, Vector | None]
    effort: Mapping[str, Vector | None]
    peak_deviation: Mapping[str, Vector | None] | None = None
    store: Any = None
    warnings: Sequence[str] | None = None
    final: Mapping[str, Vector | None] | None = None
    drawn: Sequence[str] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class MemberAttributes(Result):
    """Attributes of a Zarr store of members.

    errors: parameters that are drawn.
    left: name of the state for each number in the array `left`.
    error_states: states whose errors are stored, in order.
    error_units: unit of each error.
    states: names of the states, in order.
    state_units: unit of each state.
    inputs: names of the inputs, in order.
    input_units: unit of each input.
    plan: JSON text of everything that determines the results.
    """

    schema = "hfa.monte-carlo-store/3"

    errors: Sequence[str]
    left: Sequence[str]
    error_states: Sequence[str]
    error_units: Sequence[str]
    states: Sequence[str]
    state_units: Sequence[str]
    inputs: Sequence[str]
    input_units: Sequence[str]
    plan: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Exported(Result):
    """Files that `hfa export` wrote.

    files: name and size, bytes, of each file.
    """

    schema = "hfa.export/1"

    files: Sequence[Mapping[str, Any]]
