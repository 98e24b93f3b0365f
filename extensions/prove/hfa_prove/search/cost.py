"""Search for a lower bound of the cost.

The bound consists of polynomials W, which are fitted by linear programs and proved on boxes. The
fit of each polynomial favors initial conditions at which the earlier bounds are far below the cost
of a flight.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hfa_flight.initial_box import usual_box
from hfa_flight.problem import FlightProblem
from hfa_prove.check import Proved
from hfa_prove.check.cost import CostInequality, equilibrium_of
from hfa_prove.check.cover import OpenBoxError, RefutedError, SmallestBoxError
from hfa_prove.check.equilibrium import Equilibrium, open_rates
from hfa_prove.fields import Rejected
from hfa_prove.problem import plant_of, unknowns_of
from hfa_prove.search.cost_fit import CostProblem, Fit, TargetFlights
from hfa_prove.search.interruption import OutOfTimeError
from hfa_prove.search.kinks import kink_at
from hfa_prove.statements.cost import CostStatement, CostWitness
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Plant
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: Number of initial conditions that are drawn.
_DRAWN = 4000
#: Number of them with a flight.
_FLOWN = 120
#: Number of further flights, from the initial conditions of the largest linear cost.
_DEAREST = 80
#: The first levels, relative to the largest cost of the initial conditions.
_SHARES = (0.2, 1.0)
#: Largest number of levels for initial conditions with poor bounds.
_FOR_POOR = 6
#: Least cost that the fit of such a level considers, relative to that of the poorest condition.
_NEAR = 0.75
#: Weight of the least ratio of W to the cost of a flight, for all initial conditions.
_OF_ALL = 2.0
#: The same weight for the poorest initial conditions.
_OF_POOR = 20.0
#: Largest number of times that the first level is quartered while nothing is proved.
_QUARTERED = 12
#: Least factor between a proved level and the next, after the first level was quartered.
_LEAST_GROWTH = 1.1
#: Largest share of the remaining time for one level.
_OF_TIME_LEFT = 0.5
#: Largest distance of a good bound below the cost of a flight, in margins.
_GOOD = 1.5
#: The largest level, relative to the largest cost of a flight.
_ABOVE = 1.05
#: Factor by which z'P z of samples exceeds the level, for one or two states.
_BEYOND_FEW = 1.3
#: The same factor for more states, for which boxes at the faces of the cube are many.
_BEYOND_MANY = 1.6
#: Growth of this factor in each further trial.
_FURTHER = 1.3
#: Largest factor that is enlarged again.
_MOST_BEYOND = 2.5
#: Number of boxes that is never reached within the time limit.
_ENDLESS = 10**9
#: Largest number of refuted points for one level.
_REFUTED = 60


@dataclass(frozen=True, eq=False)
class CostBound:
    """A proved lower bound of the cost, with the effort of its search.

    statement: the proved statement
    witness: data for the proof
    boxes: number of boxes that the proof of each piece evaluated
    seconds: processor times of the fit and of the proof of each piece, s
    stopped: reason why a further level is not proved, or "" if every level that was tried is proved
    """

    statement: CostStatement
    witness: CostWitness
    boxes: tuple[int, ...]
    seconds: tuple[tuple[float, float], ...]
    stopped: str


class _Proved(NamedTuple):
    """A proved piece.

    piece: polynomial W with its level
    boxes: number of boxes that the proof evaluated
    seconds: processor times of the fit and of the proof, s
    """

    piece: Piece
    boxes: int
    seconds: tuple[float, float]


def _reached(proved: Sequence[_Proved], level: float) -> bool:
    """Return whether a proved piece has the given level or a higher one.

    A relative error of 1e-6 is permitted.
    """
    return any(each.piece.c >= level * (1.0 - 1e-6) for each in proved)


class CostSearch:
    """Search for a lower bound of the cost, with pieces of different levels.

    plant: the aircraft, whose state limits are the envelope
    equilibrium: enclosure of the equilibrium states and inputs
    solved: indices of the unknowns of the equilibrium
    weights: weights Q and R of the linear quadratic problem, and the matrix P of its optimal cost
    half: half-widths of the initial-condition box, (n,)
    degree: degree of the polynomials W
    margin: relative distance of W below the linear quadratic cost
    seconds: limit of the processor time, s
    progress: called with the progress of the present step, or None
    save: called with the bound after each proved piece, or None
    """

    def __init__(
        self,
        plant: Plant,
        equilibrium: Equilibrium,
        solved: tuple[int, ...],
        weights: tuple[np.ndarray, np.ndarray, np.ndarray],
        half: np.ndarray,
        *,
        degree: int,
        margin: float,
        seconds: float,
        progress: Progress | None = None,
        save: Callable[[CostBound], None] | None = None,
    ) -> None:
        Q, R, P = weights
        starts = half * np.random.default_rng(0).uniform(-1.0, 1.0, (_DRAWN, len(half)))
        self._problem = CostProblem(plant, equilibrium, Q, R, P, degree, margin)
        self._solved = solved
        self.starts = starts
        self._seconds = seconds
        self._begin = time.process_time()
        self._least_left = 0.0
        self._progress = progress
        self._save = save

    def found(self, earlier: Proved | None = None) -> CostBound:
        """Return the proved lower bound.

        After an interruption or at the time limit, the bound consists of the pieces proved so far.

        earlier: bound of an earlier run, whose pieces are included, or None

        Raises NoSolutionError if no piece is proved.
        """
        proved: list[_Proved] = []
        if earlier is not None:
            for known in zip(earlier.statement.pieces, earlier.sizes, strict=True):
                proved.append(_Proved(*known, (0.0, 0.0)))
        stopped = ""
        try:
            for c, least in self._levels(proved):
                if self._left() < 0.0:
                    stopped = stopped or "the time limit was reached"
                    break
                self._least_left = (1.0 - _OF_TIME_LEFT) * self._left()
                try:
                    proved.append(self._proved(c, self._target_flights(proved, c, least)))
                except (OpenBoxError, Rejected, OutOfTimeError) as error:
                    stopped = f"the level {c:.4g} is not proved: {error}"
                    continue
                if self._save is not None:
                    self._save(self._bound(proved, ""))
        except KeyboardInterrupt:
            stopped = "interrupted"
        if not proved:
            plant = self._problem.plant
            kink = kink_at(plant, open_rates(plant), self._problem.equilibrium)
            why = f"{stopped}; {kink}" if kink else stopped
            raise NoSolutionError(f"no lower bound was proved: {why}")
        return self._bound(proved, stopped)

    @cached_property
    def _flights(self) -> tuple[np.ndarray, np.ndarray]:
        """Initial conditions (N, n) and the costs (N,) of flights with the saturated LQR.

        The initial conditions are random, and those of highest linear quadratic cost are included.
        """
        dearest = np.argsort(-self._problem.linear_cost(self.starts[_FLOWN:]))[:_DEAREST]
        z = np.concatenate([self.starts[:_FLOWN], self.starts[_FLOWN + dearest]])
        return z, self._problem.saturated_lqr_costs(z)

    def _levels(self, proved: Sequence[_Proved]) -> Iterator[tuple[float, float]]:
        """Yield pairs of a level to prove and the lowest flight cost that the fit considers.

        - The first levels rise until one is not proved.
        - If none of these is proved, lower levels are tried until one is proved, and then rise
          again.
        - The last levels are just below the flight costs with the lowest ratios of proved bound to
          cost.
        """
        _, costs = self._flights
        linear = self._problem.linear_cost(self.starts)
        largest = _ABOVE * float(np.max(costs, initial=linear.max(), where=np.isfinite(costs)))
        for share in _SHARES:
            level = share * largest
            if not _reached(proved, level):
                yield level, 0.0
            if not _reached(proved, level):
                break
        for quarters in range(1, _QUARTERED + 1):
            if proved:
                break
            level = _SHARES[0] * largest / 4.0**quarters
            yield level, 0.0
            factor = 2.0
            while proved and factor > _LEAST_GROWTH:
                yield factor * level, 0.0
                if _reached(proved, factor * level):
                    level *= factor
                else:
                    factor **= 0.5
        # a flight that does not converge gives no bound of the least cost
        tried = ~np.isfinite(costs)
        for _ in range(_FOR_POOR):
            ratios = np.where(tried, np.inf, self._bounds(proved) / costs)
            cost = costs[np.argmin(ratios)]
            if not ratios.min() < self._good:
                break
            yield (1.0 - self._problem.margin) * float(cost), _NEAR * float(cost)
            tried |= (costs >= _NEAR * cost) & (costs <= cost)

    def _target_flights(self, proved: Sequence[_Proved], c: float, least: float) -> TargetFlights:
        """Return the flights at which the polynomial W of level c is to be large.

        Each flight costs at least `least`, and at most c / (1 - margin). The proved bound of its
        cost is below `_good` times the cost.

        proved: the pieces proved so far
        """
        z, costs = self._flights
        is_near = (1.0 - self._problem.margin) * costs <= c * (1.0 + 1e-9)
        is_near &= costs >= least
        poor = is_near & (self._bounds(proved) < self._good * costs)
        return TargetFlights(z[poor], costs[poor], _OF_POOR if least else _OF_ALL)

    @property
    def _good(self) -> float:
        """Ratio of proved bound to flight cost above which a bound needs no improvement."""
        return 1.0 - _GOOD * self._problem.margin

    def _bounds(self, proved: Sequence[_Proved]) -> np.ndarray:
        """Return the proved lower bounds (N,) of the cost at the initial conditions of `_flights`.

        The bounds are 0 if no piece is proved.
        """
        z, _ = self._flights
        if not proved:
            return np.zeros(len(z))
        return self._bound(proved, "").statement.bound(z)

    def _bound(self, proved: Sequence[_Proved], stopped: str) -> CostBound:
        plant = self._problem.plant
        names = (*plant.states, *plant.inputs)
        at = dict(zip(names, self._problem.equilibrium.x.tolist(), strict=True))
        pieces = tuple(each.piece for each in proved)
        statement = CostStatement(plant, at, self._problem.Q, self._problem.R, pieces)
        boxes = tuple(each.boxes for each in proved)
        solved = tuple(names[i] for i in self._solved)
        witness = CostWitness(solved, tuple(2 * count for count in boxes))
        return CostBound(statement, witness, boxes, tuple(each.seconds for each in proved), stopped)

    def _left(self) -> float:
        return self._seconds - (time.process_time() - self._begin)

    def _report(self, done: float, whole: float, text: str = "") -> None:
        if self._left() < self._least_left:
            raise OutOfTimeError("the attempt used half of the remaining time", text, done)
        if self._progress is not None:
            self._progress(done, whole, text)

    def _proved(self, c: float, wanted: TargetFlights) -> _Proved:
        """Return a proved piece of level c.

        wanted: flights at which W is to be large

        Raises OpenBoxError, Rejected or OutOfTimeError if the piece is not proved.
        """
        begin = time.process_time()
        fit, W = self._fitted(c, wanted)
        for _ in range(_REFUTED):
            piece = Piece(fit.M, W, c)
            fitted = time.process_time()
            try:
                boxes = self._inequality(piece).proved(_ENDLESS, self._report)
            except (RefutedError, SmallestBoxError) as error:
                fit.refuted(error.place)
            else:
                return _Proved(piece, boxes, (fitted - begin, time.process_time() - fitted))
            W = fit.fitted()
        raise OpenBoxError(f"{_REFUTED} successive polynomials were refuted", np.zeros(len(fit.M)))

    def _fitted(self, c: float, wanted: TargetFlights) -> tuple[Fit, Polynomial]:
        """Return the linear programs for level c and their first polynomial W.

        The sampled set is enlarged until the linear programs have a solution.

        wanted: flights at which W is to be large

        Raises OpenBoxError if the largest sampled set gives no solution.
        """

        def report(programs: int) -> None:
            self._report(0.0, 1.0, f"{programs} linear programs")

        beyond = self._beyond(c)
        while True:
            fit = Fit(self._problem, c, wanted, beyond, report)
            try:
                return fit, fit.fitted()
            except OpenBoxError:
                if beyond >= _MOST_BEYOND:
                    raise
                beyond *= _FURTHER

    def _beyond(self, c: float) -> float:
        """Return the largest z'P z of samples, as a multiple of the level c.

        The multiple is larger if flights with costs near c cost less than z'P z.
        """
        z, costs = self._flights
        near = (costs > 0.3 * c) & (costs <= c)
        ratios = self._problem.linear_cost(z[near]) / costs[near]
        least = _BEYOND_FEW if z.shape[1] <= 2 else _BEYOND_MANY
        return least * float(np.max(ratios, initial=1.0))

    def _inequality(self, piece: Piece) -> CostInequality:
        problem = self._problem
        return CostInequality(problem.plant, problem.equilibrium, piece, problem.Q, problem.R)


def bound_search(
    problem: FlightProblem,
    *,
    degree: int,
    margin: float,
    seconds: float,
    progress: Progress | None = None,
    save: Callable[[CostBound], None] | None = None,
) -> CostSearch:
    """Return a search for a lower bound of the cost of flights that begin in the box of
    `usual_box`.

    degree: degree of the polynomial W, the lower bound as a function of the initial condition
    margin: relative distance of W below the linear quadratic cost, to second order
    seconds: limit of processor time, s
    save: function called with the bound after each proved piece of the box, or None
    """
    plant = plant_of(problem)
    solved = unknowns_of(problem, plant)
    trim = np.array([*plant.trim.values(), *plant.inputs.values()])
    return CostSearch(
        plant,
        equilibrium_of(plant, trim, solved),
        solved,
        (problem.Q, problem.R, problem.P),
        usual_box(problem),
        degree=degree,
        margin=margin,
        seconds=seconds,
        progress=progress,
        save=save,
    )
