"""Selection of recorded samples."""

from __future__ import annotations

import numpy as np

from controller.game.basis import Basis
from controller.learning.recording import RANK_TOLERANCE, Stack, refuse_poor, unit_rows
from hfa_support.errors import BadInputError

#: Relative excess length of the row that begins a round: far above rounding, and far below real
#: differences.
_AHEAD = 1e-6


def rank(rows: np.ndarray) -> int:
    """Return the numerical rank of a matrix.

    Singular values up to `RANK_TOLERANCE` times the largest one count as 0.
    """
    values = np.linalg.svd(rows, compute_uv=False)
    return int(np.sum(values > RANK_TOLERANCE * values[0]))


def choose(pool: Stack, basis: Basis, samples: int) -> Stack:
    """Return those samples of a pool that differ most from each other.

    Pivoted QR orders the unit vectors ψ(z_j)/|ψ(z_j)|. Each chosen sample has the largest component
    outside the span of the samples chosen before. After each M samples the choice starts again
    among the samples that remain.

    pool: recorded samples
    basis: ψ, with M functions
    samples: number of samples to choose, at least M

    Source: Golub and Van Loan, Matrix Computations, section 5.4.2.

    Raises BadInputError if `samples` is below M or above the size of the pool, or if the rank of
    the chosen vectors is below M.
    """
    from scipy.linalg import qr

    if samples < basis.size:
        raise BadInputError(
            f"{samples} samples cannot determine {basis.size} weights; record at least {basis.size}"
        )
    if pool.samples < samples:
        raise BadInputError(
            f"the pool contains {pool.samples} samples, but {samples} are requested; record more"
        )
    rows = unit_rows(basis.psi(pool.states / pool.channel_scales()))
    chosen: list[int] = []
    remaining = np.arange(pool.samples)
    while len(chosen) < samples:
        lengths = np.ones(len(remaining))
        lengths[0] += _AHEAD
        _, order = qr((rows[remaining] * lengths[:, None]).T, mode="r", pivoting=True)
        block = remaining[order[: min(basis.size, samples - len(chosen))]]
        chosen.extend(int(index) for index in block)
        remaining = np.setdiff1d(remaining, block)
    refuse_poor(rank(rows[chosen]), basis.size, "the recorded stack")
    return Stack(pool.states[chosen], pool.drifts[chosen])
