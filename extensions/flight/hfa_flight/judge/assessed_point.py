"""Result of an assessment at one trim."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_aircraft.batch_simulation import IntegrationError
from hfa_flight.judge.flight_costs import CostRatio
from hfa_flight.judge.outcomes import Outcomes, TrimCase
from hfa_flight.needs import ALL, is_enough
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.sampled_loop import Equilibrium, Margins
from hfa_flight.simulate.envelope import flight_envelope
from hfa_support.reporting.results import Result, without_empty
from trim.linear.delays import Delays
from trim.point.operating_point import OperatingPoint


@dataclass(frozen=True, eq=False)
class AssessedPoint(Result):
    """Assessment of a policy at one trim.

    deployed: the policy on its aircraft.
    case: the trim, its initial-condition box, equilibrium and sampled loop.
    delays: spectral radii with other delays, or None without an equilibrium.
    margins: margins of the loop, or None without an equilibrium, if the loop is unstable, or if the
        computation fails.
    flights: outcomes from seeded initial conditions, or None without flights.
    disturbed: outcomes from the same initial conditions with a disturbance pulse, or None without
        flights.
    box: fraction of the initial-condition box of the flights, below 1 if the exact gain leaves the
        envelope from the whole one.
    late: outcomes with the delay of a requirement, or None without one.
    costs: cost of the flights beside the exact gain's, or None if no costs were compared.
    remarks: reasons why parts of the assessment are missing, one sentence each.
    integration: integration error of some of the flights, or None without flights.
    share: share of the flights that must converge for the policy to hold, by default all.
    """

    deployed: Deployed
    case: TrimCase
    delays: Delays | None = None
    margins: Margins | None = None
    flights: Outcomes | None = None
    disturbed: Outcomes | None = None
    box: float = 1.0
    late: Outcomes | None = None
    costs: CostRatio | None = None
    remarks: tuple[str, ...] = ()
    integration: IntegrationError | None = None
    share: float = ALL

    @property
    def point(self) -> OperatingPoint:
        """The trim."""
        return self.case.point

    @property
    def radius(self) -> float:
        """Spectral radius of the sampled loop with the deployed delay, or nan."""
        return self.case.radius

    @property
    def equilibrium(self) -> Equilibrium | None:
        """Equilibrium of the sampled loop, or None if it does not exist."""
        return self.case.equilibrium

    @property
    def holds(self) -> bool:
        """True if the required share of the flights converges, without and with a pulse.

        Without flights, True if the sampled loop is stable at its equilibrium, within the limits of
        the states and with no action or input saturated there.
        """
        if self.flights is not None:
            return self.reaches(self.share)
        if self.equilibrium is None or self.equilibrium.clips or not self.radius < 1.0:
            return False
        return not self.beyond

    def reaches(self, share: float) -> bool:
        """Return whether a share of the flights converges, without and with a pulse."""
        flown = [outcomes for outcomes in (self.flights, self.disturbed) if outcomes is not None]
        return all(is_enough(outcomes.converged, outcomes.starts, share) for outcomes in flown)

    @property
    def beyond(self) -> list[str]:
        """Sentences on the states that exceed their limits at the equilibrium."""
        if self.equilibrium is None:
            return []
        envelope = flight_envelope(self.point.model, self.point)
        return envelope.broken(self.equilibrium.states, verb="is")

    @property
    def offset(self) -> np.ndarray | None:
        """End of the flights, or without flights the equilibrium, minus the trim, (k,), or None."""
        model = self.point.model
        rows = model.state_places(model.linear)
        if self.flights is not None:
            return np.array([*self.flights.end.values()]) - self.point.x[rows]
        return None if self.equilibrium is None else (self.equilibrium.states - self.point.x)[rows]

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value, with that of the scheduling variable."""
        equilibrium, delays, margins = self.equilibrium, self.delays, self.margins
        model = self.point.model
        states = inputs = None
        if equilibrium is not None:
            states = dict(zip(model.states, equilibrium.states.tolist(), strict=True))
            inputs = dict(zip(model.inputs, equilibrium.inputs.tolist(), strict=True))
        return (
            schedule_entry(self.point)
            | {
                "K": None if equilibrium is None else equilibrium.K,
                "delay_limit": None if delays is None else delays.limit,
                "delay_searched": None if delays is None else delays.searched,
                "disk_margin": None if margins is None else margins.disk.disk,
                "flights": self.flights,
                "disturbed": self.disturbed,
                "box": self.box,
                "remarks": self.remarks,
                "spectral_radius": self.radius,
                "holds": self.holds,
                "radii": () if delays is None else delays.radii,
                "equilibrium": states,
                "equilibrium_inputs": inputs,
                "input_margins": [
                    {
                        "gain_low": loop.gain_low,
                        "gain_high": loop.gain_high,
                        "phase_deg": loop.phase,
                        "disk": loop.disk,
                    }
                    for loop in ([] if margins is None else margins.inputs)
                ],
            }
            | without_empty(
                costs=None if self.costs is None else self.costs._asdict(),
                late=self.late,
                integration=self.integration,
            )
        )


def schedule_entry(point: OperatingPoint) -> dict[str, float]:
    """Return {key: value} of the scheduling variable at a trim, or {} if the model has none.

    Angles are in degrees.
    """
    model = point.model
    if not model.schedule:
        return {}
    if model.schedule in model.parameters:  # `start` is the value of a parameter
        value = model.parameters[model.schedule].start
    else:
        value = float(point.values[model.schedule])
    return {model.schedule_key: math.degrees(value) if model.is_typed_in_degrees else value}
