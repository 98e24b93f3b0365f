"""Contradictions between a policy's files and its deployment file, each from few numbers."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from policy_cases import aircraft

from hfa_flight.policies.deployment.normalizer import Normalizer
from hfa_flight.policies.deployment.notes import (
    _distance_from_lines,
    _impossible_spreads,
    _normalizer_in_training,
    _notes_on_gain,
    _Training,
    is_of_another_checkpoint,
)

MEAN, VARIANCE = np.array([1.0, -2.0]), np.array([4.0, 0.25])
RAW = np.random.default_rng(0).normal(size=(5, 2))
#: RAW in the normalizer.
SEEN = (RAW - MEAN) / np.sqrt(VARIANCE)
OTHER = np.random.default_rng(1).normal(size=(5, 2))


@pytest.mark.parametrize(
    ("count", "last", "original", "of_normalizer", "other"),
    [
        (104.0001, OTHER, None, None, False),
        (104.4, OTHER, None, None, False),
        (108.0001, OTHER, None, None, True),
        (99.0001, OTHER, OTHER, OTHER[:3], True),
        (204.0, SEEN, None, RAW, False),
        (204.0, SEEN, RAW, OTHER, False),
        (204.0, SEEN, OTHER, OTHER, True),
        (math.nan, OTHER, None, None, False),
        (204.0, None, None, None, False),
    ],
)
def test_another_checkpoint_has_counted_other_observations(
    count, last, original, of_normalizer, other
):
    """At one checkpoint, it has counted one observation per environment more than the policy.

    Where its observations are those of the policy, the count of the policy was restarted.
    """
    stored = SimpleNamespace(timesteps=100, environments=4, last=last, last_original=original)
    normalizer = Normalizer(MEAN, VARIANCE, 0.0, count=count, last=of_normalizer)
    assert is_of_another_checkpoint(stored, normalizer) == other


def test_lines_are_recognized_without_clipped_values():
    """The largest distance of a column from its line, relative to the range of the free values."""
    x = np.linspace(-1.0, 1.0, 7)
    line = 2.0 * x + 0.5
    clipped = np.clip(line, -1.6, 1.6)
    bent = line + np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0])
    columns = lambda *each: np.column_stack(each)  # noqa: E731
    far = np.full(7, 9.0)
    assert _distance_from_lines(columns(x), columns(line)) < 1e-12
    assert _distance_from_lines(columns(x, x), columns(clipped, line / 4.0)) < 1e-12
    distance = _distance_from_lines(columns(x, x, x), columns(line / 10.0, bent, far))
    mean = 0.3 / 7.0
    assert distance == pytest.approx((0.3 - mean) / 4.0, rel=1e-6)
    assert math.isnan(_distance_from_lines(columns(x), columns(far)))


@pytest.mark.parametrize(
    ("last", "original", "on_policy", "training"),
    [
        (None, RAW, False, _Training.NONE),
        (SEEN, None, False, _Training.NONE),
        (SEEN, RAW, True, _Training.NORMALIZED),
        (RAW, RAW, False, _Training.NONE),
        (SEEN, RAW, False, _Training.NORMALIZED),
        (OTHER, RAW, False, _Training.NONE),
        (SEEN[:2], RAW[:2], False, _Training.UNKNOWN),
    ],
)
def test_the_last_observations_show_a_normalizer_in_training(last, original, on_policy, training):
    stored = SimpleNamespace(last=last, last_original=original, on_policy=on_policy)
    assert _normalizer_in_training(stored) is training


def notes_on(of_gain, **observation):
    observation = observation or {"speed": {}, "alpha": {}}
    deployment = SimpleNamespace(
        actor=SimpleNamespace(of_gain=of_gain),
        observation=observation,
        action={"elevator": {}},
        dt=0.02,
    )
    return _notes_on_gain(SimpleNamespace(deployment=deployment, model=aircraft("ppo_gtm")))


def test_a_gain_is_of_its_states_units_and_sample_time():
    names = {"states": ["speed", "alpha"], "inputs": ["elevator"]}
    assert notes_on({}) == notes_on(names) == []
    (note,) = notes_on(names | {"states": ["alpha", "speed"]})
    assert note == "K is a gain of the states alpha, speed, but [observation] lists speed, alpha"
    (note,) = notes_on(names | {"inputs": ["throttle"]})
    assert note == "K is a gain of the inputs throttle, but [action] lists elevator"
    (note,) = notes_on({"dt": 0.05})
    assert note == "K is a gain for dt = 0.05 s, but timing.dt is 0.02 s"
    units = {"state_units": ["m/s", "deg"]}
    (note,) = notes_on(units)
    assert "a gain per deg of alpha" in note
    assert f"scale = {math.radians(1.0):.6g} gives deg" in note
    assert notes_on(units, speed={}, alpha={"scale": math.radians(1.0)}) == []
    (note,) = notes_on(units, speed={"scale": 2.0}, alpha={"scale": math.radians(1.0)})
    assert "a gain per m/s of speed, but the deployment file divides speed in m/s by 2" in note
    assert notes_on(units, odd={"scale": 2.0}, alpha={"scale": math.radians(1.0)}) == []


@pytest.mark.parametrize(
    ("variance", "scale", "count", "named"),
    [
        (0.9, 0.9, 1e6, False),
        (0.9, 1.0, 1e6, True),
        (0.9, 1.0, 1000.0, False),
        (0.7, 1.0, 1e6, False),
    ],
)
def test_a_spread_beyond_the_limits_of_a_state_is_named(variance, scale, count, named):
    """alpha lies between -.1 and .5: a deviation of more than .9 rad in training is impossible."""
    model = aircraft("ppo_gtm")
    deployment = SimpleNamespace(observation={"alpha": {"scale": scale}})
    normalizer = Normalizer(np.zeros(1), np.array([variance]), count=count)
    deployed = SimpleNamespace(model=model, deployment=deployment)
    notes = list(_impossible_spreads(deployed, normalizer))
    assert bool(notes) == named
