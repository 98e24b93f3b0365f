"""Assessment of a deployed policy: results at all trims, verdict and findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hfa_aircraft.control_systems import LINEAR
from hfa_flight.judge.assessed_point import AssessedPoint
from hfa_flight.judge.assessment_report import records_table, report_parts
from hfa_flight.judge.findings import Finding, Severity, findings_at_trims, where_text, worst_first
from hfa_flight.needs import IN_AIR, SHARE
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_support.reporting.report import Report, Reported, verdict_text
from hfa_support.reporting.results import Result, storable

#: Name of a requirement -> sentence if it is not satisfied.
NEEDS = {
    "delay": "a delay of {:g} s is not tolerated",
    "margin": "the disk margin is not at least {:g}",
    "cost": "the linear cost is not within {:g} % of the optimum",
    SHARE: "fewer than the share {:g} of the flights converge",
}


@dataclass(frozen=True, eq=False, repr=False)
class Assessment(Result, Reported):
    """Assessment of a policy as it is deployed, at one or more trims.

    deployed: the policy on its aircraft.
    points: results at each trim.
    needs: delay (s), margin, cost (percent) or share of the flights -> required value.
    assumed: description of the trim that was assumed because none was given, otherwise "".

    >>> import hfa
    >>> assessment = hfa.assess(deployment, points)  # doctest: +SKIP
    """

    schema = "hfa.assessment/1"

    deployed: Deployed
    points: tuple[AssessedPoint, ...]
    needs: Mapping[str, float] = field(default_factory=dict)
    assumed: str = ""

    @property
    def holds(self) -> bool:
        """True if the policy holds at every trim."""
        return all(point.holds for point in self.points)

    @property
    def warnings(self) -> list[str]:
        """Warnings about the trims, each once."""
        sentences = [text for point in self.points for text in point.point.warnings]
        return list(dict.fromkeys(sentences))

    @property
    def unmet(self) -> list[str]:
        """Requirements that are not satisfied, one sentence each."""
        sentences = []
        for name, need in self.needs.items():
            wrong = [point for point in self.points if not _meets(point, name, need)]
            if wrong:
                where = ""
                if len(self.points) > 1:
                    where = f" at {len(wrong)} of {len(self.points)} trims"
                sentences.append(f"{NEEDS[name].format(need)}{where}")
        return sentences

    @property
    def ok(self) -> bool:
        """True if the policy passes: it holds at every trim, and no finding is a failure.

        A requirement that is not satisfied is a failure.
        """
        return self.holds and all(each.severity != Severity.FAILURE for each in self.findings)

    def __bool__(self) -> bool:
        return self.ok

    @property
    def findings(self) -> list[Finding]:
        """Findings over all trims, worst first: severity and text."""
        unmet = [Finding(Severity.FAILURE, text) for text in self.unmet]
        of_files = [
            Finding(Severity.WARNING, note) for note in self.deployed.deployment.actor.notes
        ]
        return worst_first(
            [*unmet, *findings_at_trims(self.points), *of_files, *self._unfiltered()]
        )

    def _unfiltered(self) -> list[Finding]:
        """Return a list with the note that a filter of the deployment has no effect here."""
        deployment = self.deployed.deployment
        if deployment.filter is None:
            return []
        text = (
            "assessed without its [filter]; flights behind it, in noise: "
            f"hfa fly --policy {deployment.origin} --samples {IN_AIR}"
        )
        return [Finding(Severity.NOTE, text)]

    @property
    def first_line(self) -> str:
        """Verdict, the trims at which the policy holds or the worst failure, and the cost ratio."""
        is_linear = LINEAR in self.deployed.model.about.notes
        verdict = verdict_text(self.ok) + (" on the linear plant" if is_linear else "")
        return f"{verdict}: {self._where_it_holds()}; {self._cost_ratio()}"

    def _where_it_holds(self) -> str:
        """Return the trims at which the policy holds, or the worst failure."""
        if self.holds and not self.ok:
            return self.findings[0].text
        rate = f" at {1.0 / self.deployed.deployment.dt:.4g} Hz"
        failing = [point for point in self.points if not point.holds]
        where = where_text(failing or self.points, self.points)
        is_linear = all(point.flights is None for point in self.points)
        subject = "linear loop " if is_linear else ""
        holding = len(self.points) - len(failing)
        if failing and holding:
            return f"{subject}holds at {holding} of {len(self.points)} trims{rate}, not {where}"
        return f"{subject}{'does not hold' if failing else 'holds'} {where}{rate}"

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "dynamics": self.deployed.model.name,
            "deployment_file": self.deployed.deployment.origin,
            "dt": self.deployed.deployment.dt,
            "delay": self.deployed.deployment.delay,
            "network": self.deployed.deployment.actor.chain,
            "stated": self.deployed.deployment.actor.stated,
            "commanded": self.deployed.commanded,
            "states": self.deployed.model.linear,
            "points": self.points,
            "holds": self.holds,
            "warnings": self.warnings,
            "unmet": self.unmet,
            "findings": self.findings,
            "first_line": self.first_line,
        }

    def report(self) -> Report:
        """Return the report as text and tables, with its data and a table of all digits."""
        title = [self.first_line, *self._further(), ""]
        title.append(
            f"Assessment of {self.deployed.deployment.origin} on {self.deployed.model.title}"
        )
        return Report(
            "\n".join(title),
            report_parts(self.deployed, self.points),
            data=storable(self),
            records=records_table(self.points),
        )

    def _further(self) -> list[str]:
        """Return what the first line leaves out: costs, findings worst first, the assumed trim."""
        lines = []
        dearest = self._dearest()
        if dearest is not None and dearest.costs is not None:
            where = f"{where_text([dearest], self.points)}: " if len(self.points) > 1 else ""
            lines += [where + sentence for sentence in dearest.costs.sentences()]
        first_line = self.first_line
        lines += [each.text for each in self.findings if each.text not in first_line]
        return [*lines, self.assumed] if self.assumed else lines

    def _dearest(self) -> AssessedPoint | None:
        """Return the trim with the largest median ratio of costs, or None without costs."""
        priced = [point for point in self.points if point.costs is not None]
        return max(priced, key=_median_ratio, default=None)

    def _cost_ratio(self) -> str:
        """Return a phrase on the ratio of the policy's costs."""
        dearest = self._dearest()
        if dearest is not None and dearest.costs is not None:
            return dearest.costs.ratio_text()
        if any(point.flights is not None for point in self.points):
            return "no costs were compared"
        linear = [point.cost.worst for point in self.points if point.cost is not None]
        if not linear:
            return "no flight was simulated"
        ratio = f"{1.0 + max(linear) / 100.0:.3g}x the linear optimum"
        return f"cost {ratio}, no flight was simulated"


def _median_ratio(point: AssessedPoint) -> float:
    """Return the median ratio of the costs at a trim, or 0 without costs."""
    return 0.0 if point.costs is None else point.costs.median


def _meets(point: AssessedPoint, name: str, need: float) -> bool:
    """Return whether the result at a trim satisfies a requirement."""
    if name == "delay":
        if point.delays is None or not point.holds:
            return False
        if point.delays.limit is None:
            return point.delays.searched >= need
        return point.delays.limit > need * (1.0 + 1e-9)
    if name == "margin":
        return point.margins is not None and point.margins.disk.disk >= need
    if name == SHARE:
        return point.reaches(need)
    if point.cost is None:
        return False
    return point.cost.worst <= need
