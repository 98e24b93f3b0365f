"""Results in Python: reports at the prompt and in notebooks, comparison and pickling."""

import pickle
from functools import lru_cache

import numpy as np
import pytest

import hfa
import hfa_flight
import hfa_model
import hfa_prove
import trim
import verification

#: Classes whose objects are equal if their values are; others are equal only to themselves.
EQUAL_BY_VALUE = {
    "Game",
    "ParameterSet",
    "OperatingPoint",
    "LinearModel",
    "Bands",
    "Sweep",
    "Regeneration",
    "RegeneratedPair",
}


@lru_cache(maxsize=1)
def results():
    """Return class -> a result of it, of public functions on the paper's aircraft at 15 deg."""
    aircraft = hfa.aircraft()
    condition = hfa.paper.level_flight(15 * hfa_model.DEGREE)
    point = hfa.trim(aircraft, condition)
    model = hfa.linearize(aircraft, point)
    game = hfa.paper.published_game(model)
    family = hfa_prove.Family(aircraft)
    gain = hfa.solve(game).K
    regeneration = verification.regenerate_all(aircraft)
    names = (
        aircraft,
        hfa.paper.default_parameters(),
        point,
        model,
        trim.entry_bands(hfa.paper.default_parameters(), condition, model),
        hfa.sweep(aircraft, {"speed": [20.0, 66.0, 68.0]}),
        regeneration,
        regeneration.pairs[0],
        hfa.learn(game),
        hfa.solve(game),
        hfa.verify(game, hfa.from_gain(game, hfa.solve(game).K)),
        game,
        hfa.from_gain(game, gain),
        hfa_model.published_models()[0],
        hfa_prove.prove_schedule(
            family, hfa_prove.Gains(np.array([15.0]), gain[None]), 15.0, 15.25
        ),
        hfa_flight.GainPolicy("mine", gain),
        hfa_flight.Scenario(gust=hfa_flight.OneMinusCosine(100.0, 3.0, 68.0)),
    )
    return {type(result).__name__: result for result in names}


@pytest.mark.slow
def test_results_can_be_pickled():
    """A result that is pickled and read again displays the same text, and is equal to the original
    if its class is in `EQUAL_BY_VALUE`.
    """
    for name, result in results().items():
        restored = pickle.loads(pickle.dumps(result))
        assert repr(restored) == repr(result), name
        assert name not in EQUAL_BY_VALUE or restored == result, name


def test_a_trimerror_can_be_pickled():
    """A pickled TrimError, of an aircraft too slow to fly, keeps its message and its nearest point."""
    with pytest.raises(trim.TrimError) as caught:
        hfa.trim(hfa.aircraft(), hfa.paper.level_flight(0.1, speed=30.0))
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.attempt) == (str(caught.value), caught.value.attempt)
