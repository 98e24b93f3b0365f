"""Changes of the measured quantities that no change of the unknowns explains."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hfa_identify.fit import Fit


class Directions(NamedTuple):
    """Changes F of the measured quantities, and their part F⊥ that the unknowns do not explain.

    beyond: F⊥ by index of the record, (N, k, c) each.
    moved: change of the parameters that explains the rest, (p, c).
    information: Σ F' R⁻¹ F with the variances R of the residuals, (c, c).
    information_beyond: Σ F⊥' R⁻¹ F⊥, (c, c).
    """

    beyond: Mapping[int, np.ndarray]
    moved: np.ndarray
    information: np.ndarray
    information_beyond: np.ndarray


def beyond_unknowns(fit: Fit, changes: Mapping[int, np.ndarray]) -> Directions:
    """Return the part of some changes that parameters and initial states do not explain.

    changes: changes F of the measured quantities by index of the record, (N, k, c) each
    """
    beyond_starts = {number: fit.beyond_start(number, F) for number, F in changes.items()}
    weighted = {number: F * fit.weights(number)[:, :, None] for number, F in changes.items()}
    crossed = sum(_products(fit.projected[number], F) for number, F in weighted.items())
    moved = np.linalg.pinv(fit.information, rcond=1e-13, hermitian=True) @ crossed
    left = sum(_products(beyond_starts[number], F) for number, F in weighted.items())
    return Directions(
        {number: F - fit.projected[number] @ moved for number, F in beyond_starts.items()},
        moved,
        np.asarray(sum(_products(changes[number], F) for number, F in weighted.items())),
        np.asarray(left - moved.T @ crossed),
    )


def _products(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the sums over samples and quantities of products (c, d) of (N, k, c) and (N, k, d)."""
    return np.asarray(np.tensordot(one, other, ((0, 1), (0, 1))))
