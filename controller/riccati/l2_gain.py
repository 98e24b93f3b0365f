"""L2 gain of a stable loop z' = F z + E d to a cost z'C z, proved from both sides.

The gain is below γ if the loop has a value at δ = γ (`disturbed_loop`). It is at least the gain of
any one disturbance at any one frequency.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.riccati.balls import identity, midpoints
from controller.riccati.disturbed_loop import DisturbedLoop
from controller.riccati.lyapunov import FailedError, NotProvedError
from hfa_support.errors import NoSolutionError
from trim.linear.frequency_response import System, peak_of, scaled_root

if TYPE_CHECKING:
    from flint import acb_mat

#: Largest relative difference of the bounds of a gain, if nothing prevents it.
TOLERANCE = 1e-6
#: Relative distances from the lower bound at which the upper one is tried.
ABOVE = 0.9 * TOLERANCE * np.array([1.0, 1e2, 1e4])


class GainBounds(NamedTuple):
    """Proved bounds of an L2 gain: low <= gain <= high, usually 1e-6 apart."""

    low: float
    high: float

    @property
    def is_narrow(self) -> bool:
        """True if the bounds differ by at most 1e-6."""
        return self.high <= self.low * (1.0 + TOLERANCE)


def gain_of(loop: DisturbedLoop) -> GainBounds:
    """Return the bounds of the gain, with the bits of `precision`; high is inf without proof.

    The frequency of the largest gain and D are proposed in doubles.
    """
    low = _at_least(loop)
    for above in ABOVE:
        high = low * (1.0 + float(above))
        if high > 0.0 and is_below(loop, high):
            return GainBounds(low, high)
    return GainBounds(low, math.inf)


def _at_least(loop: DisturbedLoop) -> float:
    """Return the gain of one disturbance at one frequency, rounded down; 0 without proof.

    Doubles propose the frequency of the largest gain, and the disturbance.
    """
    from flint import acb, acb_mat

    F, E, C = map(midpoints, (loop.F, loop.E, loop.C))
    system = System(F, E, scaled_root(C).T, np.zeros((len(C), E.shape[1])))
    try:
        frequency = peak_of(system, is_discrete=loop.is_discrete).frequency
        s = acb(0, frequency).exp() if loop.is_discrete else acb(0, frequency)
        response = np.linalg.solve(complex(s) * np.eye(len(F)) - F, E)
    except (NoSolutionError, np.linalg.LinAlgError):
        return 0.0
    worst = np.linalg.eigh(response.conj().T @ C @ response)[1][:, -1]
    d = acb_mat([[complex(entry)] for entry in worst])
    try:
        z = (acb_mat(identity(len(F))) * s - acb_mat(loop.F)).solve(acb_mat(loop.E) * d)
    except ZeroDivisionError:
        return 0.0
    square = (_adjoint(z) * acb_mat(loop.C) * z)[0, 0].real / (_adjoint(d) * d)[0, 0].real
    return math.nextafter(float(square.sqrt().lower()), 0.0) if square > 0 else 0.0


def is_below(loop: DisturbedLoop, gain: float) -> bool:
    """Return whether the gain is proved to be below a number."""
    try:
        loop.value(gain)
    except (FailedError, NotProvedError):
        return False
    return True


def _adjoint(matrix: acb_mat) -> acb_mat:
    """Return the conjugate transpose."""
    return matrix.conjugate().transpose()
