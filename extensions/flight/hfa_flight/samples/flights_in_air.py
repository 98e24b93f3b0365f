"""Many flights of a policy from a trim, with random differences, and their report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from hfa.options.command import ProgressLine
from hfa_flight.policies.filtered_policy import FilteredPolicy
from hfa_flight.policies.given import policy_and_scenario
from hfa_flight.samples.monte_carlo import MonteCarlo
from hfa_flight.samples.report import member_report
from hfa_flight.samples.store import run_monte_carlo
from hfa_support.progress import Progress
from hfa_support.reporting.report import Report, Reported


@dataclass(frozen=True, eq=False, repr=False)
class FlightsInAir(Reported):
    """Flights of a policy from a trim, each with its own random differences.

    plan: the flights
    flown: name of a result -> its values, one row for each flight
    uncontrolled: results of the same flights without control, of a policy behind a filter, or None
    where: where the flights are stored, for the report

    >>> import hfa
    >>> from hfa_flight import Uncertainty
    >>> model = hfa.aircraft()
    >>> point = hfa.trim(model, dihedral=0.2)
    >>> noisy = hfa.Scenario(0.1, uncertainty=Uncertainty(noise={"speed": 0.3}))
    >>> hfa.fly(model, point, scenario=noisy, samples=2).ok
    True
    """

    plan: MonteCarlo
    flown: Mapping[str, np.ndarray]
    uncontrolled: Mapping[str, np.ndarray] | None = None
    where: str = "flights not kept"

    @property
    def ok(self) -> bool:
        """True if enough flights stay within their limits."""
        return bool(self.report().data["ok"])

    def __bool__(self) -> bool:
        return self.ok

    @property
    def warnings(self) -> list[str]:
        """Warnings about the trim, each once."""
        return list(dict.fromkeys(self.plan.point.warnings))

    def report(self) -> Report:
        """Return the report: flights that leave, the 95 % band of their share, and quantiles."""
        return member_report(self.plan, self.flown, self.where, self.uncontrolled)


def flights_in_air(
    plan: MonteCarlo, workers: int | str = 1, progress: Progress | None = None
) -> FlightsInAir:
    """Simulate the flights of a plan in memory.

    workers: as for `open_workers`
    progress: callback, by default a line on a terminal
    """
    flown = run_monte_carlo(plan, workers, progress or ProgressLine("simulate"))
    return FlightsInAir(plan, flown, uncontrolled(plan))


def uncontrolled(plan: MonteCarlo) -> Mapping[str, np.ndarray] | None:
    """Return the results of the same flights with the inputs at trim, or None without a filter."""
    if not isinstance(plan.policy, FilteredPolicy):
        return None
    policy, scenario = policy_and_scenario(None, plan.point, plan.scenario)
    inputs_at_trim = replace(plan, policy=policy, scenario=scenario)
    return run_monte_carlo(inputs_at_trim, 1, ProgressLine("simulate without control"))
