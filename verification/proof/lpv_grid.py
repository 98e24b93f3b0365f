"""The coarsest grid of dihedrals between which the linear model is interpolated with a proved bound of the error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hfa_model.support.errors import NoSolutionError
from hfa_model.vectors import INPUT_SCALES
from verification.proof.ball_function import Undecided
from verification.proof.balls import symmetric
from verification.proof.steady_flights import Family
from verification.proof.taylor import DihedralBox, TaylorForm
from verification.proof.trim_branch import ModelForms, TrimBranch

if TYPE_CHECKING:
    from flint import arb_mat

#: Cells in which curvatures are bounded, deg: every node of a grid is an end of one.
_CELL = 2.0**-4
#: Narrower cells are not tried.
_NARROWEST = 2.0**-8
#: What rounding of a node's entries to doubles may add to the error, relative.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class LpvGrid:
    """A(η), B(η) and U0(η) at the nodes; between two nodes they are interpolated linearly.

    dihedral_deg: (G,). A: (G, 6, 6), B: (G, 6, 5), inputs: (G, 5). error: proved bounds, at every angle between the
    first and the last node, of |A - Â| / |A| and |B - B̂| / |B| (Frobenius) and of |U0 - Û0| in units of the inputs
    (`INPUT_SCALES`, Euclidean).
    """

    dihedral_deg: np.ndarray
    A: np.ndarray
    B: np.ndarray
    inputs: np.ndarray
    error: dict[str, float]


@dataclass(frozen=True)
class _Cell:
    """A part of the interval: bounds of |F''| per squared degree, and the least size of F, by quantity."""

    low: float
    high: float
    curvature: dict[str, float]
    size: dict[str, float]


def coarsest_grid(
    family: Family, low: float, high: float, tolerance: float, *, progress: Callable[[int, int], None] | None = None
) -> LpvGrid:
    """As few nodes as the bound allows: from `low` on, every step is the longest whose bound stays below the tolerance.

    Between nodes a distance h apart F - F̂ is the integral of F'' against Peano's kernel, whose own integral is at most
    h²/8; so |F - F̂| <= h² max |F''| / 8 in any norm. Nodes are ends of cells of 1/16 deg. NoSolutionError when no step
    is fine enough.
    """
    branch = TrimBranch(family)
    cells: list[_Cell] = []
    count = max(1, round((high - low) / _CELL))
    edges = np.linspace(low, high, count + 1).tolist()
    for index in range(count):
        cells += _cells(branch, DihedralBox(edges[index], edges[index + 1]))
        if progress is not None:
            progress(index + 1, count)
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
    return _grid(branch, nodes, {name: max(error[name] for error in errors) for name in errors[0]})


def _grid(branch: TrimBranch, nodes: list[float], error: dict[str, float]) -> LpvGrid:
    points = [branch.model_at(node) for node in nodes]
    A, B, inputs = (np.array([_doubles(point[part]) for point in points]) for part in range(3))
    return LpvGrid(np.array(nodes), A, B, inputs[..., 0], error)


def _cells(branch: TrimBranch, box: DihedralBox) -> list[_Cell]:
    """The bounds of a box, or of its parts when it is too wide for them."""
    try:
        return [_cell(branch.forms(box))]
    except Undecided:
        if box.high - box.low <= _NARROWEST:
            raise NoSolutionError(f"the models from {box.low:g} to {box.high:g} deg could not be enclosed") from None
        return [cell for half in box.halves() for cell in _cells(branch, half)]


def _cell(forms: ModelForms) -> _Cell:
    scales = [[1 / scale] for scale in INPUT_SCALES]
    curvature, size = {}, {}
    for name, form in (("A", forms.A), ("B", forms.B), ("inputs", forms.inputs)):
        bend, value = _bend(form).tolist(), form.range().tolist()
        weights = scales if name == "inputs" else [[1.0] * len(row) for row in bend]
        curvature[name] = _frobenius([[float(2 * abs(entry).upper()) for entry in row] for row in bend], weights)
        least = [[max(0.0, float(abs(entry).lower())) for entry in row] for row in value]
        size[name] = 1.0 if name == "inputs" else _frobenius(least, weights)
    return _Cell(forms.box.low, forms.box.high, curvature, size)


def _bend(form: TaylorForm) -> arb_mat:
    """F''/2 on the box: F_2 + 3 F_3(ξ) τ, the mean-value form of the second coefficient."""
    return form.coefficients[2] + (3 * symmetric(form.radius)) * form.last


def _frobenius(values: list[list[float]], weights: list[list[float]]) -> float:
    return float(np.linalg.norm(np.array(values) * np.array(weights)))


def _bound(cells: list[_Cell]) -> dict[str, float]:
    """h² max |F''| / (8 min |F|); the sums of doubles are widened by more than their rounding."""
    width = cells[-1].high - cells[0].low
    return {
        name: _wider(
            width**2 / 8 * max(cell.curvature[name] for cell in cells) / min(cell.size[name] for cell in cells)
        )
        for name in cells[0].curvature
    }


def _wider(value: float) -> float:
    return value * (1.0 + _ROUNDING) + _ROUNDING


def _doubles(values: arb_mat) -> np.ndarray:
    return np.array([[float(entry.mid()) for entry in row] for row in values.tolist()])
