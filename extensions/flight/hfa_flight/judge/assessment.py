"""Assessment of a deployed policy: results at all trims, verdict and findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.matrices import LINEAR
from hfa_flight.judge.assessed_point import AssessedPoint
from hfa_flight.judge.assessment_figure import drawn_assessment
from hfa_flight.judge.assessment_report import records_table, report_parts
from hfa_flight.judge.findings import Finding, Severity, findings_at_trims, where_text, worst_first
from hfa_flight.judge.variations import Variation
from hfa_flight.needs import SHARE
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.notes import notes_on_files
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.figure import new_figure, pyplot_figure
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Result, without_empty

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    variations: results on changed aircraft.
    assumed: description of the trim that was assumed because none was given, otherwise "".

    >>> import hfa
    >>> assessment = hfa.assess(deployment, points)  # doctest: +SKIP
    """

    schema = "hfa.assessment/1"

    deployed: Deployed
    points: tuple[AssessedPoint, ...]
    needs: Mapping[str, float] = field(default_factory=dict)
    variations: tuple[Variation, ...] = ()
    assumed: str = ""

    @property
    def holds(self) -> bool:
        """True if the policy holds at every trim."""
        return all(point.holds for point in self.points)

    @property
    def notes(self) -> list[str]:
        """Contradictions between the policy's files and the deployment file, one sentence each."""
        return notes_on_files(self.deployed)

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
                where = f" at {len(wrong)} of {len(self.points)} trims"
                if len(self.points) == 1:
                    where = ""
                sentences.append(f"{NEEDS[name].format(need)}{where}")
        return sentences

    @property
    def ok(self) -> bool:
        """True if the policy passes: it holds at every trim, and no finding is a failure.

        A requirement that is not satisfied, a changed aircraft on which the policy does not hold,
        and a flight with noise, a gust or turbulence that leaves the envelope are failures.
        """
        return self.holds and all(each.severity != Severity.FAILURE for each in self.findings)

    def __bool__(self) -> bool:
        return self.ok

    @property
    def findings(self) -> list[Finding]:
        """Findings over all trims, worst first: severity and text."""
        unmet = [Finding(Severity.FAILURE, text) for text in self.unmet]
        changed = [Finding(Severity.FAILURE, text) for text in self._failing_changes()]
        return worst_first([*unmet, *changed, *findings_at_trims(self.points)])

    @property
    def first_line(self) -> str:
        """Verdict, the trims at which the policy holds or the worst failure, and the cost ratio."""
        is_linear = LINEAR in self.deployed.model.about.notes
        verdict = verdict_text(self.ok) + (" on the linear plant" if is_linear else "")
        return f"{verdict}: {self._held()}; {self._cost_ratio()}"

    def _held(self) -> str:
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

    def _failing_changes(self) -> list[str]:
        """Return a list with the phrase on changed aircraft on which the policy does not hold."""
        failing = [variation for variation in self.variations if not variation.holds]
        if not failing:
            return []
        place = ""
        if len(self.points) > 1:
            place = f" {where_text([failing[0].assessed], self.points)}"
        count = f"{len(failing)} of {len(self.variations)} changed aircraft"
        return [f"does not hold on {count} (first{place}: {failing[0].text})"]

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "dynamics": self.deployed.model.name,
            "deployment_file": self.deployed.deployment.origin,
            "dt": self.deployed.deployment.dt,
            "delay": self.deployed.deployment.delay,
            "history": self.deployed.deployment.history,
            "network": self.deployed.deployment.actor.chain,
            "commanded": self.deployed.commanded,
            "states": self.deployed.model.linear,
            "points": self.points,
            "holds": self.holds,
            "notes": self.notes,
            "warnings": self.warnings,
            "unmet": self.unmet,
            "findings": self.findings,
            "first_line": self.first_line,
        } | without_empty(variations=self.variations)

    def report(self) -> Report:
        """Return the report as text and tables, with its data and a table of all digits."""
        title = [self.first_line, *self._further(), ""]
        title.append(
            f"Assessment of {self.deployed.deployment.origin} on {self.deployed.model.title}"
        )
        title += [f"note: {note}" for note in self.notes]
        return Report(
            "\n".join(title),
            report_parts(self.deployed, self.points, self.variations),
            data=self.as_data(),
            records=records_table(self.points),
        )

    def _further(self) -> list[str]:
        """Return what the first line leaves out: costs, findings worst first, the assumed trim."""
        told = self.first_line
        lines = []
        dearest = self._dearest()
        if dearest is not None and dearest.best is not None:
            place = ""
            if len(self.points) > 1:
                place = f"{where_text([dearest], self.points)}: "
            sentences = [each for each in dearest.best.sentences() if each not in told]
            lines += [f"{place}{sentence}" for sentence in sentences]
        lines += [each.text for each in self.findings if each.text not in told]
        return [*lines, *filter(None, [self.assumed])]

    def _dearest(self) -> AssessedPoint | None:
        """Return the trim with the largest median ratio of costs, or None without costs."""
        priced = [point for point in self.points if point.best is not None]
        return max(priced, key=lambda point: point.best.median if point.best else 0.0, default=None)

    def _cost_ratio(self) -> str:
        """Return a phrase on the ratio of the policy's costs."""
        dearest = self._dearest()
        if dearest is not None and dearest.best is not None:
            return dearest.best.ratio_text()
        if any(point.flights is not None for point in self.points):
            return "no costs were compared"
        linear = [point.cost.worst for point in self.points if point.cost is not None]
        if not linear:
            return "no flight was simulated"
        ratio = f"{1.0 + max(linear) / 100.0:.3g}x the linear optimum"
        return f"cost {ratio}, no flight was simulated"

    def figure(self) -> Figure:
        """Return a figure of spectral radius versus delay, and of flights or disk margins."""
        return drawn_assessment(self.points, new_figure(9.0, 4.0))

    def plot(self) -> np.ndarray:
        """Draw the picture of `figure` in a pyplot figure and return its Axes."""
        return np.array(drawn_assessment(self.points, pyplot_figure(9.0, 4.0)).axes)


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
