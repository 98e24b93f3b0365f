"""The cost of a flight."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_flight.flight_cost import cost_of_flight

TIMES = np.array([0.0, 1.0, 3.0])
ZEROS = np.zeros((3, 1))
INPUTS = np.array([[2.0], [1.0], [5.0]])
ONE = np.eye(1)


@pytest.mark.parametrize(("is_held", "cost"), [(True, 6.0), (False, 28.5)])
def test_held_inputs_cost_what_they_hold(is_held: bool, cost: float) -> None:
    """Held inputs cost 2² for 1 s and 1² for 2 s. Inputs linear between the rows cost trapezoids of
    2.5 and 26.
    """
    assert cost_of_flight(TIMES, ZEROS, INPUTS, ONE, ONE, is_held) == cost


def test_states_are_priced_by_trapezoids() -> None:
    assert cost_of_flight(TIMES, INPUTS, ZEROS, ONE, ONE, is_held=True) == 28.5
