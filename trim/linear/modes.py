"""Eigenvalues as an engineer reads them: named by participation, with damping, frequency and times; followed along a
path of linear models by the continuity of their eigenvectors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from hfa_model.aircraft import HFA
from hfa_support.errors import refuse_unknown
from hfa_support.model import Model
from hfa_support.reporting.text import Table, eigenvalue_text


@dataclass(frozen=True)
class Mode:
    """One real eigenvalue or one conjugate pair λ = -ζ ω_n ± i ω_n sqrt(1 - ζ²).

    eigenvalue: 1/s, imaginary part >= 0. damping: ζ = -Re λ / |λ|. frequency: ω_n = |λ|, rad/s.
    period: 2π / Im λ, s, inf when real. time_to_half: -ln 2 / Re λ, s, inf unless stable. time_to_double: ln 2 / Re λ,
    s, inf unless unstable. participation: state -> share, sums to 1.
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
    A: np.ndarray, states: tuple[str, ...], families: Mapping[str, tuple[str, ...]] = HFA.modes
) -> tuple[Mode, ...]:
    """Modes of x' = A x, fastest first; a conjugate pair is one mode.

    Participation of state k in mode i: |w_ki v_ki| / Σ_k |w_ki v_ki| with right and left eigenvectors v, w
    (Perez-Arriaga, Verghese, Schweppe 1982). A mode takes the name of the family of states with the largest
    share, or of the state where that is in no family; when two modes fall to one family, the faster is called "fast",
    the slower "slow".
    """
    eigenvalues, right = np.linalg.eig(A)
    left = np.linalg.pinv(right)
    weights = np.abs(right * left.T)
    shares = weights / weights.sum(axis=0)
    found = []
    for index in np.argsort(-np.abs(eigenvalues), kind="stable"):
        value = complex(eigenvalues[index])
        if value.imag >= 0.0:
            found.append((value, dict(zip(states, shares[:, index].tolist(), strict=True))))
    named = {state for members in families.values() for state in members}
    known = {**families, **{state: (state,) for state in states if state not in named}}
    names = [_family(participation, known) for _, participation in found]
    return tuple(_mode(_unique_name(names, i), value, participation) for i, (value, participation) in enumerate(found))


def _family(participation: dict[str, float], families: Mapping[str, tuple[str, ...]]) -> str:
    return max(families, key=lambda name: sum(participation.get(state, 0.0) for state in families[name]))


def _unique_name(families: list[str], index: int) -> str:
    same = [i for i, family in enumerate(families) if family == families[index]]
    if len(same) == 1:
        return families[index]
    words = ["fast", "slow"] if len(same) == 2 else [str(number) for number in range(1, len(same) + 1)]
    return f"{families[index]} ({words[same.index(index)]})"


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
    names = "mode", "eigenvalue 1/s", "damping", "frequency rad/s", "period s", "time to, s", "participation"
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
    A: np.ndarray, states: tuple[str, ...], neighbours: np.ndarray | None = None, model: Model = HFA
) -> np.ndarray:
    """Eigenvalues (N, n) of N system matrices (N, n, n) paired so that a column follows one mode.

    neighbours: (M, 2) pairs of points that lie next to each other; None for points along a path. Two neighbours are
    paired by the permutation that maximizes
    Σ |v_i^H w_i|² - |λ_i - μ_i| / (|λ_i| + |μ_i|): the first term (modal assurance criterion, on states in
    units of their nominal values) holds on to the shape of a mode where eigenvalues cross, the second tells the two
    members of a pair apart. From the first point on, the pairings are followed along the tree of neighbours that are
    most alike. The first point is ordered fastest first, positive imaginary part first.
    """
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
    """Every point but the first, a neighbour that comes before it, and the matching eigenvalues of that one."""
    points = np.arange(len(values))
    path = np.stack([points[:-1], points[1:]], axis=-1)
    if neighbours is None or np.array_equal(neighbours, path):
        yield from zip(range(1, len(points)), range(len(points) - 1), _pairings(values, shapes, path)[0], strict=True)
        return
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

    # The path joins what the neighbours leave apart, where nothing better does.
    pairs = np.concatenate([neighbours, path])
    pairings, gain = _pairings(values, shapes, pairs)
    cost = 2.0 * values.shape[1] - gain
    cost[len(neighbours) :] += 1e6
    cheapest = np.lexsort((cost, pairs[:, 1], pairs[:, 0]))
    chosen = cheapest[np.r_[True, (np.diff(pairs[cheapest], axis=0) != 0).any(axis=1)]]
    shape = (len(points), len(points))
    graph = csr_array((cost[chosen], tuple(pairs[chosen].T)), shape)
    order, before = breadth_first_order(minimum_spanning_tree(graph), 0, directed=False)
    number = csr_array((chosen + 1, tuple(pairs[chosen].T)), shape)
    for point in order[1:].tolist():
        forward = int(number[before[point], point])
        found = pairings[(forward or int(number[point, before[point]])) - 1]
        yield point, int(before[point]), found if forward else np.argsort(found)


def _pairings(values: np.ndarray, shapes: np.ndarray, pairs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, n): the eigenvalue of the second point of a pair that matches each of the first; and the sum that it
    maximizes, (M,)."""
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
        # Where every row's favourite is another column the favourites are the optimal permutation already.
        contested = np.flatnonzero((np.sort(best, axis=1) != np.arange(best.shape[1])).any(axis=1))
        if contested.size:
            from scipy.optimize import linear_sum_assignment

            for i in contested:
                best[i] = linear_sum_assignment(gain[i], maximize=True)[1]
        found[rows] = best
        sums[rows] = np.take_along_axis(gain, best[:, :, None], axis=2)[:, :, 0].sum(axis=1)
    return found, sums
