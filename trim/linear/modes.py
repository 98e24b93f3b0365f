"""Eigenvalues as an engineer reads them: named by participation, with damping, frequency and times;
followed along a path of linear models by the continuity of their eigenvectors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import refuse_unknown
from hfa_support.reporting.text import Table, eigenvalue_text

#: More than a permutation of eigenvalues gains: what it adds is decided first.
_PAIRED = 1e3


@dataclass(frozen=True)
class Mode:
    """One real eigenvalue or one conjugate pair λ = -ζ ω_n ± i ω_n sqrt(1 - ζ²).

    eigenvalue: 1/s, imaginary part >= 0. damping: ζ = -Re λ / |λ|. frequency: ω_n = |λ|, rad/s.
    period: 2π / Im λ, s, inf when real. time_to_half: -ln 2 / Re λ, s, inf unless stable.
    time_to_double: ln 2 / Re λ, s, inf unless unstable. participation: state -> share, sums to 1.
    """

    name: str
    eigenvalue: complex
    damping: float
    frequency: float
    period: float
    time_to_half: float
    time_to_double: float
    stable: bool
    participation: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON; infinite times become null."""
        row = asdict(self)
        row["eigenvalue"] = [self.eigenvalue.real, self.eigenvalue.imag]
        for key in ("period", "time_to_half", "time_to_double"):
            row[key] = row[key] if math.isfinite(row[key]) else None
        return row


def modes_of(
    A: np.ndarray,
    states: tuple[str, ...],
    families: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> tuple[Mode, ...]:
    """Modes of x' = A x, fastest first; a conjugate pair is one mode.

    Participation of state k in mode i: |w_ki v_ki| / Σ_k |w_ki v_ki| with right and left
    eigenvectors v, w (Perez-Arriaga, Verghese, Schweppe 1982). A mode takes the name of the family
    of states with the largest share, or of the state where that is in no family; when two modes
    fall to one family, the faster is called "fast", the slower "slow"."""
    eigenvalues, right = np.linalg.eig(A)
    weights = np.abs(right * np.linalg.pinv(right).T)
    shares = weights / weights.sum(axis=0)
    named = {state for members in families.values() for state in members}
    known = {**families, **{state: (state,) for state in states if state not in named}}
    found = []
    for index in np.argsort(-np.abs(eigenvalues), kind="stable"):
        if (value := complex(eigenvalues[index])).imag >= 0.0:
            taking = dict(zip(states, shares[:, index].tolist(), strict=True))
            family = max(
                known, key=lambda name: sum(taking.get(state, 0.0) for state in known[name])
            )
            found.append((family, value, taking))
    modes = []
    for index, (family, value, taking) in enumerate(found):
        same = [i for i, (other, _, _) in enumerate(found) if other == family]
        words = (
            ["fast", "slow"]
            if len(same) == 2
            else [str(number) for number in range(1, len(same) + 1)]
        )
        name = family if len(same) == 1 else f"{family} ({words[same.index(index)]})"
        modes.append(_mode(name, value, taking))
    return tuple(modes)


def _mode(name: str, value: complex, participation: dict[str, float]) -> Mode:
    frequency, decay = abs(value), -value.real
    half, double = (math.log(2) / rate if rate > 0 else math.inf for rate in (decay, -decay))
    period = 2 * math.pi / value.imag if value.imag > 0 else math.inf
    damping = decay / frequency if frequency > 0 else 0.0
    return Mode(name, value, damping, frequency, period, half, double, decay > 0, participation)


def modes_table(modes: Iterable[Mode]) -> Table:
    """The mode table."""
    rows = [
        (
            mode.name,
            eigenvalue_text(mode.eigenvalue),
            *(f"{value:.4f}" for value in (mode.damping, mode.frequency)),
            f"{mode.period:.3f}" if math.isfinite(mode.period) else "-",
            _time_to(mode),
            ", ".join(
                f"{name} {share:.0%}"
                for name, share in sorted(mode.participation.items(), key=lambda item: -item[1])[:2]
            ),
        )
        for mode in modes
    ]
    names = (
        "mode",
        "eigenvalue 1/s",
        "damping",
        "frequency rad/s",
        "period s",
        "time to, s",
        "participation",
    )
    return Table(names, rows)


def _time_to(mode: Mode) -> str:
    time, word = (mode.time_to_half, "half") if mode.stable else (mode.time_to_double, "double")
    return f"{time:.3f} ({word})" if math.isfinite(time) else "-"


def _order(eigenvalues: np.ndarray) -> np.ndarray:
    return np.lexsort((-eigenvalues.imag, -np.round(np.abs(eigenvalues), 9)))


def fastest_first(eigenvalues: np.ndarray) -> np.ndarray:
    """Each row (.., n) sorted: fastest first, of a pair the positive imaginary part first."""
    return np.take_along_axis(eigenvalues, _order(eigenvalues), axis=-1).astype(complex)


def track_modes(
    A: np.ndarray, states: tuple[str, ...], model: Model, neighbours: np.ndarray | None = None
) -> np.ndarray:
    """Eigenvalues (N, n) of N system matrices (N, n, n) paired so that a column follows one mode.

    neighbours: (M, 2) pairs of points that lie next to each other; None for points along a path.
    Two neighbours are paired by the permutation that maximizes Σ |v_i^H w_i|² - |λ_i - μ_i| /
    (|λ_i| + |μ_i|), conjugate pairs first and with both members: the first term (modal assurance
    criterion, on states in units of their nominal values) holds on to the shape of a mode where
    eigenvalues cross, the second tells the two members of a pair apart. From the first point on,
    the pairings are followed along the tree of neighbours that are most alike. The first point is
    ordered fastest first, positive imaginary part first."""
    for name in states:
        refuse_unknown("unknown state", name, model.states)
    values, vectors = np.linalg.eig(A)
    scales = np.array([model.states[name].nominal for name in states])
    shapes = vectors / scales[:, None]
    shapes = shapes / np.linalg.norm(shapes, axis=1, keepdims=True)
    order = np.empty(values.shape, dtype=int)
    order[0] = _order(values[0])
    for point, before, pairing in _tree(values, shapes, neighbours):
        order[point] = pairing[order[before]]
    return np.take_along_axis(values.astype(complex), order, axis=1)


def _tree(
    values: np.ndarray, shapes: np.ndarray, neighbours: np.ndarray | None
) -> Iterable[tuple[int, int, np.ndarray]]:
    """Every point but the first, a neighbour that comes before it, and the matching eigenvalues of
    that one."""
    points = np.arange(len(values))
    path = np.stack([points[:-1], points[1:]], axis=-1)
    if neighbours is None or np.array_equal(neighbours, path):
        yield from zip(
            range(1, len(points)),
            range(len(points) - 1),
            _pairings(values, shapes, path)[0],
            strict=True,
        )
        return
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import (
        breadth_first_order,
        connected_components,
        minimum_spanning_tree,
    )

    shape = (len(points), len(points))
    joined = connected_components(
        csr_array((np.ones(len(neighbours)), tuple(neighbours.T)), shape), directed=False
    )[1]
    # The path joins what the neighbours leave apart.
    pairs = np.concatenate([neighbours, path[joined[path[:, 0]] != joined[path[:, 1]]]])
    pairings, gain = _pairings(values, shapes, pairs)
    alike, rank = np.argsort(-gain), np.empty(len(pairs))
    rank[alike] = np.arange(1.0, len(pairs) + 1)
    tree = minimum_spanning_tree(csr_array((rank, tuple(pairs.T)), shape))
    order, before = breadth_first_order(tree, 0, directed=False)
    numbers = alike[
        np.asarray((tree + tree.T)[before[order[1:]], order[1:]]).astype(int).ravel() - 1
    ]
    for point, number in zip(order[1:].tolist(), numbers.tolist(), strict=True):
        found, first = pairings[number], int(before[point])
        yield point, first, found if pairs[number, 0] == first else np.argsort(found)


def _pairings(
    values: np.ndarray, shapes: np.ndarray, pairs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(M, n): the eigenvalue of the second point of a pair that matches each of the first; and the
    sum that it maximizes, (M,)."""
    found, sums = np.empty((len(pairs), values.shape[1]), dtype=int), np.empty(len(pairs))
    for begin in range(0, len(pairs), 10_000):
        rows = slice(begin, begin + 10_000)
        before, after = values[pairs[rows, 0]], values[pairs[rows, 1]]
        one, other = shapes[pairs[rows, 0]], shapes[pairs[rows, 1]]
        likeness = np.abs(np.einsum("nki,nkj->nij", one.conj(), other)) ** 2
        distance = np.abs(before[:, :, None] - after[:, None, :])
        size = np.abs(before)[:, :, None] + np.abs(after)[:, None, :]
        gain = likeness - distance / np.maximum(size, 1e-12)
        best = gain.argmax(axis=2)
        # Where every row's favourite is another column the favourites are the optimal permutation
        # already.
        for i in np.flatnonzero(
            (np.sort(best, axis=1) != np.arange(best.shape[1])).any(axis=1)
        ).tolist():
            from scipy.optimize import linear_sum_assignment

            up, up_after = (np.flatnonzero(each.imag > 0) for each in (before[i], after[i]))
            first, second = linear_sum_assignment(gain[i][np.ix_(up, up_after)], maximize=True)
            forced = gain[i].copy()
            for member in (0, 1):  # a pair has both its members side by side
                forced[up[first] + member, up_after[second] + member] += _PAIRED
            best[i] = linear_sum_assignment(forced, maximize=True)[1]
        found[rows] = best
        sums[rows] = np.take_along_axis(gain, best[:, :, None], axis=2)[:, :, 0].sum(axis=1)
    return found, sums
