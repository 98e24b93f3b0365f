"""Polynomial V on samples: its set, the obstacles to a larger set, and growth.

An obstacle is a state with V' >= 0 or beyond a limit. No proof depends on the samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg
from scipy.optimize import linprog, minimize

from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.statements.piece import Piece

#: Number of rays from the equilibrium for the size of a set. For a search: number of rays for each
#: state, their least number, number of shells and number of refinements.
_RAYS = 1000
_SEARCHED = 250
_FEWEST = 50
_SHELLS = 25
_TURNS = 8
#: Depth below the level that the shells fill, relative to the previous turn.
_SHALLOWER = 0.75
#: Largest factor on a ray at which V is evaluated.
_FARTHEST = 3.0
#: Half-width of the cube relative to the set. Above 2, the boxes at the faces after one halving are
#: outside the set.
_ROOM = 2.05
#: Least decay of a direction, relative to the largest, in the distribution of rays.
_SLOWEST = 1e-9
#: Relative enlargement of the extents of a set.
_BEYOND = 1e-3
#: Required decay of V, relative to the modal decay of the linear loop: the first value, the share
#: of V at the slowest rate in the modal decay, the factor after each growth, and the lowest value.
_DECAY = 0.5
_SLOWLY = 1e-3
_FINER = 0.4
_LEAST_DECAY = 0.02
#: Least distance from 0, relative to the set, of the samples that are uniform in the logarithm of
#: their distance; they are a quarter of all.
_NEAREST = 1e-3
#: Reduction of the required decay where V is larger than 1, relative to the modal decay.
_LEEWAY = 2.0
#: Factors in length by which a set may grow in one step.
_GROWTHS: tuple[float, ...] = (1.3, 1.12, 1.04)
#: A fit is accepted without a further one if samples allow this share of its level.
_ENOUGH = 0.97
#: Largest number of fits of one level, and least growth of a set in length.
_FITS = 8
_GAIN = 1.01
#: For linear programs: numbers of samples, of rows added per turn and of turns; largest
#: coefficient.
_FIRST = 3000
_CHECKED = 12_000
_ADDED = 400
_PROGRAMS = 6
_LARGEST = 100.0


class Bound(NamedTuple):
    """First obstacle found as the level of V rises.

    level: level of V at the obstacle, inf if no obstacle was found
    place: state deviation (n,) at the obstacle, or None if no obstacle was found
    """

    level: float
    place: np.ndarray | None


class Extents(NamedTuple):
    """Bounds of the state deviations z in a set.

    ends: (n, 2), lowest and highest z
    multipliers: (n, 2), factors of 1 - V that prove the lower and upper bounds
    """

    ends: np.ndarray
    multipliers: np.ndarray


@dataclass(frozen=True, eq=False)
class Shape:
    """Polynomial V(y) = Σ coefficient monomial with y = M z, and its set {V <= 1, |y_i| < 1}.

    z is the state deviation from the equilibrium.

    M: (n, n)
    V: polynomial in y with all monomials from degree 2 to its degree
    """

    M: np.ndarray
    V: PolynomialFunction

    @classmethod
    def of_matrix(cls, P: np.ndarray, J: np.ndarray, degree: int) -> Shape:
        """Return V = z'P z in coordinates in which V and V' are diagonal (`_diagonal`).

        J: (n, n), linearization of the loop
        degree: highest degree of the monomials
        """
        return cls(_diagonal(P, J), PolynomialFunction.quadratic(np.eye(len(P)), degree))

    def of_degree(self, degree: int) -> Shape:
        """Return V with monomials up to this degree or a higher one, whose coefficients are 0."""
        V = PolynomialFunction.quadratic(np.zeros_like(self.M), degree)
        V.coefficients[: len(self.V.coefficients)] = self.V.coefficients
        return replace(self, V=V)

    @cached_property
    def N(self) -> np.ndarray:
        """Inverse N (n, n) of M, z = N y."""
        return np.linalg.inv(self.M)

    def values(self, z: np.ndarray) -> np.ndarray:
        """Return V (N,) at state deviations z (N, n)."""
        return self.V(z @ self.M.T)

    def gradients(self, z: np.ndarray) -> np.ndarray:
        """Return ∂V/∂z (N, n) at state deviations z (N, n)."""
        return np.asarray(self.V.slope(z @ self.M.T) @ self.M)

    def linear_decay(self, J: np.ndarray) -> np.ndarray:
        """Return the symmetric D (n, n) with -V' = y'D y to second order, for z' = J z."""
        slope = self.square @ self.M @ J @ self.N
        return np.asarray(-(slope + slope.T))

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.M)

    @property
    def square(self) -> np.ndarray:
        """Symmetric S (n, n) with V = y'S y to second order."""
        return self.V.matrix()

    def modal_decay(self, J: np.ndarray) -> np.ndarray:
        """Return the matrix R (n, n) of the modal decay z'R z, for the linear loop z' = J z.

        The modal decay is the decay rate of the mean of the squared modes, each scaled to at most 1
        in the set. A small multiple of V is added, because the mean is not positive definite if
        modes coincide.
        """
        values, vectors = np.linalg.eig(J)
        modes = np.linalg.inv(vectors)
        modes /= np.abs(self.edge_points(4 * _RAYS) @ (modes @ self.N).T).max(axis=0)[:, None]
        rates = -2.0 * values.real
        mean = (modes.conj().T @ (rates[:, None] * modes)).real / len(J)
        return np.asarray(mean + _SLOWLY * rates.min() * self.M.T @ self.square @ self.M)

    def slow(self, J: np.ndarray) -> np.ndarray:
        """Return T (n, n) with -V' = |s|² to second order, for y = T s and z' = J z.

        Eigenvalues of `linear_decay` below `_SLOWEST` times the largest one are replaced by this
        limit. If the vectors s are uniformly distributed, the vectors T s are dense where V
        decreases slowly.
        """
        values, directions = scipy.linalg.eigh(self.linear_decay(J))
        return np.asarray(directions / np.sqrt(np.maximum(values, _SLOWEST * values[-1])))

    def with_coefficients(self, coefficients: np.ndarray) -> Shape:
        """Return the polynomial with other coefficients in the same coordinates."""
        return replace(self, V=self.V.with_coefficients(coefficients))

    def of_level(self, level: float) -> Shape:
        """Return V divided by a level. The set of the result is {V <= level}."""
        return replace(self, V=self.V.scaled(1.0 / level))

    def stretched(self, factors: np.ndarray) -> Shape:
        """Return the same V in coordinates y_i / factors_i.

        factors: (n,)
        """
        scale = np.prod(factors**self.V.exponents, axis=1)
        V = self.V.with_coefficients(self.V.coefficients * scale)
        return Shape(self.M / factors[:, None], V)

    def diagonal(self, J: np.ndarray) -> Shape:
        """Return V in the coordinates of `_diagonal`, in which a proof needs fewer boxes.

        A V whose quadratic part is not positive definite is returned unchanged.
        """
        square = self.M.T @ self.square @ self.M
        if not np.all(np.linalg.eigvalsh(square) > 0.0):
            return self
        turned = replace(self, M=_diagonal(square, J))
        y = np.random.default_rng(5).uniform(-1.0, 1.0, (4 * len(self.V.coefficients), len(J)))
        values = self.values(y @ turned.N.T)
        return turned.with_coefficients(np.linalg.lstsq(self.V.monomials(y), values)[0])

    def in_cube(self) -> Shape:
        """Return V in coordinates scaled such that the cube |y_i| <= 1 contains sampled boundary
        points.

        The half-width of the cube is `_ROOM` times the largest sampled |y_i|.
        """
        return self.stretched(_ROOM * np.abs(self.edge_points(4 * _RAYS)).max(axis=0))

    def piece(self) -> Piece:
        """Return the set as a piece of level 1, with rounded coefficients."""
        return Piece(self.M, self.V.rounded(), 1.0)

    def contains(self, z: np.ndarray) -> np.ndarray:
        """Return the mask (N,) of the state deviations z (N, n) in the set."""
        y = z @ self.M.T
        return np.asarray(np.all(np.abs(y) < 1.0, axis=1) & (self.V(y) <= 1.0))

    def edges(self, rays: np.ndarray, level: float = 1.0) -> np.ndarray:
        """Return for each ray y (N, n) the lowest factor at which V reaches a level, (N,).

        If V does not reach the level, the factor is `_FARTHEST`.
        """
        return np.minimum(self.V.edge(rays, level, _FARTHEST), _FARTHEST)

    def edge_points(self, count: int) -> np.ndarray:
        """Return points y (count, n) with V = 1 in random directions."""
        rays = _unit(np.random.default_rng(2).normal(size=(count, self.n)))
        return np.asarray(rays * self.edges(rays)[:, None])

    def size(self) -> float:
        """Return the size of the set, the n-th root of its volume in z.

        The volume is relative to that of the unit ball, and is estimated from random directions.
        """
        n = self.n
        lengths = np.linalg.norm(self.edge_points(4 * _RAYS), axis=1)
        return float((np.mean(lengths**n) / abs(np.linalg.det(self.M))) ** (1.0 / n))

    def bound(self, samples: LoopValues, level: float, *, quick: bool = False) -> Bound:
        """Return the first obstacle in the set {V <= level} that samples find.

        quick: whether to use 10 % of the samples and a quarter of the iterations
        """
        slow = self.slow(samples.J)
        to_slow = np.linalg.solve(slow, self.M)

        def margins(z: np.ndarray) -> np.ndarray:
            slope = np.sum(self.gradients(z) * samples.rates(z), axis=1)
            s = z @ to_slow.T
            margin = -slope / np.sum(s * s, axis=1)
            return np.where(samples.beyond(z) | np.isnan(margin), -np.inf, margin)

        rays = samples.share * _SEARCHED * self.n * (0.1 if quick else 1.0)
        turns = _TURNS // 4 if quick else _TURNS
        return self._first(margins, level, max(int(rays), _FEWEST), turns, slow)

    def _first(
        self,
        margins: Callable[[np.ndarray], np.ndarray],
        level: float,
        count: int,
        turns: int,
        slow: np.ndarray,
    ) -> Bound:
        """Return the lowest level of V, up to `level`, at which a margin is not positive."""
        n = self.n
        generator = np.random.default_rng(0)
        shells = np.arange(1, _SHELLS + 1)
        to_slow = np.linalg.inv(slow)

        def drawn(count: int) -> np.ndarray:
            rays = generator.normal(size=(count, n))
            rays[::2] = rays[::2] @ slow.T
            return _unit(rays)

        rays = drawn(count)
        best = level
        place = None
        spread = 0.5
        depth = 1.0
        for _ in range(turns):
            edges = self.edges(rays, best)[:, None] * rays
            below = depth * (_SHELLS - shells + generator.uniform(0.0, 1.0, _SHELLS)) / _SHELLS
            shares = 1.0 - below
            shares[-1] = 1.0
            z = (shares[:, None, None] * edges) @ self.N.T
            margin = margins(z.reshape(-1, n)).reshape(len(shares), len(rays))
            bad = margin <= 0.0
            first = np.where(bad.any(axis=0), bad.argmax(axis=0), len(shares))
            order = np.lexsort((margin.min(axis=0), first))[:12]
            if first[order[0]] < len(shares):
                place = z[first[order[0]], order[0]]
                along = np.linspace(0.0, 1.0, _SHELLS + 1)[1:, None] * place
                best = min(best, float(self.values(along).max()))
            near = np.repeat(rays[order], count // 24, axis=0)
            noise = spread * generator.normal(size=near.shape) / np.sqrt(n)
            is_slow = np.arange(len(near)) % 2 == 0
            lengths = np.linalg.norm(near[is_slow] @ to_slow.T, axis=1, keepdims=True)
            noise[is_slow] = lengths * (noise[is_slow] @ slow.T)
            rays = np.concatenate([rays[order], _unit(near + noise), drawn(count // 2)])
            spread *= 0.6
            depth *= _SHALLOWER
        return Bound(np.inf if place is None else best, place)

    def extents(self) -> Extents:
        """Return bounds of the state deviations z in {V <= 1}, with multipliers for their proof.

        The bounds are estimated from samples.
        """
        n = self.n
        generator = np.random.default_rng(3)
        inside = generator.uniform(size=(4 * _RAYS, 1)) ** (1.0 / n)
        z = inside * (self.edge_points(4 * _RAYS) @ self.N.T)
        room = 1.0 - self.values(z)
        ends = np.zeros((n, 2))
        multipliers = np.zeros((n, 2))
        for i in range(n):
            for side, sign in enumerate((-1.0, 1.0)):
                place = self._farthest(sign * self.N[i])
                gradient = self.gradients(place[None])[0]
                multipliers[i, side] = max(sign * gradient[i], 0.0) / (gradient @ gradient)
                reach = np.max(sign * z[:, i] + multipliers[i, side] * room)
                ends[i, side] = sign * max(sign * place[i], reach) * (1.0 + _BEYOND)
        return Extents(ends, multipliers)

    def _farthest(self, direction: np.ndarray) -> np.ndarray:
        """Return the z of the point in {V <= 1} with approximately the largest direction · y."""
        n = self.n
        generator = np.random.default_rng(4)
        rays = _unit(generator.normal(size=(_RAYS, n)))
        spread = 0.5
        for _ in range(12):
            y = rays * self.edges(rays)[:, None]
            order = np.argsort(-(y @ direction))[:5]
            near = np.repeat(rays[order], 60, axis=0)
            near = near + spread * generator.normal(size=near.shape) / np.sqrt(n)
            rays = _unit(np.concatenate([rays[order], near]))
            spread *= 0.5
        y = rays * self.edges(rays)[:, None]
        first = y[np.argmax(y @ direction)]
        refined = minimize(
            lambda y: -direction @ y,
            first,
            jac=lambda y: -direction,
            constraints={
                "type": "ineq",
                "fun": lambda y: 1.0 - self.V(y[None]),
                "jac": lambda y: -self.V.slope(y[None])[0],
            },
            method="SLSQP",
            options={"ftol": 1e-12},
        ).x
        ray = _unit(refined[None])
        last = (ray * self.edges(ray)[:, None])[0]
        return np.asarray(self.N @ (last if last @ direction > first @ direction else first))


def _diagonal(P: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Return M (n, n) of coordinates y = M z in which z'P z and its derivative are diagonal.

    z'P z = |y|², and its derivative for z' = J z is a sum of multiples of y_i².
    """
    T = np.linalg.inv(np.linalg.cholesky(P)).T
    S = T.T @ P @ J @ T
    return np.asarray(np.linalg.inv(T @ np.linalg.eigh(S + S.T)[1]))


def _unit(rays: np.ndarray) -> np.ndarray:
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


class Growth:
    """Linear programs that enlarge the set of a V.

    samples: evaluation of the closed loop
    shape: first V, scaled to the largest set in which samples find no obstacle
    report: called with a description before each linear program. The callback may raise.
    """

    def __init__(self, samples: LoopValues, shape: Shape, report: Callable[[str], None]) -> None:
        self._samples = samples
        self._report = report
        self._random = np.random.default_rng(1)
        self._obstacles = np.zeros((0, len(shape.M)))
        self._growths = _GROWTHS
        self._least_decay = _DECAY
        self.shape = shape

    def _add(self, place: np.ndarray) -> None:
        """Require V' < 0 at and near a point z (n,) in the next linear programs."""
        near = self._random.normal(size=(30, len(place))) * 0.02 * np.abs(place)
        self._obstacles = np.concatenate([self._obstacles, place[None], place + near])

    def grown(self) -> Shape | None:
        """Return a V with a larger set than the present V, or None if none is found.

        The new V replaces the present V.
        """
        while self._growths:
            found = self._good(self._growths[0] ** 2)
            if found is not None and found.size() > _GAIN * self.shape.size():
                self.shape = found
                return found
            self._growths = self._growths[1:]
        return None

    def of_degree(self, degree: int) -> None:
        """Continue with polynomials V of the given degree, the present degree or a higher one."""
        self.shape = self.shape.of_degree(degree)
        self._growths = _GROWTHS

    def finer(self) -> bool:
        """Reduce the required decay of V and return True.

        If the required decay is already below `_LEAST_DECAY`, return False without a change. A
        smaller required decay permits larger sets, but their proofs take longer.
        """
        if self._least_decay < _LEAST_DECAY:
            return False
        self._least_decay *= _FINER
        return True

    def _good(self, level: float) -> Shape | None:
        """Return the V with the largest set without an obstacle among several fits, or None.

        The obstacle of one fit becomes a constraint of the next fit. The result is None if no fit
        has a solution.

        level: level of the present V up to which the fits extend
        """
        best = None
        largest = 0.0
        self._decay = self.shape.modal_decay(self._samples.J)
        for _ in range(_FITS):
            found = self._fitted(level)
            if found is None:
                break
            # the fit has no samples beyond its level 1
            bound = found.bound(self._samples, 1.0, quick=True)
            if bound.level >= _ENOUGH:
                bound = found.bound(self._samples, 1.0)
            found = found.of_level(min(bound.level, 1.0))
            size = found.size()
            if size > largest:
                best, largest = found, size
            if bound.place is None or bound.level >= _ENOUGH:
                break
            self._add(bound.place)
        return best

    def _fitted(self, level: float) -> Shape | None:
        """Return the V with the least mean on the edge of the present set, or None.

        V >= 1 is required where the present V reaches `level`, and V' < 0 where the present V is
        lower. The result is None if the linear program has no solution.

        level: level of the present V
        """
        last = self.shape.in_cube()
        monomials = last.V.monomials
        checked = int(_CHECKED * max(self._samples.share, 0.1))
        inner = self._inside(last, level, _FIRST)
        inner = np.concatenate([inner, self._obstacles @ last.M.T])
        edge = self._edge(last, level, _FIRST // 2)
        falls, least = self._rows(last, inner)
        rows = [monomials(edge), falls]
        sides = [np.full(len(edge), 1.02), least]
        unknowns = self._unknowns(last)
        mean = monomials(self._edge(last, 1.0, _FIRST)).mean(axis=0)
        shape = None
        for _ in range(_PROGRAMS):
            self._report(f"V of degree {last.V.degree}, size {self.shape.size():.4g}")
            found = linprog(
                mean @ unknowns,
                -np.concatenate(rows) @ unknowns,
                -np.concatenate(sides),
                bounds=(-_LARGEST, _LARGEST),
                method="highs",
            )
            if found.x is None:
                return None
            coefficients = unknowns @ found.x
            shape = last.with_coefficients(coefficients)
            walls = monomials(self._edge(last, level, _CHECKED))
            low = walls[walls @ coefficients < 1.005]
            more = self._inside(last, level, checked)
            more = more[monomials(more) @ coefficients <= 1.0]
            falls, least = self._rows(last, more)
            slack = falls @ coefficients - least
            worst = np.argsort(slack)[:_ADDED]
            worst = worst[slack[worst] < -0.5 * self._least_decay]
            if not len(worst) and not len(low):
                break
            rows += [low, falls[worst]]
            sides += [np.full(len(low), 1.02), least[worst]]
        return shape

    def _unknowns(self, shape: Shape) -> np.ndarray:
        """Return vectors (K, k) whose linear combinations are the permitted coefficients of V.

        For degrees above 2, the quadratic part of V may only be scaled, because too few samples of
        a stiff loop are near 0.
        """
        if shape.V.degree == 2:
            return np.eye(len(shape.V.coefficients))
        is_square = shape.V.degrees == 2
        square = np.where(is_square, shape.V.coefficients, 0.0)
        return np.column_stack([square, np.eye(len(square))[:, ~is_square]])

    def _edge(self, shape: Shape, level: float, count: int) -> np.ndarray:
        """Return random points y (count, n) at which V equals a level."""
        rays = _unit(self._random.normal(size=(count, shape.n)))
        return np.asarray(rays * shape.edges(rays, level)[:, None])

    def _inside(self, shape: Shape, level: float, count: int) -> np.ndarray:
        """Return random points y (count, n) at which V is at most a level.

        Half of the points are in directions that are dense where V decreases slowly.
        """
        n = shape.n
        rays = self._random.normal(size=(count, n))
        rays[: count // 2] = rays[: count // 2] @ shape.slow(self._samples.J).T
        rays = _unit(rays)
        shares = self._random.uniform(size=(count, 1))
        shares[::2] **= 1.0 / n
        shares[1::4] = _NEAREST ** shares[1::4]
        return np.asarray(shares * rays * shape.edges(rays, level)[:, None])

    def _rows(self, last: Shape, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rows (N, K) and right sides (N,) of linear inequalities for the coefficients of V.

        - At a point within the limits: k V - V' / decay >= least decay + k
        - At a point beyond a limit: V >= 1.02

        k rises from 0 to `_LEEWAY` with the value of the V in `last`. The decay is the modal decay
        z'R z.

        last: the present V
        y: points in the coordinates of `last`, (N, n)
        """
        z = y @ last.N.T
        monomials = last.V.monomials(y)
        k = _LEEWAY * np.clip((monomials @ last.V.coefficients - 0.9) / 0.2, 0.0, 1.0)
        rows = k[:, None] * monomials + self._decays(last, z, self._samples.rates(z))
        beyond = self._samples.beyond(z)
        return np.where(beyond[:, None], monomials, rows), np.where(
            beyond, 1.02, self._least_decay + k
        )

    def _decays(self, last: Shape, z: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Return -V' of each monomial over the modal decay z'R z, (N, K), at z' = rates (N, n)."""
        decay = np.einsum("ki,ij,kj->k", z, self._decay, z)
        slopes = last.V.monomial_slopes(z @ last.M.T)
        return np.asarray(-np.einsum("ktj,kj->kt", slopes, rates @ last.M.T) / decay[:, None])
