"""Modes followed through the points of a sweep by the continuity of their eigenvectors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import refuse_unknown
from trim.linear.modes import order_fastest_first

#: More than a permutation of eigenvalues gains: what it adds is decided first.
_PAIRED = 1e3
#: Pairs of points that are compared at once.
_AT_ONCE = 10_000


class _Step(NamedTuple):
    """From one point to a neighbour.

    point, before: numbers of the neighbour and of the point that it is reached from.
    pairing: (n,) the eigenvalue at `point` that matches each at `before`.
    """

    point: int
    before: int
    pairing: np.ndarray


def track_modes(
    A: np.ndarray, states: tuple[str, ...], model: Model, neighbours: np.ndarray | None = None
) -> np.ndarray:
    """Eigenvalues (N, n) of N system matrices (N, n, n), paired so that a column follows one mode.

    states: names of the rows of each matrix, states of the model.
    neighbours: (M, 2) pairs of points that lie next to each other; None for points along a path.

    Two neighbours are paired by the permutation that maximizes Σ |v_i^H w_i|² - |λ_i - μ_i| /
    (|λ_i| + |μ_i|), conjugate pairs first and with both members: the first term (modal assurance
    criterion, on states in units of their nominal values) holds on to the shape of a mode where
    eigenvalues cross, the second tells the two members of a pair apart. From the first point on,
    the pairings are followed along the tree of neighbours that are most alike. The first point is
    ordered fastest first, positive imaginary part first.
    """
    for name in states:
        refuse_unknown("unknown state", name, model.states)
    values, vectors = np.linalg.eig(A)
    nominal = np.array([model.states[name].nominal for name in states])
    shapes = vectors / nominal[:, None]
    shapes = shapes / np.linalg.norm(shapes, axis=1, keepdims=True)

    points = np.arange(len(values))
    path = np.stack([points[:-1], points[1:]], axis=-1)
    if neighbours is None or np.array_equal(neighbours, path):
        steps = _along(path, values, shapes)
    else:
        steps = _along_tree(_connected(neighbours, path), values, shapes)
    order = np.empty(values.shape, dtype=int)
    order[0] = order_fastest_first(values[0])
    for step in steps:
        order[step.point] = step.pairing[order[step.before]]
    return np.take_along_axis(values.astype(complex), order, axis=1)


def _along(path: np.ndarray, values: np.ndarray, shapes: np.ndarray) -> Iterator[_Step]:
    """The steps of a path, in its order."""
    pairings, _ = _pairings(values, shapes, path)
    for (before, point), pairing in zip(path.tolist(), pairings, strict=True):
        yield _Step(point, before, pairing)


def _connected(neighbours: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Pairs of points that join all N points, (M, 2): the neighbours, and those pairs of the path
    whose two points the neighbours do not join.

    neighbours: (K, 2), pairs of points
    path: (N - 1, 2), the pairs (0, 1), (1, 2), ...
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    count = len(path) + 1
    ones = np.ones(len(neighbours))
    graph = csr_array((ones, tuple(neighbours.T.astype(np.int32))), (count, count))
    _, component = connected_components(graph, directed=False)
    apart = component[path[:, 0]] != component[path[:, 1]]
    return np.concatenate([neighbours, path[apart]])


def _along_tree(pairs: np.ndarray, values: np.ndarray, shapes: np.ndarray) -> Iterator[_Step]:
    """The steps of the tree of pairs that are most alike, from the first point on."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    count = len(values)
    pairings, gain = _pairings(values, shapes, pairs)
    most_alike = np.argsort(-gain)
    rank = np.empty(len(pairs))
    rank[most_alike] = np.arange(1.0, len(pairs) + 1)
    graph = csr_array((rank, tuple(pairs.T.astype(np.int32))), (count, count))
    tree = minimum_spanning_tree(graph)
    order, predecessors = breadth_first_order(tree, 0, directed=False)
    both_ways = tree + tree.T
    for point in order[1:].tolist():
        before = int(predecessors[point])
        number = most_alike[int(both_ways[before, point]) - 1]
        forward = pairs[number, 0] == before
        yield _Step(point, before, pairings[number] if forward else np.argsort(pairings[number]))


def _pairings(
    values: np.ndarray, shapes: np.ndarray, pairs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """How the eigenvalues of the two points of each pair match, and the gain of that matching.

    values: (N, n), eigenvalues of each point
    shapes: (N, n, n), their eigenvectors, columns of unit length
    pairs: (M, 2), pairs of points

    Returns, (M, n), for every eigenvalue of the first point the number of the one at the second,
    and, (M,), the sum of gains that this maximizes.
    """
    matches = np.empty((len(pairs), values.shape[1]), dtype=int)
    sums = np.empty(len(pairs))
    for begin in range(0, len(pairs), _AT_ONCE):
        rows = slice(begin, begin + _AT_ONCE)
        first, second = pairs[rows].T
        gain = _gain(values[first], values[second], shapes[first], shapes[second])
        best = gain.argmax(axis=2)
        # Where every row's favourite is another column the favourites are the best permutation.
        shared = (np.sort(best, axis=1) != np.arange(best.shape[1])).any(axis=1)
        for i in np.flatnonzero(shared).tolist():
            best[i] = _best_permutation(gain[i], values[first[i]], values[second[i]])
        matches[rows] = best
        sums[rows] = np.take_along_axis(gain, best[:, :, None], axis=2)[:, :, 0].sum(axis=1)
    return matches, sums


def _gain(
    values: np.ndarray, other_values: np.ndarray, shapes: np.ndarray, other_shapes: np.ndarray
) -> np.ndarray:
    """|v_i^H w_j|² - |λ_i - μ_j| / (|λ_i| + |μ_j|), (M, n, n): the gain of matching eigenvalue i of
    a point with j of the other."""
    likeness = np.abs(np.einsum("nki,nkj->nij", shapes.conj(), other_shapes)) ** 2
    distance = np.abs(values[:, :, None] - other_values[:, None, :])
    size = np.abs(values)[:, :, None] + np.abs(other_values)[:, None, :]
    return likeness - distance / np.maximum(size, 1e-12)


def _best_permutation(gain: np.ndarray, values: np.ndarray, others: np.ndarray) -> np.ndarray:
    """The permutation (n,) of largest gain (n, n) that keeps both members of a conjugate pair
    together.

    Where a pair meets two real eigenvalues both ways gain the same: the member of positive
    imaginary part matches the lower one."""
    from scipy.optimize import linear_sum_assignment

    upper = np.flatnonzero(values.imag > 0)
    other_upper = np.flatnonzero(others.imag > 0)
    rows, columns = linear_sum_assignment(gain[np.ix_(upper, other_upper)], maximize=True)
    forced = gain.copy()
    for member in (0, 1):  # the members of a pair are neighbours
        forced[upper[rows] + member, other_upper[columns] + member] += _PAIRED
    matches = linear_sum_assignment(forced, maximize=True)[1]
    for first in upper.tolist():
        members = [first, first + 1]
        if not others[matches[members]].imag.any():
            matches[members] = _lower_first(matches[members], others)
    origins = np.argsort(matches)
    for first in other_upper.tolist():
        members = [first, first + 1]
        if not values[origins[members]].imag.any():
            origins[members] = _lower_first(origins[members], values)
    return np.argsort(origins)


def _lower_first(numbers: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Numbers of real eigenvalues, the lower value first."""
    return np.array(sorted(numbers.tolist(), key=lambda number: values[number].real))
