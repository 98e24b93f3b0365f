"""Search for a large region: choice of V, its largest proved level, and obstacles beyond it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from hfa_aircraft.march.ending import Outcome
from hfa_prove.check.loop_squares import Equilibrium
from hfa_prove.check.region_squares import extents_of
from hfa_prove.search.level import (
    LevelSearch,
    ProvedLevel,
    Setting,
    accepted,
    holding_ball,
    proved_level,
)
from hfa_prove.search.monomials import PolynomialFunction, edge_points
from hfa_prove.search.obstacles import first_obstacle
from hfa_prove.search.plant import Plant, outcomes, refuse_unstable
from hfa_prove.search.shape_squares import better
from hfa_prove.statements.loop import Loop
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

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
#: Number of rays with simulated initial conditions.
_RAYS = 80
#: Number of initial conditions on each ray.
_SHELLS = 10
#: Distance of the farthest initial condition, over that of the set.
_FARTHEST = 20.0
#: Duration of these simulations, in time constants of the slowest mode.
_TIMES = 12.0
#: A limit binds if a signal reaches this share of the distance to it.
_TOUCHES = 0.97
#: Number of candidates for which a proof is tried.
_TRIED = 4
#: Largest extents of a set, in nominal values, without limits of states.
_WIDEST = 100.0


@dataclass(frozen=True, eq=False)
class Bounds:
    """Obstacles to a set larger than the proved set.

    rises: lowest V found with V' >= 0 and the state deviation there, or (inf, None)
    starts: outcome -> lowest V of an initial condition with this outcome, and the initial condition
    limits: signals whose limits the set nearly reaches
    """

    rises: tuple[float, np.ndarray | None]
    starts: Mapping[Outcome, tuple[float, np.ndarray]]
    limits: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Region:
    """A proved region, with the obstacles to a larger region.

    proved: statement and witness
    V: the polynomial V
    origin: description of V
    bounds: the obstacles
    plant: the loop in double precision
    T: matrix of the coordinates z = T y in which the set lies in the unit ball, (n, n)
    stopped: "interrupted" after Ctrl-C, otherwise ""
    tried: the V that the search optimized, each with a proof of level 1 in double precision
    """

    proved: ProvedLevel
    V: PolynomialFunction
    origin: str
    bounds: Bounds
    plant: Plant
    T: np.ndarray
    stopped: str = ""
    tried: Sequence[PolynomialFunction] = ()

    @property
    def rho(self) -> float:
        """The proved level of V."""
        return self.proved.statement.rho

    @property
    def extents(self) -> dict[str, tuple[float, float]]:
        """State -> lowest and highest deviation in the proved region."""
        return extents_of(self.proved.statement, self.T)


class RegionSearch:
    """Search for a region of attraction within a limit of the processor time.

    loop: the saturated loop
    P: matrix of the value of the game, (n, n), which is tried first, or None
    seconds: limit of the processor time, s
    degree: highest degree of V
    progress: called with the current step, or None. A KeyboardInterrupt from the callback ends the
        search early.
    save: called with each larger region that is proved, or None
    """

    def __init__(
        self,
        loop: Loop,
        P: np.ndarray | None,
        *,
        seconds: float,
        degree: int,
        progress: Progress | None = None,
        save: Callable[[ProvedLevel], None] | None = None,
    ) -> None:
        self.loop = loop
        self.plant = Plant(loop)
        self._P = P
        self._begin = time.process_time()
        self._seconds = seconds
        self._settings = settings_of(len(loop.states), degree)
        self._progress = progress
        self._save = save
        self.best: ProvedLevel | None = None
        self.origin = ""
        self._turns: list[PolynomialFunction] = []
        self._size = 0.0
        self._stopped = ""

    def found(self, known: PolynomialFunction | None = None) -> Region:
        """Return the largest proved region.

        known: V of an earlier run, scaled to level 1, from which the search continues, or None

        Raises NoSolutionError if no region is proved or the linear loop is not Hurwitz. Raises
        BadInputError if the equations cannot be enclosed.
        """
        refuse_unstable(self.plant.closed_matrix)
        Equilibrium(self.loop)  # raises for equations that a proof does not support
        V = known or self._start()
        if known:
            self._prove(V, 1.0, "V of the certificate", self._settings[0])
        for setting in self._settings:
            if self._left() > setting.seconds:
                V = self._climb(self._proved_V(V), setting)
        if self.best is None:
            why = self._stopped or "no V tried has a level that is large enough for the search"
            raise NoSolutionError(f"no region is proved: {why}")
        return self._region()

    def _proved_V(self, V: PolynomialFunction) -> PolynomialFunction:
        """Return V of the largest region proved so far, scaled to level 1.

        If no region is proved, the given V is returned.
        """
        if self.best is None:
            return V
        statement = self.best.statement
        return PolynomialFunction.of_terms(statement.terms).scaled(1.0 / statement.rho)

    @property
    def _n(self) -> int:
        return len(self.loop.states)

    def _left(self) -> float:
        return self._seconds - (time.process_time() - self._begin)

    def _report(self, what: str) -> None:
        """Call the progress function with the current step.

        If the function raises KeyboardInterrupt, the remaining time of the search is set to 0.
        """
        if self._progress is None:
            return
        done = min(self._seconds, time.process_time() - self._begin)
        try:
            self._progress(done, self._seconds, what)
        except KeyboardInterrupt:
            self._seconds = 0.0
            self._stopped = "interrupted"

    def _candidates(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield pairs of a description and a positive definite P, candidates V = z'P z."""
        if self._P is not None and np.all(np.linalg.eigvalsh((self._P + self._P.T) / 2) > 0.0):
            yield "P of the game", (self._P + self._P.T) / 2
        for P in lyapunov_matrices(self.plant, _CANDIDATES):
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
            rises, _ = first_obstacle(self.plant.rises(V.slope), V, T, quick=True)
            level = min(level, rises)
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
        self._report(f"proving {origin}")
        return self._kept(proved_level(self.loop, V, rho, setting, V.coordinates()), V, origin)

    def _kept(self, proved: ProvedLevel | None, V: PolynomialFunction, origin: str) -> float:
        """Store a proved set if it is the largest so far, and return its size.

        proved: the proved set, or None, for which the size is 0
        origin: description of V
        """
        if proved is None:
            return 0.0
        size = measured(V, proved.statement.rho, V.coordinates())
        if size > self._size:
            self.best = proved
            self.origin = origin
            self._size = size
            if self._save is not None:
                self._save(proved)
        return size

    def _climb(self, V: PolynomialFunction, setting: Setting) -> PolynomialFunction:
        """Return V, scaled to level 1, after alternate optimization of multipliers and V.

        The largest proved level of the result is stored if its set is the largest so far.

        setting: degrees of the proof
        """
        turn = self._turn(V, setting)
        if turn is None:
            return V
        for reach in setting.reaches:
            while self._left() > _TURNS_OF_A_PROOF * turn.seconds:
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
        if highest > 1.0 or not self._kept(accepted(turn.search), turn.V, origin):
            self._prove(turn.V, highest, origin, setting)
        return turn.V

    def _turn(self, V: PolynomialFunction, setting: Setting, least: float = 0.0) -> _Turn | None:
        """Return V with a proof of level 1 in double precision, or None if no proof is found.

        V is scaled to slightly lower levels if level 1 is not proved.

        setting: degrees of the proof
        least: size that the set must exceed
        """
        begin = time.process_time()
        for level in _LEVELS:
            tried = V.scaled(1.0 / level)
            held = holding_ball(tried, 1.0, tried.coordinates())
            if held is None:
                continue
            size = measured(tried, 1.0, held)
            if size <= least:
                return None
            try:
                search = LevelSearch(self.loop, tried, 1.0, held, setting)
                if search.proofs is None:
                    continue
            except NoSolutionError:  # not enclosed on such a large ball
                continue
            self._report(f"V of degree {setting.degree}, size {size:.4g}")
            self._turns.append(tried)
            return _Turn(tried, search, size, time.process_time() - begin)
        return None

    def _highest(self, V: PolynomialFunction) -> float:
        """Return the highest level, at least 1, at which samples find no obstacle.

        An obstacle is a state with V' >= 0, or a boundary point beyond a limit.
        """
        T = V.coordinates()
        rises, _ = first_obstacle(self.plant.rises(V.slope), V, T, quick=True)
        highest = 1.0
        for level in np.geomspace(1.01, _GROWTH, 12):
            points = edge_points(V, T, level) @ T.T
            if level > rises or np.any(self.plant.away(points)):
                break
            highest = float(level)
        return highest

    def _region(self) -> Region:
        """Return the proved set with the obstacles to a larger set."""
        proved = self.best
        assert proved is not None
        statement = proved.statement
        V = PolynomialFunction.of_terms(statement.terms)
        T = np.array(proved.witness["T"])
        self._report("what bounds it")
        rises = first_obstacle(self.plant.rises(V.slope), V, 2.0 * T)
        return Region(
            proved,
            V,
            self.origin,
            bounds_of(self.plant, V, statement.rho, T, rises),
            self.plant,
            T,
            self._stopped,
            tuple(self._turns),
        )


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


def lyapunov_matrices(plant: Plant, count: int) -> Iterator[np.ndarray]:
    """Yield positive definite P (n, n) with A'P + P A = -diag(w²), A the matrix of the linear loop.

    The first weights w (n,) are 1 / nominal. Each entry of the other weights is this value times a
    random factor from 0.1 to 10.

    count: number of weights
    """
    A = plant.closed_matrix
    generator = np.random.default_rng(0)
    for index in range(count):
        weights = 1.0 / plant.nominal
        factors = 10.0 ** generator.uniform(-1.0, 1.0, len(A))
        if index > 0:
            weights = weights * factors
        P = scipy.linalg.solve_continuous_lyapunov(A.T, -np.diag(weights**2))
        if np.all(np.linalg.eigvalsh(P) > 0.0):
            yield P


def bounds_of(
    plant: Plant,
    V: PolynomialFunction,
    rho: float,
    T: np.ndarray,
    rises: tuple[float, np.ndarray | None],
) -> Bounds:
    """Return the obstacles around {V <= rho}.

    Simulations begin on random rays from the trim.

    T: matrix of the coordinates z = T y, (n, n). The set is in the unit ball of y.
    rises: lowest V found with V' >= 0, and the state deviation there, or (inf, None)
    """
    generator = np.random.default_rng(1)
    directions = generator.normal(size=(_RAYS, len(T)))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = starts_by_outcome(plant, V, rho, T, directions @ T.T)
    nearest = {}
    for outcome, starts in found.items():
        values = V(starts)
        nearest[outcome] = (float(values.min()), starts[values.argmin()])
    points = edge_points(V, T, rho) @ T.T @ plant.limited_rows.T
    low, high = plant.permitted_deviations.T
    near = (points.min(axis=0) <= _TOUCHES * low) | (points.max(axis=0) >= _TOUCHES * high)
    return Bounds(rises, nearest, tuple(np.array(plant.limited)[near].tolist()))


def starts_by_outcome(
    plant: Plant, V: PolynomialFunction, rho: float, T: np.ndarray, rays: np.ndarray
) -> dict[Outcome, np.ndarray]:
    """Return outcome -> initial conditions (k, n) from which simulations have this outcome.

    - `LEFT`, `DIVERGED`: approximately the first initial condition with this outcome on each ray.
      Another equilibrium (`ELSEWHERE`) counts as `DIVERGED`
    - `UNDECIDED`: every simulated initial condition without an outcome in the time limit

    V, rho: the proved set {V <= rho}
    T: matrix of the coordinates z = T y, (n, n). The set is in the unit ball of y.
    rays: rays from the trim with ends near the boundary of the set, (N, n)
    """
    rates = np.linalg.eigvals(plant.closed_matrix).real
    seconds = _TIMES / float(np.min(np.abs(rates)))

    def holds(z: np.ndarray) -> np.ndarray:
        inside = np.linalg.norm(np.linalg.solve(T, z.T), axis=0) <= 1.0
        return np.asarray(inside & (V(z) <= rho))

    low = np.minimum(V.edge(rays, rho), 1.0)
    high = low * _FARTHEST
    kinds = np.zeros(0, dtype=object)
    open_starts = np.zeros((0, len(T)))
    for _ in range(2):
        shells = low + (high - low) * np.linspace(0.0, 1.0, _SHELLS + 1)[1:, None] ** 2
        starts = (shells[:, :, None] * rays).reshape(-1, rays.shape[1])
        found = outcomes(plant, starts, holds, seconds)
        found[found == Outcome.ELSEWHERE] = Outcome.DIVERGED
        open_starts = np.concatenate([open_starts, starts[found == Outcome.UNDECIDED]])
        found = found.reshape(shells.shape)
        gone = (found == Outcome.LEFT) | (found == Outcome.DIVERGED)
        kinds = found[gone.argmax(axis=0), np.arange(len(rays))][gone.any(axis=0)]
        rays, low, high = _first_not_converging(rays, low, shells, gone)
        if not len(rays):
            break
    first = np.asarray(high[:, None] * rays)
    of_kind = {kind: first[kinds == kind] for kind in (Outcome.LEFT, Outcome.DIVERGED)}
    of_kind[Outcome.UNDECIDED] = open_starts
    return {kind: starts for kind, starts in of_kind.items() if len(starts)}


def _first_not_converging(
    rays: np.ndarray, low: np.ndarray, shells: np.ndarray, gone: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rays with a factor that fails to converge, and two factors for each of these rays.

    The second factor is the first that fails to converge. The first factor is the factor on the
    next lower shell, or `low` if the second factor is on the first shell. A factor times a ray is
    an initial condition.

    rays: (N, n)
    low: factors that converge, (N,)
    shells: increasing factors, (k, N)
    gone: mask of the factors that fail to converge, (k, N)
    """
    hit = gone.any(axis=0)
    first = gone.argmax(axis=0)[hit]
    columns = np.flatnonzero(hit)
    before = np.vstack([low, shells])[first, columns]
    return rays[hit], before, shells[first, columns]


def measured(V: PolynomialFunction, rho: float, T: np.ndarray) -> float:
    """Return the n-th root of the ratio of the volume of {V <= rho} to the volume of the unit ball.

    The result is 0 if no sampled ray reaches the boundary of the set.

    T: matrix of the coordinates z = T y in which the boundary is sampled, (n, n)
    """
    n = len(T)
    points = edge_points(V, T, rho)
    if not len(points):
        return 0.0
    volume = float(np.mean(np.linalg.norm(points, axis=1) ** n))
    return float((volume * abs(np.linalg.det(T))) ** (1.0 / n))


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
