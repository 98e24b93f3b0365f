"""Tracking of modes through the points of a sweep, by continuity of their eigenvectors."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import refuse_unknown
from hfa_support.matrices import ROUNDING
from trim.linear.modes import modes_of, order_fastest_first

#: Gain for keeping conjugate pairs together; it exceeds every other gain.
_GAIN_OF_CONJUGATES = 1e3
#: Weight of the distance of two eigenvalues compared with the similarity of their shapes. Two modes
#: that interchange nearly parallel shapes keep their eigenvalues if these are far apart.
_WEIGHT_OF_DISTANCE = 2.0
#: Weight of an order that decides between equal gains; smaller than any difference of gains.
_TIE_BREAK = 1e-9
#: Number of pairs of points that are compared together.
_PAIRS_AT_ONCE = 10_000
#: Eigenvectors whose smallest singular value is below this fraction of the largest belong to modes
#: that coincide: roundings separate a double eigenvalue, and its eigenvectors, by the root of eps.
_PARALLEL = float(np.sqrt(np.finfo(float).eps))


class _Modes(NamedTuple):
    """Eigenvalues and eigenvectors of A at one point or at many points."""

    values: np.ndarray  # (.., n), eigenvalues
    right: np.ndarray  # (.., n, n), eigenvectors as columns
    left: np.ndarray  # (.., n, n), left eigenvectors as rows; left right = 1

    def at(self, points: np.ndarray) -> _Modes:
        """Return all modes of the points with these indices."""
        return _Modes(self.values[points], self.right[points], self.left[points])


def track_modes(
    A: np.ndarray, states: tuple[str, ...], model: Model, neighbors: np.ndarray
) -> np.ndarray:
    """Return the eigenvalues (N, n) of N matrices (N, n, n), with one mode in each column.

    The eigenvalues λ and μ of two neighbors are paired by the permutation that maximizes the sum of

      min(|tr P_i Q_i|, 1) - 2 |λ_i - μ_i| / (|λ_i| + |μ_i|)

    P_i and Q_i are the projectors on a mode along all other modes. The first term preserves the
    shape of a mode where eigenvalues cross. The second one distinguishes the two members of a pair.
    Conjugate pairs are paired first. The first point is sorted as in `fastest_first`. From there,
    the pairings are followed along the tree of the most similar neighbors. The columns of modes
    that cross between two points can be interchanged if their shapes are nearly parallel or change
    much from point to point, and where they coincide at a point of the grid. A finer grid avoids
    such interchanges.

    A: (N, n, n)
    states: names of the rows of each matrix, states of the model
    model: model of the aircraft
    neighbors: (M, 2), pairs of adjacent points

    Raises BadInputError for an unknown state.
    """
    for name in states:
        refuse_unknown("unknown state", name, model.states)
    nominal = model.nominal(states)
    path = np.arange(len(A) - 1)[:, None] + [0, 1]  # through all points, in their order
    pairs = _connected(neighbors, path)
    paired = _paired(A, nominal, pairs)
    order = np.empty(paired.values.shape, dtype=int)  # number of the eigenvalue in each column
    order[0] = order_fastest_first(paired.values[0])
    for before, point, match in _along_tree(pairs, paired):
        order[point] = match[order[before]]
    return np.take_along_axis(paired.values, order, axis=1)


def _modes(A: np.ndarray, nominal: np.ndarray) -> _Modes:
    """Return the modes of N matrices, with eigenvectors of length 1 in nominal values."""
    # Shapes are then compared independently of the units of the states.
    values, vectors = np.linalg.eig(A)
    right = vectors / nominal[:, None]
    right = right / np.linalg.norm(right, axis=1, keepdims=True)
    return _Modes(values, right, _inverse(right))


def _inverse(right: np.ndarray) -> np.ndarray:
    """Return the inverse of eigenvectors (N, n, n), their pseudo-inverse if modes coincide."""
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return np.linalg.pinv(right, rcond=_PARALLEL)
    have_coinciding_modes = ~(np.abs(left).max(axis=(1, 2)) < 1.0 / _PARALLEL)
    left[have_coinciding_modes] = np.linalg.pinv(right[have_coinciding_modes], rcond=_PARALLEL)
    return left


def _connected(neighbors: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Return pairs (M, 2) that connect all points: neighbors, and the path between groups."""
    # path: (N - 1, 2), pairs of consecutive points, through all N points
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    points = len(path) + 1
    ones = np.ones(len(neighbors))
    graph = csr_array((ones, tuple(neighbors.T.astype(np.int32))), (points, points))
    _, component = connected_components(graph, directed=False)
    apart = component[path[:, 0]] != component[path[:, 1]]
    return np.concatenate([neighbors, path[apart]])


class _Paired(NamedTuple):
    """Eigenvalues of N points, and their best pairings at M pairs of points."""

    values: np.ndarray  # (N, n), eigenvalues
    matches: np.ndarray  # (M, n), index at the second point for each eigenvalue of the first one
    gains: np.ndarray  # (M,), the sum that the pairing maximizes (`track_modes`)


def _along_tree(pairs: np.ndarray, paired: _Paired) -> Iterator[tuple[int, int, np.ndarray]]:
    """Yield (predecessor, point, match) along the tree of the most similar neighbors from point 0.

    match: index at the point for each eigenvalue of the predecessor, (n,)
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    count = len(paired.values)
    by_gain = np.argsort(-paired.gains)  # indices of the pairs, the most similar one first
    rank = np.empty(len(pairs))  # 1 for the most similar pair: the graph has no edge of weight 0
    rank[by_gain] = np.arange(1.0, len(pairs) + 1)
    graph = csr_array((rank, tuple(pairs.T.astype(np.int32))), (count, count))
    tree = minimum_spanning_tree(graph).tocoo()  # of the smallest ranks
    order, predecessors = breadth_first_order(tree, 0, directed=False)

    pair_to = np.empty(count, dtype=int)  # index of the pair that leads to each point
    ends = np.where(predecessors[tree.col] == tree.row, tree.col, tree.row)
    pair_to[ends] = by_gain[tree.data.astype(int) - 1]
    for point in order[1:].tolist():
        match = paired.matches[pair_to[point]]
        if pairs[pair_to[point], 1] != point:  # the pair is stored in the other direction
            match = np.argsort(match)  # the inverse permutation
        yield int(predecessors[point]), point, match


def _paired(A: np.ndarray, nominal: np.ndarray, pairs: np.ndarray) -> _Paired:
    """Return the eigenvalues of N matrices, and their best pairings at M pairs of points."""
    # Eigenvectors are computed for `_PAIRS_AT_ONCE` pairs at a time.
    values = np.empty(A.shape[:2], dtype=complex)
    values[:1] = _modes(A[:1], nominal).values  # of a single point, which has no pair
    matches = np.empty((len(pairs), A.shape[1]), dtype=int)
    gains = np.empty(len(pairs))
    by_point = np.argsort(pairs.max(axis=1), kind="stable")  # so that a chunk has few points
    for begin in range(0, len(pairs), _PAIRS_AT_ONCE):
        rows = by_point[begin : begin + _PAIRS_AT_ONCE]
        points, places = np.unique(pairs[rows], return_inverse=True)
        modes = _modes(A[points], nominal)
        values[points] = modes.values
        matches[rows], gains[rows] = _pairings(modes, places.reshape(-1, 2))
    return _Paired(values, matches, gains)


def _pairings(modes: _Modes, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the best pairing of the eigenvalues at the two points of each of M pairs of points,
    (M, n), and its sum of gains, (M,).

    The gain of pairing two eigenvalues is the similarity of their mode shapes minus a multiple of
    their relative distance (`_gain_of_pairing`).

    modes: of all points
    pairs: indices of the two points, (M, 2)
    """
    first, second = pairs.T
    gain = _gain_of_pairing(modes.at(first), modes.at(second))
    best = gain.argmax(axis=2)
    # If the best column of each row is a different one, these columns are the best permutation,
    # unless a conjugate pair at one point is two real eigenvalues at the other: both members of the
    # conjugate pair have equal gains with a real eigenvalue.
    is_shared = (np.sort(best, axis=1) != np.arange(best.shape[1])).any(axis=1)
    conjugate_pairs = np.count_nonzero(modes.values.imag > 0.0, axis=1)  # number at each point
    becomes_real = conjugate_pairs[first] != conjugate_pairs[second]
    for i in np.flatnonzero(is_shared | becomes_real).tolist():
        best[i] = _best_permutation(gain[i], modes.values[first[i]], modes.values[second[i]])
    return best, np.take_along_axis(gain, best[:, :, None], axis=2)[:, :, 0].sum(axis=1)


def _gain_of_pairing(modes: _Modes, others: _Modes) -> np.ndarray:
    """Return the gain of pairing eigenvalue λ_i of a point with μ_j of another, (.., n, n).

    The gain is min(|tr P_i Q_j|, 1) - `_WEIGHT_OF_DISTANCE` |λ_i - μ_j| / (|λ_i| + |μ_j|), with the
    projectors P_i = r_i l_i' and Q_j = s_j m_j' of right and left eigenvectors:
    tr P_i Q_j = l_i's_j m_j'r_i.
    """
    across = (modes.left @ others.right) * (others.left @ modes.right).swapaxes(-1, -2)
    distance = np.abs(modes.values[..., None] - others.values[..., None, :])
    speed, other_speed = np.abs(modes.values), np.abs(others.values)
    size = speed[..., None] + other_speed[..., None, :]
    fastest = speed.max(axis=-1) + other_speed.max(axis=-1)
    # Eigenvalues below the rounding of the fastest ones are at no relative distance.
    least = np.where(fastest > 0.0, ROUNDING * fastest, 1.0)[..., None, None]
    return np.minimum(np.abs(across), 1.0) - _WEIGHT_OF_DISTANCE * distance / np.maximum(
        size, least
    )


def _best_permutation(gain: np.ndarray, values: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the pairing of the eigenvalues of two points with the largest gain, (n,)."""
    from scipy.optimize import linear_sum_assignment

    # Conjugate pairs, whose members are neighbors in order, are kept together.
    first_members = np.flatnonzero(values.imag > 0)
    other_first_members = np.flatnonzero(others.imag > 0)
    gain_of_pairs = gain[np.ix_(first_members, other_first_members)]
    pairs, other_pairs = linear_sum_assignment(gain_of_pairs, maximize=True)
    adjusted = gain.copy()
    for member in (0, 1):
        matched = first_members[pairs] + member, other_first_members[other_pairs] + member
        adjusted[matched] += _GAIN_OF_CONJUGATES

    # If a pair becomes two real eigenvalues, or the reverse, its members have equal gains: the
    # member with positive imaginary part then matches the lower real eigenvalue.
    rank, other_rank = (roots.real.argsort().argsort() for roots in (values, others))
    adjusted -= _TIE_BREAK * np.outer(np.sign(values.imag), other_rank)
    adjusted -= _TIE_BREAK * np.outer(rank, np.sign(others.imag))
    _, best = linear_sum_assignment(adjusted, maximize=True)
    return np.asarray(best)


def neighbors_in_grid(sizes: list[int], trimmed: np.ndarray) -> np.ndarray:
    """Return pairs of neighbors among the trimmed points of a grid, (M, 2), which are numbered
    among the trimmed points.

    Neighbors are adjacent along a line of the grid. Points without a trim between them are skipped.

    sizes: number of points along each axis
    trimmed: (N,), mask of the points with a trim
    """
    numbers = np.cumsum(trimmed) - 1  # of each point among the trimmed ones
    index = np.arange(trimmed.size).reshape(sizes)
    pairs = []
    for axis, size in enumerate(sizes):
        along = np.moveaxis(index, axis, -1).ravel()  # all points, line after line along the axis
        line = np.arange(trimmed.size) // size  # number of the line of each
        kept = trimmed[along]
        along = along[kept]
        line = line[kept]
        same_line = line[1:] == line[:-1]
        pairs.append(np.stack([along[:-1][same_line], along[1:][same_line]], axis=-1))
    return np.asarray(numbers[np.concatenate(pairs)])


def mode_names_of(eigenvalues: np.ndarray, A: np.ndarray, model: Model) -> tuple[str, ...]:
    """Return the name of the mode of A, (k, k), that belongs to each of its eigenvalues, (k,)."""
    modes = modes_of(A, model.linear, model.modes)
    names = []
    for value in eigenvalues:
        upper = complex(value.real, abs(value.imag))
        nearest = min(modes, key=lambda mode: abs(mode.eigenvalue - upper))
        names.append(nearest.name)
    return tuple(names)
