"""Re-verifies a certificate by other means than it was made with: nobody needs to trust the search or the prover.

Every quantity is a Taylor model in the place s within a box and the errors t of the parameters. One test of roots, for
the trims and for solutions of the Riccati equation, about the polynomials that the certificate states; one of modes, H
being stated; one of distances. With the prover it shares the arithmetic alone.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from functools import cache, reduce
from itertools import chain, pairwise, zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from flint import acb, acb_mat, arb, arb_mat, ctx

from hfa_model.aircraft import compiled_dynamics
from hfa_model.parameters import Parameters
from hfa_model.variants import variant_named
from hfa_model.vectors import INPUT_SCALES, INPUTS, LINEAR_STATES, STATES
from hfa_support.errors import BadInputError, NoSolutionError, on_one_line
from hfa_support.files import read_json
from hfa_support.progress import Progress
from verification.arithmetic.ball_function import BallFunction
from verification.arithmetic.balls import matrix, norm, pivots
from verification.arithmetic.taylor_model import TaylorModel
from verification.checker.structure import Content, check_structure

SCHEMA = "hfa.certificate/5"
_LINEAR = [STATES.index(name) for name in LINEAR_STATES]
_BALANCED = [STATES.index(name) for name in ("speed", "alpha", "pitch_rate", "dihedral_rate")]


class Rejected(NoSolutionError):
    """A box of the certificate does not prove what it states."""


class Verified(NamedTuple):
    """A verified statement; covers: list of boxes -> (low, high, unstable modes) of each, deg; rate: of decay, 1/s.

    written: version, command and date that the file bears, which nothing verifies.
    """

    kind: str
    statement: Content
    covers: dict[str, list[tuple[float, float, int]]]
    rate: float
    written: Content


def sealed(head: str, origin: str) -> str:
    """A JSON object without its last brace, closed by its SHA-256, where it comes from, and the SHA-256 of all that.

    An edited digit of any number shows; the digest is that of what is stated, whenever it was proved.
    """
    whole = f'{head}, "digest": "{hashlib.sha256(head.encode()).hexdigest()}", "provenance": {origin}'
    return f'{whole}, "checksum": "{hashlib.sha256(whole.encode()).hexdigest()}"}}\n'


def check_certificate(path: Path, progress: Progress | None = None) -> Verified:
    """BadInputError when the file is none or was edited; Rejected names what is not understood or not proved."""
    ctx.prec, where, covers, done = 256, "the statement", {}, 0
    try:
        content, text = read_json(path), path.read_text(encoding="utf-8")
        origin, closing = content["provenance"], ("digest", "provenance", "checksum")
        head = json.dumps({key: value for key, value in content.items() if key not in closing})[:-1]
        edited = content["schema"] != SCHEMA or text != sealed(head, json.dumps(origin))
        written = {key: on_one_line(str(origin[key])) for key in ("version", "command", "date")}
    except (OSError, ValueError, LookupError, AttributeError, TypeError) as error:
        raise BadInputError(f"{path}: is no certificate; `hfa prove schedule -o FILE.json` writes one") from error
    if edited:
        raise BadInputError(f"{path}: refused, the certificate was edited: its digest is that of other content")
    try:
        check_structure(content)
        kind, claim, boxes = content["kind"], content["statement"], content["boxes"]
        low, high = claim["dihedral_deg"]
        for name, own in boxes.items():
            covers[name] = [(*box["dihedral_deg"], box["unstable"]) for box in own]
            runs = sorted([*(list(run[:2]) for run in covers[name]), *content.get("open", {}).get(name, ())])
            ends = [low, *chain(*runs), high]
            if ends != sorted(ends) or not (name in ("least", "most") or (runs and ends[::2] == ends[1::2])):
                raise Rejected("the boxes and what is open do not cover the interval once")
            for box in own:
                where, done = f"{name} from {box['dihedral_deg'][0]} to {box['dihedral_deg'][1]} deg", done + 1
                _check_box(claim, name, box)
                if progress is not None:
                    progress(done, sum(map(len, boxes.values())))
        rate = min((box["rate"] for box in boxes.get("loop", ()) if not box["unstable"]), default=0.0)
    except (NoSolutionError, LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise Rejected(f"{path}: {where} is not proved: {error or type(error).__name__}") from error
    return Verified(kind, claim, covers, rate, written)


def _check_box(claim: Content, name: str, box: Content) -> None:
    """What a list states of one box: its trims, A and B, and the modes of A or of the loop, or a solution."""
    known, ends, table = model_on(claim, box), box["dihedral_deg"], claim.get("table", {})
    for key in {"A", "B"} & box.keys():
        for row, found in zip(box[key], known[key].range().tolist(), strict=True):
            if not all(arb(a) <= value <= arb(b) for (a, b), value in zip(row, found, strict=True)):
                raise Rejected(f"an entry of {key} may lie outside its enclosure")
    if name in ("solution", "value", "refused", "cells"):
        _check_game(claim, name, box, known)
        return
    A, B, motion, rate = known["A"], known["B"], None, box["rate"]
    fits = {"least": rate <= 0, "most": rate >= 0}.get(name, rate >= 0 and rate * box["unstable"] == 0)
    if not (fits and abs(rate) < np.inf):
        raise Rejected("modes right of -rate are not those that are unstable")
    if name in ("loop", "motion"):  # of ζ = (x, memory): ζ' = (A x - B K ζ, 0) + N (A X ζ - B K ζ) + M ζ
        K, M, N, X = (between(table, key, ends) for key in "KMNX")
        x = matrix(np.eye(A.parts[0].nrows(), M.parts[0].nrows()))
        A = x.transpose() * (A * x - B * K) + N * (A * X - B * K) + M
    H = between(claim["lyapunov"], "P", ends) if name == "motion" else TaylorModel(matrix(box["H"]))
    if name == "motion":
        motion = H.parts[1] * (2 * arb(claim["dihedral_rate"]) / (arb(ends[1]) - arb(ends[0])))
    check_modes(A, H, box, motion)


def model_on(claim: Content, box: Content) -> dict[str, TaylorModel]:
    """A, B and the inputs; Rejected unless one trim is proved near the stated polynomial, within the limits."""
    if "A" in claim:
        return {key: TaylorModel(matrix(claim[key])) for key in "AB"}
    rates, jacobians = _functions(claim["dynamics"])
    low, high, degree, reading = *map(arb, box["dihedral_deg"]), arb.pi() / 180, 2.0**-51 if box["decimals"] else 0.0
    at, free, arguments = {}, list(box["trim"]), []
    for name, x in (claim["imposed"] | {name: claim["parameters"][name] for name in Parameters._fields}).items():
        errors = [arb(width * (name == other)) for other, width in claim["spread"].items()]
        at[name] = TaylorModel(arb(x, abs(x) * reading), arb(0), arb(0), arb(0), *errors)
    at["dihedral"] = TaylorModel((low + high) / 2 * degree, (high - low) / 2 * degree)
    for size in (0, 1):  # along the polynomials, and all about them
        for name, (c0, c1, c2, radius, *z) in box["trim"].items():
            at[name] = TaylorModel(*map(arb, (c0, c1, c2)), arb(0, size * radius), *map(arb, z))
        at["pitch"] = at["alpha"] + at["gamma"]
        arguments.append([[at[name] for name in names] for names in (STATES, INPUTS, Parameters._fields)])
    (residual,), (_, A, B) = rates(*arguments[0]), jacobians(*arguments[1])
    columns = {name: (A + B)[len(STATES) * j :][: len(STATES)] for j, name in enumerate(STATES + INPUTS)}
    found = {key: _stacked(columns, names, _LINEAR) for key, names in (("A", LINEAR_STATES), ("B", INPUTS))}
    columns |= {"F": residual, "gamma": columns["pitch"]}
    columns["alpha"] = [a + b for a, b in zip(columns["alpha"], columns["pitch"], strict=True)]
    radii = [arb(box["trim"][name][3]) for name in free]
    check_root(_stacked(columns, ["F"], _BALANCED), _stacked(columns, free, _BALANCED), radii)
    for name in (*INPUTS, *free):
        if not arb(claim["limits"][name][0]) <= at[name].range() <= arb(claim["limits"][name][1]):
            raise Rejected(f"{name} may lie beyond its limits")
    return found | {"inputs": _stacked({"u": [at[name] for name in INPUTS]}, ["u"], range(len(INPUTS)))}


@cache
def _functions(dynamics: str) -> tuple[BallFunction, BallFunction]:
    functions = compiled_dynamics(variant_named(dynamics))
    return BallFunction(functions.rates), BallFunction(functions.jacobians)


def _stacked(columns: dict[str, list[Any]], names: Iterable[str], rows: Sequence[int]) -> TaylorModel:
    """Some rows and columns of scalars as the Taylor model of a matrix."""
    parts = [TaylorModel.of(columns[name][i]).parts for name in names for i in rows]
    together = zip_longest(*parts, fillvalue=arb(0))
    return TaylorModel(*(arb_mat(len(parts) // len(rows), len(rows), part).transpose() for part in together))


def check_root(residual: TaylorModel, derivative: TaylorModel, radii: list[arb]) -> arb_mat:
    """One root of F lies about x̂ at every place: with |e| = |(e_i / r_i)|, |C F| + |I - C F'| < 1 (Krawczyk).

    residual: F along x̂, a column. derivative: F' where |e_i| <= r_i. Returns where about x̂ the root is.
    """
    J, n = derivative.range(), len(radii)
    C = J.mid().inv().mid()
    step, slope = C * residual.range(), matrix(np.eye(n)) - C * J
    contraction = norm(slope[i, j] * radii[j] / radii[i] for i in range(n) for j in range(n))
    if not norm(step[i, 0] / radii[i] for i in range(n)) + contraction < 1:
        raise Rejected("a root of the equations is not proved to exist")
    return arb_mat([[arb(0, 1) * contraction * r - step[i, 0]] for i, r in enumerate(radii)])


def check_modes(A: TaylorModel, H: TaylorModel, box: Content, motion: arb_mat | None = None) -> None:
    """-(A'H + H A + 2 rate H ± motion) > 0, and H has `unstable` negative eigenvalues and no zero one.

    Ostrowski and Schneider: A has as many eigenvalues right of -rate. Tested in the coordinates `turn`.
    """
    turn, ends = matrix(box["turn"]), [H.parts[0] - H.parts[1], H.parts[0] + H.parts[1]]
    if any(end != end.transpose() or _signs(_turned(end, turn)).count(-1) != box["unstable"] for end in ends):
        raise Rejected(f"H is not symmetric with {box['unstable']} negative eigenvalues")
    half = -(H * (A + matrix(box["rate"] * np.eye(turn.nrows()))))
    moves = [0 * turn] if motion is None else [_turned(motion, turn), _turned(-motion, turn)]
    for corner in (half + half.transpose()).map(lambda part: _turned(part, turn)).corners():
        if any(-1 in _signs(corner + each) for each in moves):
            raise Rejected("the matrix that proves the modes is not positive definite")


def _turned(part: arb_mat, turn: arb_mat) -> arb_mat:
    return turn.transpose() * part * turn


def _signs(symmetric: arb_mat) -> list[int]:
    """Of the eigenvalues (Sylvester)."""
    found = pivots(symmetric)
    if found is None:
        raise Rejected("an eigenvalue is not told from 0")
    return [1 if pivot > 0 else -1 for pivot in found]


def between(table: Content, key: str, box: list[float]) -> TaylorModel:
    """A table of matrices, linear between its angles, on a box between two of them; without angles it is constant."""
    if "dihedral_deg" not in table:
        return TaylorModel(matrix(table[key]))
    angles = table["dihedral_deg"]
    i = next((i for i, (a, b) in enumerate(pairwise(angles)) if a <= box[0] and box[1] <= b), None)
    if i is None:
        raise Rejected("the box crosses an angle of the table")
    first, last, low, high = matrix(table[key][i]), matrix(table[key][i + 1]), arb(angles[i]), arb(angles[i + 1])
    ends = [first + (last - first) * ((arb(end) - low) / (high - low)) for end in box]
    return TaylorModel((ends[0] + ends[1]) * 0.5, (ends[1] - ends[0]) * 0.5)


def _check_game(claim: Content, name: str, box: Content, known: dict[str, TaylorModel]) -> None:
    """The exact solution is as far from what is given as stated; or exists, or does not, at a bound of delta_min."""
    if name in ("value", "refused"):
        game = claim["game"] | {"delta": claim["delta_min"][name == "value"]}
        if "axis" in box and name == "refused":
            _check_axis(game, known, box["axis"])
        else:
            _solution(game, known, box, 1 if name == "value" else -1)
        return
    found = distances(claim, box, known)
    for key, (least, most) in claim["distances"].items():
        if not (found[key][1] <= arb(most) and (least == 0.0 or found[key][0] >= arb(least))):
            raise Rejected(f"the distance of {key} may be another one")


def distances(claim: Content, box: Content, known: dict[str, TaylorModel]) -> dict[str, tuple[arb, arb]]:
    """Bounds of |X - X̂| / |X|; of the inputs they are of |U - Û| in their own units.

    X̂: what the table gives, linear between its angles. A norm is convex: it is largest at a corner.
    """
    known, found, table = known | _solution(claim["game"], known, box, 1), {}, claim["table"]
    if "W" in table:  # P_ii, 2 P_ij row by row, then zeros
        P, size = known["P"].range(), len(table["W"])
        weights = [P[i, j] * (2 - (i == j)) for i in range(P.nrows()) for j in range(i, P.nrows())]
        known["W"] = TaylorModel(arb_mat(size, 1, weights + [0] * (size - len(weights))))
    for key in known.keys() & table.keys():
        away, whole = known[key] - between(table, key, box["dihedral_deg"]), norm(known[key].range().entries())
        if key == "inputs":
            away, whole = matrix(np.diag(1 / np.array(INPUT_SCALES))) * away, arb(1)
        most = reduce(arb.max, (norm(corner.entries()) for corner in away.corners()))
        found[key] = (norm(away.range().entries()) / whole).lower(), (most / whole).upper()
    return found


def _solution(game: Content, known: dict[str, TaylorModel], box: Content, sign: int) -> dict[str, TaylorModel]:
    """P and K: one root of the Riccati equation near the stated polynomial, in the units of the box.

    A - S P is Hurwitz, and the lowest eigenvalue of P has the sign.
    """
    units, n = matrix(np.diag(box["units"])), len(box["units"])
    S, gain = _weights(game, known["B"])
    A, S, Q = units.inv() * known["A"] * units, units.inv() * S * units.inv(), units * matrix(game["Q"]) * units
    P, still, radii = TaylorModel(*map(matrix, box["P"])), matrix(np.zeros((n, n))), [arb(box["reach"])] * n**2
    near = TaylorModel(still, still, still, arb_mat(n, n, [arb(0, r) for r in radii]))
    loop, places = (A - S * (P + near)).range(), [divmod(place, n) for place in range(n * n)]
    L = arb_mat([[loop[k, i] * (j == m) + loop[m, j] * (i == k) for k, m in places] for i, j in places])
    F = ((A - S * P).transpose() * P + P * A + Q).map(lambda part: arb_mat(n * n, 1, part.entries()))
    P += TaylorModel(still, still, still, arb_mat(n, n, check_root(F, TaylorModel(L), radii).entries()))
    check_modes(A - S * P, TaylorModel(matrix(box["H"])), box | {"unstable": 0, "rate": 0.0})
    turn = matrix(np.linalg.eigh(np.array(P.parts[0].tolist()).astype(float))[1])
    if min(_signs(_turned(P.range(), turn))) != sign:
        raise Rejected("the lowest eigenvalue of the solution has another sign")
    P = units.inv() * P * units.inv()
    return {"P": P, "K": gain * P}


def _weights(game: Content, B: TaylorModel) -> tuple[TaylorModel, TaylorModel]:
    """S = B R⁻¹ B' - E E' / delta² of the Riccati equation A'P + P A + Q - P S P = 0, and R⁻¹ B'; K = R⁻¹ B' P."""
    E, R = matrix(game["E"]), matrix(game["R"])
    if -1 in _signs(R):
        raise Rejected("R is not positive definite")
    gain = R.inv() * B.transpose()
    return B * gain - E * E.transpose() * (1 / arb(game["delta"]) ** 2), gain


def _check_axis(game: Content, known: dict[str, TaylorModel], frequencies: list[float]) -> None:
    """det(j ω I - H), H = [[A, -S], [-Q, -A']], is real; where it changes its sign H has an eigenvalue j ω."""
    A, S, Q = known["A"].range(), _weights(game, known["B"])[0].range(), matrix(game["Q"])
    rows = [[*a, *s] for a, s in zip(A.tolist(), (-S).tolist(), strict=True)]
    rows += [[*q, *a] for q, a in zip((-Q).tolist(), (-A.transpose()).tolist(), strict=True)]
    H, one = acb_mat(rows), acb_mat(matrix(np.eye(len(rows))))
    values = [(H - one * acb(0, arb(each))).det().real for each in frequencies]
    if not (any(value > 0 for value in values) and any(value < 0 for value in values)):
        raise Rejected("no eigenvalue is proved to lie on the axis")
