"""Flights that track a reference with the exact feedforward, and without: `hfa fly --reference`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.gare import solve
from controller.tracking import Tracking, tracked
from hfa_aircraft.waveform import Waveform, stacked
from hfa_flight.policies.policy import GainPolicy, Policy
from hfa_flight.simulate.flight import Flight
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, shown_unit, shown_value
from trim.linear.linear_model import LinearModel


def tracking_of(
    linear: LinearModel, game: Game, policy: Policy, reference: Mapping[str, Waveform]
) -> Tracking:
    """Return the tracking of a reference by the gain of a policy and the feedforward of a game.

    Raises BadInputError for a policy without a constant gain.
    """
    if not isinstance(policy, GainPolicy) or policy.gain is None:
        raise BadInputError(
            f"--reference requires a policy u = -K z, not the {policy.name}; give a file with a "
            "gain K, as `hfa solve -o FILE` writes without --order, or a law"
        )
    commands = stacked(reference, linear.states)
    return tracked(linear, solve(game), policy.gain, commands)


def with_tracking(report: Report, tracking: Tracking, flown: Flight, plain: Flight) -> Report:
    """Return the report of a policy with a section on its tracking errors.

    flown: the flight with feedforward
    plain: the flight without feedforward
    """
    names = tracking.game.names
    late = [np.array([each.rms_error[state] for state in names.states]) for each in (flown, plain)]
    rows = []
    for state, unit, *values in zip(names.states, names.state_units, *late, strict=True):
        shown = (shown_value(float(value), unit, ".3g") for value in values)
        rows.append((state, shown_unit(unit), *shown))
    header = ("rms error, 2nd half", "unit", "flight", "without feedforward")
    parts = [*report.parts, tracking.report().title, Table(header, rows)]
    for flight, which in ((flown, "With"), (plain, "Without")):
        if flight.departure is not None:
            parts.append(f"{which} feedforward, the flight {flight.departure.text()}")
    errors = dict(
        zip(("late_rms_errors", "late_rms_errors_without_feedforward"), late, strict=True)
    )
    return replace(report, parts=(*parts, *tracking.trim_parts())).with_data(
        errors, tracking=tracking
    )
