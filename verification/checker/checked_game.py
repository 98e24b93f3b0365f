"""The checker's part about games: their solutions, and how far something is from them."""

from __future__ import annotations

import numpy as np
from flint import acb, acb_mat, arb, arb_mat

from hfa_model.vectors import INPUT_SCALES
from verification.checker.checked_model import (
    Content,
    check_modes,
    constant,
    doubles,
    exact,
    linear,
    model_on,
    signs_of,
    unit,
)
from verification.checker.taylor_model import Rejected, TaylorModel


def check_game(claim: Content, name: str, box: Content) -> None:
    """Distances of what is given from the exact solution; modes of A and the loop; a value, and none, at two deltas."""
    A, B, _ = model_on(claim, box)
    given, game = {key: constant(value) for key, value in claim["given"].items()}, dict(claim["game"])
    if "K" not in given:
        given["K"] = _gain(game, B, given["P"])
    if name in ("loop", "modes"):
        check_modes(A - B * given["K"] if name == "loop" else A, box, box["unstable"], constant(box["H"]))
        return
    if name != "solution":
        game["delta"] = claim["delta_min"][name == "value"]
    if name == "refused" and "axis" in box:
        _check_axis([each.range() for each in _quadratic(game, A, B)], box["axis"])
        return
    true = _solution(game, A, B, box, 1 if name != "refused" else -1)
    for key, (least, most) in claim["distances"].items() if name == "solution" else ():
        if key == "W":  # P_ii, 2 P_ij row by row, then zeros
            P = true["P"].range()
            rows = [[P[i, j] * (2 - (i == j))] for i in range(P.nrows()) for j in range(i, P.nrows())]
            true[key] = TaylorModel(arb_mat(rows + [[0]] * (len(claim["given"]["W"]) - len(rows))))
        ratio = _norm(given[key] - true[key]) / _norm(true[key])
        if not (ratio <= arb(most) and (least == 0.0 or ratio >= arb(least))):
            raise Rejected(f"the distance of {key} may be another one")


def check_interpolation(claim: Content, _: str, box: Content) -> None:
    """|F - F̂| <= error |F| on a cell between two nodes, F̂ linear between them; of the inputs in their own units."""
    A, B, inputs = model_on(claim, box)
    K = _solution(claim["game"], A, B, box, 1)["K"]
    for key, value in {"A": A, "B": B, "inputs": inputs, "K": K}.items():
        difference = value - linear(claim["nodes"], key, box["dihedral_deg"])
        size = _norm(value)
        if key == "inputs":
            difference, size = constant(np.diag(1 / np.array(INPUT_SCALES))) * difference, arb(1)
        if not _norm(difference) <= arb(claim["error"][key]) * size:
            raise Rejected(f"the interpolation error of {key} may be larger")


def _solution(game: Content, A: TaylorModel, B: TaylorModel, box: Content, sign: int) -> dict[str, TaylorModel]:
    """P and K; E = -C F(P̂) + (I - C L) E + C (E S E) maps |E| <= reach into itself and contracts there.

    L(E) = A_c'E + E A_c, A_c = A - S P̂, C about the inverse of L, in the units of the box. A - S P is Hurwitz. The
    lowest eigenvalue of P has the sign.
    """
    units, n = np.array(box["units"]), len(box["units"])
    up, down = constant(np.diag(units)), constant(np.diag(1 / units))
    a, S, Q = _quadratic(game, A, B)
    a, S, Q = down * a * up, down * S * down, up * Q * up
    P = TaylorModel(*map(exact, box["P"]))
    residual = a.transpose() * P + P * a + Q - P * S * P
    loop, one, places = (a - S * P).range(), unit(n), [divmod(place, n) for place in range(n * n)]
    L = arb_mat([[loop[k, i] * one[j, m] + one[i, k] * loop[m, j] for k, m in places] for i, j in places])
    reach = arb(box["reach"])
    C = L.mid().inv().mid()
    newton = C * arb_mat(n * n, 1, residual.range().entries())
    slope, bend = _norm(TaylorModel(unit(n * n) - C * L)), _norm(TaylorModel(C)) * _norm(S)
    rest = slope * reach + bend * reach**2
    if not (_norm(TaylorModel(newton)) + rest < reach and slope + 2 * bend * reach < 1):
        raise Rejected("the solution is not proved to exist")
    near = arb_mat(n, n, [rest * arb(0, 1) - step for step in newton.entries()])
    P = P + TaylorModel(0 * near, 0 * near, 0 * near, near)
    check_modes(a - S * P, box, 0, constant(box["H"]))
    turn = exact(np.linalg.eigh(doubles(P.parts[0]))[1])
    if min(signs_of(turn.transpose() * P.range() * turn)) != sign:
        raise Rejected("the lowest eigenvalue of the solution has another sign")
    P = down * P * down
    return {"P": P, "K": _gain(game, B, P)}


def _quadratic(game: Content, A: TaylorModel, B: TaylorModel) -> tuple[TaylorModel, TaylorModel, TaylorModel]:
    """A, S = B R⁻¹ B' - E E' / delta², Q of the Riccati equation A'P + P A + Q - P S P = 0."""
    E = constant(game["E"]).map(lambda part: part * (1 / arb(game["delta"])))
    return A, B * _gain(game, B, constant(np.eye(len(game["Q"])))) - E * E.transpose(), constant(game["Q"])


def _gain(game: Content, B: TaylorModel, P: TaylorModel) -> TaylorModel:
    """K = R⁻¹ B' P."""
    return TaylorModel(exact(game["R"]).inv()) * B.transpose() * P


def _check_axis(riccati: list[arb_mat], frequencies: list[float]) -> None:
    """det(j ω I - H), H = [[A, -S], [-Q, -A']], is real; where it changes its sign H has an eigenvalue j ω."""
    A, S, Q = riccati
    rows = [[*a, *s] for a, s in zip(A.tolist(), (-S).tolist(), strict=True)]
    rows += [[*q, *a] for q, a in zip((-Q).tolist(), (-A.transpose()).tolist(), strict=True)]
    values = [(acb_mat(rows) - acb_mat(unit(len(rows))) * acb(0, arb(each))).det().real for each in frequencies]
    if not (any(value > 0 for value in values) and any(value < 0 for value in values)):
        raise Rejected("no eigenvalue is proved to lie on the axis")


def _norm(matrix: TaylorModel) -> arb:
    """A ball that holds the Frobenius norm."""
    entries = matrix.range().entries()
    low, high = (sum((part(entry) ** 2 for entry in entries), arb(0)) for part in (arb.abs_lower, arb.abs_upper))
    return low.sqrt().union(high.sqrt())
