"""Re-verifies a certificate by other means than it was made with: nobody needs to trust the search
or the prover.

Every quantity is a Taylor model in the place s within a box and the errors t of the parameters. One
test of roots, for the trims and for solutions of the Riccati equation, about the polynomials that
the certificate states; one of modes, H being stated; one of distances. With the prover it shares
the arithmetic alone."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import reduce
from itertools import chain, pairwise, zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from flint import acb, acb_mat, arb, arb_mat, ctx

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, NoSolutionError, on_one_line
from hfa_support.files import read_json
from hfa_support.progress import Progress
from verification.proof.arithmetic.balls import (
    TaylorModel,
    is_positive_definite,
    matrix,
    norm,
    pivots,
)
from verification.proof.arithmetic.steady_flight import steady_flight
from verification.proof.checker.structure import Content, check_structure, model_of

SCHEMA = "hfa.certificate/6"
Run = tuple[float, float, int]


class Rejected(NoSolutionError):
    """A box of the certificate does not prove what it states."""


@dataclass(frozen=True, eq=False, repr=False)
class Statement:
    """A statement, and the boxes that prove it, as `structure.py` declares a certificate of this
    kind.

    kind: schedule, game or lpv. boxes: list -> boxes. model: that it is about; None of a plant of a
    file."""

    kind: str
    statement: Content
    boxes: dict[str, list[Content]]
    model: Model | None

    @property
    def covers(self) -> dict[str, list[Run]]:
        """List of boxes -> low, high and the number of unstable modes of each."""
        return {
            name: [(*box["range"], box["unstable"]) for box in own]
            for name, own in self.boxes.items()
        }

    @property
    def rate(self) -> float:
        """Of decay, proved of the loop where it is Hurwitz, 1/s."""
        return min(
            (box["rate"] for box in self.boxes.get("loop", ()) if not box["unstable"]), default=0.0
        )


@dataclass(frozen=True, eq=False, repr=False)
class Verified(Statement):
    """parted: places from which on the trims are not proved to be those of the boxes before, in one
    branch.

    written: version, command and date in the file, which nothing verifies.
    """

    parted: list[float]
    written: Content


def sealed(head: str, origin: str) -> str:
    """A JSON object without its last brace, closed by its SHA-256, where it comes from, and the
    SHA-256 of all that.

    An edited digit of any number shows; the digest covers the statement and not the date of the
    proof."""
    whole = (
        f'{head}, "digest": "{hashlib.sha256(head.encode()).hexdigest()}", "provenance": {origin}'
    )
    return f'{whole}, "checksum": "{hashlib.sha256(whole.encode()).hexdigest()}"}}\n'


@ctx.workprec(256)
def check_certificate(
    path: Path, progress: Progress | None = None, model: Model | None = None
) -> Verified:
    """What the file proves. model: that of a certificate about a user's own.

    BadInputError when the file is none or was edited; Rejected names entries that are not
    understood or not proved."""
    where, done = "the statement", 0
    try:
        content, text = read_json(path), path.read_text(encoding="utf-8")
        origin, closing = content["provenance"], ("digest", "provenance", "checksum")
        head = json.dumps({key: value for key, value in content.items() if key not in closing})[:-1]
        edited, schema = text != sealed(head, json.dumps(origin)), str(content["schema"])
        written = {key: on_one_line(str(origin[key])) for key in ("version", "command", "date")}
    except (OSError, ValueError, LookupError, AttributeError, TypeError) as error:
        raise BadInputError(
            f"{path}: is no certificate; `hfa prove schedule -o FILE.json` writes one"
        ) from error
    if schema != SCHEMA:
        raise BadInputError(
            f"{path}: is a certificate of another version, {on_one_line(schema)}; prove it again"
        )
    if edited:
        raise BadInputError(
            f"{path}: refused, the certificate was edited: its digest is that of other content"
        )
    try:
        about = None if "A" in content["statement"] else model_of(content["statement"], model)
        check_structure(content, about)
        kind, claim, boxes = content["kind"], content["statement"], content["boxes"]
        (low, high), roots = claim["range"], dict[str, list[Root]]()
        for name, own in boxes.items():
            runs = sorted([*(box["range"] for box in own), *content.get("open", {}).get(name, ())])
            ends = [low, *chain(*runs), high]
            if ends != sorted(ends) or not (
                name in ("least", "most") or (runs and ends[::2] == ends[1::2])
            ):
                raise Rejected("the boxes and what is open do not cover the interval once")
            for box in own:
                where, done = f"{name} from {box['range'][0]} to {box['range'][1]}", done + 1
                known = model_on(claim, box, about)
                _check_box(claim, name, box, known)
                roots.setdefault(name, []).append(Root(box, known.pop("root", None)))
                if progress is not None:
                    progress(done, sum(map(len, boxes.values())))
    except BadInputError as error:  # it is about another model
        raise BadInputError(f"{path}: {error}") from error
    except (
        NoSolutionError,
        LookupError,
        TypeError,
        ValueError,
        AttributeError,
        ArithmeticError,
    ) as error:
        raise Rejected(f"{path}: {where} is not proved: {error or type(error).__name__}") from error
    return Verified(
        kind, claim, boxes, about, _parted(roots) if kind == "schedule" else [], written
    )


class Root(NamedTuple):
    """A box, and where about the polynomials of its trims the one root is, by name."""

    box: Content
    offset: Any


def _parted(roots: dict[str, list[Root]]) -> list[float]:
    """Where a box begins whose trims are not proved to be those of the loop's boxes.

    At a common place the root of one box lies where another box has no other root than its own.
    """

    def place(root: Root, name: str, at: float) -> TaylorModel:
        low, high = map(arb, root.box["range"])
        s, (c0, c1, c2, _, *z) = (
            (2 * arb(at) - low - high) / (high - low),
            map(arb, root.box["trim"][name]),
        )
        return TaylorModel(c0 + c1 * s + c2 * s * s, arb(0), arb(0), arb(0), *z)

    def same(one: Root, two: Root, at: float) -> bool:
        apart = {
            name: (place(one, name, at) - place(two, name, at)).range() + e
            for name, e in one.offset.items()
        }
        return all(
            arb(0, two.box["trim"][name][3]).contains_interior(away) for name, away in apart.items()
        )

    loop = sorted(roots.get("loop", ()), key=lambda root: root.box["range"][0])
    pairs = [(b, a) for a, b in pairwise(loop)]
    for name, own in roots.items():
        for root in own if name != "loop" else ():
            at = root.box["range"][0]
            pairs += [
                (root, other)
                for other in loop
                if other.box["range"][0] <= at < other.box["range"][1]
            ][:1]
    found = set()
    for root, other in pairs:
        at = root.box["range"][0]
        if at > other.box["range"][1] or not (same(root, other, at) or same(other, root, at)):
            found.add(at)
    return sorted(found)


def _check_box(claim: Content, name: str, box: Content, known: dict[str, TaylorModel]) -> None:
    """What a list states of one box: its trims, A and B, and the modes of A or of the loop, or a
    solution."""
    ends, table = box["range"], claim.get("table", {})
    for key in {"A", "B"} & box.keys():
        for row, found in zip(box[key], known[key].range().tolist(), strict=True):
            if not all(arb(a) <= value <= arb(b) for (a, b), value in zip(row, found, strict=True)):
                raise Rejected(f"an entry of {key} may lie outside its enclosure")
    if name in ("solution", "value", "refused", "cells"):
        _check_game(claim, name, box, known)
        return
    A, B, motion, rate = known["A"], known["B"], None, box["rate"]
    fits = {"least": rate <= 0, "most": rate >= 0}.get(
        name, rate >= 0 and rate * box["unstable"] == 0
    )
    if not (fits and abs(rate) < np.inf):
        raise Rejected("modes right of -rate are not those that are unstable")
    if name == "loop" and "M" not in table:
        A -= B * between(table, "K", ends)
    elif name in (
        "loop",
        "motion",
    ):  # of ζ = (x, memory): ζ' = (A x - B K ζ, 0) + N (A X ζ - B K ζ) + M ζ
        K, M, N, X = (between(table, key, ends) for key in "KMNX")
        x = matrix(np.eye(A.parts[0].nrows(), M.parts[0].nrows()))
        A = x.transpose() * (A * x - B * K) + N * (A * X - B * K) + M
    if "pieces" in box:
        _check_pieces(claim["actuators"], A, ends, table["places"], box["pieces"])
        return
    H = between(claim["lyapunov"], "P", ends) if name == "motion" else TaylorModel(matrix(box["H"]))
    if name == "motion":
        motion = H.parts[1] * (2 * arb(claim["place_rate"]) / (arb(ends[1]) - arb(ends[0])))
    check_modes(A, H, box, motion)


def model_on(claim: Content, box: Content, model: Model | None) -> dict[str, Any]:
    """A, B, the inputs, and where about the stated polynomial the trim is; Rejected unless one is
    proved to be there, within the limits."""
    if model is None:
        return {key: TaylorModel(matrix(claim[key])) for key in "AB"}
    low, high, reading = *map(arb, box["range"]), 2.0**-51 if box["decimals"] else 0.0
    flight = steady_flight(model, claim["imposed"])
    free, degree, at = (
        flight.free,
        arb.pi() / 180 if claim["unit"] == "deg" else arb(1),
        dict[str, Any](),
    )
    for name, x in (claim["imposed"] | claim["parameters"]).items():
        errors = [arb(width * (name == other)) for other, width in claim["spread"].items()]
        known = arb(x, abs(x) * reading)
        at[name] = TaylorModel(known, arb(0), arb(0), arb(0), *errors) if errors else known
    at[model.schedule] = TaylorModel((low + high) / 2 * degree, (high - low) / 2 * degree)
    near = at | {
        name: TaylorModel(*map(arb, (c0, c1, c2, 0, *z)))
        for name, (c0, c1, c2, _, *z) in box["trim"].items()
    }
    for name, (c0, c1, c2, radius, *z) in box["trim"].items():  # all about the polynomials
        at[name] = TaylorModel(*map(arb, (c0, c1, c2)), arb(0, radius), *map(arb, z))
    residual, (values, slopes, A, B) = flight.left(near), flight.linear(at)
    moved = [i for i, row in enumerate(slopes) if not _nothing([*row, residual[i]])]
    if len(moved) != len(free):
        raise Rejected("there are not as many equations as unknowns")
    radii = [arb(box["trim"][name][3]) for name in free]
    root = check_root(
        _stacked([[residual[i]] for i in moved]), _stacked([slopes[i] for i in moved]), radii
    )
    found = dict(zip(flight.names, (value for (value,) in values), strict=True)) | at
    for name, (least, most) in claim["limits"].items():
        if not arb(least) <= TaylorModel.of(found[name]).range() <= arb(most):
            raise Rejected(f"{name} may lie beyond its limits")
    parts = {"A": A, "B": B, "inputs": [[found[name]] for name in model.inputs]}
    roots = dict(zip(free, root.entries(), strict=True))
    return {key: _stacked(each) for key, each in parts.items()} | {"root": roots}


def _nothing(values: list[Any]) -> bool:
    """Exactly 0, all of them."""
    return all(part == 0 for value in values for part in TaylorModel.of(value).parts)


def _stacked(rows: list[list[Any]]) -> TaylorModel:
    """Rows of scalars as the Taylor model of a matrix."""
    parts = [TaylorModel.of(entry).parts for row in rows for entry in row]
    together = zip_longest(*parts, fillvalue=arb(0))
    return TaylorModel(*(arb_mat(len(rows), len(rows[0]), list(part)) for part in together))


def check_root(residual: TaylorModel, derivative: TaylorModel, radii: list[arb]) -> arb_mat:
    """One root of F lies about x̂ at every place: with |e| = |(e_i / r_i)|, |C F| + |I - C F'| < 1
    (Krawczyk).

    residual: F along x̂, a column. derivative: F' where |e_i| <= r_i. Returns where about x̂ the
    root is."""
    J, n = derivative.range(), len(radii)
    C = J.mid().inv().mid()
    step, slope = C * residual.range(), matrix(np.eye(n)) - C * J
    contraction = norm(slope[i, j] * radii[j] / radii[i] for i in range(n) for j in range(n))
    if not norm(step[i, 0] / radii[i] for i in range(n)) + contraction < 1:
        raise Rejected("a root of the equations is not proved to exist")
    return arb_mat([[arb(0, 1) * contraction * r - step[i, 0]] for i, r in enumerate(radii)])


def check_modes(
    A: TaylorModel, H: TaylorModel, box: Content, motion: arb_mat | None = None
) -> None:
    """-(A'H + H A + 2 rate H ± motion) > 0, and H has `unstable` negative eigenvalues and no zero
    one.

    Ostrowski and Schneider: A has as many eigenvalues right of -rate. Tested in the coordinates
    `turn`."""
    turn, ends = matrix(box["turn"]), [H.parts[0] - H.parts[1], H.parts[0] + H.parts[1]]
    if any(
        end != end.transpose() or _signs(_turned(end, turn)).count(-1) != box["unstable"]
        for end in ends
    ):
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


def _check_pieces(
    actuators: Content, A: TaylorModel, ends: list[float], places: list[float], pieces: Any
) -> None:
    """ζ' = A ζ + ω (own ζ + G v), v_i = λ_i(t) u_i(t - τ_i(t)), u = U ζ, is stable for each
    constant ω of the interval, all λ within theirs and delays up to the one stated.

    V' = 2 ζ'H ζ' < X_1 (d² - q²) + X_2 (e² - z²), summed over the commands, for ζ, d, e that are
    not all 0: in v = λ_0 (u + d) + e, λ_0 the middle and r the half width of the effectiveness, |e|
    <= |z|, z = r (u + d); and d = u(t - τ) - u is minus an integral of u' = q / τ, so that the
    integral of d² is at most that of q². What is required is convex in ω: the ends of a piece
    decide."""
    runs = [
        actuators["bandwidth"][0],
        *chain(*(piece["bandwidth"] for piece in pieces)),
        actuators["bandwidth"][1],
    ]
    if runs != sorted(runs) or runs[::2] != runs[1::2]:
        raise Rejected("the pieces do not cover the bandwidths once")
    G, own, U = (
        matrix(actuators["G"]),
        matrix(actuators["own"]),
        between(actuators | {"places": places}, "U", ends),
    )
    (n, a), (least, most), delay = (
        (G.nrows(), G.ncols()),
        map(arb, actuators["effectiveness"]),
        arb(actuators["delay"]),
    )
    zeta, d, e = (
        matrix(np.eye(n + 2 * a)[rows]) for rows in (slice(n), slice(n, n + a), slice(n + a, None))
    )
    heard, later = U * zeta + d, zeta.transpose()
    z, v = heard * ((most - least) / 2), heard * ((least + most) / 2) + e
    for piece in pieces:
        H, turn, (X_1, X_2) = (
            matrix(piece["H"]),
            matrix(piece["turn"]),
            np.split(np.array(piece["X"]), 2),
        )
        if min(piece["X"]) < 0.0 or H.transpose() != H or not is_positive_definite(H):
            raise Rejected("a Lyapunov function or a multiplier is not positive")
        for bandwidth in map(arb, piece["bandwidth"]):
            rates = A * zeta + (own * zeta + G * v) * bandwidth
            q, growth = U * rates * delay, later * H * rates
            form = -growth - growth.transpose()
            for weights, one, other in ((X_1, d, q), (X_2, e, z)):
                X = matrix(np.diag(weights))
                form += one.transpose() * X * one - other.transpose() * (X * other)
            if not all(
                is_positive_definite(corner)
                for corner in (turn.transpose() * form * turn).corners()
            ):
                raise Rejected("a Lyapunov function is not proved to decrease")


def between(table: Content, key: str, box: list[float]) -> TaylorModel:
    """A table of matrices, linear between its places, on a box between two of them; without places
    it is constant."""
    if "places" not in table:
        return TaylorModel(matrix(table[key]))
    places = table["places"]
    i = next((i for i, (a, b) in enumerate(pairwise(places)) if a <= box[0] and box[1] <= b), None)
    if i is None:
        raise Rejected("the box crosses a place of the table")
    first, last, low, high = (
        matrix(table[key][i]),
        matrix(table[key][i + 1]),
        arb(places[i]),
        arb(places[i + 1]),
    )
    ends = [first + (last - first) * ((arb(end) - low) / (high - low)) for end in box]
    return TaylorModel((ends[0] + ends[1]) * 0.5, (ends[1] - ends[0]) * 0.5)


def _check_game(claim: Content, name: str, box: Content, known: dict[str, TaylorModel]) -> None:
    """The exact solution is as far from the given one as stated; or exists, or does not, at a bound
    of delta_min."""
    if name in ("value", "refused"):
        game = claim["game"] | {"delta": claim["delta_min"][name == "value"]}
        if "axis" in box and name == "refused":
            _check_axis(game, known, box["axis"])
        else:
            solution_on(game, known, box, 1 if name == "value" else -1)
        return
    found = distances(claim, box, known | solution_on(claim["game"], known, box, 1))
    for key, (least, most) in claim["distances"].items():
        if not (found[key][1] <= arb(most) and (least == 0.0 or found[key][0] >= arb(least))):
            raise Rejected(f"the distance of {key} may be another one")


def distances(
    claim: Content, box: Content, known: dict[str, TaylorModel]
) -> dict[str, tuple[arb, arb]]:
    """Bounds of |X - X̂| / |X|; of the inputs they are of |U - Û| in their own units.

    known: A, B, the inputs, P and K. X̂: what the table gives, linear between its places. A norm is
    convex: it is largest at a corner."""
    known, found, table = dict(known), {}, claim["table"]
    if "W" in table:  # P_ii, 2 P_ij row by row, then zeros
        P, size = known["P"].range(), len(table["W"])
        weights = [P[i, j] * (2 - (i == j)) for i in range(P.nrows()) for j in range(i, P.nrows())]
        known["W"] = TaylorModel(arb_mat(size, 1, weights + [0] * (size - len(weights))))
    for key in known.keys() & table.keys():
        away, whole = (
            known[key] - between(table, key, box["range"]),
            norm(known[key].range().entries()),
        )
        if key == "inputs":
            away, whole = matrix(np.diag(1 / np.array(claim["input_scales"]))) * away, arb(1)
        most = reduce(arb.max, (norm(corner.entries()) for corner in away.corners()))
        found[key] = (norm(away.range().entries()) / whole).lower(), (most / whole).upper()
    return found


def solution_on(
    game: Content, known: dict[str, TaylorModel], box: Content, sign: int
) -> dict[str, TaylorModel]:
    """P and K: one root of the Riccati equation near the stated polynomial, in the units of the
    box.

    A - S P is Hurwitz, and the lowest eigenvalue of P has the sign.
    """
    units, n = matrix(np.diag(box["units"])), len(box["units"])
    S, gain = _weights(game, known["B"])
    A, S, Q = (
        units.inv() * known["A"] * units,
        units.inv() * S * units.inv(),
        units * matrix(game["Q"]) * units,
    )
    P, still, radii = (
        TaylorModel(*map(matrix, box["P"])),
        matrix(np.zeros((n, n))),
        [arb(box["reach"])] * n**2,
    )
    near = TaylorModel(still, still, still, arb_mat(n, n, [arb(0, r) for r in radii]))
    loop, places = (A - S * (P + near)).range(), [divmod(place, n) for place in range(n * n)]
    L = arb_mat(
        [[loop[k, i] * (j == m) + loop[m, j] * (i == k) for k, m in places] for i, j in places]
    )
    F = ((A - S * P).transpose() * P + P * A + Q).map(
        lambda part: arb_mat(n * n, 1, part.entries())
    )
    P += TaylorModel(
        still, still, still, arb_mat(n, n, check_root(F, TaylorModel(L), radii).entries())
    )
    check_modes(A - S * P, TaylorModel(matrix(box["H"])), box | {"unstable": 0, "rate": 0.0})
    turn = matrix(np.linalg.eigh(np.array(P.parts[0].tolist()).astype(float))[1])
    if min(_signs(_turned(P.range(), turn))) != sign:
        raise Rejected("the lowest eigenvalue of the solution has another sign")
    P = units.inv() * P * units.inv()
    return {"P": P, "K": gain * P}


def _weights(game: Content, B: TaylorModel) -> tuple[TaylorModel, TaylorModel]:
    """S = B R⁻¹ B' - E E' / delta² of the Riccati equation A'P + P A + Q - P S P = 0, and R⁻¹ B'; K
    = R⁻¹ B' P."""
    E, R = matrix(game["E"]), matrix(game["R"])
    if -1 in _signs(R):
        raise Rejected("R is not positive definite")
    gain = R.inv() * B.transpose()
    return B * gain - E * E.transpose() * (1 / arb(game["delta"]) ** 2), gain


def _check_axis(game: Content, known: dict[str, TaylorModel], frequencies: list[float]) -> None:
    """det(j ω I - H), H = [[A, -S], [-Q, -A']], is real; where it changes its sign H has an
    eigenvalue j ω."""
    A, S, Q = known["A"].range(), _weights(game, known["B"])[0].range(), matrix(game["Q"])
    rows = [[*a, *s] for a, s in zip(A.tolist(), (-S).tolist(), strict=True)]
    rows += [[*q, *a] for q, a in zip((-Q).tolist(), (-A.transpose()).tolist(), strict=True)]
    H, one = acb_mat(rows), acb_mat(matrix(np.eye(len(rows))))
    values = [(H - one * acb(0, arb(each))).det().real for each in frequencies]
    if not (any(value > 0 for value in values) and any(value < 0 for value in values)):
        raise Rejected("no eigenvalue is proved to lie on the axis")
