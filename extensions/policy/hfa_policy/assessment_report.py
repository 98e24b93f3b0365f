"""Report of an assessment: first line, findings, table of the trims, figure and data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.matrices import LINEAR
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.notes import notes_on_files
from hfa_optimal.bracket import BestCosts, bracket_table
from hfa_policy.assessment import AssessedPoint, cycle_text, scheduled_value
from hfa_policy.evidence import ActionEffect, ObservationRange
from hfa_policy.outcomes import departure_text
from hfa_policy.rough_flights import RoughFlights, rough_table
from hfa_policy.variations import Variation, variation_table
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.figure import new_figure, pyplot_figure
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import UNSTORED, Result, stored, stored_as, stored_parts
from hfa_support.reporting.text import Table, short_number, shown_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hfa_policy.outcomes import Outcomes

#: Name of a requirement -> sentence if it is not satisfied. The cost is in continuous time and
#: sampled.
NEEDS = {
    "delay": "a delay of {:g} s is not tolerated",
    "margin": "the disk margin is not at least {:g}",
    "cost": "the linear cost is not within {:g} % of the optimum",
}
#: Largest number of columns of the first line.
_FIRST_LINE = 100
#: A policy with a smaller nonlinearity counts as linear.
_LINEAR = 0.01
#: Costs that differ by less, in percent of the optimum, are equal.
_SAME_COST = 1e-6
#: An equilibrium closer to the trim, relative to the initial-condition box, counts as the trim.
_AT_TRIM = 0.01


def _median(best: BestCosts) -> float:
    """Return the median ratio of the policy's costs to the costs of the best flights found.

    The result is inf if no flight ends at the trim.
    """
    return math.inf if best.policy_over_best is None else best.policy_over_best.median


@dataclass(frozen=True, eq=False, repr=False)
class Assessment(Result, Reported):
    """Assessment of a policy as it is deployed, at one or more trims.

    deployed: the policy on its aircraft.
    points: results at each trim.
    needs: delay (s), margin, or cost (percent) -> required value.
    variations: results on changed aircraft.
    assumed: description of the trim that was assumed because none was given, otherwise "".

    >>> import hfa
    >>> assessment = hfa.assess(deployment, points)  # doctest: +SKIP
    """

    schema = "hfa.assessment/1"
    made_by = "hfa assess"

    deployed: Deployed = field(
        metadata=stored_parts(
            dynamics="model.name",
            deployment_file="deployment.origin",
            dt="deployment.dt",
            delay="deployment.delay",
            history="deployment.history",
            network="deployment.actor.chain",
            commanded="commanded",
            states="model.linear",
        )
    )
    points: tuple[AssessedPoint, ...]
    needs: Mapping[str, float] = field(default_factory=dict, metadata=UNSTORED)
    variations: tuple[Variation, ...] = field(default=(), metadata=stored_as(optional=True))
    assumed: str = field(default="", metadata=UNSTORED)

    @property
    @stored()
    def holds(self) -> bool:
        """True if the policy holds at every trim."""
        return all(point.holds for point in self.points)

    @property
    @stored()
    def notes(self) -> list[str]:
        """Contradictions between the policy's files and the deployment file, one sentence each."""
        return notes_on_files(self.deployed)

    @property
    @stored()
    def warnings(self) -> list[str]:
        """Warnings about the trims, each once."""
        sentences = [text for point in self.points for text in point.point.warnings]
        return list(dict.fromkeys(sentences))

    @property
    @stored()
    def unmet(self) -> list[str]:
        """Requirements that are not satisfied, one sentence each.

        Raises BadInputError for an unknown requirement, and if a cost is required and the
        deployment has no weights.
        """
        sentences = []
        for name, need in self.needs.items():
            refuse_unknown("unknown requirement", name, NEEDS)
            wrong = [point for point in self.points if not _meets(point, name, need)]
            if wrong:
                where = f" at {len(wrong)} of {len(self.points)} trims"
                if len(self.points) == 1:
                    where = ""
                sentences.append(f"{NEEDS[name].format(need)}{where}")
        if "cost" in self.needs and self.deployed.deployment.cost is None:
            raise BadInputError(
                "--need cost requires weights; add [cost] with the Q and R of the training "
                "to the deployment file"
            )
        return sentences

    @property
    def ok(self) -> bool:
        """True if the policy passes.

        The policy must hold at every trim and on every changed aircraft, and satisfy every
        requirement. Flights with the requested noise, gusts and turbulence must stay inside the
        envelope.
        """
        changed = all(variation.holds for variation in self.variations)
        return self.holds and changed and not self.unmet and not self._leaving_roughly()

    def __bool__(self) -> bool:
        return self.ok

    @property
    def headlines(self) -> list[str]:
        """Findings over all trims, one sentence each.

        If the assessment fails, the most serious finding is first. If the assessment passes, the
        first sentence lists the trims at which the policy holds.
        """
        holding = self._holding()
        verdicts = [holding, self._leaving_roughly()]
        if self.holds:
            verdicts.reverse()
        bad = [*filter(None, [*verdicts, *self.unmet, self._changed()])]
        flown = [self._departing(), self._cycling(), self._chattering(), self._flying()]
        costs = [self._costs_over_best(), self._drifting(), self._costing()]
        bounded = self._bounded_costs()
        loop = [self._saturating(), self._delaying(), self._offset(), *costs]
        own = self._leaving_alone()
        flown += [sentence for rough in self._rough[:1] for sentence in rough.left_out]
        if not self.ok:
            return [*filter(None, [bad[0], bounded, own, *bad[1:], *flown, *loop])]
        rough = "every flight with {} stays inside the envelope".format
        roughly = [rough(flown.disturbed_by) for flown in self._rough[:1]]
        verdicts = [holding, flown[0], bounded, own, loop[1]]
        return [*filter(None, [*verdicts, *flown[1:], *roughly, loop[0], *loop[2:]])]

    @property
    @stored()
    def first_line(self) -> str:
        """Verdict, the first finding, and the second finding if space permits.

        The second finding is included if the line then has at most 100 columns. If the second
        finding does not fit, its part before a bracket is added if this part fits.
        """
        is_linear = LINEAR in self.deployed.model.about.notes
        subject = " on the linear plant" if is_linear else ""
        line = f"{verdict_text(self.ok)}{subject}: {self.headlines[0]}"
        for headline in self.headlines[1:2]:
            short = headline.partition(" (")[0]
            fitting = [
                text for text in (headline, short) if len(line) + len(text) < _FIRST_LINE - 1
            ]
            if fitting:
                line += f"; {fitting[0]}"
        return line

    @property
    def further(self) -> list[str]:
        """Findings that are not in the first line, followed by the assumed trim.

        The order is that of `headlines`. If the first line omits only the bracket of a finding, the
        content of the bracket is listed.
        """
        line = self.first_line
        found = []
        for headline in self.headlines:
            if headline in line:
                continue
            short, _, detail = headline.partition(" (")
            is_begun = short in line and detail.endswith(")")
            found.append(detail.removesuffix(")") if is_begun else headline)
        return [*found, *filter(None, [self.assumed])]

    def _holding(self) -> str:
        """Return a phrase that reports at which trims the policy holds.

        Without flights, the phrase names the linear loop instead of the policy.
        """
        holding = [point for point in self.points if point.holds]
        rate = f"at {1.0 / self.deployed.deployment.dt:.4g} Hz"
        judged_by = "" if self._has_flights else "its linear loop "
        if len(holding) == len(self.points):
            return f"{judged_by}holds {self._where(holding)} {rate}"
        if not holding:
            return f"{judged_by}does not hold {self._where(list(self.points))} {rate}"
        failing = [point for point in self.points if not point.holds]
        return (
            f"{judged_by}holds at {len(holding)} of {len(self.points)} trims {rate}, not "
            f"{self._where(failing)}"
        )

    @property
    def _has_flights(self) -> bool:
        """True if flights from initial conditions were simulated at one trim or more."""
        return any(point.flights is not None for point in self.points)

    def _changed(self) -> str:
        """Return a phrase on changed aircraft that the policy does not stabilize, or "".

        The phrase contains the number of these aircraft and describes the first.
        """
        failing = [variation for variation in self.variations if not variation.holds]
        if not failing:
            return ""
        where = self._where([failing[0].assessed]).replace(" at the trim", "")
        count = f"{len(failing)} of {len(self.variations)} changed aircraft"
        return f"does not hold {count}, the first {where}: {failing[0].text}"

    @property
    def _rough(self) -> list[RoughFlights]:
        """Flights with noise or in moving air, one entry for each trim that has such flights."""
        return [point.rough for point in self.points if point.rough is not None]

    def _leaving_roughly(self) -> str:
        """Return a phrase on flights with disturbances that leave the envelope, or "".

        The disturbances are noise or moving air. The phrase gives the number of these flights and
        the earliest departure.
        """
        departures = [flown.departure for flown in self._rough if flown.departure is not None]
        if not departures:
            return ""
        first = min(departures, key=lambda departure: departure.time)
        count = sum(flown.flights - flown.inside for flown in self._rough)
        total = sum(flown.flights for flown in self._rough)
        flights = f"flights with {self._rough[0].disturbed_by}"
        return f"{_leaving(count, total, flights)} ({departure_text(first)})"

    def _leaving_alone(self) -> str:
        """Return a phrase on the fastest-growing mode that the policy does not control, or "".

        A mode that decays is not reported at a trim at which the policy holds.
        """
        found = [(point.own_mode, point) for point in self.points]
        modes = [(mode, point) for mode, point in found if mode is not None]
        if not modes:
            return ""
        mode, point = max(modes, key=lambda pair: pair[0].growth)
        if point.holds and mode.growth < 0.0:
            return ""
        if mode.why:
            return f"not judged: {mode.name}"
        return f"leaves {mode.name} as it is"

    def _departing(self) -> str:
        """Return a phrase on the flights that leave the envelope, or "".

        The phrase gives the number of these flights and the earliest departure.
        """
        left = [point for point in self.points if point.flights is not None and point.flights.lost]
        outcomes = [point.flights for point in left if point.flights is not None]
        if not outcomes:
            return ""
        starts = sum(point.flights.starts for point in self.points if point.flights is not None)
        text = _leaving(sum(outcome.lost for outcome in outcomes), starts, "flights")
        departures = [each.departure for each in outcomes if each.departure is not None]
        if not departures:
            return text
        first = min(departures, key=lambda departure: departure.time)
        return f"{text} (first: {departure_text(first)})"

    def _chattering(self) -> str:
        """Return a phrase with the trims at which the loop chatters at its equilibrium, or ""."""
        chattering = [point for point in self.points if point.chatters]
        if not chattering:
            return ""
        return f"chatters near its equilibrium {self._where(chattering)}, where every flight stays"

    def _cycling(self) -> str:
        """Return a phrase on the largest limit cycle and its trim, or "".

        Amplitudes are compared after division by the nominal values of the signals.
        """
        largest = None
        for point in self.points:
            cycle = None if point.flights is None else point.flights.cycle
            if cycle is None:
                continue
            share = cycle.amplitude / self.deployed.model.signals[cycle.name].nominal
            if largest is None or share > largest[0]:
                largest = (share, f"limit cycle {self._where([point])}: {cycle_text(cycle)}")
        return "" if largest is None else largest[1].replace(" at the trim:", ":")

    def _where(self, points: list[AssessedPoint]) -> str:
        """Return trims as text, such as "from 38 to 60 m/s" or "at 45 m/s".

        Without a scheduling variable, the text is "at the trim". A range is given only if no other
        trim lies inside.
        """
        values = [value for point in points for value in scheduled_value(point.point).values()]
        if not values:
            return "at the trim"
        model = self.deployed.model
        unit = shown_unit(model.schedule_unit)
        if min(values) == max(values):
            return f"at {values[0]:.4g} {unit}"
        between = [
            value for point in self.points for value in scheduled_value(point.point).values()
        ]
        inside = [value for value in between if min(values) <= value <= max(values)]
        if len(inside) == len(values):
            return f"from {min(values):.4g} to {max(values):.4g} {unit}"
        return f"at {', '.join(f'{value:.4g}' for value in values)} {unit}"

    def _unless_all(self, points: list[AssessedPoint]) -> str:
        """Return trims as text with a leading space, such as " at 45 m/s".

        The result is "" if `points` contains every trim of the assessment.
        """
        return "" if len(points) == len(self.points) else f" {self._where(points)}"

    def _delaying(self) -> str:
        """Return a phrase on the shortest unstable delay at the trims at which the policy holds.

        - The policy holds at no trim: "".
        - No examined delay is unstable: the longest delay that was examined at all these trims.
        """
        holding = [point for point in self.points if point.holds and point.delays is not None]
        limits = [point.delays.limit for point in holding if point.delays is not None]
        unstable = [limit for limit in limits if limit is not None]
        if not holding:
            return ""
        if not unstable:
            searched = min(point.delays.searched for point in holding if point.delays is not None)
            return f"stable with delays up to {1e3 * searched:.4g} ms"
        shortest = min(unstable)
        where = [
            point
            for point in holding
            if point.delays is not None and point.delays.limit == shortest
        ]
        text = f"unstable with {1e3 * shortest:.4g} ms of delay"
        return text if len(where) == len(holding) else f"{text} {self._where(where)}"

    def _offset(self) -> str:
        """Return a phrase on the largest steady-state error, relative to the initial-condition box.

        - A trim has no equilibrium: a phrase that reports this.
        - The error is negligible and the policy holds: "no steady-state error".
        - The error is negligible and the policy does not hold: "".

        Linear states that do not decide whether a flight converges are omitted.
        """
        nowhere = [point for point in self.points if point.equilibrium is None]
        if nowhere:
            return f"no equilibrium near the trim{self._unless_all(nowhere)}"
        farthest = None
        for point in self.points:
            shares = np.where(point.place.decisive, np.abs(point.offset) / point.place.box, 0.0)
            index = int(np.argmax(shares))
            if farthest is None or shares[index] > farthest[0]:
                name = point.point.model.linear[index]
                farthest = (float(shares[index]), name, float(point.offset[index]))
        assert farthest is not None
        share, name, offset = farthest
        if share < _AT_TRIM:
            return "no steady-state error" if self.holds else ""
        unit = self.deployed.model.unit(name)
        size = f"{'+' if offset > 0 else '-'}{short_number(abs(offset), unit)} {shown_unit(unit)}"
        many = "up to " if len(self.points) > 1 else ""
        return f"steady-state {name} error {many}{size}"

    def _saturating(self) -> str:
        """Return a phrase on the actions and inputs that are saturated at an equilibrium, or ""."""
        saturated: list[AssessedPoint] = []
        clips: dict[str, None] = {}
        for point in self.points:
            if point.equilibrium is not None and point.equilibrium.clips:
                saturated.append(point)
                clips |= dict.fromkeys(point.equilibrium.clips)
        if not saturated:
            return ""
        where = self._unless_all(saturated)
        return f"saturated at the equilibrium{where}: {' and '.join(clips)}"

    def _flying(self) -> str:
        """Return a phrase on the convergence of the flights.

        - Without flights: "no flight was simulated".
        - Some flights stay inside the envelope without converging: the number of these flights.
        - Every flight converges: "every flight converges".
        - The flights that do not converge all leave the envelope: "".
        """
        flown = [point.flights for point in self.points if point.flights is not None]
        if not flown:
            return "no flight was simulated"
        starts = sum(flights.starts for flights in flown)
        inside = starts - sum(flights.lost for flights in flown)
        count = inside - sum(flights.returned for flights in flown)
        if count == 0:
            return "every flight converges" if inside == starts else ""
        seconds = max(flights.seconds for flights in flown)
        return f"{count} of {starts} flights stay inside but do not converge within {seconds:.3g} s"

    def _costs_over_best(self) -> str:
        """Return a phrase on costs relative to the best flights found.

        The costs are those at the trim with the worst median. The phrase is "" without best
        flights.
        """
        flown = [point.best for point in self.points if point.best is not None]
        if not flown:
            return ""
        return max(flown, key=_median).sentence()

    def _drifting(self) -> str:
        """Return a phrase on the largest cost per second of a steady-state error, or ""."""
        flown = [point.best for point in self.points if point.best is not None]
        rate = max((best.offset_rate or 0.0 for best in flown), default=0.0)
        return f"the steady-state error costs {rate:.2g} per second" if rate > 0.0 else ""

    def _bounded_costs(self) -> str:
        """Return a phrase on costs above the proved lower bound at the first trim, or ""."""
        best = self.points[0].best
        return "" if best is None else best.bound_sentence()

    def _brackets(self) -> list[Table]:
        """Return a list with the table of lower bounds and costs, or [] without a lower bound."""
        best = self.points[0].best
        if best is None or not best.brackets:
            return []
        return [bracket_table(self.deployed.model, best.brackets)]

    def _costing(self) -> str:
        """Return a phrase on the largest linear cost at the trims at which the policy holds.

        The phrase is "" if no such cost is known.
        """
        costs = [point.cost for point in self.points if point.holds and point.cost is not None]
        if not costs:
            return ""
        worst = max(cost.largest for cost in costs)
        if not math.isfinite(worst):
            return "linear cost without bound"
        if worst < _SAME_COST:
            return "linear cost of the optimum"
        if worst < 100.0:
            return f"linear cost up to {worst:.2g} % above the optimum"
        times = float(f"{1.0 + worst / 100.0:.2g}")
        return f"linear cost up to {short_number(times, '')}x the optimum"

    def report(self) -> Report:
        """Return the report as text and tables, with its data and a table of all digits."""
        model = self.deployed.model
        deployment = self.deployed.deployment
        lines = [self.first_line, *self.further, ""]
        lines.append(f"Assessment of {deployment.origin} on {model.title}")
        lines += [f"note: {note}" for note in self.notes]
        parts: list[Any] = [deployment.actor.chain, self._table()]
        parts += [*self._brackets(), *self._findings(), *self._off_slope()]
        parts += self._evidence()
        trims = [self._where([point]) for point in self.points]
        if self._rough:
            one = self._rough[0]
            units = [model.unit(name) for name in one.rms]
            parts.append(f"flights of {one.seconds:g} s from the trim with {one.disturbed_by}:")
            parts.append(rough_table(self._rough, trims, units))
            parts += list(dict.fromkeys(rough.air for rough in self._rough if rough.air))
        if self.variations:
            parts.append(variation_table(self.variations, trims))
        return Report("\n".join(lines), tuple(parts), data=self.as_data(), records=self._records())

    def _findings(self) -> list[str]:
        """Return the findings at all trims, each preceded by the trims that it concerns."""
        where: dict[str, list[AssessedPoint]] = {}
        for point in self.points:
            for finding in point.findings:
                where.setdefault(finding, []).append(point)
        return [
            f"{self._where(points)}: {finding}".removeprefix("at the trim: ")
            for finding, points in where.items()
        ]

    def _evidence(self) -> list[Any]:
        """Return the tables of the actions' effects and of the observations, with their captions.

        The actions are shown at the trim at which one of them is nearest to reversed, and the
        observations at that at which one is farthest from the training.
        """
        parts: list[Any] = []
        with_actions = [point for point in self.points if point.actions]
        if with_actions:
            worst = min(with_actions, key=_most_reversed)
            parts.append(
                f"actions {self._where([worst])}: lowering of the sum of the eigenvalues, 1/s"
            )
            parts.append(actions_table(worst.actions))
        with_observations = [point for point in self.points if point.observations]
        if with_observations:
            worst = max(with_observations, key=_farthest)
            parts.append(
                f"observations {self._where([worst])} before a normalizer, in flight and training:"
            )
            parts.append(observations_table(worst.observations))
        return parts

    def _off_slope(self) -> list[str]:
        """Return a list with a sentence on the largest nonlinearity, or [] below `_LINEAR`."""
        points = [point for point in self.points if point.nonlinearity is not None]
        parts = [point.nonlinearity.part for point in points if point.nonlinearity is not None]
        if max(parts, default=0.0) < _LINEAR:
            return []
        where = self._where([points[int(np.argmax(parts))]])
        return [
            f"{where}: in the box of initial conditions the command deviates from its "
            f"linearization by up to {100 * max(parts):.3g} % of the largest linear command"
        ]

    def _table(self) -> Table:
        model = self.deployed.model
        scheduled = (
            f"{model.schedule} {shown_unit(model.schedule_unit)}" if model.schedule else "trim"
        )
        header = (
            *(scheduled, "holds", "radius", "unstable at ms", "disk margin"),
            *("linear cost %", "mean %", "sampled %", "converge", "leave", "disturbed"),
        )
        return Table(header, [self._row(point) for point in self.points])

    def _row(self, point: AssessedPoint) -> tuple[str, ...]:
        value = next(iter(scheduled_value(point.point).values()), None)
        limit = None if point.delays is None else point.delays.limit
        cells = ["-" if value is None else f"{value:.4g}", "yes" if point.holds else "no"]
        cells.append("-" if math.isnan(point.radius) else f"{point.radius:.5f}")
        cells.append("-" if limit is None else f"{1e3 * limit:.4g}")
        cells.append("-" if point.margins is None else f"{point.margins.disk.disk:.3f}")
        cost = point.cost
        for lost in ("worst", "mean", "sampled_worst"):
            number = math.nan if cost is None else getattr(cost, lost)
            cells.append(f"{number:.4g}" if math.isfinite(number) else "-")
        for flown in (point.flights, point.disturbed):
            cells.append("-" if flown is None else f"{flown.returned} of {flown.starts}")
            if flown is point.flights:
                cells.append("-" if flown is None else f"{flown.lost}")
        return tuple(cells)

    def _records(self) -> Table:
        """Return the table of results with all digits, one row for each trim."""
        key = self.deployed.model.schedule_key if self.deployed.model.schedule else "trim"
        header = (
            *(key, "holds", "spectral_radius", "delay_limit [s]", "disk_margin"),
            *("converged", "left_envelope", "flights"),
        )
        rows = []
        for number, point in enumerate(self.points):
            value = next(iter(scheduled_value(point.point).values()), float(number))
            data = point.as_data()
            flown = point.flights
            counts = (0, 0, 0) if flown is None else (flown.returned, flown.lost, flown.starts)
            names = ("holds", "spectral_radius", "delay_limit", "disk_margin")
            rows.append((value, *(data[name] for name in names), *counts))
        return Table(header, rows)

    def figure(self) -> Figure:
        """Return a figure of spectral radius versus delay, and of flights or disk margins."""

        return drawn_assessment(self, new_figure(9.0, 4.0))

    def plot(self) -> np.ndarray:
        """Draw the picture of `figure` in a pyplot figure and return its Axes."""

        return np.array(drawn_assessment(self, pyplot_figure(9.0, 4.0)).axes)


def _most_reversed(point: AssessedPoint) -> float:
    """Return the least effect of an action relative to that of the exact gain, 0 if both are 0."""
    effects = [(each.effect, each.exact_effect) for each in point.actions]
    return min(effect / exact if exact else 0.0 for effect, exact in effects)


def _farthest(point: AssessedPoint) -> float:
    """Return the largest distance of an observation from its mean in training, 0 if unknown."""
    return max(np.nan_to_num(each.farthest, nan=0.0) for each in point.observations)


def actions_table(actions: Sequence[ActionEffect]) -> Table:
    """Return a table of the effects of the actions beside those of the exact gain."""
    rows = [(each.action, f"{each.effect:+.3g}", f"{each.exact_effect:+.3g}") for each in actions]
    return Table(("action", "of the policy", "of the exact gain"), rows)


def observations_table(observations: Sequence[ObservationRange]) -> Table:
    """Return a table of the ranges of the observations in flight beside those in training."""
    rows = []
    for each in observations:
        numbers = (each.lowest, each.highest, each.mean, each.spread, each.farthest)
        cells = [f"{number:.3g}" if math.isfinite(number) else "-" for number in numbers]
        rows.append((each.observation, *cells))
    header = ("observation", "lowest", "highest", "mean", "deviation", "farthest/deviation")
    return Table(header, rows)


def _leaving(count: int, total: int, flights: str) -> str:
    """Return a phrase such as "1 of 2 flights leaves the envelope".

    flights: description of all flights
    """
    verb = "leaves" if count == 1 else "leave"
    return f"{count} of {total} {flights} {verb} the envelope"


def _meets(point: AssessedPoint, name: str, need: float) -> bool:
    """Return whether the result at a trim satisfies a requirement.

    name: "delay" (s), "margin" (disk margin) or "cost" (percent)
    need: required value
    """
    if name == "delay":
        if point.delays is None or not point.holds:
            return False
        if point.delays.limit is None:
            return point.delays.searched >= need
        return point.delays.limit > need * (1.0 + 1e-9)
    if name == "margin":
        return point.margins is not None and point.margins.disk.disk >= need
    if point.cost is None:
        return False
    return point.cost.largest <= need


def drawn_assessment(assessment: Assessment, figure: Figure) -> Figure:
    """Draw the spectral radius versus delay and the outcomes of the flights, and return the figure.

    Disk margins replace the outcomes if all flights converge, if all leave the envelope, or if
    there are no flights.
    """
    from matplotlib import colormaps

    left, right = figure.subplots(1, 2)
    labels = []
    shades = colormaps["viridis"](np.linspace(0.0, 0.75, len(assessment.points)))
    for number, point in enumerate(assessment.points):
        value = next(iter(scheduled_value(point.point).values()), None)
        labels.append("trim" if value is None else f"{value:.4g}")
        if point.delays is None:
            continue
        radii = point.delays.radii[:12]
        delays = 1e3 * assessment.deployed.deployment.dt * np.arange(len(radii))
        left.plot(delays, radii, "o-", color=shades[number], markersize=3, label=labels[-1])
    left.axhline(1.0, color="C3", linewidth=0.8, label="limit of stability")
    model = assessment.deployed.model
    schedule = f"{model.schedule}, {shown_unit(model.schedule_unit)}" if model.schedule else ""
    left.set_xlabel("delay, ms")
    left.set_ylabel("spectral radius of the sampled loop")
    left.grid(alpha=0.3)
    if len(labels) <= 8:
        left.legend(
            fontsize=8,
            title=schedule,
            title_fontsize=8,
            ncols=4,
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            frameon=False,
        )
    places = np.arange(len(labels))
    outcomes = [point.flights for point in assessment.points]
    flown = [outcome for outcome in outcomes if outcome is not None]
    converge = all(outcome.returned == outcome.starts for outcome in flown)
    if converge or all(outcome.lost == outcome.starts for outcome in flown):
        _draw_margins(right, assessment, shades)
        if flown:
            end = "converges" if converge else "leaves the envelope"
            right.set_title(f"disk margins; every flight {end}", fontsize=10)
    else:
        _draw_outcomes(right, outcomes)
    right.set_xlim(-1.0, len(labels))
    right.set_xticks(places, labels, rotation=0 if len(labels) <= 8 else 90)
    right.set_xlabel(schedule)
    return figure


def _draw_margins(axes: Axes, assessment: Assessment, shades: np.ndarray) -> None:
    """Draw the disk margin of each trim, 0 without margins.

    shades: color of each trim, (N, 4)
    """
    margins = [point.margins for point in assessment.points]
    disks = [0.0 if margin is None else margin.disk.disk for margin in margins]
    axes.bar(np.arange(len(disks)), disks, color=shades, width=0.6)
    axes.set_ylabel("disk margin, all inputs at once")


def _draw_outcomes(axes: Axes, outcomes: Sequence[Outcomes | None]) -> None:
    """Draw the percentages of flights that converge, leave the envelope, or do neither."""
    places = np.arange(len(outcomes))
    converged = np.zeros(len(outcomes))
    left = np.zeros(len(outcomes))
    flown = np.zeros(len(outcomes))
    for number, outcome in enumerate(outcomes):
        if outcome is not None:
            converged[number] = 100.0 * outcome.returned / outcome.starts
            left[number] = 100.0 * outcome.lost / outcome.starts
            flown[number] = 100.0
    neither = flown - converged - left
    axes.bar(places, converged, color="C0", width=0.6, label="converge")
    axes.bar(places, neither, bottom=converged, color="0.7", width=0.6, label="do neither")
    axes.bar(
        places, left, bottom=converged + neither, color="C3", width=0.6, label="leave the envelope"
    )
    axes.set_ylim(0.0, 100.0)
    axes.set_ylabel("flights, %")
    axes.legend(fontsize=8, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
