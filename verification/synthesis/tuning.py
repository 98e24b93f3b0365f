"""A search over named weights of a design: scipy.optimize, on linear flights through commands, every step on record."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.design.design import Actuator, Design, Feedforward
from controller.design.design_file import design_of
from controller.design.design_model import design_model
from controller.design.scheduled_controller import ScheduledController
from hfa_model.aircraft import Aircraft
from hfa_model.jobs.finished import stamp
from hfa_model.provenance import parameter_hash
from hfa_model.support.errors import BadInputError, NoSolutionError
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize
from trim.point.condition import level_flight
from trim.point.solve import find_operating_point
from verification.riccati.gare_schur import quick_solution
from verification.riccati.output_feedback import central_controller
from verification.synthesis.command_flight import fly_commands
from verification.synthesis.command_path import with_commands
from verification.synthesis.controllers import controller_table, from_estimator, problem_of
from verification.synthesis.corners import corner_loops

#: Cost of a constraint that is missed by its own size, and of a design without a stable loop.
PENALTY, LOST = 1e3, 1e6


class Variable(NamedTuple):
    """A number of the design file that the search may choose: the entries that get it, and its limits, > 0."""

    name: str
    entries: tuple[str, ...]
    low: float
    high: float


class Case(NamedTuple):
    """One linear flight: dihedral rad, the actuator of every input, commands (K, q) held for `each` s."""

    dihedral: float
    actuator: Actuator
    each: float
    ends: np.ndarray


@dataclass(frozen=True, eq=False)
class Tuning:
    """min Σ_cases Σ_outputs objective · rms error, subject to the corners' abscissa and the rates of the inputs.

    start: entries of the design file that the search starts from. objective: output -> cost of 1 of its unit. angles:
    rad, where the corners are closed. abscissa: largest allowed at any corner, 1/s. rate: largest allowed in any case,
    rad/s. evaluations: most of them. seed: of the search.
    """

    name: str
    start: Mapping[str, Any]
    variables: tuple[Variable, ...]
    cases: tuple[Case, ...]
    objective: Mapping[str, float]
    angles: tuple[float, ...]
    abscissa: float
    rate: float
    evaluations: int
    seed: int

    def entries_at(self, values: np.ndarray) -> dict[str, Any]:
        """The entries of the design file with these values of the variables."""
        entries = copy.deepcopy(dict(self.start))
        for variable, value in zip(self.variables, values.tolist(), strict=True):
            for path in variable.entries:
                *tables, last = path.split(".")
                place = entries
                for table in tables:
                    place = place.setdefault(table, {})
                place[last] = value
        return entries

    def first_values(self) -> np.ndarray:
        """What the start has, brought within the limits. BadInputError when it has no such number."""
        found = []
        for variable in self.variables:
            place: Any = self.start
            for part in variable.entries[0].split("."):
                place = place.get(part) if isinstance(place, dict) else None
            if isinstance(place, bool) or not isinstance(place, (int, float)):
                raise BadInputError(
                    f"{self.name}: variable {variable.name}: the design has no number {variable.entries[0]} to start "
                    "from; correct the name, or put the number into the design"
                )
            found.append(min(max(float(place), variable.low), variable.high))
        return np.array(found)


class Evaluation(NamedTuple):
    """cost: what the search makes small. abscissa: of the worst corner, 1/s. errors: rms by output, rate: rad/s, of
    each case; empty where a corner is unstable."""

    cost: float
    abscissa: float
    errors: tuple[dict[str, float], ...]
    rates: tuple[float, ...]


class Tuned(NamedTuple):
    """Values of the variables and their evaluation: of the start and of the best one found."""

    first: np.ndarray
    first_evaluation: Evaluation
    best: np.ndarray
    best_evaluation: Evaluation
    evaluations: int


def tune(aircraft: Aircraft, tuning: Tuning, record: Path, progress: Callable[[int, int], None] | None = None) -> Tuned:
    """Differential evolution on the logarithms of the variables, the start among its first members.

    record: a file of every evaluation; a search that was interrupted reads it and goes on where it ended, with the
    same result as without the interruption. BadInputError when it belongs to another search.
    Source: Storn and Price, J. Global Optimization 11 (1997), as implemented in SciPy.
    """
    from scipy.optimize import differential_evolution

    judge = _Judge(aircraft, tuning)
    known = _read_record(record, aircraft, tuning)
    bounds = [(math.log(variable.low), math.log(variable.high)) for variable in tuning.variables]
    first = tuning.first_values()
    seen: list[tuple[np.ndarray, Evaluation]] = []

    def cost(logarithms: np.ndarray) -> float:
        values = np.exp(logarithms)
        key = json.dumps(values.tolist())
        if key not in known:
            known[key] = judge.evaluate(values)
            with record.open("a", encoding="utf-8") as file:
                file.write(json.dumps([values.tolist(), *known[key]]) + "\n")
        seen.append((values, known[key]))
        if progress is not None:
            progress(min(len(seen), tuning.evaluations), tuning.evaluations)
        return known[key].cost

    cost(np.log(first))
    members = max(5, min(15 * len(bounds), tuning.evaluations // 8))
    # Half of the first members lie around the start: a good start is worth more than the middle of the limits.
    chance = np.random.default_rng(tuning.seed)
    lows, highs = np.array(bounds).T
    near = np.log(first) + 0.1 * (highs - lows) * chance.standard_normal((members, len(bounds)))
    members_at = np.where(chance.random((members, 1)) < 0.5, near, chance.uniform(lows, highs, near.shape))
    members_at[0] = np.log(first)
    differential_evolution(
        cost,
        bounds,
        init=np.clip(members_at, lows, highs),
        maxiter=max(0, (tuning.evaluations - 1) // members - 1),
        rng=chance,
        tol=0.0,
        polish=False,
    )
    best = min(seen, key=lambda each: each[1].cost)
    return Tuned(first, seen[0][1], *best, len(seen))


class _Judge:
    """Evaluates values of the variables; the linear models are made once."""

    def __init__(self, aircraft: Aircraft, tuning: Tuning) -> None:
        self._aircraft, self._tuning = aircraft, tuning
        angles = dict.fromkeys([*tuning.angles, *(case.dihedral for case in tuning.cases)])
        self._models = {
            angle: linearize(aircraft, find_operating_point(aircraft, level_flight(angle))) for angle in angles
        }

    def evaluate(self, values: np.ndarray) -> Evaluation:
        """The cost; `LOST` and more for a design that has no controller or no stable loop."""
        tuning = self._tuning
        design = design_of(tuning.name, tuning.entries_at(values))
        try:
            tables = {angle: quick_controller(self._aircraft, model, design) for angle, model in self._models.items()}
        except (NoSolutionError, np.linalg.LinAlgError):
            return Evaluation(2.0 * LOST, math.inf, (), ())
        loops = (
            loop
            for angle in tuning.angles
            for _, loop in corner_loops(self._aircraft, self._models[angle], tables[angle])
        )
        abscissa = max(loop.abscissa for loop in loops)
        if abscissa >= 0.0:
            return Evaluation(LOST * (1.0 + abscissa), abscissa, (), ())
        flights = [
            fly_commands(
                self._plant(case, tables[case.dihedral]),
                tables[case.dihedral],
                case.ends,
                case.each,
                design.feedforward or Feedforward(),
            )
            for case in tuning.cases
        ]
        cost = sum(
            size * flight.errors[name] for flight in flights for name, size in tuning.objective.items()
        ) + PENALTY * max(0.0, (abscissa - tuning.abscissa) / abs(tuning.abscissa))
        cost += sum(PENALTY * max(0.0, flight.rate / tuning.rate - 1.0) for flight in flights)
        return Evaluation(
            float(cost), abscissa, tuple(flight.errors for flight in flights), tuple(each.rate for each in flights)
        )

    def _plant(self, case: Case, table: ScheduledController) -> Any:
        from verification.synthesis.servo_loop import servo_plant

        actuators = dict.fromkeys(table.inputs, case.actuator)
        return servo_plant(self._aircraft, self._models[case.dihedral], table, actuators)


def quick_controller(aircraft: Aircraft, model: LinearModel, design: Design) -> ScheduledController:
    """The output-feedback controller of one angle without its certificate; NoSolutionError when there is none."""
    built = design_model(aircraft, model, design)
    problem = problem_of(built)
    X, Y = quick_solution(problem.game), quick_solution(problem.dual)
    found = with_commands(aircraft, built, from_estimator(built, central_controller(problem, X, Y)))
    return controller_table(aircraft, design, "output", [model], [found])


def _read_record(path: Path, aircraft: Aircraft, tuning: Tuning) -> dict[str, Evaluation]:
    """Values -> evaluation, of the lines of the file; a new file begins with what decides the results."""
    cases = [case._replace(ends=case.ends.tolist(), actuator=asdict(case.actuator))._asdict() for case in tuning.cases]  # type: ignore[arg-type]
    variables = [variable._asdict() for variable in tuning.variables]
    settings = {**tuning.__dict__, "cases": cases, "variables": variables}
    decides = stamp(settings | {"dynamics": aircraft.variant.name, "parameters": parameter_hash(aircraft.parameters)})
    if not path.exists():
        path.write_text(json.dumps(decides) + "\n", encoding="utf-8")
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    if not lines or lines[0] != json.dumps(decides):
        raise BadInputError(f"{path}: this is the record of another search; remove it, or choose another output")
    return {json.dumps(values): found for values, found in map(_evaluation, _whole(lines[1:]))}


def _whole(lines: list[str]) -> Iterator[Any]:
    """The lines that were written whole."""
    for line in lines:
        try:
            yield json.loads(line)
        except ValueError:
            return


def _evaluation(row: list[Any]) -> tuple[list[float], Evaluation]:
    values, cost, abscissa, errors, rates = row
    return values, Evaluation(cost, abscissa, tuple(errors), tuple(rates))
