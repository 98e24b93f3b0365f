"""Systems in discrete time as systems in continuous time with the same gains and margins."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np


class System(NamedTuple):
    """System C (s I - A)⁻¹ B + D.

    A: (n, n)
    B: (n, k)
    C: (p, n)
    D: (p, k)
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray


def in_continuous_time(steps: System) -> System:
    """Return the system in s = (z - 1) / (z + 1) of a system in z, C (z I - A)⁻¹ B + D.

    The unit circle becomes the imaginary axis, and stable poles remain stable. A must not have the
    eigenvalue -1.

    Source: Zhou, Doyle and Glover, Section 21.2.
    """
    A, B, C, D = steps
    one = np.eye(len(A))
    enters = np.linalg.solve(A + one, B)
    leaves = np.linalg.solve((A + one).T, C.T).T
    root = math.sqrt(2.0)
    return System(np.linalg.solve(A + one, A - one), root * enters, root * leaves, D - C @ enters)
