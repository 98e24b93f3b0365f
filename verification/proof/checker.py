"""Re-verifies a certificate by other means than it was made with: nobody needs to trust the search or the prover.

Shares nothing with the prover but the model itself and the ball arithmetic of Arb. The prover differentiates power
series and bounds Lagrange's remainder; here every quantity is a Taylor model c_0 + c_1 s + c_2 s² + rest on s in
[-1, 1], the place within the box (Makino and Berz; Tucker), carried through the model's instructions one by one. The
trims are the polynomials that the certificate states, and Krawczyk's operator is applied along them.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from hfa_model.aircraft import compiled_dynamics
from hfa_model.parameters import Parameters
from hfa_model.support.errors import BadInputError
from hfa_model.variants import variant_named
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES
from trim.point.condition import LIMITS, level_flight
from verification.proof.taylor_model import Rejected, TaylorModel, as_model, evaluate, values_of

SCHEMA = "hfa.certificate/1"
Rows = list[list[TaylorModel]]
_BITS = 106
_ROWS = [STATES.index(name) for name in LINEAR_STATES]
_BALANCED = [STATES.index(name) for name in ("speed", "alpha", "pitch_rate", "dihedral_rate")]
#: Control points of s² on the four quarters of [-1, 1]: their hull holds (s, s²).
_HULL = ((-1.0, 1.0), (-0.75, 0.5), (-0.25, 0.0), (0.25, 0.0), (0.75, 0.5), (1.0, 1.0))


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
        digest = content.pop("digest")
        schema = content["schema"]
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, KeyError, AttributeError, TypeError) as error:
        raise BadInputError(f"{path}: is no certificate; `hfa prove schedule -o FILE.json` writes one") from error
    if schema != SCHEMA or digest != hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest():
        raise BadInputError(f"{path}: refused, the certificate was edited: its digest is that of other content")
    return dict(content)


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


class _Plant:
    """The aircraft, the flights and the gains of a statement."""

    def __init__(self, claim: dict[str, Any]) -> None:
        self._functions = compiled_dynamics(variant_named(claim["dynamics"]))
        widths = [arb(0, claim["spread"][name]) for name in Parameters._fields]
        values = [_as_read(claim["parameters"][name]) for name in Parameters._fields]
        self._parameters = [value + width for value, width in zip(values, widths, strict=True)]
        # Made at both ends, which are refused beyond the limits of the dihedral; all but the dihedral is the same.
        condition, _ = (level_flight(math.radians(end), **claim["settings"]) for end in claim["dihedral_deg"])
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
            loop = self._closed(A, B, low, high) if closed else A
            _check_inertia(loop, np.array(entry["H"], dtype=float), entry["unstable"], entry["rate"])
        except Rejected as error:
            raise Rejected(f"the box from {low} to {high} deg is not proved: {error}") from error

    def _model(self, entry: dict[str, Any]) -> tuple[Rows, Rows]:
        low, high = (arb(end) for end in entry["dihedral_deg"])
        radius = (high - low) / 2
        degree = arb.pi() / 180
        dihedral = TaylorModel((low + high) / 2 * degree, radius * degree)
        centers = [TaylorModel(*(arb(c) * radius**j for j, c in enumerate(row))) for row in entry["trim"]]
        rests = [arb(0, width) if i in self._free else arb(0) for i, width in enumerate(entry["radius"])]
        inputs = [center + TaylorModel(0, 0, 0, rest) for center, rest in zip(centers, rests, strict=True)]
        for i in set(range(len(INPUTS))) - set(self._free):
            inputs[i] = centers[i] = TaylorModel(self._fixed[INPUTS[i]])
        state = [dihedral if name == "dihedral" else self._fixed[name] for name in STATES]
        residual = evaluate(self._functions.rates, state, centers, self._parameters)[0]
        _, A, B = evaluate(self._functions.jacobians, state, inputs, self._parameters)
        n = len(STATES)
        derivative = [[values_of(B[n * j + i]) for j in self._free] for i in _BALANCED]
        self._check_trim([values_of(residual[i]) for i in _BALANCED], derivative, [rests[i] for i in self._free])
        for name, value in zip(INPUTS, inputs, strict=True):
            if not (arb(LIMITS[name][0]) <= value.range() <= arb(LIMITS[name][1])):
                raise Rejected(f"{name} may lie beyond its limits")
        found = [[as_model(A[n * j + i]) for j in _ROWS] for i in _ROWS]
        found_B = [[as_model(B[n * j + i]) for j in range(len(INPUTS))] for i in _ROWS]
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

    def _closed(self, A: Rows, B: Rows, low: float, high: float) -> Rows:
        """A - B K on a box between two neighbouring angles of the table, where K is linear."""
        spans = [i for i in range(len(self._angles) - 1) if self._angles[i] <= low and high <= self._angles[i + 1]]
        if not spans:
            raise Rejected("the box crosses an angle of the table")
        i = spans[0]
        start, end = arb(self._angles[i]), arb(self._angles[i + 1])
        slope = (self._gains[i + 1] - self._gains[i]) * (1 / (end - start))
        middle = self._gains[i] + ((arb(low) + arb(high)) / 2 - start) * slope
        part = (arb(high) - arb(low)) / 2 * slope
        places = range(len(A))
        K = [[TaylorModel(middle[k, j], part[k, j]) for j in places] for k in range(middle.nrows())]
        return [[sum((-B[i][k] * K[k][j] for k in range(len(K))), A[i][j]) for j in places] for i in places]


def _check_inertia(A: Rows, H: np.ndarray, unstable: int, rate: float) -> None:
    """-(A'H + H A + 2 rate H) > 0 on the box, and H has `unstable` negative eigenvalues and no zero one."""
    if not (np.array_equal(H, H.T) and 0.0 <= rate < math.inf and rate * unstable == 0.0):
        raise Rejected("H is not symmetric, or the rate is none of a stable loop")
    weight = _exact(H.tolist())
    values, vectors = np.linalg.eigh(H)
    with np.errstate(divide="ignore", invalid="ignore"):  # an eigenvalue 0 is rejected below
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
