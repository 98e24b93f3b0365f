"""The coarsest grid of dihedrals between which the linear model is interpolated with a proved bound of the error."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from flint import arb_mat

from controller.export.c_model import comment_lines
from controller.game.zero_sum import Game, published_game
from controller.riccati.balancing import balanced_units, in_units
from controller.riccati.gare import solve_game
from hfa_model.provenance import Provenance
from hfa_model.vectors import INPUT_SCALES, INPUT_UNITS, INPUTS, LINEAR_STATES, STATE_UNITS, UNITS, entry_unit
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.jsonable import jsonable
from hfa_support.progress import Progress, told
from hfa_support.reporting.fields import Shown
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from hfa_support.reporting.unit_system import gain_unit
from verification.arithmetic.ball_function import Undecided
from verification.arithmetic.balls import doubles, exact, filled, map_entries, matrix, norm, symmetric
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.dihedral_box import DihedralBox, bisected
from verification.enclosures.eigenvalue_signs import counted
from verification.enclosures.game_balls import lyapunov_operator
from verification.enclosures.trim_branch import Family, ModelForms, TrimBranch
from verification.proof.certificate_file import box_entry, flights_claim, write_certificate
from verification.proof.stated_model import stated

Polynomial = list["arb_mat"]
#: How much wider than what Newton's step shows the solution is sought.
_REACH = 4.0
#: ... and how much wider a certificate states it, and the contraction that leaves the checker room: it takes a box of
#: entries where a ball is meant, which is n times as large in norm.
_STATED, _CONTRACTION = 36.0, 0.6


@dataclass(frozen=True, eq=False)
class GainForm:
    """K(τ) within rest, entry by entry, of K_0 + K_1 τ + K_2 τ²: coefficients (3, 5, 6), rest (5, 6), τ in degrees.

    proof: what a certificate says of P on the box. loose: how far from K, Frobenius, that leaves whoever checks it.
    """

    coefficients: np.ndarray
    rest: np.ndarray
    proof: dict[str, Any]
    loose: float


def gain_form(forms: ModelForms) -> GainForm:
    """The gain of the published game on a box. Undecided when the box is too wide.

    P̂(τ) solves the Riccati equation to second order in doubles. With L(E) = A_c'E + E A_c on all of the box and C
    about its inverse, E = -C F(P̂) + (I - C L) E + C (E S E) has one solution |E| < reach at every τ, and L stays
    invertible: no mode of A - S P crosses the axis.
    """
    A, B = ([*form.parts[:3], last] for form, last in zip((forms.A, forms.B), forms.cubic, strict=True))
    game = published_game(doubles(A[0]), doubles(B[0]))
    units = balanced_units(game)
    up, down = matrix(np.diag(units)), matrix(np.diag(1.0 / units))
    A, B = [down * each * up for each in A], [down * each for each in B]
    own, n = in_units(game, units), len(units)
    R_inverse, Q, E = matrix(own.R).inv(), matrix(own.Q), matrix(own.E)
    S = _product(B, [R_inverse * each.transpose() for each in B])
    S[0] = S[0] - E * E.transpose() * (1 / exact(own.delta) ** 2)
    guess = _solution(own, [doubles(each) for each in A[:3]], [doubles(each) for each in S[:3]])
    P = [matrix(each) for each in guess]
    half = _product([each.transpose() for each in A], P)
    residual = _sum(half, [each.transpose() for each in half], [-each for each in _product(P, _product(S, P))], [Q])
    loop = _sum(A, [-each for each in _product(S, P)])
    L = lyapunov_operator(_range(loop))
    C = matrix(np.linalg.inv(doubles(L)))
    step = C * arb_mat([[entry] for entry in _range(residual).entries()])
    slope, bend = (
        norm((matrix(np.eye(n * n)) - C * L).entries()),
        norm(C.entries()) * norm(_range(S).entries()),
    )
    reach = exact(_REACH * float(norm(step.entries()).upper()))
    rest = slope * reach + bend * reach**2
    modes = counted(loop[0])
    if (
        modes is None
        or modes.unstable
        or not (norm(step.entries()) + rest < reach and slope + 2 * n * bend * _STATED * reach < _CONTRACTION)
    ):
        raise Undecided("the solution of the game is not enclosed on this box")
    error = arb_mat(n, n, [symmetric(rest) - entry for entry in step.entries()])
    gains = [R_inverse * each * down for each in _product([each.transpose() for each in B], P)]
    over = _range([R_inverse * each.transpose() for each in B]) * error * down
    for k, each in enumerate(gains):
        over += map_entries(lambda entry, k=k: symmetric(entry if k > 2 else entry - entry.mid()), each)
    bounds = np.array([[float(abs(entry).upper()) for entry in row] for row in over.tolist()])
    proof = {
        "units": units,
        "P": guess,
        "reach": _STATED * float(reach),
        "H": modes.H,
        "turn": modes.turn,
    }
    loose = R_inverse * B[0].transpose() * filled(n, n, symmetric(proof["reach"])) * down
    scales = 1.0 / float(forms.box.radius) ** np.arange(3)[:, None, None]
    return GainForm(
        np.array([doubles(each) for each in gains[:3]]) * scales, bounds, proof, float(norm(loose.entries()).upper())
    )


def _solution(game: Game, A: list[np.ndarray], S: list[np.ndarray]) -> list[np.ndarray]:
    """P_0, P_1, P_2 of the Riccati equation along the box, in doubles: one Lyapunov equation an order."""
    from scipy.linalg import solve_continuous_lyapunov

    P = [solve_game(game).P]
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


def _product(X: Polynomial, Y: Polynomial) -> Polynomial:
    """Of two polynomials in s with matrices of balls."""
    found: list[Any] = [None] * (len(X) + len(Y) - 1)
    for i, x in enumerate(X):
        for j, y in enumerate(Y):
            found[i + j] = x * y if found[i + j] is None else found[i + j] + x * y
    return found


def _sum(*terms: Polynomial) -> Polynomial:
    longest = max(terms, key=len)
    zero = 0 * longest[0]
    return [sum((each[k] for each in terms if k < len(each)), zero) for k in range(len(longest))]


def _range(X: Polynomial) -> arb_mat:
    """Everything that it takes for |s| <= 1."""
    return sum((map_entries(symmetric, x) for x in X[1:]), X[0])


#: Cells in which curvatures are bounded, deg: every node of a grid is an end of one.
_CELL = 2.0**-4
#: Narrower cells are not tried.
_NARROWEST = 2.0**-8
#: Part of the tolerance that a certificate may leave open about K.
_LOOSE = 0.5
#: What rounding of a node's entries to doubles may add to the error, relative.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class LpvGrid(Shown):
    """A(η), B(η), U0(η) and the exact game's K(η) at the nodes; between two nodes they are interpolated linearly.

    dihedral_deg: (G,). A: (G, 6, 6), B: (G, 6, 5), inputs: (G, 5), K: (G, 5, 6). error: proved bounds, at every angle
    between the first and the last node, of |A - Â| / |A|, |B - B̂| / |B|, |K - K̂| / |K| (Frobenius) and of |U0 - Û0| in
    units of the inputs (`INPUT_SCALES`, Euclidean). cells: what a certificate says of each.
    """

    dihedral_deg: np.ndarray
    A: np.ndarray
    B: np.ndarray
    inputs: np.ndarray
    K: np.ndarray
    error: dict[str, float]
    cells: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class _Cell:
    """A part of the interval: bounds of |F''| per squared degree, and the least size of F, by quantity."""

    low: float
    high: float
    curvature: dict[str, float]
    size: dict[str, float]
    gain: GainForm
    entry: dict[str, Any]


def coarsest_grid(
    family: Family, low: float, high: float, tolerance: float, *, progress: Progress | None = None
) -> LpvGrid:
    """As few nodes as the bound allows: from `low` on, every step is the longest whose bound stays below the tolerance.

    low, high: dihedral, degrees. tolerance: of every error in `LpvGrid.error`.

    Between nodes a distance h apart F - F̂ is the integral of F'' against Peano's kernel, whose own integral is at most
    h²/8; so |F - F̂| <= h² max |F''| / 8 in any norm. K is compared with its polynomial on each cell. Nodes are ends of
    cells of 1/16 deg. NoSolutionError when no step is fine enough.
    """
    if not low < high:
        raise BadInputError(f"the interval goes from {low:g} to {high:g} deg; give the lower end first")
    branch = TrimBranch(family)
    cells: list[_Cell] = []
    count = max(1, round((high - low) / _CELL))
    edges = np.linspace(low, high, count + 1).tolist()
    for box in told([DihedralBox(*ends) for ends in pairwise(edges)], progress):
        cells += _cells(branch, box, _LOOSE * tolerance)
    nodes, errors, first = [low], [], 0
    while first < len(cells):
        last, error = first, _bound(cells[first : first + 1])
        while last + 1 < len(cells) and max(_bound(cells[first : last + 2]).values()) <= tolerance:
            last += 1
            error = _bound(cells[first : last + 1])
        if max(error.values()) > tolerance:
            raise NoSolutionError(
                f"no grid is proved within {tolerance:g}: from {cells[first].low:g} to {cells[first].high:g} deg the "
                f"bound is {max(error.values()):.3g}; ask for a larger tolerance"
            )
        nodes.append(cells[last].high)
        errors.append(error)
        first = last + 1
    bounds = {name: max(error[name] for error in errors) for name in errors[0]}
    ends = {cell.low: _gain_at(cell, -1.0) for cell in cells} | {cells[-1].high: _gain_at(cells[-1], 1.0)}
    K = np.array([ends[node] for node in nodes])
    points = [branch.model_at(node) for node in nodes]
    A, B, inputs = (np.array([doubles(point[part]) for point in points]) for part in range(3))
    return LpvGrid(np.array(nodes), A, B, inputs[..., 0], K, bounds, tuple(cell.entry for cell in cells))


def certify(grid: LpvGrid, family: Family, path: Path, origin: Provenance) -> None:
    """Write the certificate of a grid; it states the errors that the checker finds: it encloses in another way."""
    from verification.checker.checker import distances, model_on

    game = published_game(grid.A[0], grid.B[0])
    nodes = {name: getattr(grid, name) for name in ("dihedral_deg", "A", "B", "K")} | {"inputs": grid.inputs[..., None]}
    claim = flights_claim(family, float(grid.dihedral_deg[0]), float(grid.dihedral_deg[-1])) | {
        "game": {name: getattr(game, name) for name in ("Q", "R", "E", "delta")},
        "table": nodes,
    }
    claim = jsonable(claim)
    found = [distances(claim, cell, model_on(claim, cell)) for cell in map(jsonable, grid.cells)]
    claim["distances"] = {name: [0.0, _wider(max(float(each[name][1]) for each in found))] for name in grid.error}
    write_certificate(path, origin, "lpv", claim, {"cells": list(grid.cells)})


def _cells(branch: TrimBranch, box: DihedralBox, loose: float) -> list[_Cell]:
    """The bounds of a box, or of its parts when it is too wide for them, or for a check of K within `loose`."""

    def bounded(part: DihedralBox) -> _Cell | None:
        found = _cell(branch.forms(part), branch)
        sharp = found.gain.loose <= loose * found.size["K"] or part.high - part.low <= _NARROWEST
        return found if sharp else None

    cells = []
    for part, cell in bisected([box], bounded, _NARROWEST):
        if cell is None:
            raise NoSolutionError(f"the models from {part.low:g} to {part.high:g} deg could not be enclosed")
        cells.append(cell)
    return cells


def _cell(forms: ModelForms, branch: TrimBranch) -> _Cell:
    scales = [[1 / scale] for scale in INPUT_SCALES]
    curvature, size = {}, {}
    for name, form in (("A", forms.A), ("B", forms.B), ("inputs", forms.inputs)):
        bend, value = _bend(form, forms.box).tolist(), form.range().tolist()
        weights = scales if name == "inputs" else [[1.0] * len(row) for row in bend]
        curvature[name] = _frobenius([[float(2 * abs(entry).upper()) for entry in row] for row in bend], weights)
        least = [[max(0.0, float(abs(entry).lower())) for entry in row] for row in value]
        size[name] = 1.0 if name == "inputs" else _frobenius(least, weights)
    gain = gain_form(forms)
    K, rises = np.abs(gain.coefficients[0]), np.abs(gain.coefficients[1:]) * _powers(forms.box)
    size["K"] = float(np.linalg.norm(np.maximum(0.0, K - rises.sum(axis=0) - gain.rest)))
    entry = box_entry(forms.box, stated(forms, branch.free), branch.family.decimals, **gain.proof)
    return _Cell(forms.box.low, forms.box.high, curvature, size, gain, entry)


def _powers(box: DihedralBox) -> np.ndarray:
    return np.array([float(box.radius), float(box.radius) ** 2])[:, None, None]


def _gain_at(cell: _Cell, s: float) -> np.ndarray:
    """The polynomial of K at an end of the cell, s = -1 or 1."""
    r = s * (cell.high - cell.low) / 2
    return np.asarray(cell.gain.coefficients[0] + r * cell.gain.coefficients[1] + r * r * cell.gain.coefficients[2])


def _gain_error(cells: list[_Cell]) -> float:
    """|K - K̂| / |K| with K̂ linear over all of the cells: on each by the control points of the difference."""
    low, high = cells[0].low, cells[-1].high
    first, last = _gain_at(cells[0], -1.0), _gain_at(cells[-1], 1.0)
    worst = 0.0
    for cell in cells:
        middle, r = (cell.low + cell.high) / 2, (cell.high - cell.low) / 2
        slope = (last - first) / (high - low)
        c0 = cell.gain.coefficients[0] - first - slope * (middle - low)
        c1, c2 = (cell.gain.coefficients[1] - slope) * r, cell.gain.coefficients[2] * r * r
        most = np.abs([c0 - c1 + c2, c0 - c2, c0 + c1 + c2]).max(axis=0) + cell.gain.rest
        worst = max(worst, float(np.linalg.norm(most)))
    return _wider(worst / min(cell.size["K"] for cell in cells))


def _bend(form: TaylorModel, box: DihedralBox) -> arb_mat:
    """F''/2 on the box: F_2 + 3 F_3(ξ) τ, the mean-value form of the second coefficient."""
    return (form.parts[2] + 3 * form.parts[3]) * (1 / box.radius**2)


def _frobenius(values: list[list[float]], weights: list[list[float]]) -> float:
    return float(np.linalg.norm(np.array(values) * np.array(weights)))


def _bound(cells: list[_Cell]) -> dict[str, float]:
    """h² max |F''| / (8 min |F|); the sums of doubles are widened by more than their rounding."""
    width = cells[-1].high - cells[0].low
    bounds = {
        name: _wider(
            width**2 / 8 * max(cell.curvature[name] for cell in cells) / min(cell.size[name] for cell in cells)
        )
        for name in cells[0].curvature
    }
    return bounds | {"K": _gain_error(cells)}


def _wider(value: float) -> float:
    return value * (1.0 + _ROUNDING) + _ROUNDING


SCHEMA = "hfa.lpv/1"


def lpv_report(grid: LpvGrid, tolerance: float, dynamics: str) -> Report:
    """The proved bounds and where the nodes are; the matrices are data."""
    steps = np.diff(grid.dihedral_deg)
    low, high = grid.dihedral_deg[0], grid.dihedral_deg[-1]
    what = {
        "A": "|A - Â| / |A|",
        "B": "|B - B̂| / |B|",
        "inputs": "|U0 - Û0|, in units of the inputs",
        "K": "|K - K̂| / |K|",
    }
    rows = [(what[name], f"{value:.3g}") for name, value in grid.error.items()]
    data: dict[str, Any] = {
        "schema": SCHEMA,
        "dynamics": dynamics,
        "tolerance": tolerance,
        "error": grid.error,
        "dihedral_deg": grid.dihedral_deg,
        "A": grid.A,
        "B": grid.B,
        "inputs_offset": grid.inputs,
        "K": grid.K,
        "states": list(LINEAR_STATES),
        "inputs": list(INPUTS),
        "state_units": [getattr(STATE_UNITS, name) for name in LINEAR_STATES],
        "input_units": list(INPUT_UNITS),
    }
    return Report(
        title=f"Proved: {len(grid.dihedral_deg)} models from {low:g} to {high:g} deg, {dynamics} dynamics, interpolate "
        f"linearly within {tolerance:g}",
        parts=[
            Table(("error at every angle between, at most", "bound"), rows),
            f"steps from {steps.min():g} to {steps.max():g} deg",
        ],
        data=data,
        records=_records(grid),
    )


def c_source(grid: LpvGrid, origin: str) -> str:
    """A C99 function that interpolates A, B and U0, row by row; it needs no library. origin: said at its top."""
    count = len(grid.dihedral_deg)
    bounds = ", ".join(f"{name} {value:.3g}" for name, value in grid.error.items())
    tables = "\n".join(
        f"static const double {name}_at[{count}][{values[0].size}] = {{\n{_rows(values)}}};"
        for name, values in (("A", grid.A), ("B", grid.B), ("U0", grid.inputs), ("K", grid.K))
    )
    return f"""/* {comment_lines(origin)} */
/* Linear models of the aircraft over the dihedral, linear between the nodes; proved errors: {bounds}.
   States: {", ".join(LINEAR_STATES)}. Inputs: {", ".join(INPUTS)}. English units and radians; dihedral in degrees. */
#include <stddef.h>
static const double node_deg[{count}] = {{{_numbers(grid.dihedral_deg)}}};
{tables}
static void between(const double *first, const double *last, double share, size_t size, double *out)
{{
    for (size_t i = 0; i < size; i++) out[i] = first[i] + share * (last[i] - first[i]);
}}
/* A[36], B[30], U0[5] and the exact game's gain K[30], u = -K x; matrices row by row. Returns 0, or 1 and nothing when
   the dihedral is outside the nodes. */
int hfa_lpv(double dihedral_deg, double *A, double *B, double *U0, double *K)
{{
    size_t k = 0;
    if (!(dihedral_deg >= node_deg[0] && dihedral_deg <= node_deg[{count - 1}])) return 1;
    while (k + 2 < {count} && dihedral_deg > node_deg[k + 1]) k++;
    double share = (dihedral_deg - node_deg[k]) / (node_deg[k + 1] - node_deg[k]);
    between(A_at[k], A_at[k + 1], share, 36, A);
    between(B_at[k], B_at[k + 1], share, 30, B);
    between(U0_at[k], U0_at[k + 1], share, 5, U0);
    between(K_at[k], K_at[k + 1], share, 30, K);
    return 0;
}}
"""


def _rows(values: np.ndarray) -> str:
    return "".join(f"    {{{_numbers(each)}}},\n" for each in values)


def _numbers(values: np.ndarray) -> str:
    return ", ".join(repr(value) for value in np.ravel(values).tolist())


def _records(grid: LpvGrid) -> Table:
    rows = []
    for k, angle in enumerate(grid.dihedral_deg.tolist()):
        for name, values, names, columns, unit in (
            ("A", grid.A[k], LINEAR_STATES, LINEAR_STATES, entry_unit),
            ("B", grid.B[k], LINEAR_STATES, INPUTS, entry_unit),
            ("K", grid.K[k], INPUTS, LINEAR_STATES, lambda row, column: gain_unit(UNITS[row], UNITS[column])),
        ):
            rows += [
                (angle, name, row, column, values[i, j], unit(row, column))
                for i, row in enumerate(names)
                for j, column in enumerate(columns)
            ]
        offsets = zip(INPUTS, grid.inputs[k].tolist(), INPUT_UNITS, strict=True)
        rows += [(angle, "U0", name, "", value, unit) for name, value, unit in offsets]
    return Table(("dihedral_deg", "matrix", "row", "column", "value", "unit"), rows)
