"""The critic's basis: monomials ψ(z), their gradient, and the way between the weights W and the matrix P."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hfa_model.vectors import LINEAR_STATES
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.reporting.fields import Shown

#: The channels whose fourth power completes the paper's M = 25. The paper prints M and not its basis, so this
#: is an assumption: the three tracked channels and the pitch rate, the strongest coupling of Section 5.1.
PAPER_QUARTIC_CHANNELS = ("speed", "alpha", "pitch_rate", "dihedral")


@dataclass(frozen=True, eq=False, repr=False)
class Basis(Shown):
    """ψ_m(z) = Π_i z_i^exponents[m, i], V(z) = W'ψ(z) (paper Section 3.2).

    exponents: (M, n) nonnegative integers; the first n(n+1)/2 rows are z_i z_j for i <= j, row by row.
    """

    name: str
    exponents: np.ndarray

    @property
    def size(self) -> int:
        """M, the number of weights."""
        return int(self.exponents.shape[0])

    @property
    def states(self) -> int:
        """n, the number of states."""
        return int(self.exponents.shape[1])

    @property
    def quadratic_size(self) -> int:
        """n(n+1)/2, the number of quadratic weights; they come first."""
        return self.states * (self.states + 1) // 2

    @cached_property
    def _upper(self) -> tuple[np.ndarray, np.ndarray]:
        return np.triu_indices(self.states)

    @cached_property
    def _weight_of_entry(self) -> np.ndarray:
        """Which quadratic weight P_ij comes from, (n, n)."""
        places = np.zeros((self.states, self.states), dtype=int)
        places[self._upper] = places.T[self._upper] = np.arange(self.quadratic_size)
        return places

    @cached_property
    def _entry_of_weight(self) -> np.ndarray:
        """P_ij of each quadratic weight: W on the diagonal, W/2 off it."""
        row, column = self._upper
        return np.where(row == column, 1.0, 0.5)

    @cached_property
    def _orders(self) -> np.ndarray:
        """p = 0 .. the highest exponent."""
        return np.arange(self.exponents.max() + 1.0)

    @cached_property
    def _factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Places of each factor z_c^p in the table of powers: of ψ_m (M, k), of ∂ψ_m/∂z_i (M, n, k), k channels each.

        A derivative of a factor that is not there gets the exponent 0 and is multiplied by the exponent 0.
        """
        absent = self.exponents == 0
        channels = np.argsort(absent, axis=1, kind="stable")[:, : np.count_nonzero(~absent, axis=1).max()]
        place = np.arange(self.states) * len(self._orders)
        lowered = np.maximum(self.exponents[:, None, :] - np.eye(self.states, dtype=int)[None], 0)
        return (
            np.take_along_axis(place + self.exponents, channels, axis=-1),
            np.take_along_axis(place + lowered, channels[:, None, :], axis=-1),
        )

    def _products(self, z: np.ndarray, factors: np.ndarray) -> np.ndarray:
        """Of the powers of z (..., n) at these places: (..., *factors.shape[:-1])."""
        powers = (z[..., :, None] ** self._orders).reshape(*z.shape[:-1], -1)
        product: np.ndarray = powers[..., factors].prod(axis=-1)
        return product

    def psi(self, z: np.ndarray) -> np.ndarray:
        """ψ(z): (..., n) -> (..., M)."""
        return self._products(z, self._factors[0])

    def gradient(self, z: np.ndarray) -> np.ndarray:
        """∂ψ/∂z: (..., n) -> (..., M, n)."""
        return self.exponents * self._products(z, self._factors[1])

    def matrix(self, weights: np.ndarray) -> np.ndarray:
        """P of the quadratic part z'Pz of W'ψ(z): P_ii = W, P_ij = W/2; (n, n) symmetric."""
        P: np.ndarray = (self._entry_of_weight * weights[: self.quadratic_size])[self._weight_of_entry]
        return P

    def weights(self, P: np.ndarray) -> np.ndarray:
        """W with W'ψ(z) = z'Pz, (M,): weights beyond the quadratic ones are 0. P: (n, n) symmetric."""
        weights = np.zeros(self.size)
        weights[: self.quadratic_size] = np.asarray(P)[self._upper] / self._entry_of_weight
        return weights

    def scaling(self, scales: np.ndarray) -> np.ndarray:
        """s with ψ(diag(scales) y) = s * ψ(y), (M,): weights in the coordinates y = z / scales are s * W."""
        return np.prod(np.asarray(scales, dtype=float) ** self.exponents, axis=-1)

    def weight_units(self, state_units: tuple[str, ...]) -> list[str]:
        """Of each weight, V having none: 1/((ft/s) (rad))."""
        factors = (
            [f"({unit})" for unit, power in zip(state_units, row, strict=True) for _ in range(power)]
            for row in self.exponents.tolist()
        )
        return [f"1/({' '.join(each)})" for each in factors]


def basis(name: str, states: int) -> Basis:
    """The basis of that name on `states` channels.

    "quadratic": z_i z_j for i <= j, M = n(n+1)/2. "quadratic+linear": and z_i. "quadratic+quartic": and z_i⁴.
    "paper": M = 25 on the paper's six channels, the quadratic ones and four fourth powers
    (`PAPER_QUARTIC_CHANNELS`, our assumption).

    Raises BadInputError for an unknown name, and for "paper" on another number of channels.
    """
    refuse_unknown("unknown basis", name, BASES)
    if states < 1:
        raise BadInputError(f"a basis needs at least 1 state, not {states}")
    exponents = np.vstack([_quadratic(states), BASES[name](states)])
    exponents.setflags(write=False)
    return Basis(name, exponents)


def _quadratic(states: int) -> np.ndarray:
    unit = np.eye(states, dtype=int)
    row, column = np.triu_indices(states)
    return unit[row] + unit[column]


def _paper(states: int) -> np.ndarray:
    if states != len(LINEAR_STATES):
        raise BadInputError(f"basis 'paper' is for {len(LINEAR_STATES)} states, not {states}; choose 'quadratic'")
    return 4 * np.eye(states, dtype=int)[[LINEAR_STATES.index(name) for name in PAPER_QUARTIC_CHANNELS]]


#: What each basis adds to the quadratic monomials.
BASES: dict[str, Callable[[int], np.ndarray]] = {
    "quadratic": lambda states: np.zeros((0, states), dtype=int),
    "quadratic+linear": lambda states: np.eye(states, dtype=int),
    "quadratic+quartic": lambda states: 4 * np.eye(states, dtype=int),
    "paper": _paper,
}


def bases_with(weights: int, states: int) -> list[str]:
    """Names of the bases that have so many weights on so many states."""
    found = []
    for name in BASES:
        with contextlib.suppress(BadInputError):
            found += [name] * (basis(name, states).size == weights)
    return found
