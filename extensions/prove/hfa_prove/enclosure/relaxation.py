"""Bounds of a function over boxes of its inputs by linear relaxation, including rounding errors.

Over a box, each node v of a program lies between two parallel lines, v = Σ α t + c ± ρ, where
t are the rows of its arguments. The lines are substituted from the last node to the first. Each
output then is a row of the inputs, e = l'y + l0 ± r. Sources: DeepZ, Singh et al., NeurIPS 2018;
CROWN, Zhang et al., NeurIPS 2018.

Rounding. In double precision, the error of a sum of N products in any order is at most γ_N times
the sum of their absolute values, with γ_N = N u / (1 - N u) and u = 2⁻⁵³ (Higham, Accuracy and
Stability of Numerical Algorithms, Section 3.1). The double closest to a rational coefficient has
a relative error of at most u. A node with the coefficient M contributes at most
|M| (Σ |α| S + |c|) to a row, with S = Σ |w_j| max |v_j| over the row w of its argument.
Therefore ρ is enlarged by γ (Σ |α| S + |c|), and each row begins with r = γ S. γ is γ_N for
N = four times the number of terms and nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_prove.enclosure.elementary import ROUNDING
from hfa_prove.enclosure.lines import enclosed
from hfa_prove.enclosure.program import Argument, Kind, Program

#: Largest degree of a product of polynomials that is expanded to monomials.
_LARGEST_DEGREE = 4
#: Largest contribution of a node to a row with the coefficient 1. Larger ones give no bound.
_LARGEST = 1e100
#: Bound on the sum of all underflows. Each is below 1e-323, multiplied by `_LARGEST` and 1e9 terms.
_TINY = 1e-200
#: Approximate number of entries of the largest array. Larger arrays do not fit into the cache.
_LARGEST_ARRAY = 2**17
_MOST_BOXES = 256


class Lines(NamedTuple):
    """Linear enclosures v = Σ slopes t + constant ± radius with |v| <= size.

    Each array is (boxes, nodes).
    """

    slopes: tuple[np.ndarray, ...]
    constant: np.ndarray
    radius: np.ndarray
    size: np.ndarray


def lines_of(kind: Kind, *ends: np.ndarray) -> Lines:
    """Return linear enclosures of nodes of one kind.

    ends: lowest and highest value of each argument, (boxes, nodes)
    """
    return _product_lines(*ends) if kind == "product" else _function_lines(kind, *ends)


def _function_lines(kind: Kind, low: np.ndarray, high: np.ndarray) -> Lines:
    middle = 0.5 * (low + high)
    line = enclosed(kind).line((middle, low, high))
    constant = line.value - line.slope * middle
    reach = np.abs(line.slope) * np.maximum(high - middle, middle - low)
    size = np.abs(line.value) + np.abs(line.slope * middle)
    radius = line.rest + 4.0 * ROUNDING * size
    return Lines((line.slope,), constant, radius, np.abs(line.value) + reach + radius)


def _product_lines(
    low: np.ndarray, high: np.ndarray, other_low: np.ndarray, other_high: np.ndarray
) -> Lines:
    """Return linear enclosures of the product s t on [low, high] x [other_low, other_high].

    s t = n s + m t - m n + (s - m) (t - n) with m, n the middles of the intervals.
    """
    m = 0.5 * (low + high)
    n = 0.5 * (other_low + other_high)
    rest = np.maximum(high - m, m - low) * np.maximum(other_high - n, n - other_low)
    radius = rest + 4.0 * ROUNDING * (rest + np.abs(m * n))
    size = np.maximum(np.abs(low), np.abs(high))
    other_size = np.maximum(np.abs(other_low), np.abs(other_high))
    return Lines((n, m), -m * n, radius, size * other_size)


#: Group of variables -> coefficients, (..., rows, variables). Group 0, the constant 1 and the
#: inputs, always exists. Other groups exist if a coefficient is not 0.
_Blocks = dict[int, np.ndarray]


class _Group(NamedTuple):
    """Nodes of one kind and level, evaluated together.

    kind: kind of the nodes
    arguments: for each argument, its rows for all nodes, as returned by `_dense`
    """

    kind: Kind
    arguments: tuple[_Blocks, ...]


class _Affine(NamedTuple):
    """Rows l'y + l0 ± r of the inputs y, for each box.

    slopes: l, (boxes, rows, n).
    constant, radius: l0 and r, (boxes, rows).
    spreads: group -> (boxes, rows, nodes), contribution of each node to the radius. Groups that
        occur in no row are missing.
    """

    slopes: np.ndarray
    constant: np.ndarray
    radius: np.ndarray
    spreads: _Blocks


class Bounds(NamedTuple):
    """Bounds on the largest output |e_i| over each box.

    highest: (boxes,), upper bound on all |e_i| in the box, or not finite without a bound.
    lowest: (boxes,), lower bound on max |e_i| at `corner`.
    corner: (boxes, n), a corner of each box.
    gaps: (boxes, n), contribution of each input to the width of the bound.
    """

    highest: np.ndarray
    lowest: np.ndarray
    corner: np.ndarray
    gaps: np.ndarray


class Relaxation:
    """Bounds on the outputs of a function y (n,) -> e over boxes.

    function: the function
    name: name of the function, for messages

    Raises BadInputError if an operation cannot be enclosed or the function is too large.
    """

    def __init__(self, function: ca.Function, name: str) -> None:
        program = Program(function, name, degree=_LARGEST_DEGREE)
        self._groups = [
            _Group(group.kind, tuple(_dense(each, program) for each in group.arguments))
            for group in program.groups
        ]
        self._rows = _dense(program.outputs, program)
        widths = program.widths
        self._gamma = 4.0 * (sum(widths) + len(widths) + 50) * 2.0**-53
        self._at_once = int(np.clip(_LARGEST_ARRAY // max(widths) ** 2, 1, _MOST_BOXES))

    def over(self, centres: np.ndarray, half_widths: np.ndarray) -> Bounds:
        """Return the bounds over boxes.

        centres, half_widths: (boxes, n)
        """
        parts = []
        with np.errstate(all="ignore"):  # values that are not finite give no bound
            for first in range(0, len(centres), self._at_once):
                batch = slice(first, first + self._at_once)
                parts.append(self._over(centres[batch], half_widths[batch]))
        return Bounds(*map(np.concatenate, zip(*parts, strict=True)))

    def _over(self, centres: np.ndarray, half_widths: np.ndarray) -> Bounds:
        count = len(centres)
        sizes = [np.hstack([np.ones((count, 1)), np.abs(centres) + half_widths])]
        lines: list[Lines] = []
        shares = []  # (boxes, nodes, n), contribution of each input to the width of an argument
        for group in self._groups:
            ends: list[np.ndarray] = []
            share = 0.0
            for argument in group.arguments:
                affine = self._back(argument, sizes, lines)
                middle, radius = self._range(affine, centres, half_widths)
                ends += [middle - radius, middle + radius]
                reach = np.abs(affine.slopes) * half_widths[:, None, :]
                share = share + reach / (radius[..., None] + _TINY)
            line = self._rounded(lines_of(group.kind, *ends), group, sizes)
            infinite = ~np.isfinite(sum(np.abs(end) for end in ends))
            line.radius[infinite] = np.inf
            lines.append(line)
            shares.append(share)
            sizes.append((1.0 + self._gamma) * line.size)
        affine = self._back(self._rows, sizes, lines)
        middle, radius = self._range(affine, centres, half_widths)
        radius = np.where(_sizes_of(self._rows, sizes) <= _LARGEST, radius, np.inf)
        boxes = np.arange(count)
        worst = np.argmax(np.abs(middle) + radius, axis=1)
        gaps = np.zeros_like(centres)
        for number, spread in affine.spreads.items():
            gaps += np.einsum("bk,bkn->bn", spread[boxes, worst], shares[number - 1])
        slopes = affine.slopes[boxes, worst]
        height = np.abs(middle)[boxes, worst]
        reach = np.sum(np.abs(slopes) * half_widths, axis=1)
        rest = radius[boxes, worst] - reach
        away = np.sign(slopes) * np.where(middle[boxes, worst] < 0.0, -1.0, 1.0)[:, None]
        corner = centres + away * half_widths
        return Bounds(height + reach + rest, height + reach - rest, corner, gaps)

    def _rounded(self, line: Lines, group: _Group, sizes: list[np.ndarray]) -> Lines:
        """Return linear enclosures of nodes, enlarged by the rounding error of their evaluation.

        line: enclosures without rounding error
        group: the nodes
        sizes: for each group of variables, the bounds on |v|, (boxes, variables)
        """
        rounding = np.abs(line.constant)
        for slope, argument in zip(line.slopes, group.arguments, strict=True):
            rounding = rounding + np.abs(slope) * _sizes_of(argument, sizes)
        radius = line.radius + self._gamma * rounding + _TINY
        return line._replace(radius=np.where(rounding <= _LARGEST, radius, np.inf))

    def _back(self, blocks: _Blocks, sizes: list[np.ndarray], lines: list[Lines]) -> _Affine:
        """Return rows of inputs and nodes as rows of the inputs alone, with radii.

        The nodes are replaced by their linear enclosures, from the last group to the first.

        blocks: the rows, as returned by `_dense`
        sizes: for each group, the bounds on |v|, (boxes, variables)
        lines: enclosures of the nodes of each group
        """
        rows = {group: block[None] for group, block in blocks.items()}
        radius = self._gamma * _sizes_of(blocks, sizes)
        spreads: _Blocks = {}
        for group in range(len(lines), 0, -1):
            if group not in rows:
                continue
            line = lines[group - 1]
            coefficients = rows.pop(group)
            spreads[group] = np.abs(coefficients) * line.radius[:, None, :]
            radius = radius + spreads[group].sum(axis=2)
            for slope, argument in zip(line.slopes, self._groups[group - 1].arguments, strict=True):
                scaled = coefficients * slope[:, None, :]
                for before, block in argument.items():
                    part = _times(scaled, block)
                    rows[before] = rows[before] + part if before in rows else part
            rows[0][:, :, 0] += np.matmul(coefficients, line.constant[:, :, None])[:, :, 0]
        inputs = np.broadcast_to(rows[0], (len(radius), *rows[0].shape[1:]))
        return _Affine(inputs[:, :, 1:], inputs[:, :, 0], (1.0 + self._gamma) * radius, spreads)

    def _range(
        self, affine: _Affine, centres: np.ndarray, half_widths: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the middle and the half-width of each row's range over each box, (boxes, rows).

        affine: the rows, as rows of the inputs
        centres, half_widths: (boxes, n)
        """
        middle = affine.constant + np.matmul(affine.slopes, centres[:, :, None])[:, :, 0]
        sizes = np.abs(affine.slopes)
        radius = affine.radius + np.matmul(sizes, half_widths[:, :, None])[:, :, 0]
        terms = np.abs(affine.constant) + np.matmul(sizes, np.abs(centres)[:, :, None])[:, :, 0]
        return middle, radius + self._gamma * (terms + radius) + _TINY


def _dense(argument: Argument, program: Program) -> _Blocks:
    """Return the coefficients of rows as dense matrices."""
    blocks = {
        group: block if isinstance(block, np.ndarray) else block.toarray()
        for group, block in argument.blocks.items()
    }
    count = next((len(block) for block in blocks.values()), 1)
    return {0: np.zeros((count, program.widths[0])), **blocks}


def _sizes_of(blocks: _Blocks, sizes: Sequence[np.ndarray]) -> np.ndarray:
    """Return Σ_j |w_j| |v_j| for each row w, (boxes, rows).

    blocks: coefficients w, as returned by `_dense`
    sizes: for each group, the bounds on |v_j|, (boxes, variables)
    """
    terms = [sizes[group] @ np.abs(block).T for group, block in blocks.items()]
    return np.sum(terms, axis=0)


def _times(stack: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return the matrix product stack @ matrix, (boxes, rows, columns).

    stack: (boxes, rows, inner)
    matrix: (inner, columns)
    """
    boxes, rows, inner = stack.shape
    return (stack.reshape(boxes * rows, inner) @ matrix).reshape(boxes, rows, -1)
