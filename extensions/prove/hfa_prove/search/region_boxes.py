"""Search for a large level set {V <= c} of a closed loop, proved on boxes.

The first V are quadratic, later V have a higher degree. Linear programs on samples enlarge the set
(`shape_boxes.py`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from hfa_prove.check.cover import OpenBoxError, RefutedError, SmallestBoxError
from hfa_prove.check.equilibrium import equilibrium_near
from hfa_prove.check.region_boxes import claims_of
from hfa_prove.fields import Rejected
from hfa_prove.search.clock import OutOfTimeError
from hfa_prove.search.kinks import kink_at
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.region_search import (
    Region,
    RegionProblem,
    Settings,
    lyapunov_matrices,
    refuse_boundless,
    refuse_unstable,
)
from hfa_prove.search.shape_boxes import Growth, Shape
from hfa_prove.statements.loop import Loop
from hfa_prove.statements.region import RegionStatement, RegionWitness
from hfa_prove.words import place_in_words
from hfa_support.errors import NoSolutionError

#: Share of the sampled set, in length, that is tried first while none is proved. It is halved down
#: to the least share.
_FIRST = 0.5
_LEAST = 0.004
#: Shares that are tried for a later V, one after the other: near the largest proved set, and for a
#: set that is more than `_FAR` times as long.
_NEAR_SHARES = (0.985, 0.95, 0.8, 0.5)
_FAR_SHARES = (0.8, 0.5)
_FAR = 2.0
#: Parts of the remaining time: for the choice of a first V or the growth of a set, for a level
#: while none is proved, and for a level of a later V.
_OF_GROWTH = 0.4
_OF_FIRST = 0.3
_OF_LATER = 0.8
#: Least growth in length of a set for which a proof is tried.
_LARGER = 1.01
#: Extents of a set that is scaled to a state limit, relative to the limit.
_WITHIN = 0.999
#: Numbers of Lyapunov matrices and sums of squared modes that are tried, and of those that are
#: sampled more densely.
_CANDIDATES = 20
_SAMPLED = 4
#: Highest level of V that is sampled, relative to the level of its set.
_HIGHEST = 1.5
#: Number of boxes that is never reached within the time limit.
_ENDLESS = 10**9
#: Least ratio of the eigenvalues of a first P, in nominal values. Modes that coincide give less.
_DEFINITE = 1e-12
#: Largest extents of a set, in nominal values.
_WIDEST = 100.0


class BoxesSearch:
    """Search for a region of attraction on boxes.

    What is proved is kept if the time is over or the user interrupts the search.

    problem: the closed loop. Its disturbances are neglected while V is searched.
    settings: degree, time limit and what is saved

    Raises Rejected if no equilibrium near the trim is proved.
    """

    def __init__(self, problem: RegionProblem, settings: Settings) -> None:
        self._problem = problem
        self.loop = replace(problem.loop, disturbances={})
        self._settings = settings
        self._degree = settings.degree
        self._clock = settings.clock
        self.equilibrium = equilibrium_near(self.loop, np.array(list(self.loop.trim.values())))
        #: Why nothing more is proved, or "".
        self._stopped = ""
        self.samples = LoopValues(self.loop, self.equilibrium.x, self._clock)
        self.J = self.samples.J
        self._best: Region | None = None
        self._largest = 0.0
        #: Descriptions and first V of the search, the largest sampled set first.
        self.firsts: list[tuple[str, Shape]] = []

    def found(self) -> Region:
        """Return the largest proved region.

        After an interruption or at the time limit, the largest region proved so far is returned.

        Raises NoSolutionError if no region is proved or the linearization is not Hurwitz. Raises
        BadInputError if the loop is linear and nothing limits it.
        """
        refuse_unstable(self.J)
        if not self._problem.loop.disturbances:
            refuse_boundless(self.loop, self.J)
        try:
            self._search()
        except OutOfTimeError as error:
            self._stopped = self._stopped or str(error)
        except KeyboardInterrupt:
            self._stopped = "interrupted"
        if self._best is None:
            kink = kink_at(self.loop, self.equilibrium)
            raise NoSolutionError(f"{self._stopped}; {kink}" if kink else self._stopped)
        return replace(self._best, stopped=self._stopped)

    def _search(self) -> None:
        """Prove growing sets from each initial V in turn, until the time limit (OutOfTimeError)."""
        self.firsts = self._first_shapes()
        for origin, shape in self.firsts:
            growth = Growth(self.samples, shape, self._report)
            if self._best is None:
                self._first_level(growth, origin)
            self._enlarge(growth)
            self._report("the first V")

    def _enlarge(self, growth: Growth) -> None:
        """Prove larger sets while V grows, first with degree 2 and then with the highest degree."""
        for degree in sorted({2, self._degree}):
            if degree < growth.shape.V.degree:
                continue
            origin = f"a polynomial of degree {degree} from the search"
            self._grow(growth, degree)
            is_last = degree == self._degree
            while self._later_level(growth, origin) and is_last and growth.finer():
                self._grow(growth, degree)

    def _first_level(self, growth: Growth, origin: str) -> None:
        """Prove the set of a V, scaled in length by a share that is halved down to `_LEAST`."""
        share = _FIRST
        while not self._is_proved(growth, share, origin, _OF_FIRST):
            share /= 2.0
            if share < _LEAST or self._clock.left < 0.0:
                return

    def _later_level(self, growth: Growth, origin: str) -> bool:
        """Prove the set of a V, scaled in length by falling shares, and return whether to continue.

        - If no set is proved yet: the result is whether a first set is proved.
        - If a share is proved: True.
        - If the full set is hardly larger than the largest proved set: True, without a proof.
        - Otherwise: False.

        growth: V with its linear programs
        origin: description of V
        """
        if self._best is None:
            self._first_level(growth, origin)
            return self._best is not None
        is_far = growth.shape.size() > _FAR * self._largest
        shares = _FAR_SHARES if is_far else _NEAR_SHARES
        for share in shares:
            if self._clock.left < 0.0:
                return False
            if share * growth.shape.size() < _LARGER * self._largest:
                return share == _NEAR_SHARES[0]
            if self._is_proved(growth, share, origin, _OF_LATER):
                return True
        return False

    def _grow(self, growth: Growth, degree: int) -> None:
        """Enlarge the set of a V of the given degree up to the first obstacle that samples find."""
        growth.of_degree(degree)
        try:
            with self._clock.step(_OF_GROWTH):
                while growth.grown() is not None:
                    pass
        except OutOfTimeError:
            self._stopped = "the time limit was reached before larger sets were tried"
        level = growth.shape.bound(self.samples, _HIGHEST).level
        growth.shape = growth.shape.of_level(min(level, _HIGHEST))

    def _is_proved(self, growth: Growth, share: float, origin: str, time_share: float) -> bool:
        """Return whether the set of a V, scaled in length by a share, is proved.

        growth: V with its linear programs
        share: factor on the lengths of the set
        origin: description of V
        time_share: largest share of the remaining time for the proof of one V
        """
        part = self.part(growth.shape, share)
        try:
            with self._clock.step(time_share):
                self._prove(part, origin)
        except (RefutedError, SmallestBoxError) as error:
            is_refuted = isinstance(error, RefutedError)
            what = "V' >= 0 or a limit is exceeded" if is_refuted else "V' < 0 is undecided"
            where = place_in_words(self.loop, part.N @ error.place)
            self._stopped = f"{what} at {where}, in {share:.3g} of the set by samples"
            return False
        except (OpenBoxError, Rejected, OutOfTimeError) as error:
            self._stopped = f"at {share:.3g} of the set by samples, linearly: {error}"
            return False
        self._stopped = "no V with a larger set was found"
        return True

    def part(self, shape: Shape, share: float) -> Shape:
        """Return the set of a V, scaled in length by a share and reduced to the state limits."""
        part = shape.of_level(share**2).diagonal(self.J).in_cube()
        limits = self.loop.ends(self.loop.states) - self.equilibrium.x[:, None]
        beyond = float(np.max(part.extents().ends / limits))
        if beyond < 1.0:
            return part
        return part.of_level((_WITHIN / beyond) ** 2).in_cube()

    def _prove(self, shape: Shape, origin: str) -> None:
        """Prove {V <= 1}, and store it as the result if it is the largest so far."""
        region = self.proved(self.loop, shape, origin)
        size = shape.size()
        if size <= self._largest:
            return
        self._best = region
        self._largest = size
        if self._settings.save is not None:
            self._settings.save(region)

    def proved(self, loop: Loop, shape: Shape, origin: str) -> Region:
        """Return the proved region of a loop, or its invariant set if it has disturbances.

        shape: V, whose set {V <= 1} is proved

        Raises OpenBoxError, Rejected or OutOfTimeError if the set is not proved.
        """
        extents = shape.extents()
        piece = shape.piece()
        claims = claims_of(loop, self.equilibrium, piece, extents.ends, extents.multipliers)
        boxes = sum(claim.proved(_ENDLESS, self._clock) for claim in claims)
        states = loop.states
        at = dict(zip(states, self.equilibrium.x.tolist(), strict=True))
        ends = {
            name: (low, high)
            for name, (low, high) in zip(states, extents.ends.tolist(), strict=True)
        }
        statement = RegionStatement(loop, at, piece, ends)
        witness = RegionWitness(extents.multipliers, 2 * boxes)
        return Region(statement, witness, boxes, shape, ends, origin)

    def _report(self, what: str) -> None:
        self._clock(0.0, 1.0, what)

    def _first_shapes(self) -> list[tuple[str, Shape]]:
        """Return descriptions and quadratic V, scaled as by `_good`, the largest set first."""
        sampled: list[tuple[str, Shape]] = []
        end = self._clock.used + _OF_GROWTH * self._clock.left
        for origin, P in self._candidates():
            if sampled and self._clock.used > end:
                break
            P = 0.5 * (P + P.T)
            slope = P @ self.J
            sizes = np.linalg.eigvalsh(P * np.outer(self.samples.nominal, self.samples.nominal))
            if not sizes[0] > _DEFINITE * sizes[-1]:
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
            if firsts and self._clock.used > end:
                break
            firsts.append((origin, self._good(shape, quick=False)))
        return sorted(firsts, key=lambda each: -each[1].size())

    def _good(self, shape: Shape, *, quick: bool) -> Shape:
        """Return V scaled to its largest set within {V <= 1} without an obstacle in samples."""
        return shape.of_level(min(shape.bound(self.samples, 1.0, quick=quick).level, 1.0))

    def _candidates(self) -> Iterator[tuple[str, np.ndarray]]:
        yield from self._problem.known
        modes = np.linalg.inv(np.linalg.eig(self.J)[1])
        modes /= np.linalg.norm(modes * self.samples.nominal, axis=1, keepdims=True)
        generator = np.random.default_rng(0)
        for P in lyapunov_matrices(self.J, self.samples.nominal, _CANDIDATES):
            yield "a Lyapunov matrix of the loop", P
            weights = 10.0 ** generator.uniform(-2.0, 2.0, len(self.J))
            yield "a sum of squares of modes", (modes.conj().T @ (weights[:, None] * modes)).real

    @property
    def _limit_distances(self) -> np.ndarray:
        """Distances (n,) of the states from their nearer limits, at most `_WIDEST` nominals."""
        ends = self.loop.ends(self.loop.states) - self.equilibrium.x[:, None]
        return np.minimum(_WIDEST * self.samples.nominal, np.abs(ends).min(axis=1))
