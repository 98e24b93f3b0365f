"""Search for a large level set {V <= c} of a closed loop, proved on boxes.

The first V are quadratic, later V have a higher degree. Linear programs on samples enlarge the set
(`shape.py`). A point at which a proof fails becomes a constraint of the next program.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from scipy.integrate import solve_ivp

from hfa_prove.check.cover import OpenBoxError, RefutedError, SmallestBoxError
from hfa_prove.check.loop_boxes import Decrease, equilibrium_near
from hfa_prove.fields import Rejected
from hfa_prove.search.clock import OutOfTimeError
from hfa_prove.search.kinks import kink_at
from hfa_prove.search.plant import refuse_unstable
from hfa_prove.search.shape_boxes import Bound, Growth, Samples, Shape
from hfa_prove.statements.loop import Loop
from hfa_prove.statements.region import BoxWitness, RegionStatement
from hfa_prove.words import place_in_words
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: Shares of the sampled set, in length, that are tried for the first V, one after the other. If the
#: first is not proved, it is halved down to the least share. The last tuple is for a later V.
_RISING = (0.5, 0.8)
_FALLING = (0.985, 0.95, 0.8, 0.5)
_LEAST = 0.004
#: Parts of the remaining time: for the choice of a first V or the growth of a set, for a level
#: while none is proved, for a higher level of the first V, and for a level of a later V.
_OF_GROWTH = 0.4
_OF_FIRST = 0.3
_OF_HIGHER = 0.15
_OF_LATER = 0.8
#: Least growth in length of a set for which a proof is tried.
_LARGER = 1.01
#: Extents of a set that is scaled to a state limit, relative to the limit.
_WITHIN = 0.999
#: Largest number of refuted points that become rows of linear programs, for one V.
_REFUTED = 12
#: Numbers of Lyapunov matrices and sums of squared modes that are tried, and of those that are
#: sampled more densely.
_CANDIDATES = 20
_SAMPLED = 4
#: Highest level of V that is sampled, relative to the level of its set.
_HIGHEST = 1.5
#: Number of boxes that is never reached within the time limit.
_ENDLESS = 10**9
#: Largest extents of a set, in nominal values.
_WIDEST = 100.0


@dataclass(frozen=True, eq=False)
class BoxRegion:
    """A proved region, with the obstacle to a larger region.

    statement: the proved statement
    witness: data for the proof
    boxes: number of boxes that the proof evaluated
    origin: description of V
    bound: first obstacle found beyond the set
    stopped: reason why no larger set is proved
    """

    statement: RegionStatement
    witness: BoxWitness
    boxes: int
    origin: str
    bound: Bound
    stopped: str


class RegionSearch:
    """Search for a region of attraction within a limit of the processor time.

    loop: the closed loop
    policy: the policy as stored in the statement
    known: pairs of a description and a matrix P, each of which gives a candidate V = z'P z
    seconds: limit of the processor time, s
    degree: highest degree of V
    progress: called with the current step, or None
    save: called with each larger region that is proved, or None

    Raises Rejected if no equilibrium near the trim is proved.
    """

    def __init__(
        self,
        loop: Loop,
        known: Sequence[tuple[str, np.ndarray]],
        *,
        seconds: float,
        degree: int = 2,
        progress: Progress | None = None,
        save: Callable[[BoxRegion], None] | None = None,
    ) -> None:
        self.loop = loop
        self._begin = time.process_time()
        self._seconds = seconds
        self._degree = degree
        self._progress = progress
        self._save = save
        self.equilibrium = equilibrium_near(loop, np.array(list(loop.trim.values())))
        self.samples = Samples(loop, self.equilibrium)
        self.J = self.samples.J
        self._known = known
        self._deadline = np.inf
        self._largest = 0.0
        self._best: tuple[BoxRegion, Shape] | None = None
        self._stopped = ""

    def found(self, earlier: RegionStatement | None = None) -> BoxRegion:
        """Return the largest proved region.

        After an interruption or at the time limit, the largest region proved so far is returned.

        earlier: statement of an earlier run, whose V is tried first, or None

        Raises NoSolutionError if no region is proved or the linearization is not Hurwitz.
        """
        refuse_unstable(self.J)
        try:
            self._search(earlier)
        except KeyboardInterrupt:
            self._stopped = "interrupted"
        if self._best is None:
            kink = kink_at(self.loop, self.loop.closed, self.equilibrium)
            why = f"{self._stopped}; {kink}" if kink else self._stopped
            raise NoSolutionError(f"no region was proved: {why}")
        region, shape = self._best
        bound = shape.bound(self.samples, _HIGHEST)
        return replace(region, bound=bound, stopped=self._stopped)

    def _search(self, earlier: RegionStatement | None) -> None:
        """Prove growing sets from each initial V in turn, until the time limit.

        earlier: statement of an earlier run, which is proved first, or None
        """
        firsts = self._first_shapes()
        if earlier is not None:
            origin = "V of the certificate"
            shape = Shape.of_piece(earlier.piece, self._degree)
            self._prove(self._part(shape, 1.0), origin)
            firsts.insert(0, (origin, shape))
        for origin, shape in firsts:
            growth = Growth(self.samples, shape, self._report)
            if self._best is None:
                self._first_levels(growth, origin)
            self._enlarge(growth)
            if self._left() < 0.0:
                return

    def _enlarge(self, growth: Growth) -> None:
        """Prove larger sets while V grows, first with degree 2 and then with the highest degree.

        growth: V with its linear programs
        """
        for degree in sorted({2, self._degree}):
            if degree < growth.shape.basis.degree:
                continue
            origin = f"a polynomial of degree {degree} from the search"
            self._grow(growth, degree)
            is_last = degree == self._degree
            while self._later_level(growth, origin) and is_last and growth.finer():
                self._grow(growth, degree)

    def _first_levels(self, growth: Growth, origin: str) -> None:
        """Prove the set of a V, scaled in length by rising shares.

        If the first share is not proved, it is halved until a share is proved, the share is below
        `_LEAST`, or the time is over.

        growth: V with its linear programs
        origin: description of V
        """
        share = _RISING[0]
        while not self._is_proved(growth, share, origin, _OF_FIRST):
            share /= 2.0
            if share < _LEAST or self._left() < 0.0:
                return
        if share == _RISING[0]:
            for larger in _RISING[1:]:
                if not self._is_proved(growth, larger, origin, _OF_HIGHER):
                    return

    def _later_level(self, growth: Growth, origin: str) -> bool:
        """Prove the set of a V, scaled in length by falling shares, and return whether to continue.

        - If no set is proved yet: rising shares are tried, and the result is whether one is proved.
        - If a share is proved: True.
        - If the full set is hardly larger than the largest proved set: True, without a proof.
        - Otherwise: False.

        growth: V with its linear programs
        origin: description of V
        """
        if self._best is None:
            self._first_levels(growth, origin)
            return self._best is not None
        for share in _FALLING:
            if self._left() < 0.0:
                return False
            if share * growth.shape.size() < _LARGER * self._largest:
                return share == _FALLING[0]
            if self._is_proved(growth, share, origin, _OF_LATER):
                return True
        return False

    def _grow(self, growth: Growth, degree: int) -> None:
        """Enlarge the set of a V of the given degree up to the first obstacle that samples find."""
        growth.of_degree(degree)
        self._deadline = time.process_time() + _OF_GROWTH * self._left()
        try:
            while growth.grown() is not None:
                pass
        except OutOfTimeError:
            self._stopped = "the time limit was reached before larger sets were tried"
        level = growth.shape.bound(self.samples, _HIGHEST).level
        growth.shape = growth.shape.of_level(min(level, _HIGHEST))

    def _is_proved(self, growth: Growth, share: float, origin: str, time_share: float) -> bool:
        """Return whether the set of a V, scaled in length by a share, is proved.

        If the proof fails at a point, V is changed there and the proof is repeated.

        growth: V with its linear programs
        share: factor on the lengths of the set
        origin: description of V
        time_share: largest share of the remaining time for the proof of one V
        """
        try:
            for _ in range(_REFUTED):
                self._deadline = time.process_time() + time_share * self._left()
                part = self._part(growth.shape, share)
                try:
                    self._prove(part, origin)
                except (RefutedError, SmallestBoxError) as error:
                    place = part.N @ error.place
                    is_refuted = isinstance(error, RefutedError)
                    what = "V' >= 0 or a limit is exceeded" if is_refuted else "V' < 0 is undecided"
                    where = place_in_words(self.loop, place)
                    self._stopped = f"{what} at {where}, in {share:.3g} of the set by samples"
                    if growth.refuted(place) is None:
                        return False
                else:
                    self._stopped = "no V with a larger set was found"
                    return True
        except (OpenBoxError, Rejected, OutOfTimeError) as error:
            self._stopped = f"at {share:.3g} of the set by samples, linearly: {error}"
        return False

    def _part(self, shape: Shape, share: float) -> Shape:
        """Return the set of a V, scaled in length by a share and reduced to the state limits."""
        part = shape.of_level(share**2).diagonal(self.J).in_cube()
        limits = self.loop.ends(self.loop.states) - self.equilibrium.x[:, None]
        beyond = float(np.max(part.extents().ends / limits))
        if beyond < 1.0:
            return part
        return part.of_level((_WITHIN / beyond) ** 2).in_cube()

    def _left(self) -> float:
        return self._seconds - (time.process_time() - self._begin)

    def _prove(self, shape: Shape, origin: str) -> None:
        """Prove a set, and store it as the result if it is the largest so far.

        shape: V, whose set {V <= 1} is proved
        origin: description of V

        Raises OpenBoxError, Rejected or OutOfTimeError if the set is not proved.
        """
        extents = shape.extents()
        decrease = Decrease(
            self.loop, self.equilibrium, shape.piece(), extents.ends, extents.multipliers
        )
        boxes = decrease.proved(_ENDLESS, self._count)
        size = shape.size()
        if size <= self._largest:
            return
        states = self.loop.states
        at = dict(zip(states, self.equilibrium.x.tolist(), strict=True))
        ends = {
            name: (low, high)
            for name, (low, high) in zip(states, extents.ends.tolist(), strict=True)
        }
        statement = RegionStatement(self.loop, at, decrease.piece, ends)
        witness = BoxWitness(extents.multipliers, 2 * boxes)
        region = BoxRegion(statement, witness, boxes, origin, Bound(np.inf, None, False), "")
        self._best = region, shape
        self._largest = size
        if self._save is not None:
            self._save(region)

    def _report(self, what: str) -> None:
        self._count(0.0, 1.0, what)

    def _count(self, done: float, whole: float, text: str = "") -> None:
        if time.process_time() > self._deadline:
            raise OutOfTimeError(text, done)
        if self._progress is not None:
            self._progress(done, whole, text)

    def _first_shapes(self) -> list[tuple[str, Shape]]:
        """Return pairs of a description and a quadratic V, the largest set first.

        Each V is scaled such that {V <= 1} is the largest set in which samples find no obstacle.

        Raises NoSolutionError if no V decreases near the equilibrium.
        """
        sampled: list[tuple[str, Shape]] = []
        end = time.process_time() + _OF_GROWTH * self._left()
        for origin, P in self._candidates():
            if sampled and time.process_time() > end:
                break
            P = 0.5 * (P + P.T)
            slope = P @ self.J
            if not np.all(np.linalg.eigvalsh(P) > 0.0):
                continue
            if not np.all(np.linalg.eigvalsh(slope + slope.T) < 0.0):
                continue
            widths = np.diag(np.linalg.inv(P))
            widest = float(np.min(self._limit_distances**2 / widths))
            sampled.append((origin, self._good(Shape.of_matrix(P / widest, self.J, 2), quick=True)))
        if not sampled:
            raise NoSolutionError("no Lyapunov function V decreases near the equilibrium")
        sampled.sort(key=lambda each: -each[1].size())
        firsts: list[tuple[str, Shape]] = []
        for origin, shape in sampled[:_SAMPLED]:
            if firsts and time.process_time() > end:
                break
            firsts.append((origin, self._good(shape, quick=False)))
        return sorted(firsts, key=lambda each: -each[1].size())

    def _good(self, shape: Shape, *, quick: bool) -> Shape:
        """Return V scaled such that the samples find no obstacle in {V <= 1}.

        The set is the largest level set without an obstacle within the set of the given V.

        quick: whether to use fewer samples
        """
        return shape.of_level(min(shape.bound(self.samples, 1.0, quick=quick).level, 1.0))

    def _candidates(self) -> Iterator[tuple[str, np.ndarray]]:
        yield from self._known
        n = len(self.J)
        modes = np.linalg.inv(np.linalg.eig(self.J)[1])
        modes /= np.linalg.norm(modes * self._nominal, axis=1, keepdims=True)
        generator = np.random.default_rng(0)
        for _ in range(_CANDIDATES):
            weights = 10.0 ** generator.uniform(-2.0, 2.0, n)
            nominal = np.diag(weights / self._nominal**2)
            yield (
                "a Lyapunov matrix of the loop",
                scipy.linalg.solve_continuous_lyapunov(self.J.T, -nominal),
            )
            yield "a sum of squares of modes", (modes.conj().T @ (weights[:, None] * modes)).real

    @property
    def _limit_distances(self) -> np.ndarray:
        """Distances (n,) of the states at the equilibrium from their nearer limits.

        Each distance is at most `_WIDEST` nominal values.
        """
        ends = self.loop.ends(self.loop.states) - self.equilibrium.x[:, None]
        return np.minimum(_WIDEST * self._nominal, np.abs(ends).min(axis=1))

    @property
    def _nominal(self) -> np.ndarray:
        signals = self.loop.model.signals
        return np.array([signals[name].nominal for name in self.loop.states])


def flight_outcome(samples: Samples, place: np.ndarray, region: BoxRegion) -> str:
    """Return a clause on the outcome of a flight that begins at the state deviation `place` (n,).

    The flight ends in three cases:
    - The state is in the proved set.
    - The largest deviation is 1000 times the initial value.
    - Ten time constants of the slowest mode have passed.

    samples: evaluation of the closed loop
    region: the proved region
    """
    modes = np.linalg.eigvals(samples.J)
    seconds = 10.0 / float(np.min(np.abs(modes.real)))
    piece = region.statement.piece
    far = 1e3 * np.abs(place).max()

    def rates(_: float, z: np.ndarray) -> np.ndarray:
        return np.asarray(samples.rates(z[None])[0])

    def is_in(_: float, z: np.ndarray) -> float:
        return 0.0 if piece.contains(z[None])[0] else 1.0

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
