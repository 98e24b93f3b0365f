"""The largest level of V = z'P z of which a region is proved on boxes."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import scipy.linalg
from scipy.integrate import solve_ivp

from hfa_boxes.check.checker import BoxWitness
from hfa_boxes.check.cover import OpenBoxError, RefutedError, cover
from hfa_boxes.check.loop import Decrease, Loop, equilibrium_near
from hfa_boxes.check.plant import Equilibrium
from hfa_boxes.check.statement import BoxStatement, digest_of
from hfa_boxes.enclosure.slopes import Intervals, jacobian
from hfa_proof.checker.reading import Rejected
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: How much larger than the level the unit ball of the coordinates is, linearly.
_ROOM = 1.0 + 1e-9
#: Shares of the sampled limit that are tried, linearly, one after the other; where none is proved,
#: halves of the first, down to the least.
_SHARES = (0.5, 0.8, 0.9, 0.95, 0.97, 0.985)
_LEAST = 0.004
#: Levels nearer to each other than this, linearly, are not divided.
_NEAR = 1.05
#: Part of the time that is left which a level gets while none is proved.
_FIRST = 0.3
#: Lyapunov matrices that are tried, and points at which V' is sampled.
_CANDIDATES = 40
_RAYS = 1000
_SHELLS = 20
_TURNS = 8
#: More than are proved in any time that is given.
_ENDLESS = 10**9


@dataclass(frozen=True, eq=False)
class BoxRegion:
    """A proved region, and further data on its V.

    statement: proved
    witness: its evidence
    boxes: number of boxes on which V' < 0
    origin: V in words
    rises: the lowest level at which V' >= 0 was found, and the state (n,); inf and None for none
    stopped: the reason why no larger level is proved
    """

    statement: BoxStatement
    witness: BoxWitness
    boxes: int
    origin: str
    rises: tuple[float, np.ndarray | None]
    stopped: str


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A candidate V = z'P z.

    limit: its largest level by samples and limits
    origin: V in words
    rises: the state at which V' >= 0 was found
    """

    P: np.ndarray
    limit: float
    origin: str
    rises: tuple[float, np.ndarray | None]


class OutOfTimeError(NoSolutionError):
    """The time of a search is over."""


class RegionSearch:
    """The search for a region in a given time.

    loop: with its policy
    known: candidates for V, by description
    seconds: of processor time
    progress: called with the current step
    save: called with every region that is proved
    """

    def __init__(
        self,
        loop: Loop,
        known: Sequence[tuple[str, np.ndarray]],
        *,
        seconds: float,
        progress: Progress | None = None,
        save: Callable[[BoxRegion], None] | None = None,
    ) -> None:
        self.loop = loop
        self._begin = time.process_time()
        self._seconds = seconds
        self._progress = progress
        self._save = save
        self.equilibrium = equilibrium_near(loop, np.array(list(loop.trim.values())))
        point = Intervals(self.equilibrium.x, np.zeros_like(self.equilibrium.x))
        self.J = jacobian(loop.closed, point).slopes.middle
        self._samples = Samples(loop, self.equilibrium)
        self._known = known
        self._is_saved = False
        self._deadline = np.inf

    def found(self) -> BoxRegion:
        """The largest region of the best V; NoSolutionError where none is proved."""
        modes = np.linalg.eigvals(self.J)
        if not np.all(modes.real < 0.0):
            raise NoSolutionError(
                "the loop's linearization is not Hurwitz (an eigenvalue with real part "
                f"{modes.real.max():.3g}); such equilibria are not covered"
            )
        origin, P, limit, rises = self._best()
        subject = _Candidate(P, limit, origin, rises)
        best = None
        stopped = "a limit of the model" if rises[1] is None else "V' >= 0 was found there"
        low = 0.0
        high = 1.0
        share = _SHARES[0]
        while share > _LEAST:
            try:
                best = self._proved(subject, share, stopped)
                low = share
            except RefutedError as error:
                place = self._coordinates(P, limit * share**2) @ error.place
                subject = replace(subject, rises=(float(place @ P @ place), place))
                stopped = f"V' >= 0 at {share:.3g} of the sampled limit"
                high = share
            except (OpenBoxError, Rejected, OutOfTimeError) as error:
                stopped = f"at {share:.3g} of the sampled limit: {error}"
                high = share
                if best is not None and isinstance(error, OutOfTimeError):
                    break
            larger = [each for each in _SHARES if low < each < high]
            if not larger and ((low > 0.0 and high / low < _NEAR) or low == _SHARES[-1]):
                break
            share = larger[0] if larger else (high / 2.0 if low == 0.0 else 0.5 * (low + high))
            if self._left() < 0.0:
                break
        if best is None:
            raise NoSolutionError(f"no region is proved in {self._seconds:g} s: {stopped}")
        return replace(best, rises=subject.rises, stopped=stopped)

    def _left(self) -> float:
        return self._seconds - (time.process_time() - self._begin)

    def _proved(self, subject: _Candidate, share: float, stopped: str) -> BoxRegion:
        """The region at a share of the sampled limit, linearly; an error where it is not proved."""
        P = subject.P
        rho = subject.limit * share**2
        self._deadline = time.process_time() + self._left() * (1.0 if self._is_saved else _FIRST)
        T = self._coordinates(P, rho)
        decrease = Decrease(self.loop, self.equilibrium, P, T)
        decrease.check_level(rho)
        boxes = cover(decrease.inequality, _ENDLESS, self._tell)
        at = zip(self.loop.states, self.equilibrium.x.tolist(), strict=True)
        extents = zip(self.loop.states, decrease.reach().tolist(), strict=True)
        digest = digest_of(self.loop.policy)
        statement = BoxStatement(self.loop, digest, dict(at), P, rho, dict(extents))
        region = BoxRegion(
            statement, BoxWitness(T, 2 * boxes), boxes, subject.origin, subject.rises, stopped
        )
        self._is_saved = True
        if self._save is not None:
            self._save(region)
        return region

    def _tell(self, done: float, whole: float, text: str = "") -> None:
        if time.process_time() > self._deadline:
            raise OutOfTimeError(f"the time was over, {done:.0%} of the cube decided")
        if self._progress is not None:
            self._progress(done, whole, text)

    def _coordinates(self, P: np.ndarray, rho: float) -> np.ndarray:
        """T with V = rho |y|², nearly, in which V' is diagonal to second order."""
        T = np.sqrt(rho) * _ROOM * np.linalg.inv(np.linalg.cholesky(P)).T
        S = T.T @ P @ self.J @ T
        return np.asarray(T @ np.linalg.eigh(S + S.T)[1])

    def _best(self) -> tuple[str, np.ndarray, float, tuple[float, np.ndarray | None]]:
        """Return the V with the largest sampled set: its description, P, its largest level by
        samples and limits, and where V' >= 0 was found."""
        best = None
        largest = 0.0
        n = len(self.J)
        for origin, P in self._candidates():
            slope = P @ self.J
            if not np.all(np.linalg.eigvalsh(slope + slope.T) < 0.0):
                continue
            level = self._limit(P)
            reached = min(level, self._samples.rises(P, level, quick=True)[0])
            size = reached ** (n / 2) / np.sqrt(np.linalg.det(P))
            if size > largest:
                largest = size
                best = (origin, P, reached)
        if best is None:
            raise NoSolutionError("no V was found that falls near the equilibrium")
        origin, P, reached = best
        rises = self._samples.rises(P, min(1.2 * reached, self._limit(P)))
        return origin, P, min(reached, rises[0]), rises

    def _candidates(self) -> Sequence[tuple[str, np.ndarray]]:
        found = [(origin, 0.5 * (P + P.T)) for origin, P in self._known]
        generator = np.random.default_rng(0)
        scale = self._nominal
        for _ in range(_CANDIDATES):
            weights = 10.0 ** generator.uniform(-2.0, 2.0, len(self.J)) / scale**2
            P = scipy.linalg.solve_continuous_lyapunov(self.J.T, -np.diag(weights))
            found.append(("a Lyapunov matrix of the loop", 0.5 * (P + P.T)))
        return [(origin, P) for origin, P in found if np.all(np.linalg.eigvalsh(P) > 0.0)]

    @property
    def _nominal(self) -> np.ndarray:
        signals = self.loop.model.signals
        return np.array([signals[name].nominal for name in self.loop.states])

    def _limit(self, P: np.ndarray) -> float:
        """The largest level within the limits of the states, and within 100 nominal values."""
        x = self.equilibrium.x
        room = 100.0 * self._nominal
        for index, name in enumerate(self.loop.states):
            low, high = self.loop.limits.get(name, (-np.inf, np.inf))
            room[index] = min(room[index], x[index] - low, high - x[index])
        widths = np.diag(np.linalg.inv(P))
        return float(np.min(room**2 / widths)) * (1.0 - 1e-6)


class Samples:
    """V' of many states at once, in doubles."""

    def __init__(self, loop: Loop, equilibrium: Equilibrium) -> None:
        x = ca.SX.sym("x", len(loop.states))
        self._function = ca.Function("rates", [x], [ca.densify(loop.rates(x)[0])])
        self._x = equilibrium.x

    def rates(self, z: np.ndarray) -> np.ndarray:
        """z' of deviations (N, n)."""
        return np.array(self._function((z + self._x).T)).T

    def rises(
        self, P: np.ndarray, level: float, *, quick: bool = False
    ) -> tuple[float, np.ndarray | None]:
        """The lowest level up to `level` where V' >= 0 was found, and where; inf and None.

        quick: with a fiftieth of the samples."""
        count = _RAYS // 10 if quick else _RAYS
        turns = _TURNS // 4 if quick else _TURNS
        n = len(P)
        T = np.sqrt(level) * np.linalg.inv(np.linalg.cholesky(P)).T
        generator = np.random.default_rng(0)
        shares = np.linspace(0.0, 1.0, _SHELLS + 1)[1:]
        rays = generator.normal(size=(count, n))
        best = 1.0
        place = None
        spread = 0.5
        for _ in range(turns):
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            radii = best * shares
            z = (radii[:, None, None] * rays) @ T.T
            rising = ~(self._slope(P, z.reshape(-1, n)) < 0.0).reshape(len(radii), len(rays))
            first = np.where(rising.any(axis=0), rising.argmax(axis=0), len(radii))
            order = np.argsort(first)[:12]
            if first[order[0]] < len(radii):
                best = float(radii[first[order[0]]])
                place = best * (T @ rays[order[0]])
            near = np.repeat(rays[order], count // 24, axis=0)
            near = near + spread * generator.normal(size=near.shape) / np.sqrt(n)
            far = generator.normal(size=(count // 2, n))
            rays = np.concatenate([rays[order], near, far])
            spread *= 0.6
        if place is None:
            return np.inf, None
        return level * best**2, place

    def _slope(self, P: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.asarray(2.0 * np.sum((z @ P) * self.rates(z), axis=1))


def flown(samples: Samples, J: np.ndarray, place: np.ndarray, region: BoxRegion) -> str:
    """Return the end of a flight from a deviation (n,), in words; J: Jacobian of the loop."""
    modes = np.linalg.eigvals(J)
    seconds = 10.0 / float(np.min(np.abs(modes.real)))
    P = region.statement.P
    rho = region.statement.rho
    far = 1e3 * np.abs(place).max()

    def rates(_: float, z: np.ndarray) -> np.ndarray:
        return np.asarray(samples.rates(z[None])[0])

    def is_in(_: float, z: np.ndarray) -> float:
        return float(z @ P @ z - rho)

    def is_away(_: float, z: np.ndarray) -> float:
        return float(far - np.abs(z).max())

    is_in.terminal = is_away.terminal = True  # type: ignore[attr-defined]
    events = (is_in, is_away)
    solution = solve_ivp(rates, (0.0, seconds), place, "LSODA", events=events, rtol=1e-8)
    if len(solution.t_events[0]):
        return "enters the proved set and converges"
    if len(solution.t_events[1]):
        return "leaves: its deviation grows a thousandfold"
    return f"has not entered the proved set after {seconds:.3g} s"
