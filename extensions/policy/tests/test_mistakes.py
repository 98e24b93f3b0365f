"""Planted mistakes of deployment files, and correct files."""

import shutil
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from policy_cases import AIRCRAFT, FOLDER, ROOT, aircraft, model_of, stored_deployment, trims

import hfa
from hfa_policy.assessment import Assessor
from hfa_policy.change_flights import ChangeFlights, Sample
from hfa_policy.deployed import Deployed
from hfa_policy.deployment import Deployment
from hfa_policy.mistakes import mistakes_of
from hfa_policy.mistakes_in_files import mistakes_in_files
from hfa_policy.normalizer import read_normalizer
from hfa_policy.normalizer_evidence import unknown_normalizer
from hfa_policy.observation_evidence import UNCLEAR
from hfa_policy.repairs import deployment_with_gain
from hfa_policy.trims import trims_of

DEGREES = 180.0 / np.pi


def kinds(name, deployment):
    """Return the kinds of mistakes that follow from the files of a policy."""
    deployed = Deployed(deployment, aircraft(name))
    return [mistake.kind for mistake in mistakes_in_files(deployed, trims(name))]


def with_policy(name, **entries):
    changed = {
        key: value for key, value in stored_deployment(name).policy.items() if key not in entries
    }
    given = {key: value for key, value in entries.items() if value is not None}
    return stored_deployment(name).changed(policy={**changed, **given})


def observed(name, **entries):
    observation = {
        key: {**value, **entries} for key, value in stored_deployment(name).observation.items()
    }
    return stored_deployment(name).changed(observation=observation)


@pytest.mark.parametrize("name", AIRCRAFT)
def test_correct_deployment_files_have_no_mistake(name):
    """No mistake is reported for correct deployment files."""
    assert kinds(name, stored_deployment(name)) == []


@pytest.mark.parametrize("name", ["ppo_gtm", "a2c_gtm", "td3_gtm", "ppo_c172"])
def test_a_missing_normalizer_is_named(name):
    """A deployment file without the normalizer used in training is reported."""
    assert kinds(name, with_policy(name, normalizer=None)) == ["no normalizer"]


@pytest.mark.parametrize(("name", "proved"), [("a2c_gtm", True), ("td3_gtm", False)])
def test_missing_normalizer_is_proved_for_a2c_not_td3(name, proved):
    """A missing normalizer is proved for A2C and likely for TD3. No other mistake is reported."""
    deployed = Deployed(with_policy(name, normalizer=None), aircraft(name))
    assert [mistake.proved for mistake in mistakes_in_files(deployed, trims(name))] == [proved]


def of_eight_environments(last, last_original):
    """Return a deployment of a SAC policy without normalizer, trained in eight environments.

    last, last_original: last observations in training, normalized and original, (8, 4)
    """
    deployment = Deployment.load(FOLDER / "sac_gtm.toml")
    actor = deployment.actor
    stored = replace(actor.stored, last=last, last_original=last_original, environments=8)
    vars(deployment)["actor"] = replace(actor, stored=stored)
    return deployment


def test_linear_observations_prove_a_missing_sac_normalizer():
    """A missing normalizer of SAC is proved if the stored observations are linear in the original
    ones.

    Clipped values are excepted.
    """
    original = np.random.default_rng(1).normal(size=(8, 4))
    last = np.clip((original - 0.1) / [0.3, 0.5, 0.9, 1.1], -2.0, 2.0).astype(np.float32)
    deployed = Deployed(of_eight_environments(last, original), aircraft("sac_gtm"))
    (found,) = mistakes_in_files(deployed, trims("sac_gtm"))
    assert (found.kind, found.proved) == ("no normalizer", True)


@pytest.mark.parametrize("change", [0.0, 0.003, 1.0])
def test_sac_trained_without_normalizer_has_no_mistake(change):
    """For a SAC policy that was trained without a normalizer, no mistake is reported.

    The stored observations differ from the original ones by random changes of any size.
    """
    random = np.random.default_rng(1)
    original = random.normal(size=(8, 4))
    last = original + change * random.normal(size=(8, 4))
    assert kinds("sac_gtm", of_eight_environments(last, original)) == []


def test_a_superfluous_normalizer_of_sac_is_named():
    """A superfluous normalizer of SAC is reported if eight environments prove that none was used.

    The records of one environment do not prove a superfluous normalizer.
    """
    random = np.random.default_rng(1)
    original = random.normal(size=(8, 4))
    several = of_eight_environments(original + 0.003 * random.normal(size=(8, 4)), original)
    given = {**several.policy, "normalizer": "td3_gtm.pkl"}
    wrong = several.changed(policy=given)
    vars(wrong)["actor"] = several.actor
    assert kinds("sac_gtm", wrong) == ["a normalizer too many"]
    one = with_policy("sac_gtm", normalizer="td3_gtm.pkl")
    assert "a normalizer too many" not in kinds("sac_gtm", one)


def test_constant_observations_leave_the_normalizer_undecided():
    """From stored observations without variation, a missing normalizer is neither proved nor
    excluded.
    """
    unvaried = of_eight_environments(np.full((8, 4), 0.001), np.zeros((8, 4)))
    assert kinds("sac_gtm", unvaried) == []
    assert "does not show whether" in unknown_normalizer(Deployed(unvaried, aircraft("sac_gtm")))


def test_one_sac_environment_leaves_the_normalizer_undecided():
    """The records of one SAC environment cause a warning that a normalizer may have been used.

    The warning is omitted if the deployment file specifies that none was used.
    """
    said = unknown_normalizer(Deployed(stored_deployment("sac_gtm"), aircraft("sac_gtm")))
    assert 'else normalizer = "none"' in said
    for name in ("sac_gtm", "ppo_gtm", "a2c_gtm"):
        told = Deployed(with_policy(name, normalizer="none"), aircraft(name))
        assert unknown_normalizer(told) == ""


def test_normalizer_none_reports_no_missing_normalizer():
    """With `normalizer = "none"`, no missing normalizer is reported."""
    assert kinds("ppo_gtm", with_policy("ppo_gtm", normalizer="none")) == []


def test_a_superfluous_normalizer_is_named():
    """A normalizer for a policy that was trained without one is reported."""
    found = kinds("ppo_raw", with_policy("ppo_raw", normalizer="ppo_gtm.pkl"))
    assert found == ["a normalizer too many"]


@pytest.mark.parametrize(("name", "other"), [("ppo_gtm", "a2c_gtm"), ("a2c_gtm", "td3_gtm")])
def test_the_normalizer_of_another_checkpoint_is_named(name, other):
    """The normalizer of another checkpoint is named, without any further finding."""
    found = kinds(name, with_policy(name, normalizer=f"{other}.pkl"))
    assert found == ["another checkpoint's normalizer"]


def test_a_normalizer_without_count_causes_no_finding():
    """A normalizer given as a table without a count causes no finding."""
    stored = read_normalizer(FOLDER / "ppo_gtm.pkl")
    table = {"mean": stored.mean, "variance": stored.variance}
    assert kinds("ppo_gtm", with_policy("ppo_gtm", normalizer=table)) == []


@pytest.mark.parametrize("name", ["ppo_gtm", "ppo_raw", "a2c_gtm", "ppo_hfa"])
def test_absolute_values_for_deviations_are_named(name):
    """Observations without subtraction of the trim are reported for policies that observe
    deviations.
    """
    assert "absolute values for deviations" in kinds(name, observed(name, about=0.0))


def test_degrees_for_radians_are_named_beyond_limits():
    """Degrees in place of radians are reported as a wrong scale."""
    name = "ppo_gtm"
    scaled = {
        key: {**entry, "scale": entry["scale"] * (1.0 if key == "speed" else DEGREES)}
        for key, entry in stored_deployment(name).observation.items()
    }
    assert "scale" in kinds(name, stored_deployment(name).changed(observation=scaled))


def trained_on_absolute_values():
    """Return a deployment whose normalizer contains statistics of absolute values."""
    right = observed("ppo_gtm", about=0.0)
    deployed = Deployed(right, aircraft("ppo_gtm"))
    trim = deployed.trim_vector(trims("ppo_gtm")[1])
    n, m = len(deployed.model.states), len(deployed.model.inputs)
    mean = np.array(deployed.observe(trim[:n], trim[n : n + m], trim)).ravel()
    variance = read_normalizer(FOLDER / "ppo_gtm.pkl").variance
    table = {"mean": mean, "variance": variance}
    return right.changed(policy={**right.policy, "normalizer": table})


def test_a_wrong_observation_order_is_unclear():
    """A wrong order of absolute observations is reported as unclear.

    The order is not reported as a confusion of absolute values and deviations.
    """
    right = trained_on_absolute_values()
    names = ["pitch", "alpha", "pitch_rate", "speed"]
    wrong = right.changed(observation={key: right.observation[key] for key in names})
    assert kinds("ppo_gtm", right) == []
    assert set(kinds("ppo_gtm", wrong)) == {UNCLEAR}


def test_absolute_degrees_are_not_reported_as_deviations():
    """Absolute angles in degrees are not reported as deviations from the trim.

    At most an unclear mistake is reported.
    """
    right = trained_on_absolute_values()
    observation = {
        key: {**entry, "scale": entry["scale"] / (1.0 if key == "speed" else DEGREES)}
        for key, entry in right.observation.items()
    }
    assert set(kinds("ppo_gtm", right.changed(observation=observation))) <= {UNCLEAR}


def test_omitted_scales_are_reported_as_unclear():
    """Omitted scales of absolute observations are reported as unclear, not as deviations."""
    right = observed("ppo_raw", about=0.0)
    stored = stored_deployment("ppo_raw").actor.stored
    last = stored.last.copy()
    last[:, 0] += 45.0 / right.observation["speed"]["scale"]
    wrong = observed("ppo_raw", about=0.0, scale=1.0)
    actor = replace(stored_deployment("ppo_raw").actor, stored=replace(stored, last=last))
    vars(right)["actor"] = vars(wrong)["actor"] = actor
    assert kinds("ppo_raw", right) == []
    assert set(kinds("ppo_raw", wrong)) == {UNCLEAR}


def with_reversed_sign(name, action):
    entries = {key: dict(entry) for key, entry in stored_deployment(name).action.items()}
    entries[action]["map"] = entries[action]["map"].replace("+", "-")
    return stored_deployment(name).changed(action=entries)


def exchanged(name, one, other):
    names = list(stored_deployment(name).observation)
    names[one], names[other] = names[other], names[one]
    return stored_deployment(name).changed(
        observation={key: stored_deployment(name).observation[key] for key in names}
    )


def suggested(name, deployment, points=None):
    """Return the texts of the changes that are suggested for a deployment.

    The function asserts that no mistake is proved.

    points: trims, or None for the trims of the policy
    """
    assessor = Assessor(Deployed(deployment, aircraft(name)), points or trims(name), 24)
    found = list(mistakes_of(assessor, assessor.assessed()))
    assert not any(mistake.proved for mistake in found)
    return [mistake.text for mistake in found]


@pytest.mark.parametrize("name", ["ppo_gtm", pytest.param("ppo_raw", marks=pytest.mark.slow)])
def test_the_sign_of_an_action_is_suggested(name):
    """For an action with a reversed sign, the first suggestion is the other sign."""
    (first, *_) = suggested(name, with_reversed_sign(name, "elevator"), trims(name)[:1])
    assert first.startswith("flights would improve if the action of elevator had the other sign")


@pytest.mark.slow
def test_the_order_of_observations_is_suggested():
    """For two exchanged observations, the exchange is among the suggestions."""
    found = suggested("ppo_raw", exchanged("ppo_raw", 0, 3))
    assert any("pitch and speed were exchanged" in text for text in found)


def rescaled(name, of):
    """Return the deployment of a policy with changed scales of the observed angles.

    of: function from a scale to the changed scale
    """
    observation = {
        key: {**entry, "scale": entry["scale"] if key == "speed" else of(entry["scale"])}
        for key, entry in stored_deployment(name).observation.items()
    }
    return stored_deployment(name).changed(observation=observation)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (rescaled("ppo_raw", lambda scale: scale / DEGREES), "its angles were observed in radians"),
        (rescaled("ppo_raw", lambda scale: scale * DEGREES), "its angles were observed in degrees"),
        (
            stored_deployment("ppo_raw").changed(timing={"dt": 0.16}),
            "the policy were sampled every",
        ),
    ],
)
def test_degrees_and_the_sample_time_are_suggested(changed, said):
    """Wrong units of angles and a wrong sample time are among the suggestions."""
    assert any(said in text for text in suggested("ppo_raw", changed))


def without_records(deployment, times=1.0):
    """Return a deployment after removing its records of training.

    The deployment itself is changed.

    times: factor on the output of the policy
    """
    actor = stored_deployment("ppo_raw").actor
    o = ca.SX.sym("o", actor.function.numel_in(0))
    function = ca.Function("alone", [o], [times * actor.function(o)])
    vars(deployment)["actor"] = replace(actor, function=function, rows=None, stored=None)
    return deployment


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of", "said"),
    [
        (lambda scale: scale / DEGREES, "its angles were observed in radians"),
        (lambda scale: scale * DEGREES, "its angles were observed in degrees"),
    ],
)
def test_degrees_are_suggested_without_training_records(of, said):
    """A wrong angle unit is suggested as the mistake of a policy without records of its
    training.
    """
    found = suggested("ppo_raw", without_records(rescaled("ppo_raw", of)))
    assert any(said in text for text in found)


@pytest.mark.slow
@pytest.mark.parametrize("times", [0.25, 1.0, 4.0])
def test_correct_deployments_without_records_get_no_suggestion(times):
    """For a correct deployment file without records of training, no change is suggested.

    The output of the policy is multiplied by a factor.
    """
    right = Deployment.load(FOLDER / "ppo_raw.toml")
    assert suggested("ppo_raw", without_records(right, times)) == []


@pytest.mark.slow
def test_a_stable_exchange_gets_no_suggestion():
    """If two observations are exchanged and the loop is still stable, no change is suggested."""
    assert suggested("ppo_raw", exchanged("ppo_raw", 1, 2)) == []


@pytest.mark.slow
@pytest.mark.parametrize("times", [0.25, 2.0, 4.0])
@pytest.mark.parametrize("name", ["a2c_gtm", "ppo_gtm", "ppo_raw"])
def test_a_correct_deployment_gets_no_suggestion(name, times):
    """For a correct deployment file whose policy is stronger or weaker, no change is suggested."""
    actor = stored_deployment(name).actor
    o = ca.SX.sym("o", actor.function.numel_in(0))
    strong = Deployment.load(FOLDER / f"{name}.toml")
    function = ca.Function("strong", [o], [times * actor.function(o)])
    vars(strong)["actor"] = replace(actor, function=function, rows=None)
    assert suggested(name, strong) == []


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.02, 0.06])
@pytest.mark.parametrize("name", [name for name in AIRCRAFT if name != "ppo_c172"])
def test_a_correct_deployment_with_delay_gets_no_suggestion(name, delay):
    """For a correct deployment file with a delay of 0 or more, no change is suggested."""
    timing = {**stored_deployment(name).timing, "delay": delay}
    assert suggested(name, stored_deployment(name).changed(timing=timing)) == []


F16 = f"{ROOT}/examples/f16_constant.py:F16"
SCALES = {"speed": 50.0, "alpha": 0.1, "pitch": 0.2, "pitch_rate": 0.5}


def optimum_on_f16(times=1.0):
    """Return a deployment of the exact optimum on the F-16, with scaled observations.

    times: factor on the gain
    """
    Q = {name: scale**-2 for name, scale in SCALES.items()}
    R = {"thrust": 1e-6, "elevator": 0.04}
    model = model_of(F16)
    linear = hfa.linearize(model, hfa.trim(model, hold={"speed": 502.0}))
    K = hfa.solve(hfa.game(linear, Q, R)).K
    o = ca.SX.sym("o", 4)
    sizes = np.array([SCALES[name] for name in model.linear])
    return Deployment(
        policy={"file": ca.Function("optimum", [o], [ca.mtimes(ca.DM(-times * K * sizes), o)])},
        observation={name: {"about": "trim", "scale": SCALES[name]} for name in model.linear},
        action={"thrust": {"map": "trim + a"}, "elevator": {"map": "trim + a"}},
        timing={"dt": 0.05},
        cost={"Q": Q, "R": R},
    )


def kinds_on_f16(deployment):
    """Return the kinds of mistakes that are reported for a deployment on the F-16."""
    model = model_of(F16)
    assessor = Assessor(Deployed(deployment, model), trims_of(model, [502.0]), 12)
    return [mistake.kind for mistake in mistakes_of(assessor, assessor.assessed())]


def with_mistake(kind):
    """Return the deployment of the optimum on the F-16 with one planted mistake.

    kind: kind of the mistake
    """
    right = optimum_on_f16()
    observation = {name: dict(entry) for name, entry in right.observation.items()}
    if kind == "sign":
        action = {**right.action, "elevator": {"map": "trim - a"}}
        return right.changed(action=action)
    if kind == "map":
        return right.changed(action={**right.action, "elevator": {"map": f"trim + {DEGREES} * a"}})
    if kind == "actions":
        return right.changed(action={name: right.action[name] for name in ("elevator", "thrust")})
    if kind == "order":
        names = ["alpha", "speed", "pitch", "pitch_rate"]
        return right.changed(observation={name: observation[name] for name in names})
    for name, entry in observation.items():
        if kind == "about":
            entry["about"] = 0.0
        elif kind == "degrees" and name != "speed":
            entry["scale"] *= DEGREES
        elif kind == "scale":
            entry["scale"] = 1.0
    return right.changed(observation=observation)


@pytest.mark.parametrize("kind", ["sign", "order", "about", "degrees", "scale", "map", "actions"])
def test_mistakes_are_reported_on_the_f16(kind):
    """Each planted kind of mistake is reported on the F-16."""
    assert kind in kinds_on_f16(with_mistake(kind))


@pytest.mark.parametrize(("times", "found"), [(-0.1, ["sign"]), (-0.02, []), (-10.0, [])])
def test_a_change_is_named_only_near_the_optimum(times, found):
    """A wrong sign is reported for -0.1 times the optimal gain, but not for -0.02 or -10 times.

    times: factor on the optimal gain
    found: expected kinds of mistakes
    """
    assert kinds_on_f16(optimum_on_f16(times)) == found


def test_the_sampled_optimum_costs_as_predicted():
    """Flights of the exact optimum as a deployment cost as much as the sampled optimum, to 3 %."""
    model = model_of(F16)
    deployed = Deployed(optimum_on_f16(), model)
    assessor = Assessor(deployed, tuple(trims_of(model, [502.0])), 4)
    flights = ChangeFlights(assessor, assessor.places(assessor.flight()))
    (own,) = flights.simulate([deployment_with_gain(deployed.deployment, 1.0)], Sample(8, 20.0))
    optimum = flights.simulate_optimum(Sample(8, 20.0))
    assert optimum.kept == own.kept == 8
    assert own.times(optimum) == pytest.approx(1.0, abs=0.03)


def with_attitude(model):
    """Return the model with a further output, attitude, that equals the pitch angle."""

    def equations(x, u, p, w):
        rates, outputs = model.equations(x, u, p, w)
        return rates, outputs | {"attitude": x.pitch}

    outputs = model.outputs | {"attitude": hfa.Signal("rad", nominal=0.1)}
    return replace(model, equations=equations, outputs=outputs)


def test_weights_of_outputs_and_states_cost_equally():
    """An output that equals a state has the cost and the optimum of this state."""
    model = with_attitude(model_of(F16))
    right = optimum_on_f16(0.1)
    Q, R = right.cost["Q"], right.cost["R"]
    moved = {name: Q[name] for name in Q if name != "pitch"} | {"attitude": Q["pitch"]}
    sample = Sample(4, 5.0)
    flown = []
    for weights in (Q, moved):
        deployment = right.changed(cost={"Q": weights, "R": R})
        assessor = Assessor(Deployed(deployment, model), tuple(trims_of(model, [502.0])), 4)
        flights = ChangeFlights(assessor, assessor.places(assessor.flight()))
        repairs = [deployment_with_gain(deployment, gain) for gain in (1.0, 0.0)]
        flown.append([*flights.simulate(repairs, sample), flights.simulate_optimum(sample)])
    for of_states, of_outputs in zip(*flown, strict=True):
        assert of_outputs.costs == pytest.approx(of_states.costs, rel=1e-6)
        assert of_outputs[1:] == of_states[1:]


def test_all_signs_are_suggested_together():
    """If all actions have the wrong sign, the first suggestion changes all signs."""
    right = optimum_on_f16()
    turned_all = {name: {"map": "trim - a"} for name in right.action}
    model = model_of(F16)
    wrong = right.changed(action=turned_all)
    assessor = Assessor(Deployed(wrong, model), trims_of(model, [502.0]), 24)
    texts = [mistake.text for mistake in mistakes_of(assessor, assessor.assessed())]
    assert "all actions had the other sign" in texts[0]


@pytest.mark.slow
@pytest.mark.parametrize("times", [0.02, 0.2, 1.0, 3.0])
def test_a_scaled_optimal_gain_gets_no_suggestion(times):
    """For the optimal gain multiplied by 0.02 to 3, no change is suggested."""
    assert kinds_on_f16(optimum_on_f16(times)) == []


@pytest.mark.slow
@pytest.mark.parametrize("samples", [2, 6])
def test_a_delayed_optimum_gets_no_suggestion(samples):
    """For the optimum with a delay, no change is suggested."""
    assert (
        kinds_on_f16(optimum_on_f16().changed(timing={"dt": 0.05, "delay": samples * 0.05})) == []
    )


@pytest.mark.slow
def test_a_reversed_sign_is_found_with_delay():
    """A reversed sign is found also for an optimal gain with delay."""
    late = with_mistake("sign").changed(timing={"dt": 0.05, "delay": 0.1})
    assert "sign" in kinds_on_f16(late)


def test_a_missing_normalizer_file_is_refused(tmp_path):
    """A deployment file whose normalizer does not exist is refused, with the normalizer's name."""
    for file in ("ppo_gtm.toml", "ppo_gtm.zip"):
        shutil.copy(FOLDER / file, tmp_path)
    with pytest.raises(ValueError, match=r"ppo_gtm\.pkl: cannot be read"):
        Deployed(Deployment.load(tmp_path / "ppo_gtm.toml"), aircraft("ppo_gtm")).command  # noqa: B018
