"""The two linear models printed in the paper."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_model.parameters import LINEAR_STATES, published_data
from hfa_support.reporting.report import Reported
from hfa_support.reporting.results import ByValue
from hfa_support.reporting.text import in_degrees


@dataclass(frozen=True, eq=False, repr=False)
class PublishedModel(ByValue, Reported):
    """Linear model x' = A x + B u printed in the paper (Section 5.1).

    dihedral: rad
    A: (6, 6), in the order of `LINEAR_STATES`
    B: (6, 5), in the order of `LINEAR_STATES` and `INPUTS`
    half_unit_A: (6, 6), half a unit of the last printed digit of each entry of A
    half_unit_B: (6, 5), half a unit of the last printed digit of each entry of B

    An entry printed as 0 or 1 without decimals is assumed to have four decimals, like its
    neighbors. For example, B(alpha, throttle) is -2.6e-5 and is printed as 0.
    """

    dihedral: float
    A: np.ndarray
    B: np.ndarray
    half_unit_A: np.ndarray
    half_unit_B: np.ndarray

    @property
    def dihedral_deg(self) -> float:
        """Dihedral angle of the printed model, as printed in the paper, degrees."""
        return in_degrees(self.dihedral)


def published_models() -> tuple[PublishedModel, ...]:
    """Return the printed linear models (A1, B1) at 15 deg and (A2, B2) at 5 deg, in this order.

    >>> from hfa_model import published_models
    >>> [round(model.dihedral, 4) for model in published_models()]
    [0.2618, 0.0873]
    """
    return tuple(_model(case) for case in published_data()["cases"])


def _model(case: dict[str, Any]) -> PublishedModel:
    """Return one of the printed linear models."""
    A = np.array(case["A"], dtype=float)
    B = np.array(case["B"], dtype=float)
    decimals = published_data()["printed_decimals"]
    half_unit = 0.5 * 10.0 ** -decimals["default"]
    half_unit_A = np.full(A.shape, half_unit)
    half_unit_B = np.full(B.shape, half_unit)
    speed_row, pitch_column = (LINEAR_STATES.index(name) for name in ("speed", "pitch"))
    # This entry, -g, is printed with fewer decimals.
    half_unit_A[speed_row, pitch_column] = 0.5 * 10.0 ** -decimals["A[speed][pitch]"]
    return PublishedModel(float(np.radians(case["dihedral_deg"])), A, B, half_unit_A, half_unit_B)
