"""L2 gain of a stable loop z' = F z + E d to a cost z'C z, proved from both sides.

The gain is below γ if F'D + D F + C + D E E'D / γ² = 0 (in discrete time its counterpart) has a
stabilizing solution D. It is at least the gain of any one disturbance at any one frequency.

Sources: Zhou, Doyle and Glover, Robust and Optimal Control, Theorems 4.5 and 21.12.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import DoubleBalls, ball_matrix, identity, midpoints
from controller.riccati.candidate import stabilizing_in_doubles
from controller.riccati.equation import equation_of, users_units
from controller.riccati.excess import ExcessEquation
from controller.riccati.lyapunov import FailedError, NotProvedError
from hfa_support.errors import BadInputError, NoSolutionError
from trim.linear.bilinear import System
from trim.linear.frequency_response import peak_of, scaled_root

if TYPE_CHECKING:
    from flint import acb_mat, arb_mat

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


class DisturbedLoop(NamedTuple):
    """Stable loop z' = F z + E d with the cost z'C z, in discrete time z⁺ = F z + E d, in balls.

    F, E, C: (n, n), (n, k), (n, n)
    """

    F: arb_mat
    E: arb_mat
    C: arb_mat
    is_discrete: bool

    def gain(self) -> GainBounds:
        """Return the bounds of the gain, with the bits of `precision`; high is inf without proof.

        The frequency of the largest gain and D are proposed in doubles.
        """
        low = self._at_least()
        for above in ABOVE:
            high = low * (1.0 + float(above))
            if high > 0.0 and self.is_below(high):
                return GainBounds(low, high)
        return GainBounds(low, math.inf)

    def _at_least(self) -> float:
        """Return the gain of one disturbance at one frequency, rounded down; 0 without proof.

        Doubles propose the frequency of the largest gain, and the disturbance.
        """
        from flint import acb, acb_mat

        F, E, C = map(midpoints, (self.F, self.E, self.C))
        system = System(F, E, scaled_root(C).T, np.zeros((len(C), E.shape[1])))
        try:
            frequency = peak_of(system, is_discrete=self.is_discrete).frequency
            s = acb(0, frequency).exp() if self.is_discrete else acb(0, frequency)
            response = np.linalg.solve(complex(s) * np.eye(len(F)) - F, E)
        except (NoSolutionError, np.linalg.LinAlgError):
            return 0.0
        worst = np.linalg.eigh(response.conj().T @ C @ response)[1][:, -1]
        d = acb_mat([[complex(entry)] for entry in worst])
        try:
            z = (acb_mat(identity(len(F))) * s - acb_mat(self.F)).solve(acb_mat(self.E) * d)
        except ZeroDivisionError:
            return 0.0
        square = (_adjoint(z) * acb_mat(self.C) * z)[0, 0].real / (_adjoint(d) * d)[0, 0].real
        return math.nextafter(float(square.sqrt().lower()), 0.0) if square > 0 else 0.0

    def is_below(self, gain: float) -> bool:
        """Return whether the gain is proved to be below a number."""
        from flint import arb

        k = self.E.ncols()
        crossed = ball_matrix(np.zeros((k, self.F.nrows()))) if self.is_discrete else None
        price = identity(k) * arb(gain) ** 2
        equation = ExcessEquation(self.F, self.E, self.C, crossed, price)
        try:
            equation.solved(self._in_doubles(gain))
        except (FailedError, NotProvedError, ZeroDivisionError):
            return False
        return True

    def _in_doubles(self, gain: float) -> arb_mat | None:
        """Return D by LAPACK, (n, n), as that of a game whose input does nothing, or None."""
        F, E, C = map(midpoints, (self.F, self.E, self.C))
        try:
            game = Game(
                F,
                np.zeros((len(F), 1)),
                E=E,
                Q=(C + C.T) / 2.0,
                R=[1.0],
                delta=gain,
                dt=True if self.is_discrete else None,
            )
            with np.errstate(all="ignore"):
                X = stabilizing_in_doubles(equation_of(game, users_units(game), DoubleBalls))
        except (BadInputError, FailedError, np.linalg.LinAlgError, ValueError):
            return None
        return ball_matrix(X)


def _adjoint(matrix: acb_mat) -> acb_mat:
    """Return the conjugate transpose."""
    return matrix.conjugate().transpose()
