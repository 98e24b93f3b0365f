"""Units of the vectors."""

from __future__ import annotations

import math

import pytest

from hfa_model import DEGREE


def test_half_a_turn_is_180_degrees() -> None:
    assert pytest.approx(math.pi, rel=1e-15) == 180 * DEGREE
