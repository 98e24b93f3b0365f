"""The coarsest grid of dihedrals between which the linear model is interpolated with a proved bound of the error."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from flint import arb_mat

from controller.game.zero_sum import published_game
from hfa_model.provenance import Provenance
from hfa_model.vectors import INPUT_SCALES
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.jsonable import jsonable
from hfa_support.progress import Progress, told
from hfa_support.reporting.fields import Shown
from verification.arithmetic.balls import doubles
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.gain_forms import GainForm, gain_form
from verification.enclosures.taylor import DihedralBox, bisected
from verification.enclosures.trim_branch import ModelForms, TrimBranch
from verification.enclosures.trim_family import Family
from verification.proof.certificate_file import box_entry, flights_claim, write_certificate
from verification.proof.stated_model import stated

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
