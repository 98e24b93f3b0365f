"""The checker's part about games: their solutions, and how far something is from them."""

from __future__ import annotations

from functools import reduce

import numpy as np
from flint import acb, acb_mat, arb, arb_mat

from hfa_model.vectors import INPUT_SCALES
from verification.checker.checked_model import (
    Content,
    between,
    check_modes,
    check_root,
    constant,
    exact,
    model_on,
    norm,
    signs,
)
from verification.checker.taylor_model import Rejected, TaylorModel


def check_game(claim: Content, name: str, box: Content) -> None:
    """The exact solution is as far from what is given as stated; or exists, or does not, at a bound of delta_min."""
    game = dict(claim["game"])
    if name in ("value", "refused"):
        game["delta"] = claim["delta_min"][name == "value"]
        known = model_on(claim, box)
        if name == "refused" and "axis" in box:
            _check_axis(game, known, box["axis"])
        else:
            _solution(game, known["A"], known["B"], box, 1 if name == "value" else -1)
        return
    found = distances(claim, box)
    for key, (least, most) in claim["distances"].items():
        if not (found[key][1] <= arb(most) and (least == 0.0 or found[key][0] >= arb(least))):
            raise Rejected(f"the distance of {key} may be another one")


def distances(claim: Content, box: Content) -> dict[str, tuple[arb, arb]]:
    """Bounds of |X - X̂| / |X|; of the inputs they are of |U - Û| in their own units.

    X̂: what the table gives, linear between its angles. A norm is convex: it is largest at a corner.
    """
    known, found, table = model_on(claim, box), {}, claim["table"]
    known |= _solution(claim["game"], known["A"], known["B"], box, 1)
    if "W" in table:  # P_ii, 2 P_ij row by row, then zeros
        P, size = known["P"].range(), len(table["W"])
        weights = [P[i, j] * (2 - (i == j)) for i in range(P.nrows()) for j in range(i, P.nrows())]
        known["W"] = TaylorModel(arb_mat(size, 1, weights + [0] * (size - len(weights))))
    for key in known.keys() & table.keys():
        away, whole = known[key] - between(table, key, box["dihedral_deg"]), norm(known[key].range())
        if key == "inputs":
            away, whole = constant(np.diag(1 / np.array(INPUT_SCALES))) * away, arb(1)
        most = reduce(arb.max, map(norm, away.corners()))
        found[key] = (norm(away.range()) / whole).lower(), (most / whole).upper()
    return found


def _solution(game: Content, A: TaylorModel, B: TaylorModel, box: Content, sign: int) -> dict[str, TaylorModel]:
    """P and K: one root of the Riccati equation near the stated polynomial, in the units of the box.

    A - S P is Hurwitz, and the lowest eigenvalue of P has the sign.
    """
    units, n = np.array(box["units"]), len(box["units"])
    up, down = constant(np.diag(units)), TaylorModel(exact(np.diag(units)).inv())
    S, gain = _weights(game, B)
    a, S, Q = down * A * up, down * S * down, up * constant(game["Q"]) * up
    P, still, radii = TaylorModel(*map(exact, box["P"])), exact(np.zeros((n, n))), [arb(box["reach"])] * n**2
    near = TaylorModel(still, still, still, arb_mat(n, n, [arb(0, r) for r in radii]))
    loop, places = (a - S * (P + near)).range(), [divmod(place, n) for place in range(n * n)]
    L = arb_mat([[loop[k, i] * (j == m) + loop[m, j] * (i == k) for k, m in places] for i, j in places])
    F = ((a - S * P).transpose() * P + P * a + Q).map(lambda part: arb_mat(n * n, 1, part.entries()))
    P += TaylorModel(still, still, still, arb_mat(n, n, check_root(F, TaylorModel(L), radii).entries()))
    check_modes(a - S * P, box | {"unstable": 0}, constant(box["H"]), still)
    turn = exact(np.linalg.eigh(np.array(P.parts[0].tolist()).astype(float))[1])
    if min(signs(turn.transpose() * P.range() * turn)) != sign:
        raise Rejected("the lowest eigenvalue of the solution has another sign")
    P = down * P * down
    return {"P": P, "K": gain * P}


def _weights(game: Content, B: TaylorModel) -> tuple[TaylorModel, TaylorModel]:
    """S = B R⁻¹ B' - E E' / delta² of the Riccati equation A'P + P A + Q - P S P = 0, and R⁻¹ B'; K = R⁻¹ B' P."""
    E, gain = constant(game["E"]), TaylorModel(exact(game["R"]).inv()) * B.transpose()
    return B * gain - (E * E.transpose()).map(lambda part: part * (1 / arb(game["delta"]) ** 2)), gain


def _check_axis(game: Content, known: dict[str, TaylorModel], frequencies: list[float]) -> None:
    """det(j ω I - H), H = [[A, -S], [-Q, -A']], is real; where it changes its sign H has an eigenvalue j ω."""
    A, S, Q = (each.range() for each in (known["A"], _weights(game, known["B"])[0], constant(game["Q"])))
    rows = [[*a, *s] for a, s in zip(A.tolist(), (-S).tolist(), strict=True)]
    rows += [[*q, *a] for q, a in zip((-Q).tolist(), (-A.transpose()).tolist(), strict=True)]
    values = [
        (acb_mat(rows) - acb_mat(exact(np.eye(len(rows)))) * acb(0, arb(each))).det().real for each in frequencies
    ]
    if not (any(value > 0 for value in values) and any(value < 0 for value in values)):
        raise Rejected("no eigenvalue is proved to lie on the axis")
