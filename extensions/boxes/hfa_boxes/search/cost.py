"""The search for a lower bound W of the cost: linear programs on samples, then a proof on boxes.

W = (1 - margin) z'P z and terms of higher degree, which are as large as grad W · f + x'Qx + u'Ru >=
0 allows on samples, with a part of the margin to spare. The best inputs at a sample depend on W:
rows for those of the present W are added until none is violated (cutting planes)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import NamedTuple

import casadi as ca
import numpy as np
from scipy.optimize import linprog

from hfa_boxes.check.cost import CostInequality, Polynomial, solved_for
from hfa_boxes.check.cost_checker import CostWitness
from hfa_boxes.check.cost_statement import CostStatement, Piece
from hfa_boxes.check.cover import Boxes, OpenBoxError, RefutedError, cover
from hfa_boxes.check.plant import Equilibrium, Plant
from hfa_proof.checker.reading import Rejected
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: The part of the margin that the rows of the linear programs keep.
_KEPT = 0.6
#: How far beyond the level z'P z of samples goes.
_BEYOND = 1.6
#: Samples of a turn, rows that a turn adds, and turns of one fit.
_SAMPLES = 20_000
_ADDED = 400
_TURNS = 40
_FIRST = 1500
#: Levels that are tried, one after the other, over the largest linear cost of the initial
#: conditions.
_SHARES = (0.1, 0.4, 1.0, 1.8, 3.0)
_ENDLESS = 10**9
#: Refuted places that become rows of the next fit.
_REFUTED = 60
#: Boxes that are tried for their shape, of which this part may be undecided; how often an edge is
#: doubled, and the most halvings.
_TRIED = 100
_OPEN = 0.5
_STRETCHED = 3
_DEEPEST_TRIED = 9
#: Bits of a coefficient, so that its products with powers are doubles.
_BITS = 45


@dataclass(frozen=True, eq=False)
class CostBound:
    """A proved lower bound.

    statement: proved
    witness: that proves it
    boxes: of each piece
    seconds: processor time of the fit and of the proof of each piece
    stopped: why no larger level is proved; "" where all initial conditions are below it
    """

    statement: CostStatement
    witness: CostWitness
    boxes: tuple[int, ...]
    seconds: tuple[tuple[float, float], ...]
    stopped: str


class _Proved(NamedTuple):
    """A piece, on how many boxes, and the processor time of its fit and of its proof."""

    piece: Piece
    boxes: int
    seconds: tuple[float, float]


class OutOfTimeError(NoSolutionError):
    """The processor time was over."""


class CostSearch:
    """Finds bounds on a growing set.

    plant: limits of states are the envelope
    equilibrium: of states and inputs; solved: the unknowns of it
    Q, R: (n, n), (m, m). P: (n, n), of the linear quadratic problem
    half: (n,), half widths of the initial conditions
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
        self.plant = plant
        self.equilibrium = equilibrium
        self.solved = solved
        self.Q, self.R, self.P = weights
        self.degree = degree
        self.margin = margin
        self._seconds = seconds
        self._begin = time.process_time()
        self._progress = progress
        self._save = save
        self.starts = half * np.random.default_rng(0).uniform(-1.0, 1.0, (4000, len(half)))

    def found(self) -> CostBound:
        """Return the bounds on growing sets; NoSolutionError where none is proved.

        An interruption keeps the proved ones."""
        costs = np.einsum("ki,ij,kj->k", self.starts, self.P, self.starts)
        proved: list[_Proved] = []
        stopped = ""
        for share in _SHARES:
            try:
                proved.append(self._proved(share * float(costs.max())))
            except (OpenBoxError, Rejected, OutOfTimeError) as error:
                stopped = f"at {share:g} of the largest linear cost: {error}"
                break
            except KeyboardInterrupt:
                stopped = f"at {share:g} of the largest linear cost: interrupted"
                break
            bound = self._bound(proved, "")
            if self._save is not None:
                self._save(bound)
            if np.all(bound.statement.bound(self.starts) < proved[-1].piece.c):
                break
        if not proved:
            raise NoSolutionError(f"no lower bound is proved in {self._seconds:g} s: {stopped}")
        return self._bound(proved, stopped)

    def _bound(self, proved: Sequence[_Proved], stopped: str) -> CostBound:
        names = (*self.plant.states, *self.plant.inputs)
        at = dict(zip(names, self.equilibrium.x.tolist(), strict=True))
        pieces = tuple(each.piece for each in proved)
        statement = CostStatement(self.plant, at, self.Q, self.R, pieces)
        boxes = tuple(each.boxes for each in proved)
        witness = CostWitness(
            tuple(names[i] for i in self.solved), tuple(2 * count for count in boxes)
        )
        return CostBound(statement, witness, boxes, tuple(each.seconds for each in proved), stopped)

    def _left(self) -> float:
        return self._seconds - (time.process_time() - self._begin)

    def _tell(self, done: float, whole: float, text: str = "") -> None:
        if self._left() < 0.0:
            raise OutOfTimeError(f"the time was over, {done:.0%} of the cube decided")
        if self._progress is not None:
            self._progress(done, whole, text)

    def _proved(self, c: float) -> _Proved:
        """The bound of one level."""
        begin = time.process_time()
        fit = _Fit(self, c)
        for _ in range(_REFUTED):
            piece = Piece(fit.M, fit.fitted(), c)
            fitted = time.process_time()
            try:
                piece = self._stretched(piece, fit.places())
                boxes = cover(self._inequality(piece), _ENDLESS, self._tell)
            except RefutedError as error:
                fit.refuted(fit.M @ np.linalg.solve(piece.M, error.place))
                continue
            return _Proved(piece, boxes, (fitted - begin, time.process_time() - fitted))
        raise OpenBoxError(f"{_REFUTED} polynomials were refuted", np.zeros(len(self.Q)))

    def _inequality(self, piece: Piece) -> CostInequality:
        return CostInequality(self.plant, self.equilibrium, self.Q, self.R, *piece)

    def _stretched(self, piece: Piece, places: np.ndarray) -> Piece:
        """The piece with coordinates divided by powers of 2, so that boxes are long where that
        leaves most of them proved; places: (N, n), centres of boxes that are tried."""
        inequality = self._inequality(piece)

        def undecided(depths: np.ndarray) -> int:
            tried = Boxes(places, np.tile(depths, (len(places), 1)))
            return int(inequality.undecided(tried).sum())

        n = len(self.Q)
        depths = np.full(n, 3)
        while undecided(depths) > _OPEN * len(places) and depths[0] < _DEEPEST_TRIED:
            depths = depths + 1
        for _ in range(_STRETCHED * n):
            counts = [undecided(depths - row) for row in np.eye(n, dtype=int)]
            if min(counts) > _OPEN * len(places):
                break
            depths[int(np.argmin(counts))] -= 1
        powers_of_two = (depths.max() - depths).tolist()
        M = np.ldexp(1.0, -np.array(powers_of_two))[:, None] * piece.M
        terms = []
        for value, powers in piece.W.terms:
            shift = sum(a * power for a, power in zip(powers_of_two, powers, strict=True))
            terms.append((float(np.ldexp(value, shift)), powers))
        return Piece(M, Polynomial(n, tuple(terms)), piece.c)


class _Fit:
    """Linear programs of one level. Coordinates y = M z; z'P z = _BEYOND c is the unit sphere,
    turned and stretched to the envelope."""

    def __init__(self, search: CostSearch, c: float) -> None:
        self.search = search
        self.c = c
        self._random = np.random.default_rng(1)
        n = len(search.P)
        self.M = self._coordinates()
        self.N = np.linalg.inv(self.M)
        powers = []
        for degree in range(2, search.degree + 1):
            for chosen in combinations_with_replacement(range(n), degree):
                powers.append(tuple(chosen.count(i) for i in range(n)))
        self.powers = np.array(powers)
        square = (1.0 - search.margin) * self.N.T @ search.P @ self.N
        self.fixed = np.array([_square_term(square, each) for each in powers])
        self.free = self.powers.sum(axis=1) > 2
        self.coefficients = self.fixed.copy()
        self._rows: list[np.ndarray] = []
        self._sides: list[np.ndarray] = []
        self._begun = False

    def _ball(self, count: int) -> np.ndarray:
        """Deviations z (count, n) with z'P z <= _BEYOND c, within the envelope; more near 0 than
        uniformly."""
        P = self.search.P
        n = len(P)
        L = np.linalg.cholesky(P)
        found = np.zeros((0, n))
        for _ in range(200):
            rays = self._random.normal(size=(4 * count, n))
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            radii = self._random.uniform(size=(len(rays), 1)) ** (1.5 / n)
            z = np.sqrt(_BEYOND * self.c) * np.linalg.solve(L.T, (radii * rays).T).T
            found = np.concatenate([found, z[self._in_envelope(z)]])
            if len(found) >= count:
                break
        return found[:count]

    def _in_envelope(self, z: np.ndarray) -> np.ndarray:
        plant = self.search.plant
        low, high = plant.ends(plant.states).T
        x = z + self.search.equilibrium.x[: z.shape[1]]
        return np.asarray(np.all((low <= x) & (x <= high), axis=1))

    def _coordinates(self) -> np.ndarray:
        search = self.search
        L = np.linalg.cholesky(search.P)
        # the least of g to second order, in ball coordinates
        x = search.equilibrium.x
        rates = self._rates_at_equilibrium(x)
        n = len(search.P)
        G = search.P @ rates[:, n:]
        price = search.Q + G @ np.linalg.pinv(search.R) @ G.T
        inner = np.linalg.solve(L, np.linalg.solve(L, price).T)
        turn = np.linalg.eigh(0.5 * (inner + inner.T))[1]
        z = self._ball(4000)
        w = z @ L @ turn
        reach = np.abs(w).max(axis=0) * 1.02
        return np.asarray((L @ turn / reach).T)

    def _rates_at_equilibrium(self, x: np.ndarray) -> np.ndarray:
        n = len(self.search.P)
        both = ca.SX.sym("both", len(x))
        f, _ = self.search.plant.rates_at(both[:n], both[n:])
        return np.array(ca.Function("J", [both], [ca.jacobian(f, both)])(x))

    @cached_property
    def _pilot(self) -> tuple[ca.Function, ca.Function]:
        """(z, v) -> f and (z, v, p) -> gradient and Hessian in v of p·f + v'Rv."""
        search = self.search
        n, m = len(search.Q), len(search.R)
        z, v, p = ca.SX.sym("z", n), ca.SX.sym("v", m), ca.SX.sym("p", n)
        at = ca.DM(search.equilibrium.x)
        f, _ = search.plant.rates_at(at[:n] + z, at[n:] + v)
        price = ca.dot(p, f) + ca.dot(ca.DM(search.R) @ v, v)
        slope = ca.gradient(price, v)
        second = ca.vec(ca.jacobian(slope, v))
        return (
            ca.Function("f", [z, v], [f]),
            ca.Function("h", [z, v, p], [ca.densify(slope), ca.densify(second)]),
        )

    def fitted(self) -> Polynomial:
        """The polynomial of the last linear program that no sample violates."""
        if not self._begun:
            self._begun = True
            z = self._ball(_FIRST)
            self._add(z, self._best_inputs(z))
            self._add_walls(_FIRST)
        margin = self.search.margin
        accepted = 0
        for _ in range(_TURNS):
            self._solve()
            self.search._tell(0.0, 1.0, f"{len(self._sides)} linear programs")
            z = self._ball(_SAMPLES)
            z = z[self._values(z @ self.M.T) <= 1.05 * self.c]
            v = self._best_inputs(z)
            row, side = self._row(z, v)
            # in units of the running cost: 0 is the row itself, -_KEPT margin is g = 0
            slack = row @ self.coefficients - side
            walls = self._add_walls(_FIRST // 3)
            worst = np.argsort(slack)[:_ADDED]
            worst = worst[slack[worst] < -0.1 * margin]
            if len(worst) == 0 and not walls:
                accepted += 1
                if accepted == 1:
                    break
                continue
            self._rows.append(row[worst])
            self._sides.append(side[worst])
        return self.polynomial()

    def places(self) -> np.ndarray:
        """(N, n), coordinates of samples in the set, off the faces of the cube."""
        y = self._ball(20 * _TRIED) @ self.M.T
        inside = (self._values(y) <= self.c) & np.all(np.abs(y) < 0.8, axis=1)
        return y[inside][:_TRIED]

    def refuted(self, y: np.ndarray) -> None:
        """Add rows at and about a place where g < 0."""
        near = y + 0.02 * self._random.normal(size=(30, len(y)))
        y = np.concatenate([y[None], near])
        z = y @ self.N.T
        self._add(z, self._best_inputs(z))

    def polynomial(self) -> Polynomial:
        """With coefficients of few bits."""
        mantissa, exponent = np.frexp(self.coefficients)
        rounded = np.ldexp(np.round(np.ldexp(mantissa, _BITS)), exponent - _BITS)
        pairs = zip(rounded.tolist(), self.powers.tolist(), strict=True)
        terms = tuple((value, tuple(powers)) for value, powers in pairs if value)
        return Polynomial(len(self.M), terms)

    def _solve(self) -> None:
        rows = np.concatenate(self._rows)
        sides = np.concatenate(self._sides)
        y = self._ball(4000) @ self.M.T
        y = y[self._values(y) <= self.c] if len(self._sides) > 2 else y
        z = y @ self.N.T
        linear = np.einsum("ki,ij,kj->k", z, self.search.P, z)
        gain = np.mean(self._monomials(y) / linear[:, None], axis=0)[self.free]
        starts = self.search.starts @ self.M.T
        reached = np.all(np.abs(starts) < 1.0, axis=1) & (self._values(starts) <= self.c)
        if np.any(reached):
            z = self.search.starts[reached]
            linear = np.einsum("ki,ij,kj->k", z, self.search.P, z)
            gain += np.mean(self._monomials(starts[reached]) / linear[:, None], axis=0)[self.free]
        left = sides - rows @ self.fixed
        most = 30.0 * self.c
        count = int(self.free.sum())
        if not count:
            return
        # W / c of order 1
        found = linprog(
            -gain * self.c,
            -rows[:, self.free] * self.c,
            -left,
            bounds=[(-most / self.c, most / self.c)] * count,
            method="highs",
        )
        if found.x is None:
            raise OpenBoxError(f"the linear program has no solution: {found.message}", y[0])
        self.coefficients[self.free] = found.x * self.c
        slack = left - rows[:, self.free] @ self.coefficients[self.free]
        # rows far from active are left out of the next
        if len(rows) > 6000:
            keep = np.argsort(-slack)[:4000]
            self._rows = [rows[keep]]
            self._sides = [sides[keep]]

    def _monomials(self, y: np.ndarray) -> np.ndarray:
        table = _power_table(y, self.search.degree)
        values = np.ones((len(y), len(self.powers)))
        for i in range(y.shape[1]):
            values *= table[self.powers[:, i], :, i].T
        return values

    def _values(self, y: np.ndarray) -> np.ndarray:
        return np.asarray(self._monomials(y) @ self.coefficients)

    def _slopes(self, y: np.ndarray) -> np.ndarray:
        """(N, terms, n), of each monomial."""
        table = _power_table(y, self.search.degree)
        n = y.shape[1]
        slopes = np.empty((len(y), len(self.powers), n))
        for j in range(n):
            powers = self.powers.copy()
            powers[:, j] = np.maximum(powers[:, j] - 1, 0)
            values = np.broadcast_to(self.powers[:, j].astype(float), slopes.shape[:2]).copy()
            for i in range(n):
                values *= table[powers[:, i], :, i].T
            slopes[:, :, j] = values
        return slopes

    def _row(self, z: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and sides of: grad W · f + (1 - kept margin) cost >= 0, in units of the cost."""
        search = self.search
        f = np.array(self._pilot[0](z.T, v.T)).T @ self.M.T
        cost = np.einsum("ki,ij,kj->k", z, search.Q, z) + np.einsum("ki,ij,kj->k", v, search.R, v)
        rows = np.einsum("ktj,kj->kt", self._slopes(z @ self.M.T), f)
        scale = cost + 1e-12 * self.c
        return rows / scale[:, None], np.full(len(z), -(1.0 - _KEPT * search.margin))

    def _add(self, z: np.ndarray, v: np.ndarray) -> None:
        rows, sides = self._row(z, v)
        self._rows.append(rows)
        self._sides.append(sides)

    def _add_walls(self, count: int) -> bool:
        """Rows W >= 1.02 c where z'P z > _BEYOND c in the cube; whether any was violated."""
        n = len(self.M)
        y = self._random.uniform(-1.0, 1.0, (4 * count, n))
        faces = y[: 2 * count].copy()
        which = self._random.integers(0, n, len(faces))
        faces[np.arange(len(faces)), which] = np.sign(faces[np.arange(len(faces)), which])
        z = faces @ self.N.T
        on_face = faces[self._in_envelope(z)]
        z = y @ self.N.T
        far = np.einsum("ki,ij,kj->k", z, self.search.P, z) > _BEYOND * self.c
        y = np.concatenate([on_face, y[far & self._in_envelope(z)]])[: 2 * count]
        if not len(y):
            return False
        values = self._monomials(y) / self.c
        broken = values @ self.coefficients < 1.01
        chosen = broken if self._begun and len(self._rows) > 2 else np.ones(len(y), dtype=bool)
        self._rows.append(values[chosen])
        self._sides.append(np.full(int(chosen.sum()), 1.02))
        return bool(broken.any())

    def _best_inputs(self, z: np.ndarray) -> np.ndarray:
        search = self.search
        m = len(search.R)
        v = np.zeros((len(z), m))
        if not m:
            return v
        n = len(search.Q)
        names = tuple(search.plant.inputs)
        low, high = (search.plant.ends(names) - search.equilibrium.x[n:, None]).T
        y = z @ self.M.T
        p = np.einsum("ktj,t->kj", self._slopes(y), self.coefficients) @ self.M
        for _ in range(8):
            b, H = (np.array(each).T for each in self._pilot[1](z.T, v.T, p.T))
            free = ~(((v <= low) & (b > 0.0)) | ((v >= high) & (b < 0.0)))
            step = solved_for(H.reshape(-1, m, m), np.where(free, -b, 0.0)[..., None], free)[..., 0]
            new = np.clip(v + step, low, high)
            change = np.abs(new - v).max()
            v = new
            if change <= 1e-9:
                break
        return v


def _square_term(S: np.ndarray, powers: tuple[int, ...]) -> float:
    """The coefficient of a monomial of degree 2 in y'S y; 0 of a higher one."""
    if sum(powers) != 2:
        return 0.0
    chosen = [i for i, power in enumerate(powers) for _ in range(power)]
    i, j = chosen
    return float(S[i, i] if i == j else S[i, j] + S[j, i])


def _power_table(y: np.ndarray, degree: int) -> np.ndarray:
    """(degree + 1, N, n), y to each power."""
    table = np.ones((degree + 1, *y.shape))
    for power in range(1, degree + 1):
        table[power] = table[power - 1] * y
    return table
