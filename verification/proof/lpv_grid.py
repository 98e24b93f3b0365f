"""The coarsest grid of places between which the linear model is interpolated with a proved bound of the error.

What is searched for here, in doubles, is proved by `verification/checker` alone: trims, A, B and K on every cell, and
how far they are from the chord of two nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from flint import arb_mat

from controller.export.c_model import c_table, comment_lines
from controller.game.zero_sum import Game, usual_game
from controller.riccati.balancing import balanced_units, in_units
from controller.riccati.gare_schur import schur_solution
from hfa_model.provenance import Provenance
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.jsonable import jsonable
from hfa_support.model import Model
from hfa_support.progress import Progress, told
from hfa_support.reporting.fields import Shown
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from hfa_support.reporting.unit_system import gain_unit
from verification.arithmetic.ball_function import Undecided
from verification.arithmetic.balls import doubles, exact, matrix, norm
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.eigenvalue_signs import counted
from verification.enclosures.game_balls import lyapunov_operator
from verification.enclosures.place_box import PlaceBox, bisected
from verification.enclosures.trim_branch import Family, ModelForms, TrimBranch
from verification.proof.certificate_file import box_entry, flights_claim, write_certificate
from verification.proof.proof_report import scheduled
from verification.proof.stated_model import stated

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


@dataclass(frozen=True, eq=False, repr=False)
class LpvGrid(Shown):
    """A(η), B(η), U0(η) and the usual game's K(η) at the nodes; between two nodes they are interpolated linearly.

    places: (G,). A: (G, n, n), B: (G, n, m), inputs: (G, m), K: (G, m, n). error: proved bounds, at every place
    between the first and the last node, of |A - Â| / |A|, |B - B̂| / |B|, |K - K̂| / |K| (Frobenius) and of |U0 - Û0| in
    nominal units of the inputs (Euclidean). claim, cells: what a certificate says of it, and of each cell.
    """

    model: Model
    places: np.ndarray
    A: np.ndarray
    B: np.ndarray
    inputs: np.ndarray
    K: np.ndarray
    error: dict[str, float]
    claim: dict[str, Any]
    cells: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class _Cell:
    """What is proved on a part of the interval: A, B, K and the inputs as Taylor models."""

    entry: dict[str, Any]
    known: dict[str, TaylorModel]

    def at(self, name: str, s: float) -> np.ndarray:
        """In doubles, at an end: s = -1 or 1."""
        c0, c1, c2, *_ = self.known[name].parts
        return doubles(c0 + s * c1 + c2)


def coarsest_grid(
    family: Family, low: float, high: float, tolerance: float, *, progress: Progress | None = None
) -> LpvGrid:
    """As few nodes as the bound allows: from `low` on, every step is the longest whose error is proved to stay below
    the tolerance, which is of every error in `LpvGrid.error`.

    Nodes are ends of cells of 1/16 of a step, or less. NoSolutionError when no step is fine enough.
    """
    from verification.checker.checker import Rejected, distances, model_on, solution_on

    if not low < high:
        raise BadInputError(f"the interval goes from {low:g} to {high:g}; give the lower end first")
    branch, model, cells = TrimBranch(family), family.model, list[_Cell]()
    narrowest = _NARROWEST * family.step
    point = branch.model_at(low)
    game = usual_game(model, *map(doubles, point[:2]))
    weights = {name: getattr(game, name) for name in "QRE"} | {"delta": game.delta if game.delta < np.inf else "inf"}
    claim = jsonable(flights_claim(family, low, high) | {"game": weights, "distances": dict.fromkeys(_PARTS)})

    def bound(first: int, last: int) -> dict[str, float]:
        """The largest error on these cells when their outer ends are nodes."""
        table = tables([first, last])
        found = [distances(claim | {"table": table}, each.entry, each.known) for each in cells[first:last]]
        return {name: max(float(each[name][1]) for each in found) * (1.0 + _ROUNDING) for name in _PARTS}

    def tables(nodes: list[int]) -> dict[str, Any]:
        """Places and matrices where these cells begin, and at the end of the last one."""
        at = [(cells[k], -1.0) if k < len(cells) else (cells[-1], 1.0) for k in nodes]
        found = {name: [cell.at(name, s) for cell, s in at] for name in _PARTS}
        return {"places": [cell.entry["range"][int(s > 0.0)] for cell, s in at], **found}

    def proved(box: PlaceBox) -> _Cell | None:
        forms = branch.forms(box)
        entry = jsonable(box_entry(box, stated(forms, family), family.decimals, **_game_on(forms, game)))
        try:
            known = model_on(claim, entry, model)
            cell = _Cell(entry, known | solution_on(claim["game"], known, entry, 1))
        except Rejected:
            return None
        cells.append(cell)  # to see what is left when its own ends are nodes
        sharp = box.high - box.low <= narrowest or max(bound(len(cells) - 1, len(cells)).values()) <= _LOOSE * tolerance
        cells.pop()
        return cell if sharp else None

    count = max(1, round((high - low) / (_CELL * family.step)))
    edges = np.linspace(low, high, count + 1).tolist()
    for box in told([PlaceBox(*ends) for ends in pairwise(edges)], progress):
        for part, cell in bisected([box], proved, narrowest):
            if cell is None:
                raise NoSolutionError(f"the models from {part.low:g} to {part.high:g} could not be enclosed")
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
    claim |= jsonable({"table": table, "distances": {name: [0.0, most] for name, most in largest.items()}})
    places, A, B, inputs, K = map(np.array, table.values())
    return LpvGrid(model, places, A, B, inputs[..., 0], K, largest, claim, tuple(cell.entry for cell in cells))


_PARTS = ("A", "B", "inputs", "K")


def certify(grid: LpvGrid, path: Path, origin: Provenance) -> None:
    """Write the certificate of a grid."""
    write_certificate(path, origin, "lpv", grid.claim, {"cells": list(grid.cells)})


def _game_on(forms: ModelForms, first: Game) -> dict[str, Any]:
    """What a certificate says of the solution of the game on a box: P(τ) to second order, and how far off it may be."""
    game = replace(first, A=doubles(forms.A.parts[0]), B=doubles(forms.B.parts[0]))
    units = balanced_units(game)
    up, down = matrix(np.diag(units)), matrix(np.diag(1.0 / units))
    A, B, own = down * forms.A * up, down * forms.B, in_units(game, units)
    E = matrix(own.E)
    S = B * (matrix(own.R).inv() * B.transpose()) - E * E.transpose() * (1 / exact(own.delta) ** 2)
    guess = _solution(own, *([doubles(part) for part in form.parts[:3]] for form in (A, S)))
    P = TaylorModel(*map(matrix, guess))
    half, loop = (A - S * P * 0.5).transpose() * P, A - S * P
    inverse = matrix(np.linalg.inv(doubles(lyapunov_operator(loop.parts[0]))))
    step = inverse * arb_mat([[entry] for entry in (half + half.transpose() + matrix(own.Q)).range().entries()])
    modes = counted(loop.parts[0])
    if modes is None or modes.unstable:
        raise Undecided("the solution of the game is not found on this box")
    reach = _REACH * float(norm(step.entries()).upper())
    return {"units": units, "P": guess, "reach": reach, "H": modes.H, "turn": modes.turn}


def _solution(game: Game, A: list[np.ndarray], S: list[np.ndarray]) -> list[np.ndarray]:
    """P_0, P_1, P_2 of the Riccati equation along the box, in doubles: one Lyapunov equation an order."""
    from scipy.linalg import solve_continuous_lyapunov

    P = [schur_solution(game)]
    loop = A[0] - S[0] @ P[0]
    for order in (1, 2):
        known = [*P, np.zeros_like(P[0])]
        rest = sum(A[i].T @ known[order - i] + known[order - i] @ A[i] for i in range(order + 1))
        for i in range(order + 1):
            for j in range(order + 1 - i):
                rest = rest - known[i] @ S[j] @ known[order - i - j]
        found = solve_continuous_lyapunov(loop.T, -rest)
        P.append((found + found.T) / 2)
    return P


SCHEMA = "hfa.lpv/1"


def lpv_report(grid: LpvGrid, tolerance: float) -> Report:
    """The proved bounds and where the nodes are; the matrices are data."""
    steps, model = np.diff(grid.places), grid.model
    low, high, unit = grid.places[0], grid.places[-1], model.schedule_unit
    rows = [
        (
            f"|{name} - interpolated| / |{name}|" if name != "inputs" else "|U0 - interpolated|, in nominal units",
            f"{value:.3g}",
        )
        for name, value in grid.error.items()
    ]
    data: dict[str, Any] = {
        "schema": SCHEMA,
        "dynamics": model.name,
        "tolerance": tolerance,
        "error": grid.error,
        **scheduled(model, grid.places),
        **{name: getattr(grid, name) for name in "ABK"},
        "inputs_offset": grid.inputs,
        "states": list(model.linear),
        "inputs": list(model.inputs),
        "state_units": list(model.units(model.linear)),
        "input_units": list(model.units(tuple(model.inputs))),
    }
    return Report(
        title=f"Proved: {len(grid.places)} models from {low:g} to {high:g} {unit}, {model.title}, interpolate "
        f"linearly within {tolerance:g}",
        parts=[
            Table((f"error at every {'angle' if unit == 'deg' else model.schedule} between, at most", "bound"), rows),
            f"steps from {steps.min():g} to {steps.max():g} {unit}",
        ],
        data=data,
        records=_records(grid),
    )


def c_source(grid: LpvGrid, origin: str) -> str:
    """A C99 function that interpolates A, B, U0 and K, row by row; it needs no library. origin: stated at its top."""
    model, key = grid.model, grid.model.schedule_key
    parts = {"A": grid.A, "B": grid.B, "U0": grid.inputs, "K": grid.K}
    bounds = ", ".join(f"{name} {value:.3g}" for name, value in grid.error.items())
    sizes = {name: values[0].size for name, values in parts.items()}
    tables = [
        c_table(f"static const double {name}_at", values.reshape(len(values), -1)) for name, values in parts.items()
    ]
    tables.append(c_table("static const double node", grid.places))
    calls = "\n    ".join(
        f"between({name}_at[k], {name}_at[k + 1], share, {size}, {name});" for name, size in sizes.items()
    )
    units = ", ".join(f"{name} {model.unit(name)}" for name in (*model.linear, *model.inputs))
    return f"""/* {comment_lines(origin)} */
/* Linear models over the {model.schedule}, linear between the nodes; proved errors: {bounds}.
   States: {", ".join(model.linear)}. Inputs: {", ".join(model.inputs)}. Units: {units}. */
#include <stddef.h>
{chr(10).join(tables)}
static void between(const double *first, const double *last, double share, size_t size, double *out)
{{
    for (size_t i = 0; i < size; i++) out[i] = first[i] + share * (last[i] - first[i]);
}}
/* {", ".join(f"{name}[{size}]" for name, size in sizes.items())}, u = -K x; matrices row by row. Returns 0, or 1 and
   nothing when {key} is outside the nodes. */
int hfa_lpv(double {key}, double *A, double *B, double *U0, double *K)
{{
    size_t k = 0;
    if (!({key} >= node[0] && {key} <= node[{len(grid.places) - 1}])) return 1;
    while (k + 2 < {len(grid.places)} && {key} > node[k + 1]) k++;
    double share = ({key} - node[k]) / (node[k + 1] - node[k]);
    {calls}
    return 0;
}}
"""


def _records(grid: LpvGrid) -> Table:
    model, rows = grid.model, list[tuple[Any, ...]]()
    states, inputs = model.linear, tuple(model.inputs)
    per_gain = lambda row, column: gain_unit(model.unit(row), model.unit(column))  # noqa: E731
    for k, place in enumerate(grid.places.tolist()):
        for name, names, columns, unit in (
            ("A", states, states, model.entry_unit),
            ("B", states, inputs, model.entry_unit),
            ("K", inputs, states, per_gain),
        ):
            values = getattr(grid, name)[k].tolist()
            rows += [
                (place, name, row, column, values[i][j], unit(row, column))
                for i, row in enumerate(names)
                for j, column in enumerate(columns)
            ]
        rows += [
            (place, "U0", name, "", value, model.unit(name))
            for name, value in zip(inputs, grid.inputs[k].tolist(), strict=True)
        ]
    return Table((model.schedule_key, "matrix", "row", "column", "value", "unit"), rows)
