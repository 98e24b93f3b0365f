"""Search for a lower bound of the cost.

The bound consists of polynomials W, which are proved on boxes. Linear programs fit the first
polynomials, and favor initial conditions at which the earlier bounds are far below the cost of a
flight. If they do not reach the cost of all initial conditions, W = a z'P z with decreasing shares
a follows: a smaller share satisfies the inequality on a larger set.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from hfa_flight.initial_box import usual_box
from hfa_flight.problem import FlightProblem
from hfa_prove.check.cost import CostInequality
from hfa_prove.check.cover import OpenBoxError, RefutedError, SmallestBoxError
from hfa_prove.check.equilibrium import Equilibrium, equilibrium_near
from hfa_prove.fields import Rejected
from hfa_prove.problem import plant_of, unknowns_of
from hfa_prove.search.clock import Clock, OutOfTimeError
from hfa_prove.search.cost_fit import CostProblem, Fit, TargetFlights, quadratic_piece
from hfa_prove.search.timed_search import TimedSearch
from hfa_prove.statements.cost import CostStatement, CostWitness
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Plant
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
#: Shares a of the further bounds a z'P z, besides the first, 1 - margin.
_LADDER = (0.9, 0.8, 0.6, 0.4, 0.2, 0.1, 0.05)
#: Part of the sampled level that is tried while nothing is proved.
_FIRST_OF_LEVEL = 0.25
#: Factor on the level at a point where the inequality of a share fails, for the next trial.
_BELOW_REFUTED = 0.98
#: The same factor on an undecided level.
_BELOW_UNDECIDED = 0.6
#: Least relative gain of the mean bound by a share that is tried.
_LEAST_GAIN = 0.02
#: Relative difference of levels that count as equal.
_EQUAL = 1e-6
#: Largest part of the remaining time for one level, and for one level while nothing is proved.
_OF_TIME_LEFT = 0.5
_OF_TIME_FIRST = 0.3
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
    covered: share of the initial conditions at which each W is below its level
    over_linear: median of W / z'P z at these initial conditions, nan if there is none
    of_box: highest level, relative to the largest linear cost of the initial conditions
    stopped: reason why a further level is not proved, or "" if every level that was tried is proved
    """

    statement: CostStatement
    witness: CostWitness
    boxes: tuple[int, ...]
    seconds: tuple[tuple[float, float], ...]
    covered: tuple[float, ...]
    over_linear: tuple[float, ...]
    of_box: float
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


class CostSearch(TimedSearch):
    """Search for a lower bound of the cost, with pieces of different levels.

    plant: the aircraft, whose state limits are the envelope
    equilibrium: enclosure of the equilibrium states and inputs
    solved: indices of the unknowns of the equilibrium
    weights: weights Q and R of the linear quadratic problem, and the matrix P of its optimal cost
    half: half-widths of the initial-condition box, (n,)
    degree: degree of the polynomials W
    margin: relative distance of W below the linear quadratic cost
    clock: limit of the processor time, and progress
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
        clock: Clock,
        save: Callable[[CostBound], None] | None = None,
    ) -> None:
        super().__init__(plant, equilibrium, clock)
        Q, R, P = weights
        starts = half * np.random.default_rng(0).uniform(-1.0, 1.0, (_DRAWN, len(half)))
        self.problem = CostProblem(plant, equilibrium, Q, R, P, degree, margin)
        self._solved = solved
        self.starts = starts
        self._save = save
        self._pieces: list[_Proved] = []

    def found(self) -> CostBound:
        """Return the proved lower bound.

        After an interruption or at the time limit, the bound consists of the pieces proved so far.

        Raises NoSolutionError if no piece is proved.
        """
        self._run()
        if not self._pieces:
            raise self._nothing_proved("no lower bound was proved: ")
        return self._bound()

    def _search(self) -> None:
        """Prove pieces in this order:

        - fitted polynomials, with levels up to the largest cost of the initial conditions
        - W = a z'P z with decreasing shares a, if this cost is not reached
        - fitted polynomials for the flights with the lowest ratios of proved bound to cost

        Raises OutOfTimeError at the time limit.
        """
        _, costs = self._flights
        linear = self.problem.linear_cost(self.starts)
        largest = _ABOVE * float(np.max(costs, initial=linear.max(), where=np.isfinite(costs)))
        for part in _SHARES:
            if not self._fitted_at(part * largest):
                break
        if self._level < largest * (1.0 - _EQUAL):
            self._climb_ladder(largest)
        self._fit_poor_flights()

    def _fitted_at(self, c: float, least: float = 0.0) -> bool:
        """Return whether a level is proved, if necessary by a fitted polynomial.

        least: lowest flight cost that the fit considers
        """
        if self._level >= c * (1.0 - _EQUAL):
            return True
        return self._tried(c, partial(self._fitted, c, self._target_flights(c, least))) is None

    def _tried(self, c: float, prove: Callable[[], _Proved]) -> Exception | None:
        """Store a piece of level c and return None, or return the reason why it is not proved.

        prove: proof of the piece
        """
        try:
            with self._clock.step(_OF_TIME_LEFT if self._pieces else _OF_TIME_FIRST):
                self._pieces.append(prove())
        except (OpenBoxError, Rejected, OutOfTimeError) as error:
            self._stopped = f"the level {c:.4g} is not proved: {error}"
            return error
        if self._save is not None:
            self._save(self._bound())
        return None

    @property
    def _level(self) -> float:
        """Largest proved level, 0 if nothing is proved."""
        return max((each.piece.c for each in self._pieces), default=0.0)

    def _climb_ladder(self, largest: float) -> None:
        """Prove W = a z'P z for several shares a, each at about the highest level found.

        The next share is the one that raises the bounds of the initial conditions most. Samples
        give its first level. A level at which the inequality fails is replaced by that of the
        refuted point, and an undecided one is reduced.

        largest: largest cost of the initial conditions
        """
        first = 1.0 - self.problem.margin
        levels: dict[float, float] = {}
        for share in (first, *(share for share in _LADDER if share < first)):
            self._clock(0.0, 1.0, f"samples of {share:g} of the linear cost")
            level = self.problem.permitted_level(share, largest)
            levels[share] = min(_BELOW_REFUTED * level, share * largest)
        while True:
            gains = {share: self._gain(share, c) for share, c in levels.items()}
            share = max(gains, key=lambda share: gains[share])
            if gains[share] < _LEAST_GAIN:
                return
            c = levels[share] if self._pieces else _FIRST_OF_LEVEL * levels[share]
            piece = quadratic_piece(self.problem, share, c)
            error = self._tried(piece.c, partial(self._of_piece, piece))
            if error is None:
                levels[share] = 0.0 if c == levels[share] else levels[share]
            elif isinstance(error, (RefutedError, SmallestBoxError)):
                levels[share] = _BELOW_REFUTED * float(piece.W.at(error.place[None])[0])
            else:
                levels[share] *= _BELOW_UNDECIDED if self._pieces else _FIRST_OF_LEVEL
            self._clock(0.0, 1.0)

    def _gain(self, share: float, c: float) -> float:
        """Return the mean gain of bound / linear cost by the piece W = share z'P z of level c.

        The gain is relative to the present mean, inf if nothing is proved.
        """
        linear = self.problem.linear_cost(self.starts)
        known = (
            self._bound().statement.bound(self.starts) if self._pieces else np.zeros(len(linear))
        )
        gained = np.mean(np.maximum(np.minimum(share * linear, c) - known, 0.0) / linear)
        return float(gained / np.mean(known / linear)) if self._pieces else float(gained) / _EQUAL

    def _of_piece(self, piece: Piece) -> _Proved:
        """Return a proved piece.

        Raises OpenBoxError, Rejected or OutOfTimeError if the piece is not proved.
        """
        begin = self._clock.used
        boxes = self._inequality(piece).proved(_ENDLESS, self._clock)
        return _Proved(piece, boxes, (0.0, self._clock.used - begin))

    def _fit_poor_flights(self) -> None:
        """Prove polynomials just below the flight costs with the lowest ratios of bound to cost."""
        _, costs = self._flights
        # a flight that does not converge gives no bound of the least cost
        tried = ~np.isfinite(costs)
        for _ in range(_FOR_POOR):
            ratios = np.where(tried, np.inf, self._bounds() / costs)
            cost = costs[np.argmin(ratios)]
            if not ratios.min() < self._good:
                break
            c = (1.0 - self.problem.margin) * float(cost)
            least = _NEAR * float(cost)
            self._tried(c, partial(self._fitted, c, self._target_flights(c, least)))
            tried |= (costs >= least) & (costs <= cost)

    @cached_property
    def _flights(self) -> tuple[np.ndarray, np.ndarray]:
        """Initial conditions (N, n) and the costs (N,) of flights with the saturated LQR.

        The initial conditions are random, and those of highest linear quadratic cost are included.
        """
        dearest = np.argsort(-self.problem.linear_cost(self.starts[_FLOWN:]))[:_DEAREST]
        z = np.concatenate([self.starts[:_FLOWN], self.starts[_FLOWN + dearest]])
        return z, self.problem.saturated_lqr_costs(z, self._clock)

    def _target_flights(self, c: float, least: float) -> TargetFlights:
        """Return the flights at which the polynomial W of level c is to be large.

        Each flight costs at least `least`, and at most c / (1 - margin). The proved bound of its
        cost is below `_good` times the cost.
        """
        z, costs = self._flights
        is_near = (1.0 - self.problem.margin) * costs <= c * (1.0 + 1e-9)
        is_near &= costs >= least
        poor = is_near & (self._bounds() < self._good * costs)
        return TargetFlights(z[poor], costs[poor], _OF_POOR if least else _OF_ALL)

    @property
    def _good(self) -> float:
        """Ratio of proved bound to flight cost above which a bound needs no improvement."""
        return 1.0 - _GOOD * self.problem.margin

    def _bounds(self) -> np.ndarray:
        """Return the proved lower bounds (N,) of the cost at the initial conditions of `_flights`.

        The bounds are 0 if no piece is proved.
        """
        z, _ = self._flights
        return self._bound().statement.bound(z) if self._pieces else np.zeros(len(z))

    def _bound(self) -> CostBound:
        plant = self.problem.plant
        names = (*plant.states, *plant.inputs)
        at = dict(zip(names, self.problem.equilibrium.x.tolist(), strict=True))
        pieces = tuple(each.piece for each in self._pieces)
        statement = CostStatement(plant, at, self.problem.Q, self.problem.R, pieces)
        boxes = tuple(each.boxes for each in self._pieces)
        solved = tuple(names[i] for i in self._solved)
        witness = CostWitness(solved, tuple(2 * count for count in boxes))
        seconds = tuple(each.seconds for each in self._pieces)
        covered, over_linear = [], []
        linear = self.problem.linear_cost(self.starts)
        for piece in pieces:
            bound = piece.bound(self.starts)
            below = bound < piece.c
            covered.append(float(np.mean(below)))
            over_linear.append(float(np.median((bound / linear)[below])) if any(below) else np.nan)
        return CostBound(
            statement,
            witness,
            boxes,
            seconds,
            tuple(covered),
            tuple(over_linear),
            statement.level / float(linear.max()),
            self._stopped,
        )

    def _fitted(self, c: float, wanted: TargetFlights) -> _Proved:
        """Return a proved piece of level c with a fitted polynomial.

        wanted: flights at which W is to be large

        Raises OpenBoxError, Rejected or OutOfTimeError if the piece is not proved.
        """
        begin = self._clock.used
        fit, W = self._fit(c, wanted)
        for _ in range(_REFUTED):
            piece = Piece(fit.M, W, c)
            fitted = self._clock.used
            try:
                boxes = self._inequality(piece).proved(_ENDLESS, self._clock)
            except (RefutedError, SmallestBoxError) as error:
                fit.refuted(error.place)
            else:
                return _Proved(piece, boxes, (fitted - begin, self._clock.used - fitted))
            W = fit.fitted()
        raise OpenBoxError(f"{_REFUTED} successive polynomials were refuted", np.zeros(len(fit.M)))

    def _fit(self, c: float, wanted: TargetFlights) -> tuple[Fit, Polynomial]:
        """Return the linear programs for level c and their first polynomial W.

        The sampled set is enlarged until the linear programs have a solution.

        wanted: flights at which W is to be large

        Raises OpenBoxError if the largest sampled set gives no solution.
        """

        def report(programs: int) -> None:
            self._clock(0.0, 1.0, f"{programs} linear programs")

        beyond = self._beyond(c)
        while True:
            fit = Fit(self.problem, c, wanted, beyond, report)
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
        ratios = self.problem.linear_cost(z[near]) / costs[near]
        least = _BEYOND_FEW if z.shape[1] <= 2 else _BEYOND_MANY
        return least * float(np.max(ratios, initial=1.0))

    def _inequality(self, piece: Piece) -> CostInequality:
        problem = self.problem
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
    clock = Clock(seconds, progress)
    plant = plant_of(problem)
    solved = unknowns_of(problem, plant)
    trim = np.array([*plant.trim.values(), *plant.inputs.values()])
    return CostSearch(
        plant,
        equilibrium_near(plant, trim, solved),
        solved,
        (problem.Q, problem.R, problem.P),
        usual_box(problem),
        degree=degree,
        margin=margin,
        clock=clock,
        save=save,
    )
