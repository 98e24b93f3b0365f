"""Reference results for generalized plants from SLICOT, which shares no code with this project."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from hfa_design import GeneralizedPlant, closed_plant


def of_slycot(plant: GeneralizedPlant) -> tuple[float, float]:
    """Return the smallest gain that SLICOT's SB10AD reports, and the gain of its closed loop.

    Both are inf if SB10AD finds no controller.
    """
    slycot = pytest.importorskip("slycot")
    B = np.hstack([plant.B1, plant.B2])
    C = np.vstack([plant.C1, plant.C2])
    D = np.block([[plant.D11, plant.D12], [plant.D21, plant.D22]])
    sizes = len(plant.A), B.shape[1], len(C), plant.B2.shape[1], len(plant.C2)
    try:
        found = slycot.sb10ad(*sizes, 1e4, plant.A, B, C, D, gtol=1e-10)
    except slycot.exceptions.SlycotArithmeticError:  # "a stabilizing controller cannot be found"
        return math.inf, math.inf
    return float(found[0]), norm(*found[5:9])


def norm(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> float:
    """Return the L2 gain of a system, computed by SLICOT's AB13DD."""
    slycot = pytest.importorskip("slycot")
    E = np.eye(len(A))
    return float(
        slycot.ab13dd("C", "I", "N", "D", len(A), B.shape[1], len(C), A, E, B, C, D, tol=1e-10)[0]
    )


def gain_of(plant: GeneralizedPlant, found: Any) -> float:
    loop = closed_plant(plant, (found.Ak, found.Bk, found.Ck, found.Dk))
    assert np.linalg.eigvals(loop[0]).real.max() < 0.0
    return norm(*loop)


@cache
def random_plant(seed: int, feedthrough: float = 1.0) -> GeneralizedPlant:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 9))
    m = int(rng.integers(1, 4))
    p = int(rng.integers(1, 4))
    r = m + int(rng.integers(0, 4))
    k = p + int(rng.integers(0, 4))
    sizes = {
        "A": (n, n),
        "B1": (n, k),
        "B2": (n, m),
        "C1": (r, n),
        "D12": (r, m),
        "C2": (p, n),
        "D21": (p, k),
    }
    matrices = {name: rng.standard_normal(shape) for name, shape in sizes.items()}
    through = {
        "D11": feedthrough * rng.standard_normal((r, k)),
        "D22": feedthrough * rng.standard_normal((p, m)),
    }
    return GeneralizedPlant(**matrices, **through)


@cache
def smallest_of(seed: int, feedthrough: float = 1.0) -> Any:
    return random_plant(seed, feedthrough).minimum_delta()
