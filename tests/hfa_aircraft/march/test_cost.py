"""The cost of a flight with inputs that are constant in a tick or interpolated."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_aircraft.march.cost import cost_of_flight

TIMES = np.array([0.0, 1.0, 3.0])
ZEROS = np.zeros((3, 1))
INPUTS = np.array([[2.0], [1.0], [5.0]])
ONE = np.eye(1)


@pytest.mark.parametrize(("is_held", "cost"), [(True, 6.0), (False, 28.5)])
def test_costs_of_held_and_interpolated_inputs_are_exact(is_held: bool, cost: float) -> None:
    """Held inputs of 2 for 1 s and 1 for 2 s cost 2² + 2·1². Interpolated inputs follow the
    trapezoidal rule.
    """
    assert cost_of_flight(TIMES, ZEROS, INPUTS, ONE, ONE, is_held) == cost


def test_cost_integrates_by_the_trapezoidal_rule() -> None:
    """The cost of a flight with held inputs equals a trapezoidal sum computed by hand."""
    assert cost_of_flight(TIMES, INPUTS, ZEROS, ONE, ONE, is_held=True) == 28.5
