"""Contradictions in files, effects of actions, and observations in flight and in training."""

import base64
import json
import pickle
import zipfile

import casadi as ca
import numpy as np
import pytest
from policy_cases import (
    AIRCRAFT,
    FOLDER,
    ROOT,
    aircraft,
    gtm_deployment,
    model_of,
    stored_deployment,
    trims,
)

import hfa
from hfa import Deployment, assess

DEGREES = 180.0 / np.pi
OMITTED = "was trained with a VecNormalize that the deployment file omits"
SUPERFLUOUS = "was trained without a VecNormalize"
UNKNOWN = "does not show whether it was trained with a VecNormalize"
OTHER_CHECKPOINT = "belongs to another checkpoint"


def notes(name, deployment):
    """Return the notes that follow from the files of a policy."""
    points = [AIRCRAFT[name][1][0]]
    return hfa.assess(aircraft(name), deployment, points, samples=0).notes


def the_note(name, deployment):
    """Return the only note that follows from the files of a policy."""
    (note,) = notes(name, deployment)
    return note


def with_policy(name, **entries):
    changed = {
        key: value for key, value in stored_deployment(name).policy.items() if key not in entries
    }
    given = {key: value for key, value in entries.items() if value is not None}
    return stored_deployment(name).changed(policy={**changed, **given})


QUICK = ("ppo_gtm", "ppo_raw")


@pytest.mark.parametrize(
    "name",
    [
        name if name in QUICK else pytest.param(name, marks=pytest.mark.slow)
        for name in AIRCRAFT
        if name != "sac_gtm"
    ],
)
def test_right_deployment_files_have_no_note(name):
    """No contradiction is reported for right deployment files."""
    assert notes(name, stored_deployment(name)) == []


@pytest.mark.parametrize("name", ["ppo_gtm", "a2c_gtm"])
def test_a_missing_normalizer_is_named(name):
    """A deployment file without the normalizer used in training is reported."""
    assert OMITTED in the_note(name, with_policy(name, normalizer=None))


def of_eight_environments(folder, last, last_original, **entries):
    """Return the deployment of a SAC policy whose zip says that eight environments trained it.

    last, last_original: last observations in training, normalized and original, (8, 4)
    entries: replacements in the table policy
    """
    arrays = {"_last_obs": last, "_last_original_obs": last_original}
    with zipfile.ZipFile(FOLDER / "sac_gtm.zip") as old:
        data = json.loads(old.read("data")) | {"n_envs": 8}
        for name, array in arrays.items():
            data[name] = {":serialized:": base64.b64encode(pickle.dumps(array)).decode()}
        with zipfile.ZipFile(folder / "eight.zip", "w") as new:
            new.writestr("data", json.dumps(data))
            new.writestr("policy.pth", old.read("policy.pth"))
    return with_policy("sac_gtm", file=str(folder / "eight.zip"), **entries)


def test_the_last_observations_of_eight_environments_prove_a_normalizer(tmp_path):
    """Linear in the original ones, but for clipped values: a normalizer is missing.

    Not linear: none was used, and a given one is superfluous. Constant: undecided.
    """
    random = np.random.default_rng(1)
    original = random.normal(size=(8, 4))
    linear = np.clip((original - 0.1) / [0.3, 0.5, 0.9, 1.1], -2.0, 2.0).astype(np.float32)
    assert OMITTED in the_note("sac_gtm", of_eight_environments(tmp_path, linear, original))
    last = original + 0.003 * random.normal(size=(8, 4))
    assert notes("sac_gtm", of_eight_environments(tmp_path, last, original)) == []
    given = {"normalizer": str(FOLDER / "td3_gtm.pkl")}
    wrong = of_eight_environments(tmp_path, last, original, **given)
    assert SUPERFLUOUS in the_note("sac_gtm", wrong)
    constant = of_eight_environments(tmp_path, np.full((8, 4), 0.001), np.zeros((8, 4)))
    assert UNKNOWN in the_note("sac_gtm", constant)


def test_one_environment_leaves_the_normalizer_undecided():
    """Unless the deployment file says that there is none."""
    assert UNKNOWN in the_note("sac_gtm", stored_deployment("sac_gtm"))
    one = with_policy("sac_gtm", normalizer="td3_gtm.pkl")
    assert not any(SUPERFLUOUS in note for note in notes("sac_gtm", one))
    assert notes("ppo_gtm", with_policy("ppo_gtm", normalizer="none")) == []


@pytest.mark.parametrize(
    ("entries", "found"),
    [
        ({}, 0),
        (
            {
                "states": ["speed", "alpha", "pitch_rate", "pitch"],
                "inputs": ["elevator", "throttle"],
            },
            0,
        ),
        ({"states": ["alpha", "speed", "pitch_rate", "pitch"]}, 1),
        ({"inputs": ["throttle", "elevator"]}, 1),
        ({"dt": 0.05}, 1),
        ({"dt": 0.02}, 0),
        ({"state_units": ["m/s", "deg", "rad/s", "rad"]}, 1),
        ({"state_units": ["m/s", "rad", "rad/s", "rad"]}, 0),
    ],
)
def test_a_gain_is_of_its_states_inputs_units_and_sample_time(tmp_path, entries, found):
    np.savez(tmp_path / "K.npz", K=0.01 * np.ones((2, 4)), **entries)
    deployment = gtm_deployment({"file": str(tmp_path / "K.npz")})
    told = hfa.assess(aircraft("ppo_gtm"), deployment, [45.0], samples=0).notes
    assert len(told) == found
    assert all(note.startswith("K is a gain") for note in told)


def test_a_superfluous_normalizer_is_named():
    """A normalizer for a policy that was trained without one is reported."""
    assert SUPERFLUOUS in the_note("ppo_raw", with_policy("ppo_raw", normalizer="ppo_gtm.pkl"))


def test_the_normalizer_of_another_checkpoint_is_named():
    """The normalizer of another checkpoint is named, without any further finding."""
    assert OTHER_CHECKPOINT in the_note("ppo_gtm", with_policy("ppo_gtm", normalizer="a2c_gtm.pkl"))


def test_a_normalizer_without_count_causes_no_finding():
    """A normalizer given as a table without a count causes no finding."""
    stored = stored_deployment("ppo_gtm").normalizer
    table = {"mean": stored.mean, "variance": stored.variance}
    assert notes("ppo_gtm", with_policy("ppo_gtm", normalizer=table)) == []


def in_degrees(name):
    """Return the deployment of a policy whose angles have the scale of another unit."""
    observation = {
        key: {**entry, "scale": entry["scale"] * (1.0 if key == "speed" else DEGREES)}
        for key, entry in stored_deployment(name).observation.items()
    }
    return stored_deployment(name).changed(observation=observation)


def test_a_spread_in_training_beyond_the_limits_is_noted():
    """A state whose spread in training would exceed its limits is noted, with its unit."""
    found = notes("ppo_gtm", in_degrees("ppo_gtm"))
    assert any(note.startswith("pitch: with this scale") for note in found)


def exact_deployment(model, point, times=1.0):
    """Return the optimal gain for 1/nominal² as a deployment.

    times: factor on the actions
    """
    linear = hfa.linearize(model, point)
    Q = {name: model.states[name].nominal ** -2.0 for name in model.linear}
    R = {name: signal.nominal**-2.0 for name, signal in model.inputs.items()}
    K = hfa.solve(hfa.game(linear, Q, R)).K
    o = ca.SX.sym("o", K.shape[1])
    action = {name: {"map": f"trim + {times} * a"} for name in model.inputs}
    return Deployment(
        policy={"file": ca.Function("gain", [o], [-ca.DM(K) @ o])},
        observation={name: {} for name in model.linear},
        action=action,
        timing={"dt": 0.01},
    )


@pytest.mark.parametrize("name", ["gtm.py:GTM", pytest.param("uav.toml", marks=pytest.mark.slow)])
def test_the_exact_gain_has_its_own_effects(name):
    """For the exact gain, each action has the effect of the exact gain.

    The effects are positive, nothing is noted, and no training is known.
    """
    model = model_of(f"{ROOT}/examples/{name}")
    point = hfa.trim(model, at=45.0) if name == "gtm.py:GTM" else hfa.trim(model)
    result = assess(model, exact_deployment(model, point), [point], samples=1, best=0)
    assert result.notes == []
    observations, actions = result.points[0].observations, result.points[0].actions
    assert [each.observation for each in observations] == list(model.linear)
    assert all(np.isnan(each.mean) for each in observations)
    assert [each.action for each in actions] == list(model.inputs)
    for each in actions:
        assert each.exact_effect > 0.0
        assert each.effect == pytest.approx(each.exact_effect, rel=1e-6)


def test_a_reversed_rudder_is_a_row_with_the_opposite_sign():
    """A reversed rudder has the opposite effect of the exact gain's. The other actions have theirs."""
    model = model_of(f"{ROOT}/examples/navion.py:NAVION")
    point = hfa.trim(model, at=176.0)
    right = exact_deployment(model, point)
    wrong = right.changed(action={**right.action, "rudder": {"map": "trim - a"}})
    result = assess(model, wrong, [point], samples=1, best=0)
    for each in result.points[0].actions:
        sign = -1.0 if each.action == "rudder" else 1.0
        assert each.effect == pytest.approx(sign * each.exact_effect, rel=1e-6)
    (row,) = [line for line in result.report().text().splitlines() if line.startswith("rudder ")]
    of_policy, of_exact = row.split()[1:]
    assert of_policy.startswith("-")
    assert of_policy[1:] == of_exact[1:]


def test_the_effects_shift_the_sum_of_the_eigenvalues():
    """The sum of the effects equals the difference of the sums of eigenvalues without and with K."""
    (point,) = assess(aircraft("ppo_gtm"), stored_deployment("ppo_gtm"), [45.0], samples=0).points
    loop = point.equilibrium
    moved = np.linalg.eigvals(loop.A).sum() - np.linalg.eigvals(loop.A - loop.B @ loop.K).sum()
    assert sum(each.effect for each in point.actions) == pytest.approx(moved.real, rel=1e-9)


def observed_in_flight(deployment):
    """Return the ranges of the observations in one flight and one with a disturbance pulse."""
    point = trims("ppo_gtm")[1]
    found = hfa.assess(aircraft("ppo_gtm"), deployment, [point], samples=1, best=0)
    return found.points[0].observations


def test_observations_in_degrees_are_far_from_the_training():
    """Observations of the wrong unit are far from those in training."""
    entries = stored_deployment("ppo_gtm").observation
    wrong = {**entries, "pitch": {**entries["pitch"], "scale": entries["pitch"]["scale"] / DEGREES}}
    seen = observed_in_flight(stored_deployment("ppo_gtm").changed(observation=wrong))
    (pitch,) = [each for each in seen if each.observation == "pitch"]
    assert pitch.farthest > 20.0


def test_ranges_contain_the_initial_conditions_and_the_training():
    """The ranges contain the observations of the flights, and the table the training's statistics."""
    normalizer = stored_deployment("ppo_gtm").normalizer
    seen = observed_in_flight(stored_deployment("ppo_gtm"))
    for each, mean, variance in zip(seen, normalizer.mean, normalizer.variance, strict=True):
        spread = np.sqrt(variance)
        assert each.lowest < 0.0 < each.highest
        assert (each.mean, each.spread) == (mean, pytest.approx(spread))
        farthest = max(each.highest - mean, mean - each.lowest) / spread
        assert each.farthest == pytest.approx(farthest)
