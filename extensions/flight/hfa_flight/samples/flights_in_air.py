"""Flights of a policy with random differences from one or more trims."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hfa.options.output import ProgressLine
from hfa_flight.policies.filtered_policy import FilteredPolicy
from hfa_flight.policies.given import policy_and_scenario
from hfa_flight.samples.monte_carlo import MonteCarlo
from hfa_flight.samples.report import member_report
from hfa_flight.samples.store import run_monte_carlo
from hfa_support.progress import Progress
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table

#: Columns of a CSV file, entries of the data of each trim.
_COLUMNS = ("at", "members", "within_limits", "held")


@dataclass(frozen=True, eq=False, repr=False)
class FlightsInAir(Reported):
    """Flights of a policy from each trim, in noise or moving air.

    plans: the flights from each trim
    reports: report of the flights from each trim

    >>> import hfa
    >>> from hfa_flight import Scenario, Uncertainty
    >>> noisy = Scenario(0.1, uncertainty=Uncertainty(noise={"speed": 0.3}))
    >>> hfa.assess(hfa.aircraft(), None, [0.2], samples=2, scenario=noisy).ok
    True
    """

    plans: tuple[MonteCarlo, ...]
    reports: tuple[Report, ...]

    @property
    def ok(self) -> bool:
        """True if enough flights from every trim stay within their limits."""
        return all(report.data["ok"] for report in self.reports)

    def __bool__(self) -> bool:
        return self.ok

    @property
    def warnings(self) -> list[str]:
        """Warnings about the trims, each once."""
        return list(dict.fromkeys(text for plan in self.plans for text in plan.point.warnings))

    def report(self) -> Report:
        """Return the report of the flights from a trim, or those of all trims and a verdict."""
        trims = [
            {"at": plan.point.values.get(plan.model.schedule), **report.data}
            for plan, report in zip(self.plans, self.reports, strict=True)
        ]
        data = {"schema": "hfa.flights-in-air/1", "ok": self.ok, "trims": trims}
        records = Table(_COLUMNS, [tuple(at[name] for name in _COLUMNS) for at in trims])
        if len(trims) == 1:
            return replace(self.reports[0], data=data, records=records)
        passed = sum(at["ok"] for at in trims)
        title = (
            f"{verdict_text(self.ok)}: law {self.plans[0].policy.name} passes at {passed} of "
            f"{len(trims)} trims"
        )
        parts = [
            replace(report, title=f"{plan.point.at_scheduled}: {report.title}")
            for plan, report in zip(self.plans, self.reports, strict=True)
        ]
        return Report(title, parts, data=data, records=records)


def flights_in_air(plans: Sequence[MonteCarlo], progress: Progress | None = None) -> FlightsInAir:
    """Return the simulated flights of plans, one plan for each trim."""
    return FlightsInAir(tuple(plans), tuple(flown_report(plan, 1, progress) for plan in plans))


def flown_report(
    plan: MonteCarlo, workers: int | str = 1, progress: Progress | None = None
) -> Report:
    """Simulate the flights of a plan in memory and return their report.

    workers: as for `open_workers`
    progress: callback, by default a line on a terminal
    """
    flown = run_monte_carlo(plan, workers, progress or ProgressLine("simulate"))
    return member_report(plan, flown.__getitem__, "flights not kept", uncontrolled(plan))


def uncontrolled(plan: MonteCarlo) -> Mapping[str, np.ndarray] | None:
    """Return the results of the same flights without control beside those with a filter."""
    if not isinstance(plan.policy, FilteredPolicy):
        return None
    policy, scenario = policy_and_scenario(None, plan.point, plan.scenario)
    free = replace(plan, policy=policy, scenario=scenario)
    return run_monte_carlo(free, 1, ProgressLine("simulate without control"))
