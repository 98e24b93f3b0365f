"""Re-verifies a certificate, by other means than it was made with: nobody needs to trust the search or the prover.

Shares nothing with the prover but the model itself and the ball arithmetic of Arb. The prover differentiates power
series and bounds Lagrange's remainder; here every quantity is a Taylor model c_0 + c_1 s + c_2 s² + rest of second order
on s in [-1, 1], the place within the box (Makino and Berz; Tucker), carried through the model's instructions one by
one. The trims are the polynomials that the certificate states, and Krawczyk's operator is applied along them.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from flint import arb, arb_mat, arb_series, ctx

from hfa_model.aircraft import compiled_dynamics
from hfa_model.parameters import Parameters
from hfa_model.support.errors import BadInputError, NoSolutionError
from hfa_model.variants import variant_named
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES
from trim.point.condition import LIMITS, level_flight

SCHEMA = "hfa.certificate/1"
_BITS = 106
_ROWS = [STATES.index(name) for name in LINEAR_STATES]
_BALANCED = [STATES.index(name) for name in ("speed", "alpha", "pitch_rate", "dihedral_rate")]
#: Control points of s² on the four quarters of [-1, 1]: their hull holds (s, s²).
_HULL = ((-1.0, 1.0), (-0.75, 0.5), (-0.25, 0.0), (0.25, 0.0), (0.75, 0.5), (1.0, 1.0))


class Rejected(NoSolutionError):
    """A box of the certificate does not prove what it states."""


@dataclass(frozen=True)
class Verified:
    """What a certificate proves: low and high (deg), the loop's and A's runs of (low, high, unstable modes), the decay
    rate of the loop where it is Hurwitz (1/s), and how many boxes were verified."""

    low: float
    high: float
    loop: list[tuple[float, float, int]]
    modes: list[tuple[float, float, int]]
    rate: float
    boxes: int

    @property
    def proved(self) -> bool:
        """The loop is Hurwitz on the whole interval."""
        return self.loop == [(self.low, self.high, 0)]


def check_certificate(path: Path, progress: Any = None) -> Verified:
    """BadInputError when the file is none or was edited; Rejected names the first box that fails."""
    ctx.prec = _BITS
    content = _read(path)
    try:
        plant = _Plant(content["statement"])
        low, high = content["statement"]["dihedral_deg"]
        total = len(content["loop"]) + len(content["modes"])
        for index, entry in enumerate([*content["loop"], *content["modes"]]):
            plant.verify(entry, closed=index < len(content["loop"]))
            if progress is not None:
                progress(index + 1, total)
        rates = [entry["rate"] for entry in content["loop"] if entry["unstable"] == 0]
        runs = [_runs(content[name], low, high) for name in ("loop", "modes")]
    except (KeyError, TypeError, ValueError, IndexError, np.linalg.LinAlgError) as error:
        raise Rejected(f"{path}: the certificate is not complete ({type(error).__name__}: {error})") from error
    return Verified(low, high, runs[0], runs[1], min(rates, default=0.0), total)


def _read(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise BadInputError(f"{path}: is not JSON ({error})") from error
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise BadInputError(f"{path}: is no certificate; `hfa prove schedule -o FILE.json` writes one")
    kept = {key: value for key, value in content.items() if key != "digest"}
    if content.get("digest") != hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest():
        raise BadInputError(f"{path}: refused, the certificate was edited: its digest is that of other content")
    return content


def _runs(entries: list[Any], low: float, high: float) -> list[tuple[float, float, int]]:
    """Boxes in increasing order, neighbours with the same number of unstable modes joined."""
    runs: list[tuple[float, float, int]] = []
    for entry in entries:
        start, end = entry["dihedral_deg"]
        if not (low <= start < end <= high) or (runs and start < runs[-1][1]):
            raise Rejected(f"the box from {start} to {end} deg is out of place")
        if runs and runs[-1][1:] == (start, entry["unstable"]):
            runs[-1] = (runs[-1][0], end, entry["unstable"])
        else:
            runs.append((start, end, entry["unstable"]))
    return runs


class TaylorModel:
    """c_0 + c_1 s + c_2 s² + rest for every |s| <= 1, with balls as coefficients."""

    __slots__ = ("c0", "c1", "c2", "rest")

    def __init__(self, c0: Any, c1: Any = 0, c2: Any = 0, rest: Any = 0) -> None:
        self.c0, self.c1, self.c2, self.rest = arb(c0), arb(c1), arb(c2), arb(rest)

    def __add__(self, other: Any) -> TaylorModel:
        o = _model(other)
        return TaylorModel(self.c0 + o.c0, self.c1 + o.c1, self.c2 + o.c2, self.rest + o.rest)

    def __neg__(self) -> TaylorModel:
        return TaylorModel(-self.c0, -self.c1, -self.c2, -self.rest)

    def __mul__(self, other: Any) -> TaylorModel:
        if isinstance(other, arb):
            return TaylorModel(self.c0 * other, self.c1 * other, self.c2 * other, self.rest * other)
        o = other
        cut = _ball(self.c1 * o.c2 + self.c2 * o.c1) + self.c2 * o.c2 * _SQUARE
        rest = cut + self.rest * o.range() + o.rest * self._polynomial()
        c2 = self.c0 * o.c2 + self.c1 * o.c1 + self.c2 * o.c0
        return TaylorModel(self.c0 * o.c0, self.c0 * o.c1 + self.c1 * o.c0, c2, rest)

    def _polynomial(self) -> arb:
        return self.c0 + _ball(self.c1) + self.c2 * _SQUARE

    def range(self) -> arb:
        """Every value on the box."""
        return self._polynomial() + self.rest

    def through(self, function: Any) -> TaylorModel:
        """f(c_0 + δ) = f + f' δ + f''/2 δ² + f'''(ξ)/6 δ³ with ξ in the range."""
        near = function(arb_series([self.c0, 1], prec=3))
        far = function(arb_series([self.range(), 1], prec=4))
        delta = TaylorModel(0, self.c1, self.c2, self.rest)
        square = delta * delta
        total = delta * near[1] + square * near[2] + TaylorModel(near[0])
        return total + TaylorModel(0, 0, 0, far[3] * square.range() * delta.range())


_SQUARE = arb(0.5, 0.5)


def _ball(value: arb) -> arb:
    """{s value : |s| <= 1}."""
    return arb(0, 1) * value


def _model(value: Any) -> TaylorModel:
    return value if isinstance(value, TaylorModel) else TaylorModel(value)


def _value(value: Any) -> arb:
    return value.range() if isinstance(value, TaylorModel) else value


def _through(function: Any) -> Any:
    return lambda x: x.through(function) if isinstance(x, TaylorModel) else function(arb_series([x], prec=1))[0]


def _product(x: Any, y: Any) -> Any:
    return y * x if isinstance(y, TaylorModel) else x * y


def _sum(x: Any, y: Any) -> Any:
    return y + x if isinstance(y, TaylorModel) else x + y


_inverse = _through(lambda x: 1 / x)


def _choice(x: Any, y: Any, first: Any, second: Any) -> Any:
    """The first where x <= y is certain, the second where x > y is."""
    if _value(x) <= _value(y):
        return first
    if _value(x) > _value(y):
        return second
    raise Rejected("a branch of the equations is not decided")


def _arctangent(y: Any, x: Any) -> Any:
    if not _value(x) > 0:
        raise Rejected("atan2 outside the right half plane")
    return _through(lambda z: z.atan())(_product(y, _inverse(x)))


_OPERATIONS = {
    ca.OP_ADD: _sum,
    ca.OP_SUB: lambda x, y: _sum(x, -y),
    ca.OP_MUL: _product,
    ca.OP_DIV: lambda x, y: _product(x, _inverse(y)),
    ca.OP_NEG: lambda x: -x,
    ca.OP_TWICE: lambda x: _sum(x, x),
    ca.OP_SQ: lambda x: _product(x, x),
    ca.OP_INV: _inverse,
    ca.OP_SQRT: _through(lambda x: x.sqrt()),
    ca.OP_EXP: _through(lambda x: x.exp()),
    ca.OP_SIN: _through(lambda x: x.sin()),
    ca.OP_COS: _through(lambda x: x.cos()),
    ca.OP_ASIN: _through(lambda x: x.asin()),
    ca.OP_ATAN2: _arctangent,
    ca.OP_CONSTPOW: lambda x, y: (y * x.log()).exp(),  # of the atmosphere: both are balls, the base positive
    ca.OP_FMIN: lambda x, y: _choice(x, y, x, y),
    ca.OP_FMAX: lambda x, y: _choice(x, y, y, x),
    ca.OP_LE: lambda x, y: _choice(x, y, arb(1), arb(0)),
}


def evaluate(function: ca.Function, *arguments: Sequence[Any]) -> list[list[Any]]:
    """Instruction by instruction, on balls and Taylor models; a KeyError for an operation that is not known."""
    work: list[Any] = [None] * function.sz_w()
    results: list[list[Any]] = [[None] * function.nnz_out(index) for index in range(function.n_out())]
    for index in range(function.n_instructions()):
        code = function.instruction_id(index)
        out, source = function.instruction_output(index), function.instruction_input(index)
        if code == ca.OP_INPUT:
            work[out[0]] = arguments[source[0]][source[1]]
        elif code == ca.OP_OUTPUT:
            results[out[0]][out[1]] = work[source[0]]
        elif code == ca.OP_CONST:
            work[out[0]] = arb(function.instruction_constant(index))
        else:
            work[out[0]] = _OPERATIONS[code](*(work[place] for place in source))
    return results


class _Plant:
    """The aircraft, the flights and the gains of a statement."""

    def __init__(self, claim: dict[str, Any]) -> None:
        self._functions = compiled_dynamics(variant_named(claim["dynamics"]))
        widths = [arb(0, claim["spread"][name]) for name in Parameters._fields]
        values = [_as_read(claim["parameters"][name]) for name in Parameters._fields]
        self._parameters = [value + width for value, width in zip(values, widths, strict=True)]
        condition = level_flight(0.0, **claim["settings"])
        self._fixed: dict[str, Any] = {name: _as_read(value) for name, value in condition.imposed.items()}
        self._fixed["pitch"] = self._fixed["alpha"] + self._fixed["gamma"]
        self._free = [INPUTS.index(name) for name in condition.free]
        self._angles = claim["table"]["dihedral_deg"]
        self._gains = [_exact(K) for K in claim["table"]["K"]]

    def verify(self, entry: dict[str, Any], *, closed: bool) -> None:
        """Trims, limits, enclosures and the number of unstable modes of one box; Rejected when one is not proved."""
        low, high = entry["dihedral_deg"]
        try:
            A, B = self._model(entry)
            if closed:
                K = self._gain(low, high)
                A = [[_dot(A[i][j], B[i], [row[j] for row in K]) for j in range(len(A))] for i in range(len(A))]
            _check_inertia(A, np.array(entry["H"], dtype=float), entry["unstable"], entry["rate"])
        except Rejected as error:
            raise Rejected(f"the box from {low} to {high} deg is not proved: {error}") from error

    def _model(self, entry: dict[str, Any]) -> tuple[list[list[TaylorModel]], list[list[TaylorModel]]]:
        low, high = (arb(end) for end in entry["dihedral_deg"])
        radius = (high - low) / 2
        degree = arb.pi() / 180
        dihedral = TaylorModel((low + high) / 2 * degree, radius * degree)
        centers = [TaylorModel(*(arb(c) * radius**j for j, c in enumerate(row))) for row in entry["trim"]]
        rests = [arb(0, width) if i in self._free else arb(0) for i, width in enumerate(entry["radius"])]
        inputs = [center + TaylorModel(0, 0, 0, rest) for center, rest in zip(centers, rests, strict=True)]
        fixed = [i for i in range(len(INPUTS)) if i not in self._free]
        for i in fixed:
            inputs[i] = centers[i] = TaylorModel(self._fixed[INPUTS[i]])
        state = [dihedral if name == "dihedral" else self._fixed[name] for name in STATES]
        residual = evaluate(self._functions.rates, state, centers, self._parameters)[0]
        _, A, B = evaluate(self._functions.jacobians, state, inputs, self._parameters)
        n = len(STATES)
        derivative = [[_value(B[n * j + i]) for j in self._free] for i in _BALANCED]
        self._check_trim([_value(residual[i]) for i in _BALANCED], derivative, [rests[i] for i in self._free])
        for name, value in zip(INPUTS, inputs, strict=True):
            if not (arb(LIMITS[name][0]) <= value.range() <= arb(LIMITS[name][1])):
                raise Rejected(f"{name} may lie beyond its limits")
        found = [[_model(A[n * j + i]) for j in _ROWS] for i in _ROWS]
        found_B = [[_model(B[n * j + i]) for j in range(len(INPUTS))] for i in _ROWS]
        for name, entries in (("A", found), ("B", found_B)):
            for row, said in zip(entries, entry[name], strict=True):
                if not all(arb(a) <= value.range() <= arb(b) for value, (a, b) in zip(row, said, strict=True)):
                    raise Rejected(f"an entry of {name} may lie outside its enclosure")
        return found, found_B

    def _check_trim(self, residual: list[arb], derivative: list[list[arb]], offsets: list[arb]) -> None:
        """-C F + (I - C F_w) W in the interior of W: one trim, and only one, near the polynomial at every angle."""
        J = arb_mat(derivative)
        C = _exact(np.linalg.inv([[float(value.mid()) for value in row] for row in derivative]).tolist())
        identity = _exact(np.eye(len(residual)).tolist())
        image = (identity - C * J) * arb_mat([[each] for each in offsets]) - C * arb_mat([[each] for each in residual])
        if not all(offset.contains_interior(row[0]) for offset, row in zip(offsets, image.tolist(), strict=True)):
            raise Rejected("the trim is not proved to exist")

    def _gain(self, low: float, high: float) -> list[list[TaylorModel]]:
        """K on a box between two neighbouring angles of the table, where it is linear."""
        spans = [i for i in range(len(self._angles) - 1) if self._angles[i] <= low and high <= self._angles[i + 1]]
        if not spans:
            raise Rejected("the box crosses an angle of the table")
        i = spans[0]
        slope = (self._gains[i + 1] - self._gains[i]) / (arb(self._angles[i + 1]) - arb(self._angles[i]))
        middle = self._gains[i] + ((arb(low) + arb(high)) / 2 - arb(self._angles[i])) * slope
        part = (arb(high) - arb(low)) / 2 * slope
        pairs = zip(middle.tolist(), part.tolist(), strict=True)
        return [[TaylorModel(a, b) for a, b in zip(row, other, strict=True)] for row, other in pairs]


def _dot(start: TaylorModel, row: list[TaylorModel], column: list[TaylorModel]) -> TaylorModel:
    for a, b in zip(row, column, strict=True):
        start = start + -(a * b)
    return start


def _check_inertia(A: list[list[TaylorModel]], H: np.ndarray, unstable: int, rate: float) -> None:
    """-(A'H + H A + 2 rate H) > 0 on the box, and H has `unstable` negative eigenvalues and no zero one."""
    if not (np.array_equal(H, H.T) and math.isfinite(rate)):
        raise Rejected("H is not symmetric, or the rate no number")
    weight = _exact(H.tolist())
    values, vectors = np.linalg.eigh(H)
    turn = _exact((vectors / np.sqrt(np.abs(values))).tolist())
    signs = _signs(turn.transpose() * weight * turn)
    if sum(1 for sign in signs if sign < 0) != unstable:
        raise Rejected(f"H does not have {unstable} negative eigenvalues")
    parts = [arb_mat([[getattr(each, part) for each in row] for row in A]) for part in TaylorModel.__slots__]

    def decrease(matrix: arb_mat) -> arb_mat:
        product = weight * matrix
        return -(product + product.transpose() + 2 * arb(rate) * weight)

    middle = np.array([[float(value.mid()) for value in row] for row in decrease(parts[0]).tolist()])
    turn = _exact(np.linalg.inv(np.linalg.cholesky((middle + middle.T) / 2)).T.tolist())
    for s, square in _HULL:
        corner = parts[0] + arb(s) * parts[1] + arb(square) * parts[2] + parts[3]
        if any(sign < 0 for sign in _signs(turn.transpose() * decrease(corner) * turn)):
            raise Rejected("the matrix that proves the modes is not positive definite")


def _signs(matrix: arb_mat) -> list[int]:
    """Signs of the eigenvalues of a symmetric matrix, by the pivots of Gaussian elimination (Sylvester)."""
    rows, signs = matrix.tolist(), []
    while rows:
        head = rows[0][0]
        if not (head > 0 or head < 0):
            raise Rejected("an eigenvalue is not told from 0")
        signs.append(1 if head > 0 else -1)
        rows = [[b - row[0] / head * a for a, b in zip(rows[0][1:], row[1:], strict=True)] for row in rows[1:]]
    return signs


def _exact(rows: Any) -> arb_mat:
    return arb_mat([[arb(value) for value in row] for row in rows])


def _as_read(value: float) -> arb:
    """The double and the decimal, or the degrees, that it was read from."""
    return arb(value, abs(value) * 2.0**-51)
