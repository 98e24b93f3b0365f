"""Modes of linear models: names, eigenvalues, damping, frequency and times."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from hfa_support.errors import BadInputError, numbers_in
from hfa_support.matrices import ROUNDING, balanced
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table, eigenvalue_text


@dataclass(frozen=True)
class Mode(Result):
    """Mode with a real eigenvalue, or a conjugate pair λ = -ζ ω_n ± i ω_n sqrt(1 - ζ²).

    Times are in the model's unit of time, by default s.

    name: name, from the family of states with the largest participation, or a number.
    eigenvalue: λ, 1/s, with imaginary part >= 0; 0 within rounding.
    damping: damping ratio ζ = -Re λ / |λ|, 0 for λ = 0.
    frequency: natural frequency ω_n = |λ|, rad/s.
    period: 2π / Im λ, s, inf for a real eigenvalue.
    time_to_half: -ln 2 / Re λ, s, inf for Re λ >= 0.
    time_to_double: ln 2 / Re λ, s, inf for Re λ <= 0.
    stable: True if Re λ < 0.
    participation: state -> participation; the sum is 1.
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


#: Smallest participation that a table of modes prints.
_LEAST_PRINTED = 0.005
#: Least participation of a family in a mode that is named after it instead of another family.
_SHARED = 0.25


class Spectrum(NamedTuple):
    """Eigenvalues of a matrix (n, n), with bounds on their errors due to rounding.

    values: (n,); an eigenvalue or a real part that is not larger than its error is replaced by 0
    errors: (n,), absolute
    right: (n, n), eigenvectors as columns
    left: (n, n), left eigenvectors as rows
    """

    values: np.ndarray
    errors: np.ndarray
    right: np.ndarray
    left: np.ndarray


def modes_of(
    A: np.ndarray,
    states: tuple[str, ...],
    families: Mapping[str, tuple[str, ...]] = MappingProxyType({}),
) -> tuple[Mode, ...]:
    """Return the modes of x' = A x, fastest first. A conjugate pair is one mode.

    The participation of state k in mode i is |w_ki v_ki| / Σ_k |w_ki v_ki|, with right and left
    eigenvectors v, w (Perez-Arriaga, Verghese, Schweppe 1982). A mode is named after the family of
    states with the largest participation. One in which a state without a family participates most
    has a number, the fastest "mode 1". A family that names no mode, such as the spiral in a steep
    turn, takes a mode without oscillation from one that names several, if its participation in that
    mode is at least a fourth. More than two eigenvalues 0, whose eigenvectors are arbitrary, are
    named "neutral". Equal names are distinguished by "fast" and "slow", or by numbers if there are
    more than two.

    A: (n, n)
    states: names of the n states
    families: name of a mode -> the states that participate most in it

    Raises BadInputError if A is not a square matrix of finite numbers with one row for each state.

    >>> import numpy as np
    >>> from trim import modes_of
    >>> mode = modes_of(np.array([[0.0, 1.0], [-4.0, -0.4]]), ("position", "velocity"))[0]
    >>> round(mode.damping, 3)
    0.1
    """
    A = numbers_in("A", A)
    n = len(states)
    if A.shape != (n, n):
        raise BadInputError(f"A has shape {A.shape}; give shape {(n, n)}, one row for each state")
    if not np.isfinite(A).all():
        raise BadInputError("A has an entry that is not finite; give finite numbers")
    eigenvalues, _, right, left = spectrum(A)
    weights = np.abs(right * left.T)
    coincide = weights.sum(axis=0) <= np.finfo(float).eps  # w v = 0 for a double eigenvalue
    weights = np.where(coincide, np.abs(right) ** 2, weights)
    shares = weights / weights.sum(axis=0)

    values = []
    participations = []
    for index in np.argsort(-np.abs(eigenvalues), kind="stable"):
        value = complex(eigenvalues[index])
        if value.imag >= 0.0:  # a pair is one mode
            values.append(value)
            participations.append(dict(zip(states, shares[:, index].tolist(), strict=True)))

    in_families = {state for members in families.values() for state in members}
    of_single_states = {state: (state,) for state in states if state not in in_families}
    all_families = {**of_single_states, **families}
    names = []
    for participation in participations:
        by_family = {name: _share(participation, all_families[name]) for name in all_families}
        names.append(max(by_family, key=by_family.__getitem__))
    if np.count_nonzero(eigenvalues == 0.0) > 2:
        names = [
            "neutral" if value == 0.0 else name for name, value in zip(names, values, strict=True)
        ]
    names = _with_missing_families(names, values, participations, families)
    number = count(1)
    named = {*families, "neutral"}
    names = [name if name in named else f"mode {next(number)}" for name in names]
    names = _distinguished(names)
    return tuple(map(_mode, names, values, participations))


def _with_missing_families(
    names: Sequence[str],
    values: Sequence[complex],
    participations: Sequence[Mapping[str, float]],
    families: Mapping[str, Iterable[str]],
) -> list[str]:
    """Return names of modes, in which a family that names none takes a mode from one with several.

    The family takes the mode without oscillation in which it participates most, if its share is at
    least `_SHARED`.
    """
    named = list(names)
    for family in [name for name in families if name not in named]:
        shares = {
            mode: _share(participations[mode], families[family])
            for mode, name in enumerate(named)
            if name in families and named.count(name) > 1 and values[mode].imag == 0.0
        }
        largest = max(shares, key=shares.__getitem__, default=None)
        if largest is not None and shares[largest] >= _SHARED:
            named[largest] = family
    return named


def _share(participation: Mapping[str, float], members: Iterable[str]) -> float:
    """Return the participation of a family of states in a mode."""
    return sum(participation.get(state, 0.0) for state in members)


def spectrum(A: np.ndarray) -> Spectrum:
    """Return the eigenvalues and eigenvectors of A, with bounds on the errors of the eigenvalues.

    The bounds are computed in units of the states, powers of two, in which A is balanced.
    They therefore do not depend on the units of A.

    A: (n, n)
    """
    scaled, units = balanced(A)
    values, right = np.linalg.eig(scaled)
    left = _left_vectors(scaled, values, right)
    errors = _errors_of_eigenvalues(scaled, values, left, right)
    values = np.where(np.abs(values) <= errors, 0.0, values).astype(complex)
    values.real[np.abs(values.real) <= errors] = 0.0
    return Spectrum(values, errors, right * units[:, None], left / units)


def _left_vectors(A: np.ndarray, values: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return left eigenvectors of A of length 1 as rows, (n, n): the inverse of the right ones."""
    # Where right eigenvectors nearly coincide, half of the digits of the inverse or more are wrong
    # in all rows: each row then begins an inverse iteration w (A - λ) = previous w.
    eps = np.finfo(float).eps
    U, singular, Vh = np.linalg.svd(right)
    left = (Vh.conj().T / np.maximum(singular, eps)) @ U.conj().T
    if singular[-1] < np.sqrt(eps):
        # With the transpose (A - λ)ᵀ = Q R, the equation w (A - λ) = v is R wᵀ = Qᴴ vᵀ.
        Q, R = np.linalg.qr((A - values[:, None, None] * np.eye(len(A))).swapaxes(1, 2))
        pivots = np.einsum("kii->ki", R)  # a view of the diagonals
        least = ROUNDING * float(np.linalg.norm(A))
        pivots[np.abs(pivots) < least] = least  # A - λ is singular
        for _ in range(2):  # after one step, the vectors of a defective pair are not yet separated
            left = np.linalg.solve(R, Q.conj().swapaxes(1, 2) @ left[..., None])[..., 0]
            left /= np.abs(left).max(axis=1, keepdims=True)
    return np.asarray(left / np.linalg.norm(left, axis=1, keepdims=True))


def _errors_of_eigenvalues(
    A: np.ndarray, values: np.ndarray, left: np.ndarray, right: np.ndarray
) -> np.ndarray:
    """Return bounds on the errors of the eigenvalues of A, (n,), due to the rounding of A."""
    # The error of a simple eigenvalue is the rounding error of A divided by |w'v| (Wilkinson), with
    # its eigenvectors of length 1. The error of an eigenvalue that coincides with another one is
    # the distance from it at which the smallest singular value of A - s I exceeds the rounding
    # error, both for real and for imaginary distances, or the norm of A.
    eps = np.finfo(float).eps
    norm = float(np.linalg.norm(A))
    rounding = ROUNDING * norm
    cosines = np.abs(np.sum(left * right.T, axis=1))
    errors = rounding / np.maximum(cosines, eps)
    distances = rounding * 4.0 ** np.arange(np.log(1.0 / ROUNDING) / np.log(4.0) + 1.0)
    for i in np.flatnonzero(cosines < np.sqrt(eps)):
        points = values[i] + np.outer(distances, [1.0, 1.0j])
        singular = np.linalg.svd(A - points[..., None, None] * np.eye(len(A)), compute_uv=False)
        outside = (singular[..., -1] > rounding).all(axis=1)
        errors[i] = distances[np.argmax(outside)] if outside.any() else norm
    return np.asarray(errors)


def _distinguished(names: list[str]) -> list[str]:
    """Return names of modes, fastest first, equal ones with "fast" and "slow", or numbers."""
    different = []
    for index, name in enumerate(names):
        count = names.count(name)
        number = names[:index].count(name)
        if count == 1:
            different.append(name)
        elif count == 2:
            different.append(f"{name} ({('fast', 'slow')[number]})")
        else:
            different.append(f"{name} ({number + 1})")
    return different


def _mode(name: str, value: complex, participation: dict[str, float]) -> Mode:
    """Return the mode of an eigenvalue, with its damping, frequency and times."""
    frequency = abs(value)
    decay = 0.0 - value.real  # decay rate -Re λ, without -0
    return Mode(
        name=name,
        eigenvalue=value,
        damping=decay / frequency if frequency > 0 else 0.0,
        frequency=frequency,
        period=2 * math.pi / value.imag if value.imag > 0 else math.inf,
        time_to_half=math.log(2) / decay if decay > 0 else math.inf,
        time_to_double=math.log(2) / -decay if decay < 0 else math.inf,
        stable=decay > 0,
        participation=participation,
    )


def modes_table(modes: Iterable[Mode], time: str, *, participation: bool = True) -> Table:
    """Return a table of modes, one row each.

    time: unit of time of the eigenvalues
    participation: whether to include the states with the largest participation
    """
    rows = []
    for mode in modes:
        largest = sorted(mode.participation.items(), key=lambda item: -item[1])[:2]
        largest = [(state, share) for state, share in largest if share >= _LEAST_PRINTED]
        row = (
            mode.name,
            eigenvalue_text(mode.eigenvalue),
            f"{mode.damping:.4f}",
            f"{mode.frequency:.4g}",
            f"{mode.period:.4g}" if math.isfinite(mode.period) else "-",
            _time_to(mode),
            ", ".join(f"{state} {share:.0%}" for state, share in largest),
        )
        rows.append(row if participation else row[:-1])
    header = (
        "mode",
        f"eigenvalue 1/{time}",
        "damping",
        f"rad/{time}",
        f"period {time}",
        f"time to, {time}",
        "participation",
    )
    return Table(header if participation else header[:-1], rows)


def _time_to(mode: Mode) -> str:
    """Return the time to half or to double of a mode as text, or "-" if both are infinite."""
    if math.isfinite(mode.time_to_half):
        return f"{mode.time_to_half:.4g} (half)"
    if math.isfinite(mode.time_to_double):
        return f"{mode.time_to_double:.4g} (double)"
    return "-"


def fastest_first(eigenvalues: np.ndarray) -> np.ndarray:
    """Return eigenvalues (..., n), sorted along the last axis by decreasing magnitude.

    Eigenvalues of equal magnitude, to 9 digits, are sorted by increasing real part, then by
    decreasing imaginary part.
    """
    order = order_fastest_first(eigenvalues)
    return np.take_along_axis(eigenvalues, order, axis=-1).astype(complex)


def order_fastest_first(eigenvalues: np.ndarray) -> np.ndarray:
    """Return the indices (..., n) that sort eigenvalues (..., n) as in `fastest_first`."""
    with np.errstate(divide="ignore"):
        speeds = np.round(np.log(np.abs(eigenvalues)), 9)  # more digits would order roundings
    return np.lexsort((-eigenvalues.imag, eigenvalues.real, -speeds))
