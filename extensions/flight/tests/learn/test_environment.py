"""Environments of an aircraft: simulation, rewards, seeds and ends of episodes."""

import copy
import pickle
import runpy

import casadi as ca
import numpy as np
import pytest
from policy_cases import ROOT, aircraft, gtm_deployment, model_of, stored_deployment, trims
from small_plants import oscillator
from tolerances import SAME_FORMULA

import hfa
from hfa import BadInputError, Turbulence, environment

gymnasium = pytest.importorskip("gymnasium")
START = np.array([2.0, 0.03, 0.1, -0.05])
ACTION = {"elevator": {"box": [-1, 1], "map": "trim + 0.3 * a"}}


def elevator_environment(points=None, **more):
    """Return an environment of the GTM whose action moves the elevator by up to .3 rad."""
    return environment(aircraft("ppo_gtm"), gtm_deployment({}, action=ACTION), points, **more)


@pytest.mark.slow
def test_an_imitated_planner_flies_in_the_environment():
    """The policy that the example trains on the planner's flights costs less than half of no action."""
    imitation, nothing = runpy.run_path("examples/imitate_a_planner.py")["main"](flights=3)
    assert imitation < 0.5 * nothing


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_checker_of_gymnasium_passes():
    """The environment passes the checker of Gymnasium."""
    from gymnasium.utils.env_checker import check_env

    name = "ppo_gtm"
    check_env(environment(aircraft(name), stored_deployment(name), trims(name)[:1]))


@pytest.fixture(scope="module")
def flexible():
    """Return the registered environment of the flexible aircraft, at its default of 15 deg."""
    flights = gymnasium.make("hfa.gym:hfa/Flexible-v0").unwrapped
    assert np.degrees(flights.point.states.dihedral) == pytest.approx(15.0)
    return flights


def test_episodes_begin_in_the_box_and_survive_a_second_without_action(flexible):
    nothing = np.zeros(flexible.action_space.shape)
    box = np.array([*flexible.start_box.values()])
    rows = flexible.model.state_places(flexible.model.linear)
    for seed in range(5):
        # A reset draws the initial states of the linear model from the box about the trim.
        start = flexible.reset(seed=seed)[1]["X"] - flexible.point.x
        assert (np.abs(start[rows]) <= box).all()
        stepped = [flexible.step(nothing) for _ in range(round(1.0 / flexible.dt))]
        assert not any(has_left for _, _, has_left, *_ in stepped)


def test_the_flexible_aircraft_has_the_cost_of_the_papers_game(flexible):
    cost = flexible.deployment.cost
    game = hfa.paper.published_game(flexible.point.linearize())
    assert [*cost["Q"].values()] == np.diag(game.Q).tolist()
    assert [*cost["R"].values()] == np.diag(game.R).tolist()


@pytest.fixture
def costly():
    """Return an environment of 1 s, 50 samples of 0.02 s, with weights of speed, alpha and elevator."""
    cost = {"Q": {"speed": 0.5, "alpha": 8.0}, "R": {"elevator": 2.0}}
    deployment = gtm_deployment({}, action=ACTION, cost=cost)
    return environment(aircraft("ppo_gtm"), deployment, trims("ppo_gtm")[1], seconds=1.0)


def test_the_reward_is_the_negative_cost_of_the_sample(costly):
    """The sample of 0.02 s begins 2 m/s and 0.03 rad of alpha off the trim, and moves the elevator by
    0.3 * 0.5 rad. The weights of speed, alpha and elevator are 0.5, 8 and 2.
    """
    costly.reset(options={"state": costly.point.x + START})
    _, reward, terminated, truncated, _ = costly.step(np.array([0.5]))
    paid = 0.02 * (0.5 * 2.0**2 + 8.0 * 0.03**2 + 2.0 * 0.15**2)
    assert (reward, terminated, truncated) == (pytest.approx(-paid, rel=SAME_FORMULA), False, False)


def test_an_episode_that_leaves_the_limits_is_charged_for_the_remaining_samples(costly):
    """Alpha, of weight 8, leaves in the first of 50 samples of 0.02 s. Each of the 49 others is charged for
    the same cost, and for speed and alpha, of weights 0.5 and 8, at their limits farthest from the trim.
    """
    model, point = costly.model, costly.point
    edge = model.states["alpha"].max - 1e-3
    costly.reset(options={"state": {"alpha": edge, "pitch_rate": 3.0}})
    _, reward, terminated, _, info = costly.step(np.array([0.0]))
    assert terminated
    assert info["left"].startswith("alpha above ")
    farthest = {}
    for name in ("speed", "alpha"):
        signal = model.states[name]
        farthest[name] = max(point[name] - signal.min, signal.max - point[name])
    assert np.isfinite([*farthest.values()]).all()
    paid = 50 * 8.0 * (edge - point["alpha"]) ** 2
    paid += 49 * (0.5 * farthest["speed"] ** 2 + 8.0 * farthest["alpha"] ** 2)
    assert reward == pytest.approx(-0.02 * paid, rel=1e-9)


def test_an_episode_ends_if_the_action_is_nan():
    """The map has no value for the action -0.8: log(-0.8 + 0.5). The episode ends, without a delay by a
    state that is nan, and with a delay at once. The observation of the sample before is returned,
    with a large cost.
    """
    model, points = aircraft("ppo_gtm"), trims("ppo_gtm")[1:2]
    action = {"elevator": {"box": [-1, 1], "map": "trim + 0.1 * log(a + 0.5)"}}
    for delay, said in (
        (0.0, "speed is not finite at 0.04 s"),
        (0.02, "the command is not a number"),
    ):
        timing = {"dt": 0.02, "delay": delay}
        env = environment(
            model, gtm_deployment({}, action=action, timing=timing), points, seconds=1.0
        )
        env.reset(seed=1)
        before, *_ = env.step(np.array([1.0]))
        after, reward, terminated, truncated, info = env.step(np.array([-0.8]))
        assert (terminated, truncated) == (True, False)
        assert said in info["left"]
        assert reward < -1e6
        np.testing.assert_array_equal(after, before)


@pytest.mark.parametrize("sensors", [{}, {"pitch_rate": hfa.Sensor(0.0, bias=0.03)}])
def test_fly_and_environments_give_equal_flights(sensors):
    """A flight and an episode of one second, 50 samples, with the same gain, a delay of a sample and a
    half and the same bias end at the same state. The first observation has the bias.
    """
    model, point = aircraft("ppo_gtm"), trims("ppo_gtm")[1]
    gain = np.array([[0.0, 0.4, 0.2, 0.4], [-1.0, 0.0, 0.0, 0.0]])
    o = ca.SX.sym("o", 4)
    action = {"elevator": {"box": [-9, 9]}, "throttle": {"box": [-9, 9]}}
    policy = {"file": ca.Function("gain", [o], [ca.DM(gain) @ o])}
    timing = {"dt": 0.02, "delay": 0.03}
    deployment = gtm_deployment(policy, action=action, timing=timing)
    env = environment(model, deployment, [point], sensors=sensors)
    observation, _ = env.reset(options={"state": np.add(point.states, START)})
    errors = observation - START.astype(np.float32)
    assert np.abs(errors) == pytest.approx([0.0, 0.0, 0.03 * bool(sensors), 0.0], abs=1e-6)
    flight = hfa.Scenario(1.0, tick=0.02, initial=START, samples=np.tile(errors, (50, 1)))
    flown = hfa.fly(model, point, deployment, scenario=flight, predict=False).states[-1]
    for _ in range(50):
        observation, *_, info = env.step(gain @ observation.astype(float))
    np.testing.assert_allclose(info["X"], flown, rtol=1e-5)


def test_actions_act_within_their_box():
    """An action beyond the box [-1, 1] has the effect of its nearer end, and costs as much."""
    env = elevator_environment(trims("ppo_gtm")[1])
    effects = {}
    for action in (-7.0, -1.0, 1.0, 7.0):
        env.reset(seed=1)
        _, reward, _, _, info = env.step(np.array([action]))
        effects[action] = [reward, *info["X"], *info["U"]]
    assert effects[-7.0] == effects[-1.0] != effects[1.0] == effects[7.0]


def test_a_limit_passed_between_two_samples_is_named():
    """An oscillator of 1 Hz is below -1 m only in the middle of a sample of half a second."""
    env = environment(oscillator(), dt=0.5)
    env.reset(options={"state": {"x": 0.0, "v": -9.0}})
    *_, terminated, _, info = env.step(np.array([0.0]))
    assert terminated
    assert info["left"].startswith("x below -1 m")


def test_options_of_a_reset_are_obeyed_or_refused():
    """An initial state, of all states or of some by name beside those of a trim, is the one of the
    episode. Unknown options, wrong states and a trim that is not there are refused.
    """
    points = trims("ppo_gtm")[:2]
    env = elevator_environment(points)
    trimmed = np.array(points[1].states)
    _, info = env.reset(options={"state": {"alpha": 0.1}, "trim": 1})
    np.testing.assert_array_equal(
        info["X"], np.where(np.array([*env.model.states]) == "alpha", 0.1, trimmed)
    )
    _, info = env.reset(options={"state": trimmed, "trim": 1})
    np.testing.assert_array_equal(info["X"], trimmed)
    for options, said in (
        ({"start": trimmed}, "unknown option 'start'"),
        ({"trim": 1}, "add a state"),
        ({"state": trimmed[:-1]}, "finite numbers, one for each state"),
        ({"state": {"alfa": 0.1}}, "unknown state 'alfa'"),
        ({"state": {"alpha": 9.0}}, r"options: state: alpha is .* within the limits"),
        ({"state": trimmed, "trim": 7}, "the last trim has the index"),
    ):
        with pytest.raises(BadInputError, match=said):
            env.reset(options=options)


def test_wrong_actions_and_steps_out_of_turn_are_refused():
    env = environment(aircraft("ppo_gtm"), dt=0.05, seconds=0.1)
    still = np.zeros(2, np.float32)
    with pytest.raises(BadInputError, match="call reset"):
        env.step(still)
    env.reset(seed=1)
    for wrong in ([np.nan, 0.0], [0.0], ["full", 0.0], None):
        with pytest.raises(BadInputError, match="the action"):
            env.step(wrong)
    # The second sample of 0.05 s ends the episode of 0.1 s (truncated).
    assert [env.step(still)[3] for _ in range(2)] == [False, True]
    with pytest.raises(BadInputError, match="no episode is under way"):
        env.step(still)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"points": trims("ppo_hfa")}, "was trimmed with"),
        ({"dt": 0.05}, r"timing\.dt"),
        ({"R": [1.0]}, r"R cannot be combined with a deployment; change cost\.R"),
        ({"deployment": None, "Q": np.ones((4, 4))}, "Q is not a diagonal matrix of 4 weights"),
        (
            {"deployment": gtm_deployment({}, action={"elevator": {}})},
            r"action\.elevator has no box",
        ),
        ({"seconds": 0.001}, "give at least the sample time"),
        ({"vary": {"panel_weight": (1.0, 2.0)}}, "unknown parameter 'panel_weight'"),
        ({"vary": {"lift_slope": (2.0, 1.0)}}, "ascending order"),
        ({"vary": {"lift_slope": (-9.0, 1.0)}}, "lift_slope is -9"),
    ],
)
def test_wrong_arguments_of_an_environment_are_refused(given, said):
    """Wrong points, weights, actions, times and drawn parameters are refused."""
    model = model_of(f"{ROOT}/examples/gtm.py:UNCERTAIN_GTM")
    with pytest.raises(BadInputError, match=said):
        environment(model, **{"deployment": stored_deployment("ppo_gtm"), **given})


@pytest.mark.filterwarnings("ignore:turbulence without")
@pytest.mark.parametrize(
    "copied",
    [
        pytest.param(copy.deepcopy, marks=pytest.mark.slow),
        lambda env: pickle.loads(pickle.dumps(env)),
    ],
)
def test_a_copy_of_an_environment_continues_at_the_same_sample(copied):
    """A copy has the observations, rewards and next draws of the original, in turbulence with a drawn
    parameter and a delay. It does not move the original.
    """
    model = model_of(f"{ROOT}/examples/gtm.py:UNCERTAIN_GTM")
    deployment = gtm_deployment({}, action=ACTION, timing={"dt": 0.02, "delay": 0.03})
    air = Turbulence("light", 150.0, span=2.0)
    vary = {"lift_slope": (0.9, 1.1)}
    env = environment(model, deployment, [45.0], turbulence=air, vary=vary)
    env.reset(seed=4)
    env.step(np.array([0.3]))
    other = copied(env)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 1))
    runs = [[environment.step(action)[:2] for action in actions] for environment in (other, env)]
    for (seen, reward), (same, equal) in zip(*runs, strict=True):
        assert reward == equal
        np.testing.assert_array_equal(seen, same)
    again = [environment.reset() for environment in (other, env)]  # the next draws are equal too
    np.testing.assert_array_equal(again[0][0], again[1][0])
    assert again[0][1]["parameters"] == again[1][1]["parameters"]


@pytest.mark.filterwarnings("ignore:turbulence without")
def test_episodes_with_equal_seeds_have_equal_turbulence():
    """From one initial state, turbulence is equal for equal seeds, and differs for different seeds. A
    pitot tube measures it, and the speed over the ground does not.
    """
    light = Turbulence("light", 150.0, span=2.0)
    point = trims("ppo_gtm")[1]
    sensors = dict.fromkeys(("speed", "airspeed"), 0.0)
    env = environment(aircraft("ppo_gtm"), None, point, turbulence=light, sensors=sensors)
    still = env.action_space.low * 0.0
    runs = []
    for seed in (5, 5, 6):
        env.reset(seed=seed, options={"state": np.array(point.states)})
        runs.append([env.step(still)[0] for _ in range(20)])
    np.testing.assert_array_equal(runs[0], runs[1])
    assert np.abs(np.subtract(runs[0], runs[2])).max() > 1e-3
    assert np.abs(np.diff(runs[0])).max() > 1e-3
