"""Results in Python: reports at the prompt and in notebooks, comparison and pickling."""

import pickle

import pytest

import hfa
import trim


def test_a_trimerror_can_be_pickled():
    """A pickled TrimError, of an aircraft too slow to fly, keeps its message and its nearest point."""
    with pytest.raises(trim.TrimError) as caught:
        hfa.trim(hfa.aircraft(), hfa.paper.level_flight(0.1, speed=30.0))
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.attempt) == (str(caught.value), caught.value.attempt)
