"""The coarsest grid of places between which the linear model is interpolated with a proved bound of
the error.

What is searched for here, in doubles, is proved by `verification/proof/checker` alone: trims, A, B
and K on every cell, and how far they are from the chord of two nodes."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from flint import arb_mat

from controller.game.zero_sum import Game
from controller.hfa_game import usual_game
from controller.riccati.balancing import balanced_units
from controller.riccati.derivations import schur_solution
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.jsonable import jsonable
from hfa_support.progress import Progress, told
from verification.proof.arithmetic.ball_function import Undecided
from verification.proof.arithmetic.balls import TaylorModel, doubles, matrix, norm
from verification.proof.checker.checker import Rejected, distances, model_on, solution_on
from verification.proof.enclosures.matrix_balls import BallGame, counted, lyapunov_operator
from verification.proof.enclosures.trim_branch import (
    Family,
    ModelForms,
    PlaceBox,
    TrimBranch,
    bisected,
)
from verification.proof.search.certificate import Content, Proof, flights_claim, proved_box
from verification.proof.search.proof_report import place_data

SCHEMA = "hfa.lpv/1"
#: How much wider than what Newton's step shows the solution of the game is sought.
_REACH = 4.0
#: Cells, in steps of the family: every node of a grid is an end of one.
_CELL = 2.0**-4
#: Narrower cells are not tried.
_NARROWEST = 2.0**-8
#: Part of the tolerance that a cell may use up with nodes at its own ends.
_LOOSE = 0.5
#: What the error is stated larger than it is found, relative.
_ROUNDING = 1e-9
#: P is found in doubles at the zeros of Chebyshev's polynomial of third order, 0 and this on either
#: side.
_ZERO = 0.75**0.5
_PARTS = ("A", "B", "inputs", "K")


class _Cell(NamedTuple):
    """What is proved on a part of the interval: A, B, K and the inputs as Taylor models."""

    entry: Content
    known: dict[str, TaylorModel]


def coarsest_grid(
    family: Family, low: float, high: float, tolerance: float, *, progress: Progress | None = None
) -> Proof:
    """A, B, the trimmed inputs and the usual game's K at as few nodes as the bound allows: from
    `low` on, every step is the longest that is proved to keep every error, at every place between
    two nodes, below the tolerance.

    data: dihedral_deg or scheduled, the nodes, (G,); A (G, n, n), B, inputs_offset (G, m), K (G, m,
    n) there; error: the bounds of |A - Â| / |A|, |B - B̂| / |B|, |K - K̂| / |K| (Frobenius) and of
    |U0 - Û0| in nominal units (Euclidean). Nodes are ends of cells of 1/16 of a step, or less.
    NoSolutionError when no step is fine enough."""
    if not low < high:
        raise BadInputError(f"the interval goes from {low:g} to {high:g}; give the lower end first")
    branch, model, cells = TrimBranch(family), family.model, list[_Cell]()
    narrowest = _NARROWEST * family.step
    game = usual_game(model, *map(doubles, branch.model_at(low)))
    weights = {name: getattr(game, name) for name in "QRE"} | {
        "delta": game.delta if game.delta < np.inf else "inf"
    }
    claim = jsonable(
        flights_claim(family, low, high) | {"game": weights, "distances": dict.fromkeys(_PARTS)}
    )

    def bound(first: int, last: int) -> dict[str, float]:
        """The largest error on these cells when their outer ends are nodes."""
        table = tables([first, last])
        found = [
            distances(claim | {"table": table}, each.entry, each.known)
            for each in cells[first:last]
        ]
        return {
            name: max(float(each[name][1]) for each in found) * (1.0 + _ROUNDING) for name in _PARTS
        }

    def tables(nodes: list[int]) -> Content:
        """Places and matrices where these cells begin, and at the end of the last one."""
        at = [(cells[k], -1.0) if k < len(cells) else (cells[-1], 1.0) for k in nodes]
        parts = {name: [(cell.known[name].parts, s) for cell, s in at] for name in _PARTS}
        found = {
            name: [doubles(c0 + s * c1 + c2) for (c0, c1, c2, *_), s in own]
            for name, own in parts.items()
        }
        return {"places": [cell.entry["range"][int(s > 0.0)] for cell, s in at], **found}

    def proved(box: PlaceBox) -> _Cell | None:
        forms = branch.forms(box)
        entry = jsonable(proved_box(forms, family, **_game_on(forms, game)))
        try:
            known = model_on(claim, entry, model)
            cell = _Cell(entry, known | solution_on(claim["game"], known, entry, 1))
        except Rejected:
            return None
        cells.append(cell)  # to see what is left when its own ends are nodes
        sharp = (
            box.high - box.low <= narrowest
            or max(bound(len(cells) - 1, len(cells)).values()) <= _LOOSE * tolerance
        )
        cells.pop()
        return cell if sharp else None

    count = max(1, round((high - low) / (_CELL * family.step)))
    edges = np.linspace(low, high, count + 1).tolist()
    for box in told([PlaceBox(*ends) for ends in pairwise(edges)], progress):
        for part, cell in bisected([box], proved, narrowest):
            if cell is None:
                raise NoSolutionError(
                    f"the models from {part.low:g} to {part.high:g} could not be enclosed"
                )
            cells.append(cell)
    nodes, errors = [0], list[dict[str, float]]()
    while nodes[-1] < len(cells):
        last, error = nodes[-1] + 1, bound(nodes[-1], nodes[-1] + 1)
        while last < len(cells) and max((more := bound(nodes[-1], last + 1)).values()) <= tolerance:
            last, error = last + 1, more
        if max(error.values()) > tolerance:
            first, after = cells[nodes[-1]].entry["range"]
            raise NoSolutionError(
                f"no grid is proved within {tolerance:g}: from {first:g} to {after:g} {family.unit} the bound is "
                f"{max(error.values()):.3g}; ask for a larger tolerance"
            )
        nodes.append(last)
        errors.append(error)
    largest, table = {name: max(each[name] for each in errors) for name in _PARTS}, tables(nodes)
    claim |= jsonable(
        {"table": table, "distances": {name: [0.0, most] for name, most in largest.items()}}
    )
    data = {
        "schema": SCHEMA,
        "dynamics": model.name,
        "tolerance": tolerance,
        "error": largest,
        **place_data(model, np.array(table["places"])),
        **{name: np.array(table[name]) for name in "ABK"},
        "inputs_offset": np.array(table["inputs"])[..., 0],
        "states": list(model.linear),
        "inputs": list(model.inputs),
        "state_units": list(model.units(model.linear)),
        "input_units": list(model.units(tuple(model.inputs))),
    }
    return Proof("lpv", claim, {"cells": [cell.entry for cell in cells]}, model, data=data)


def _game_on(forms: ModelForms, first: Game) -> Content:
    """What a certificate says of the solution of the game on a box: P(s) to second order, and how
    far off it may be."""
    game = BallGame(
        replace(first, A=doubles(forms.A.parts[0]), B=doubles(forms.B.parts[0])), forms.A, forms.B
    )
    units = balanced_units(game.game)
    own = game.scaled(units)

    def solved(s: float) -> np.ndarray:
        at = [
            c0 + s * c1 + s * s * c2
            for c0, c1, c2 in (map(doubles, form.parts[:3]) for form in (own.A, own.B))
        ]
        return schur_solution(replace(own.game, A=at[0], B=at[1]))

    before, middle, after = map(solved, (-_ZERO, 0.0, _ZERO))
    guess = [middle, (after - before) / (2 * _ZERO), ((after + before) / 2 - middle) / _ZERO**2]
    P, S = TaylorModel(*map(matrix, guess)), own.S()
    half, loop = (own.A - S * P * 0.5).transpose() * P, own.A - S * P
    inverse = matrix(np.linalg.inv(doubles(lyapunov_operator(loop.parts[0]))))
    step = inverse * arb_mat(
        [[entry] for entry in (half + half.transpose() + own.Q()).range().entries()]
    )
    modes = counted(loop.parts[0])
    if modes is None or modes.unstable:
        raise Undecided("the solution of the game is not found on this box")
    reach = _REACH * float(norm(step.entries()).upper())
    return {"units": units, "P": guess, "reach": reach, "H": modes.H, "turn": modes.turn}
