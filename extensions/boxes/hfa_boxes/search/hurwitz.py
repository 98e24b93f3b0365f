"""Test that the linearization of a loop is stable."""

from __future__ import annotations

import numpy as np

from hfa_support.errors import NoSolutionError


def refuse_unstable(J: np.ndarray) -> None:
    """Raise NoSolutionError unless every eigenvalue of J (n, n) has a negative real part.

    J: linearization of the loop
    """
    modes = np.linalg.eigvals(J)
    if not np.all(modes.real < 0.0):
        raise NoSolutionError(
            "the loop's linearization is not Hurwitz (largest real part of an eigenvalue: "
            f"{modes.real.max():.3g}); only equilibria with a stable linearization are supported"
        )
