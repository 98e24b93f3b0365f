"""The search for the weights of a design: what an evaluation flies, the search, the designs between two."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller import ScheduledController
from controller.design.controllers import controller_at, controller_table
from controller.design.design import Design
from controller.design.servo_loop import corner_loops, servo_loop, servo_plant
from controller.riccati.gare_schur import quick_solution
from hfa_model import Aircraft
from hfa_support import BadInputError, NoSolutionError, Report
from hfa_support.files import write_text
from hfa_support.jsonable import records_text
from hfa_support.reporting.text import Table
from studies.finished import finished, stamped
from studies.servo.feedforward import Feedforward, shaped_design, with_feedforward
from studies.servo.flights import LARGEST, fly_commands, gust_held, gust_share, turbulence_rms
from studies.servo.tuning import Tuning
from trim import LinearModel, level_model

#: Cost of a constraint that is missed by its own size, and of a design without a stable loop.
PENALTY, LOST = 1e3, 1e6

#: Dynamics and dihedral, rad, of a linear model.
Place = tuple[str, float]


class Evaluation(NamedTuple):
    """cost: what the search makes small. abscissa: of the worst corner, of the worst loop where one is unstable, 1/s.

    errors: rms by output, rates: rad/s, of each case. rms: by state, of each turbulence. gusts: the share of the
    envelope that each needs, 1 for all of it. margin: smallest of all flights. fastest: 1/s. Figures that were left out
    are empty, 0 or inf: all where a loop is unstable, and those that come after a cost that is no longer of interest,
    which is then a lower bound.
    """

    cost: float
    abscissa: float
    errors: tuple[dict[str, float], ...] = ()
    rates: tuple[float, ...] = ()
    rms: tuple[dict[str, float], ...] = ()
    gusts: tuple[float, ...] = ()
    margin: float = 0.0
    fastest: float = math.inf


class DesignEvaluation:
    """Evaluates values of the variables of a search; the linear models are made once."""

    def __init__(self, aircraft: Aircraft, tuning: Tuning) -> None:
        self._tuning, self._own = tuning, aircraft.variant.name
        self._corners = [(name, angle) for name in tuning.dynamics or (self._own,) for angle in tuning.angles]
        self._in_gusts = [((gust.dynamics or self._own, gust.dihedral), gust) for gust in tuning.gusts]
        self._models: dict[Place, tuple[Aircraft, LinearModel]] = {}
        for name, angle in [*((self._own, angle) for angle, _ in tuning.places), *self._corners, *dict(self._in_gusts)]:
            if (name, angle) not in self._models:
                flown = aircraft if name == self._own else Aircraft(aircraft.parameters, name)
                self._models[name, angle] = flown, level_model(flown, angle)

    def at(self, values: np.ndarray, below: float = math.inf) -> Evaluation:
        """Of values of the variables, as `of`."""
        return self.of(self._tuning.entries_at(values), below)

    def held(self, entries: Mapping[str, Any]) -> tuple[float, ...]:
        """Of the entries of a design file, the largest peak stood in each gust of the search, ft/s, as `gust_held`."""
        table_at = self._tables(shaped_design(self._tuning.name, entries)[0])
        return tuple(gust_held(*self._models[place], table_at(place), gust) for place, gust in self._in_gusts)

    def of(self, entries: Mapping[str, Any], below: float = math.inf) -> Evaluation:
        """The cost; `LOST` and more for a design that has no controller or no stable loop.

        below: what the cost must not exceed to be of interest. Once it does, what takes longer is left out: the cost is
        then a lower bound, above `below`.
        """
        found = Evaluation(2.0 * LOST, math.inf)
        try:
            for found in self._parts(*shaped_design(self._tuning.name, entries)):
                if found.cost > below:
                    break
        except (BadInputError, NoSolutionError, np.linalg.LinAlgError):
            return Evaluation(2.0 * LOST, math.inf)
        return found

    def _tables(self, design: Design) -> Callable[[Place], ScheduledController]:
        """The controllers of a design, each made when it is first asked for."""
        return cache(lambda place: quick_controller(*self._models[place], design))

    def _parts(self, design: Design, feedforward: Feedforward | None) -> Iterator[Evaluation]:
        """The evaluation with ever more in it, by the time that it takes; no part makes the cost smaller."""
        tuning, found = self._tuning, Evaluation(0.0, math.inf)
        sizes: list[float] = []  # of errors, weighted
        missed: list[float] = []  # of constraints, as shares of their limits

        def with_more(**figures: Any) -> Evaluation:
            nonlocal found
            with np.errstate(over="ignore"):
                norm = np.linalg.norm(sizes, tuning.power) if sizes else 0.0
            found = found._replace(cost=float(norm + PENALTY * sum(max(0.0, each) for each in missed)), **figures)
            return found

        table_at, loops = self._tables(design), {}
        for angle, actuator in tuning.places:
            table = table_at((self._own, angle))
            actuators = dict.fromkeys(table.inputs, actuator)
            plant = servo_plant(*self._models[self._own, angle], table, actuators)
            loops[angle, actuator] = plant, servo_loop(plant, table)
        worst, abscissa = max(loop.abscissa for _, loop in loops.values()), -math.inf
        if worst < 0.0:
            rms = []
            for air in tuning.turbulence:
                states = turbulence_rms(*loops[air.dihedral, air.actuator], air.intensity, air.scale)
                rms.append({name: states[name] for name in air.objective})
                sizes += [size * states[name] for name, size in air.objective.items()]
            fastest = max(float(np.abs(np.linalg.eigvals(loop.closed)).max()) for _, loop in loops.values())
            missed.append(fastest / tuning.fastest - 1.0)
            part = with_more(rms=tuple(rms), fastest=fastest)
            yield part._replace(cost=min(part.cost, LOST))  # a corner may be unstable yet
        for place in self._corners:
            corners = corner_loops(*self._models[place], table_at(place))
            abscissa = max(abscissa, *(loop.abscissa for _, loop in corners))
            worst = max(worst, abscissa)
            if worst >= 0.0:
                yield Evaluation(LOST * (1.0 + worst), worst)
        if worst >= 0.0:
            return
        missed.append((abscissa - tuning.abscissa) / abs(tuning.abscissa))
        yield with_more(abscissa=abscissa)
        flights = []

        @cache
        def shaped_at(place: Place) -> ScheduledController:
            flown, model = self._models[place]
            table = table_at(place)
            return with_feedforward(flown, [model], table, feedforward)[0] if feedforward else table

        for case in tuning.cases:
            plant, table = loops[case.dihedral, case.actuator][0], shaped_at((self._own, case.dihedral))
            flights.append(fly_commands(plant, table, case.ends, case.each, feedforward or Feedforward()))
        errors, rates = zip(*flights, strict=True)
        sizes += [size * each[name] for each in errors for name, size in tuning.objective.items()]
        missed += [rate / tuning.rate - 1.0 for rate in rates]
        yield with_more(errors=errors, rates=rates)
        if tuning.margin:
            margins = [(loop.margin_at_inputs().disk, loop.margin_at_sensors().disk) for _, loop in loops.values()]
            missed.append(1.0 - min(map(min, margins)) / tuning.margin)
            yield with_more(margin=min(map(min, margins)))
        for place, gust in self._in_gusts:
            share = gust_share(*self._models[place], table_at(place), gust)
            missed.append(share - 1.0)
            yield with_more(gusts=(*found.gusts, share))


def quick_controller(aircraft: Aircraft, model: LinearModel, design: Design) -> ScheduledController:
    """The controller of one angle without its certificate; NoSolutionError when there is none."""
    feedback = "output" if design.sensors else "state"
    found = controller_at(aircraft, model, design, feedback, quick_solution)
    return controller_table(aircraft, design, feedback, [model], [found])


#: Share of the numbers that a step changes, on average.
CHANGED = 0.3
#: Deviation of their logarithms: at first, at most, and the smallest, from which it returns to `AGAIN`.
FIRST, WIDEST, SMALLEST, AGAIN = 0.5, 1.5, 0.015, 0.25
#: What the deviation is multiplied by after a better design, as is its step, which is taken again; and after others.
GROW, SHRINK = 1.3, 0.97
_ANGLES = ("alpha", "pitch", "dihedral")


class Tuned(NamedTuple):
    """Values of the variables and their evaluation: of the start and of the best one found. seen: all evaluations."""

    first: np.ndarray
    first_evaluation: Evaluation
    best: np.ndarray
    best_evaluation: Evaluation
    seen: tuple[Evaluation, ...]


def tune(aircraft: Aircraft, tuning: Tuning, kept: Path, progress: Callable[[int, int], None] | None = None) -> Tuned:
    """A (1 + 1) evolution strategy: l + σ m z from the best logarithms l so far, m of 0 and 1, z normal.

    It asks only which of two designs is better, so that an evaluation ends once it is known to be the worse one.

    kept: a folder with a file of every evaluation. A search that was interrupted finds them and goes on to the same
    result as without the interruption, and so does one that is given more evaluations.
    Source: Rechenberg, Evolutionsstrategie, 1973.
    """
    evaluation, seen = DesignEvaluation(aircraft, tuning), list[Evaluation]()
    decides = asdict(tuning) | {"dynamics of": aircraft.variant.name, "parameters": aircraft.parameters._asdict()}
    del decides["evaluations"]  # the first of more are the same
    kept.mkdir(exist_ok=True)

    def evaluated(values: np.ndarray, below: float) -> Evaluation:
        part, asked = kept / f"{len(seen):05d}.json", decides | {"values": values, "below": below}
        known = finished(part, asked)
        if known is None:
            found = evaluation.at(values, below)
            write_text(part, records_text(stamped({"evaluation": found._asdict()}, asked)))
        else:
            found = Evaluation(**{name: _read(value) for name, value in known["evaluation"].items()})
        seen.append(found)
        if progress is not None:
            progress(len(seen), tuning.evaluations)
        return found

    chance = np.random.default_rng(tuning.seed)
    lows, highs = np.log([(variable.low, variable.high) for variable in tuning.variables]).T
    first = tuning.first_values()
    best, place, smallest = first, np.log(first), evaluated(first, math.inf)
    deviation, step, better = FIRST, np.zeros(len(first)), False
    while len(seen) < tuning.evaluations:
        if better:
            step, deviation = GROW * step, min(GROW * deviation, WIDEST)
        else:
            changed = chance.random(len(first)) < CHANGED
            changed[chance.integers(len(first))] = True
            step = deviation * changed * chance.standard_normal(len(first))
            deviation = SHRINK * deviation if deviation > SMALLEST else AGAIN
        tried = np.clip(place + step, lows, highs)
        values = np.exp(tried)
        found = evaluated(values, smallest.cost)
        better = found.cost < smallest.cost
        if better:
            best, place, smallest = values, tried, found
    return Tuned(first, seen[0], best, smallest, tuple(seen))


def _read(value: Any) -> Any:
    """A value of an evaluation as it was before it became JSON: null stands for infinity."""
    if isinstance(value, list):
        return tuple(map(_read, value))
    if isinstance(value, dict):
        return {name: _read(each) for name, each in value.items()}
    return math.inf if value is None else value


def search_report(tuning: Tuning, found: Tuned) -> Report:
    """Start and best beside each other: variables with their limits, figures with what they must be."""
    rows, ok = [], bool(found.best_evaluation.rates)
    start = {name: value for name, value, _, _ in _figures(tuning, found.first_evaluation)}
    for name, value, limit, kept in _figures(tuning, found.best_evaluation):
        begun = f"{start[name]:.4g}" if name in start else "unstable"
        rows.append((name, begun, f"{value:.4g}", limit, "" if kept else "FAIL"))
        ok = ok and kept
    chosen = list(zip(tuning.variables, found.first.tolist(), found.best.tolist(), strict=True))
    rows += [(each.name, f"{a:.6g}", f"{b:.6g}", f"{each.low:g} to {each.high:g}", "") for each, a, b in chosen]
    return Report(
        f"Search over {len(chosen)} variables of {tuning.name}: cost {found.first_evaluation.cost:.6g} at first, "
        f"{found.best_evaluation.cost:.6g} after {len(found.seen)} evaluations",
        (Table(("figure or variable", "start", "best", "must be", ""), rows),),
        data={
            "ok": ok,
            "evaluations": len(found.seen),
            "variables": {each.name: {"start": a, "best": b} for each, a, b in chosen},
            "start": found.first_evaluation._asdict(),
            "best": found.best_evaluation._asdict(),
        },
    )


def _figures(tuning: Tuning, found: Evaluation) -> Iterator[tuple[str, float, str, bool]]:
    """Name with its unit, figure, what it must be, whether it is; the abscissa alone where a loop is unstable."""
    yield "abscissa 1/s", found.abscissa, f"<= {tuning.abscissa:g}", found.abscissa <= tuning.abscissa
    for number, (errors, rate) in enumerate(zip(found.errors, found.rates, strict=True), 1):
        for name in tuning.objective:
            yield f"case {number}, rms {error_name(name)}", shown_error(errors[name], name), "", True
        limit = f"<= {math.degrees(tuning.rate):g}"
        yield f"case {number}, rate deg/s", math.degrees(rate), limit, rate <= tuning.rate
    for number, rms in enumerate(found.rms, 1):
        for name, each in rms.items():
            yield f"turbulence {number}, rms {error_name(name)}", shown_error(each, name), "", True
    if tuning.margin:
        yield "margin", found.margin, f">= {tuning.margin:g}", found.margin >= tuning.margin
    if math.isfinite(tuning.fastest):
        yield "fastest 1/s", found.fastest, f"<= {tuning.fastest:g}", found.fastest <= tuning.fastest
    for number, share in enumerate(found.gusts, 1):
        yield f"gust {number}, share of the envelope", share, "<= 1", share <= 1.0


def shown_error(value: float, name: str) -> float:
    """An error of a state or an output in the unit of `error_name`."""
    return math.degrees(value) if name in _ANGLES else value


def error_name(name: str) -> str:
    """The name, with deg behind an angle."""
    return f"{name} deg" if name in _ANGLES else name


#: Where on the line the designs lie: 0 is the first, 1 the second.
SHARES = tuple(round(-0.2 + 0.1 * k, 1) for k in range(15))


def between(first: Mapping[str, Any], second: Mapping[str, Any], share: float) -> dict[str, Any]:
    """Entries of the design whose numbers are a^(1 - share) b^share of those of two designs, a and b.

    Where one of them is 0: (1 - share) a + share b, at least 0. What only one design has is left as it is; what is no
    number is that of the first.
    """
    found = copy.deepcopy({**second, **first})
    for name in set(first) & set(second):
        a, b = first[name], second[name]
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            found[name] = between(a, b, share)
        elif all(isinstance(each, (int, float)) and math.isfinite(each) for each in (a, b)) and a != b:
            found[name] = a ** (1.0 - share) * b**share if a and b else max(0.0, (1.0 - share) * a + share * b)
    return found


def design_line(aircraft: Aircraft, tuning: Tuning, toward: str, entries: Mapping[str, Any]) -> Report:
    """The designs at `SHARES` of the way from that of `tuning` to that of `entries`, on the flights of the search."""
    evaluation, points = DesignEvaluation(aircraft, tuning), []
    for share in SHARES:
        design = between(tuning.start, entries, share)
        found = evaluation.of(design)
        held = evaluation.held(design) if found.errors else ()
        points.append({"share": share, "evaluation": found._asdict(), "held": held})
    return line_report(tuning, toward, points)


def line_report(tuning: Tuning, toward: str, points: list[dict[str, Any]]) -> Report:
    """Each design with its largest rms error in the first output of the objective, smallest gusts held, fastest input.

    held: largest peak stood in each gust of the search, ft/s; () where a loop is unstable.
    """
    first, rows = next(iter(tuning.objective)), []
    for point in points:
        figures = ["unstable", "", "", ""]
        if point["held"]:
            error = max(errors[first] for errors in point["evaluation"]["errors"])
            peaks = [(gust.peak > 0.0, peak) for gust, peak in zip(tuning.gusts, point["held"], strict=True)]
            up, down = (min((peak for up, peak in peaks if up == way), default=math.nan) for way in (True, False))
            rate = math.degrees(max(point["evaluation"]["rates"]))
            figures = [f"{shown_error(error, first):.3f}", f"{up:g}", f"{down:g}", f"{rate:.2f}"]
        rows.append((f"{point['share']:g}", *figures))
    header = ("share", f"rms {error_name(first)}", "held up ft/s", "held down ft/s", "rate deg/s")
    return Report(
        f"Designs from that of {tuning.name} (share 0) to {toward} (share 1): worst error of a case, and the gust that "
        f"is just held ({LARGEST:g} for all that were tried)",
        (Table(header, rows),),
        data={"toward": toward, "points": points},
    )
