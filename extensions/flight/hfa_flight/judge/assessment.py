"""Assessment of a deployed policy: results at all trims, verdict and findings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hfa.options.command import ProgressLine
from hfa_aircraft.control_systems import is_linear_plant
from hfa_aircraft.model import Model
from hfa_aircraft.servos import positions_of_servos
from hfa_flight.air.scenario import conditions_text
from hfa_flight.air.sensors import Sensor, sensors_of
from hfa_flight.judge.assessed_point import AssessedPoint
from hfa_flight.judge.assessment_report import (
    Finding,
    Severity,
    findings_at_trims,
    records_table,
    report_parts,
    where_text,
    worst_first,
)
from hfa_flight.judge.assessor import Assessor
from hfa_flight.judge.flight_costs import has_weights
from hfa_flight.needs import NEEDS, SAMPLES, SHARE, is_enough
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_support.errors import (
    BadInputError,
    is_finite,
    refuse_unknown,
    refuse_unless_positive,
    refuse_unless_whole,
    shown,
)
from hfa_support.progress import Progress
from hfa_support.reporting.report import Report, Reported, verdict_text
from hfa_support.reporting.results import Entries, Result, without_empty
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim


def trims_of(model: Model, points: Iterable[Any] | None) -> tuple[OperatingPoint, ...]:
    """Return operating points, given or found at values of the scheduling variable.

    Without `points`, the result is the model's default trim.

    Raises BadInputError in these cases:
    - A point belongs to another aircraft.
    - A point is neither an operating point nor a finite number.
    - A number is given for a model without a scheduling variable.
    - `points` is empty.

    Raises TrimError if no trim is found.
    """
    if points is None:
        return (trim(model),)
    found: list[OperatingPoint] = []
    for point in _listed(points):
        if isinstance(point, OperatingPoint):
            point._refuse_other_model(model)
            found.append(point)
            continue
        if not is_finite(point) or not model.schedule:
            raise BadInputError(
                f"points contains {shown(point)}; give operating points, or values of the "
                "scheduling variable"
            )
        if model.schedule in model.parameters:
            found.append(trim(model.with_parameters(**{model.schedule: float(point)})))
        else:
            found.append(trim(model, at=float(point)))
    if not found:
        raise BadInputError(
            "points is empty; give at least one point, or None for the default trim of the model"
        )
    return tuple(found)


def _listed(points: Any) -> list[Any]:
    """Return one or several points as a list. An object that is not iterable is one point."""
    if isinstance(points, OperatingPoint):
        return [points]
    try:
        return list(points)
    except TypeError:  # NumPy and CasADi raise their own messages
        return [points]


@dataclass(frozen=True, eq=False, repr=False)
class Assessment(Result, Reported):
    """Assessment of a policy as it is deployed, at one or more trims.

    deployed: the policy on its aircraft.
    points: results at each trim.
    needs: delay (s), margin, cost (percent) or share of the flights -> required value.
    assumed: description of the trim that was assumed because none was given, otherwise "".
    sensors: what is measured in the flights -> `Sensor`.

    >>> import hfa
    >>> assessment = hfa.assess(deployment, points)  # doctest: +SKIP
    """

    schema = "hfa.assessment/1"

    deployed: Deployed
    points: tuple[AssessedPoint, ...]
    needs: Mapping[str, float] = field(default_factory=dict)
    assumed: str = ""
    sensors: Mapping[str, Sensor] = field(default_factory=dict)

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
                sentences.append(f"{NEEDS[name].unmet.format(need)}{where}")
        return sentences

    @property
    def ok(self) -> bool:
        """True if the policy passes: it holds at every trim, and no finding is a failure.

        A requirement that is not satisfied is a failure.
        """
        return self.holds and all(finding.severity != Severity.FAILURE for finding in self.findings)

    def __bool__(self) -> bool:
        return self.ok

    @property
    def findings(self) -> list[Finding]:
        """Findings over all trims, worst first: severity and text."""
        unmet = [Finding(Severity.FAILURE, text) for text in self.unmet]
        # Notes on contradictions between the deployment and the files of the policy.
        notes = self.deployed.deployment.actor.notes
        contradictions = [Finding(Severity.WARNING, note) for note in notes]
        return worst_first([*unmet, *findings_at_trims(self.points), *contradictions])

    @property
    def first_line(self) -> str:
        """Verdict, the trims at which the policy holds or the worst failure, and the cost ratio."""
        is_linear = is_linear_plant(self.deployed.model)
        verdict = verdict_text(self.ok) + (" on the linear plant" if is_linear else "")
        return f"{verdict}: {self._where_it_holds()}; {self._cost_ratio()}"

    def _converging(self) -> str:
        """Return how many flights converge, or stay inside, without a pulse and with one."""
        flown = [point for point in self.points if point.flights is not None]
        if not flown:
            return ""
        outcomes = [of for point in flown for of in (point.flights, point.disturbed) if of]
        converged = sum(of.converged for of in outcomes)
        succeed = "stay within the limits" if self.sensors else "converge"
        return f": {converged} of {sum(of.starts for of in outcomes)} flights {succeed}"

    def _where_it_holds(self) -> str:
        """Return the trims at which the policy holds, or the worst failure."""
        if self.holds and not self.ok:  # as for a requirement that is not satisfied
            return self.findings[0].text
        timing = self.deployed.deployment
        is_prompt = not (timing.delay or positions_of_servos(self.deployed.model))
        without = "without sensor errors" + " and latency" * is_prompt
        if count := len(self.sensors):
            conditions = conditions_text(self.deployed.model, timing.delay, self.sensors)
            without = f"with {count} sensor{'s' * (count > 1)}, {conditions}"
        rate = f" at {1.0 / timing.dt:.4g} Hz {without}"
        failing = [point for point in self.points if not point.holds]
        where = where_text(failing or self.points, self.points)
        is_linear = all(point.flights is None for point in self.points)
        subject = "linear loop " if is_linear else ""
        holding = len(self.points) - len(failing)
        if failing and holding:
            held = f"{subject}holds at {holding} of {len(self.points)} trims{rate}, not {where}"
            return held + self._converging()
        return (
            f"{subject}{'does not hold' if failing else 'holds'} {where}{rate}{self._converging()}"
        )

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        deployment = self.deployed.deployment
        return {
            "dynamics": self.deployed.model.name,
            "deployment_file": deployment.origin,
            "dt": deployment.dt,
            "delay": deployment.delay,
            "network": deployment.actor.chain,
            "declared": deployment.actor.declared,
            "commanded": self.deployed.commanded,
            "states": self.deployed.model.linear,
            "points": self.points,
            "holds": self.holds,
            "warnings": self.warnings,
            "unmet": self.unmet,
            "findings": self.findings,
            "first_line": self.first_line,
        } | without_empty(sensors={name: vars(of) for name, of in self.sensors.items()})

    def report(self) -> Report:
        """Return the report as text and tables, with its data and a table of all digits."""
        title = [self.first_line, *self._further(), ""]
        title.append(
            f"Assessment of {self.deployed.deployment.origin} on {self.deployed.model.title}"
        )
        return Report(
            "\n".join(title),
            report_parts(self.deployed, self.points, with_errors=bool(self.sensors)),
            data=Entries(self),
            records=records_table(self.points),
        )

    def _further(self) -> list[str]:
        """Return what the first line leaves out: costs, findings worst first, the assumed trim."""
        first_line = self.first_line
        lines = [finding.text for finding in self.findings if finding.text not in first_line]
        return [*lines, self.assumed] if self.assumed else lines

    def _dearest(self) -> AssessedPoint | None:
        """Return the trim with the largest median ratio of costs, or None without costs."""
        priced = [point for point in self.points if point.costs is not None]
        return max(priced, key=_median_ratio, default=None)

    def _cost_ratio(self) -> str:
        """Return a phrase on the ratio of the policy's costs."""
        dearest = self._dearest()
        if dearest is not None and dearest.costs is not None:
            return dearest.costs.text()
        if any(point.flights is not None for point in self.points):
            return "no costs were compared"
        return "no flight was simulated"


def _median_ratio(point: AssessedPoint) -> float:
    """Return the median ratio of the costs at a trim, or 0 without costs."""
    return 0.0 if point.costs is None else point.costs.median


def _meets(point: AssessedPoint, name: str, need: float) -> bool:
    """Return whether the result at a trim satisfies a requirement."""
    if name == "delay":
        late, delays = point.late, point.delays  # None without flights, or of a policy with steps
        flown = late is None or is_enough(late.converged, late.starts, point.share)
        if delays is None:
            return point.holds and flown and late is not None
        is_stable = delays.searched >= need if delays.limit is None else delays.limit > need
        return point.holds and flown and is_stable
    if name == "margin":
        return point.margins is not None and point.margins.disk.disk >= need
    if name == SHARE:
        return point.reaches(need)
    return point.costs is not None and point.costs.median <= 1.0 + need / 100.0


def assess(
    model: Model,
    deployment: Deployment | str | Path,
    points: Sequence[Any] | None = None,
    samples: int = SAMPLES,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    box: Mapping[str, float] | None = None,
    needs: Mapping[str, float] | None = None,
    sensors: Mapping[str, Any] | None = None,
) -> Assessment:
    """Assess a policy as it is deployed: its sampled loop, flights, and cost.

    Flights in moving air, and of a policy behind a filter, are those of `hfa.fly` with `samples`.

    model: the aircraft
    deployment: observations, actions and timing of the policy, or the path of a deployment file
    points: operating points, or values of the scheduling variable in the units of the model.
        Default: the model's default trim
    samples: number of initial conditions at each trim. Each is flown with and without the
        disturbance pulse, and without it by the exact gain, too
    seed: seed of the initial conditions
    progress: callback for the progress of the flights, by default a line on a terminal
    box: linear state -> half-width of the initial-condition box in the unit of the model, in place
        of the usual half-width
    needs: requirement of `hfa assess --need`, such as "delay" (s) or "cost" (%) -> required value
    sensors: what is measured, a state or an output -> `hfa.Sensor`, or the standard deviation of
        its noise. The policy sees it with these errors, and other states without. As the errors do
        not end, a flight counts as converged if it stays within the limits

    Raises BadInputError for a wrong argument or a deployment that does not fit the aircraft, and
    TrimError if there is no trim.

    >>> import casadi as ca
    >>> import hfa
    >>> o = ca.SX.sym("o", 2)
    >>> deployment = hfa.Deployment(
    ...     policy={"file": ca.Function("policy", [o], [0.1 * o[1]])},
    ...     observation={"speed": {"scale": 10.0}, "pitch": {}},
    ...     action={"elevator_center": {"box": [-1, 1], "map": "trim + 0.1 * a"}},
    ...     timing={"dt": 0.02},
    ... )
    >>> hfa.assess(hfa.aircraft(), deployment, [0.1], samples=0).points[0].holds
    True
    """
    for name, need in (needs or {}).items():
        refuse_unknown("unknown requirement", name, NEEDS)
        if NEEDS[name].values.of(need) is None:
            raise BadInputError(f"needs: {name} is {shown(need)}; give {NEEDS[name].values}")
    refuse_unless_whole("samples", samples, 0)
    refuse_unless_whole("seed", seed, 0)
    deployed = Deployed(Deployment.of(deployment), model)
    measured = sensors_of(sensors or {}, model)
    for name, width in (box or {}).items():
        refuse_unknown("box names an unknown state", name, model.linear)
        refuse_unless_positive(f"box of {name}", width)
    trims = trims_of(model, points)
    needs = needs or {}
    if "cost" in needs and not has_weights(deployed):
        raise BadInputError(
            f"a required cost: {deployed.deployment.origin} has no table [cost]; give a deployment "
            "file with Q and R in [cost], or Q and R in the plant file"
        )
    if measured and not samples:
        raise BadInputError("sensors have errors in flights only; give samples, or remove sensors")
    assessor = Assessor(deployed, trims, samples, seed, box or {}, needs, measured)
    assessed = assessor.assessed(progress or ProgressLine("fly"))
    return Assessment(deployed, tuple(assessed), needs, sensors=measured)
