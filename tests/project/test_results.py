"""Results in Python: reports at the prompt and in notebooks, comparison and pickling."""

import pickle
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from known_models import game_at, model_at

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
def test_results_display_reports():
    """A result displays a text of 20 to 12,000 characters without the repr of an array, and HTML
    without scripts.
    """
    for name, result in results().items():
        shown = repr(result)
        assert "array(" not in shown, name
        assert 20 < len(shown) < 12_000, name
        assert "<script" not in result._repr_html_(), name


@pytest.mark.slow
def test_results_can_be_pickled():
    """A result that is pickled and read again displays the same text, and is equal to the original
    if its class is in `EQUAL_BY_VALUE`.
    """
    for name, result in results().items():
        restored = pickle.loads(pickle.dumps(result))
        assert repr(restored) == repr(result), name
        assert name not in EQUAL_BY_VALUE or restored == result, name


def test_linear_models_are_equal_by_their_values():
    """Linear models are equal if their entries are, where nan equals nan; a change of 1e-12 or of
    the order of the names makes them different. They cannot be hashed.
    """
    model = model_at(15.0)
    assert model == replace(model, A=model.A.copy())
    changed = model.A.copy()
    changed[0, 0] += 1e-12
    assert model != replace(model, A=changed)
    assert model != replace(model, states=model.states[::-1])
    assert model != "a model"
    assert replace(model, A=np.full_like(changed, np.nan)) == replace(
        model, A=np.full_like(changed, np.nan)
    )
    with pytest.raises(TypeError, match="unhashable"):
        hash(model)


def test_a_trimerror_can_be_pickled():
    """A pickled TrimError, of an aircraft too slow to fly, keeps its message and its nearest point."""
    with pytest.raises(trim.TrimError) as caught:
        hfa.trim(hfa.aircraft(), hfa.paper.level_flight(0.1, speed=30.0))
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.attempt) == (str(caught.value), caught.value.attempt)


def test_games_are_equal_by_their_values():
    """Games with equal values are equal and have equal hashes; games that differ in delta, or in
    the last bit of an entry of A, are not equal.
    """
    game = game_at(15.0)
    again = game.with_delta(100.0).with_delta(game.delta)
    assert (again, hash(again)) == (game, hash(game))
    assert game != game.with_delta(100.0)
    changed = game.A.copy()
    changed[0, 0] = np.nextafter(changed[0, 0], 1.0)
    assert game != replace(game, A=changed)
