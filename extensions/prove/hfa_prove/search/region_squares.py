"""Search for a large region by sums of squares: choice of V, and its largest proved level."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hfa_prove.check.equilibrium import equilibrium_near
from hfa_prove.check.region_squares import extents_of
from hfa_prove.monomials import PolynomialFunction, edge_points
from hfa_prove.search.clock import OutOfTimeError
from hfa_prove.search.kinks import kink_at
from hfa_prove.search.level import (
    LevelSearch,
    ProvedLevel,
    Setting,
    accepted,
    holding_ball,
    proved_level,
)
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import LevelSet, first_obstacle, rises
from hfa_prove.search.region_search import Region, Settings, lyapunov_matrices, refuse_unstable
from hfa_prove.search.shape_squares import better
from hfa_prove.statements.loop import Loop
from hfa_prove.words import place_in_words
from hfa_support.errors import NoSolutionError

#: A step with a smaller linear growth of the set is the last for its reach.
_GAIN = 1.004
#: Decreasing levels of a new V that are tried.
_LEVELS = (1.0, 0.93, 0.85, 0.7, 0.5)
#: Time that is reserved for a proof, in steps of the search.
_TURNS_OF_A_PROOF = 5.0
#: Highest level of the last V that is tried.
_GROWTH = 1.6
#: Number of Lyapunov matrices of the loop that are tried.
_CANDIDATES = 10
#: Description of a V that is a Lyapunov matrix.
LYAPUNOV = "a Lyapunov matrix of the loop"
#: Number of candidates for which a proof is tried.
_TRIED = 4
#: Largest extents of a set, in nominal values, without limits of states.
_WIDEST = 100.0


class SquaresSearch:
    """Search for a region of attraction by sums of squares.

    loop: the saturated loop
    known: pairs of a description and a matrix P, each of which gives a candidate V = z'P z
    settings: degree, time limit and what is saved
    """

    def __init__(
        self,
        loop: Loop,
        known: Sequence[tuple[str, np.ndarray]],
        settings: Settings,
    ) -> None:
        self.loop = loop
        self.plant = LoopValues(loop)
        self._known = known
        self._search = settings
        self._clock = settings.clock
        self._settings = settings_of(len(loop.states), settings.degree)
        self._best = settings.earlier
        self._turns: list[PolynomialFunction] = []
        self._stopped = ""

    def found(self) -> Region:
        """Return the largest proved region.

        After an interruption or at the time limit, the largest region proved so far is returned.

        Raises NoSolutionError if no region is proved or the linear loop is not Hurwitz. Raises
        BadInputError if the equations cannot be enclosed.
        """
        refuse_unstable(self.plant.J)
        kink = kink_at(self.loop, equilibrium_near(self.loop, np.array([*self.loop.trim.values()])))
        if kink:
            raise NoSolutionError(kink)
        try:
            self._climb_all()
        except OutOfTimeError as error:
            self._stopped = str(error)
        except KeyboardInterrupt:
            self._stopped = "interrupted"
        if self._best is None:
            raise NoSolutionError(self._stopped or self._where_it_ended())
        return replace(self._best, stopped=self._stopped, tried=tuple(self._turns))

    def _climb_all(self) -> None:
        """Prove the first V, then grow it by each setting in turn.

        Raises OutOfTimeError at the time limit.
        """
        if self._best is None:
            V = self._start()
        else:
            V = self._best.set.V.scaled(1.0 / self._best.set.rho)
        for setting in self._settings:
            if self._clock.left > setting.seconds:
                V = self._climb(self._proved_V(V), setting)

    def _where_it_ended(self) -> str:
        """Return a clause on the first obstacle to the V with the largest sampled set."""
        (_, V, origin), *_ = self._sampled()
        T = V.coordinates()
        _, place = first_obstacle(rises(self.plant, V.slope), V, T)
        where = "" if place is None else f"; V' >= 0 at {place_in_words(self.loop, place)}"
        return f"no level of V = z'P z ({origin}) is proved{where}"

    def _proved_V(self, V: PolynomialFunction) -> PolynomialFunction:
        """Return V of the largest region proved so far, scaled to level 1.

        If no region is proved, the given V is returned.
        """
        if self._best is None:
            return V
        proved = self._best.set
        return proved.V.scaled(1.0 / proved.rho)

    @property
    def _n(self) -> int:
        return len(self.loop.states)

    def _candidates(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield pairs of a description and a positive definite P, candidates V = z'P z."""
        for origin, P in self._known:
            if np.all(np.linalg.eigvalsh((P + P.T) / 2) > 0.0):
                yield origin, (P + P.T) / 2
        for P in lyapunov_matrices(self.plant.J, self.plant.nominal, _CANDIDATES):
            yield LYAPUNOV, P

    def _start(self) -> PolynomialFunction:
        """Return the first candidate V with a proved level, scaled to level 1.

        At most `_TRIED` candidates are tried, in descending order of the size of their sampled
        sets. If no level is proved, the candidate with the largest sampled set is returned.
        """
        candidates = self._sampled()
        for _, V, origin in candidates[:_TRIED]:
            if self._prove(V, 1.0, origin, self._settings[0]):
                return V
        return candidates[0][1]

    def _sampled(self) -> list[tuple[float, PolynomialFunction, str]]:
        """Return (size of the sampled set, V scaled to level 1, description) of each candidate.

        The sampled set is the largest level set in which samples find no obstacle. The candidate
        with the largest set is first.
        """
        found = []
        for origin, P in self._candidates():
            level, T = self._limit_of(P)
            V = PolynomialFunction.quadratic(P)
            rise, _ = first_obstacle(rises(self.plant, V.slope), V, T, quick=True)
            level = min(level, rise)
            size = level ** (self._n / 2) / np.sqrt(np.linalg.det(P))
            found.append((float(size), V.scaled(1.0 / level), origin))
        return sorted(found, key=lambda candidate: -candidate[0])

    def _limit_of(self, P: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the largest level of z'P z within the limits, and T (n, n) of coordinates z = T y.

        The level set is the unit ball of y. It also stays within `_WIDEST` nominal values of the
        states.
        """
        inverse = np.linalg.inv(P)
        rows = np.vstack([self.plant.limited_rows, np.eye(self._n)])
        nearest = np.min(np.abs(self.plant.permitted_deviations), axis=1)
        room = np.concatenate([nearest, _WIDEST * self.plant.nominal])
        widths = np.einsum("ki,ij,kj->k", rows, inverse, rows)
        level = float(np.min(room**2 / widths)) * (1.0 - 1e-9)
        return level, np.sqrt(level) * np.linalg.inv(np.linalg.cholesky(P)).T

    def _prove(self, V: PolynomialFunction, rho: float, origin: str, setting: Setting) -> float:
        """Prove the largest level of V up to rho, and return the size of its set.

        The size is 0 if no level is proved. The result is stored if its set is the largest so far.

        origin: description of V
        setting: degrees of the proof
        """
        self._clock(0.0, 1.0, f"proving {origin}")
        T = V.coordinates()
        return self._kept(proved_level(self.loop, V, rho, setting, T, self._clock), origin)

    def _kept(self, proved: ProvedLevel | None, origin: str) -> float:
        """Store a proved set if it is the largest so far, and return its size.

        proved: the proved set, or None, for which the size is 0
        origin: description of V
        """
        if proved is None:
            return 0.0
        region = region_of(proved, self.plant, origin)
        if self._best is None or region.set.size > self._best.set.size:
            self._best = region
            if self._search.save is not None:
                self._search.save(region)
        return region.set.size

    def _climb(self, V: PolynomialFunction, setting: Setting) -> PolynomialFunction:
        """Return V, scaled to level 1, after alternate optimization of multipliers and V.

        The largest proved level of the result is stored if its set is the largest so far.

        setting: degrees of the proof
        """
        turn = self._turn(V, setting)
        if turn is None:
            return V
        for reach in setting.reaches:
            while self._clock.left > _TURNS_OF_A_PROOF * turn.seconds:
                found = better(
                    turn.search, self.plant.limited_rows, self.plant.permitted_deviations, reach
                )
                after = None if found is None else self._turn(found, setting, turn.size)
                if after is None:
                    break
                grown = after.size / turn.size
                turn = after
                if grown < _GAIN:
                    break
        origin = origin_of(turn.V)
        highest = self._highest(turn.V)
        if highest > 1.0 or not self._kept(accepted(turn.search), origin):
            self._prove(turn.V, highest, origin, setting)
        return turn.V

    def _turn(self, V: PolynomialFunction, setting: Setting, least: float = 0.0) -> _Turn | None:
        """Return V with a proof of level 1 in double precision, or None if no proof is found.

        V is scaled to slightly lower levels if level 1 is not proved.

        setting: degrees of the proof
        least: size that the set must exceed
        """
        begin = self._clock.used
        for level in _LEVELS:
            tried = V.scaled(1.0 / level)
            held = holding_ball(tried, 1.0, tried.coordinates(), self._clock)
            if held is None:
                continue
            size = LevelSet(tried, 1.0, held).size
            if size <= least:
                return None
            try:
                search = LevelSearch(self.loop, tried, 1.0, held, setting, self._clock)
                if search.proofs is None:
                    continue
            except NoSolutionError:  # not enclosed on such a large ball
                continue
            self._clock(0.0, 1.0, f"V of degree {setting.degree}, size {size:.4g}")
            self._turns.append(tried)
            return _Turn(tried, search, size, self._clock.used - begin)
        return None

    def _highest(self, V: PolynomialFunction) -> float:
        """Return the highest level, at least 1, at which samples find no obstacle.

        An obstacle is a state with V' >= 0, or a boundary point beyond a limit.
        """
        T = V.coordinates()
        rise, _ = first_obstacle(rises(self.plant, V.slope), V, T, quick=True)
        highest = 1.0
        for level in np.geomspace(1.01, _GROWTH, 12):
            points = edge_points(V, T, level) @ T.T
            if level > rise or np.any(self.plant.away(points)):
                break
            highest = float(level)
        return highest


@dataclass(frozen=True, eq=False)
class _Turn:
    """A V with a proof of level 1 in double precision.

    V: the polynomial V
    search: search in a ball around the set {V <= 1}
    size: size of the set
    seconds: processor time of the proof, s
    """

    V: PolynomialFunction
    search: LevelSearch
    size: float
    seconds: float


def origin_of(V: PolynomialFunction) -> str:
    """Return the description of a V that the search optimized."""
    return f"a polynomial of degree {V.degree} from the search"


def region_of(
    proved: ProvedLevel,
    loop: LoopValues,
    origin: str,
    rise: tuple[float, np.ndarray | None] | None = None,
) -> Region:
    """Return a proved level as a region.

    loop: the loop in double precision
    origin: description of V
    rise: lowest V found with V' >= 0 and the state deviation there, or None
    """
    statement = proved.statement
    T = np.array(proved.witness["T"])
    return Region(
        statement,
        proved.witness,
        proved.parts,
        LevelSet(PolynomialFunction.of_terms(statement.terms), statement.rho, T),
        extents_of(statement, T),
        origin,
        loop,
        rise,
    )


def settings_of(n: int, degree: int) -> list[Setting]:
    """Return the settings of proofs to try, in order.

    n: number of states
    degree: highest degree of V
    """
    if n <= 2:
        tried = [Setting(8, 4, 2), Setting(9, 5, 4), Setting(11, 6, 6)]
    elif n <= 4:
        # A quartic V needs half = 5. With half = 4 only 0.4 of its level is proved, a smaller set
        # than with a quadratic V. With half = 3 only large steps are made, since half = 4 needs
        # fewer.
        first = Setting(6, 3, 2, reaches=(1.35,))
        tried = [first, Setting(7, 4, 2), Setting(9, 5, 4, 200.0)]
    else:
        tried = [Setting(5, 2, 2)]
    return [setting for setting in tried if setting.degree <= degree]
