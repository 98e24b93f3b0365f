"""Kalman filters for noise and turbulence, and policies of their estimates."""

import copy
import pickle
import re
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cli import assert_refused, hfa as run
from innovations import innovations_of
from known_models import exact_gain, model_at
from project import ROOT
from scipy.linalg import expm
from scipy.stats import binom

import hfa
import hfa_flight
from hfa import BadInputError, Turbulence
from hfa_flight import MonteCarlo, Scenario, Uncertainty, flight_envelope
from hfa_flight.needs import band_text, outside_band
from hfa_flight.policies.estimate import extended_step
from hfa_flight.policies.kalman import least_rms
from hfa_flight.samples.fly import flights_in_air

DEG = np.pi / 180.0
#: A sample's noise as in ordinary sensors: ft/s, rad, rad/s.
NOISE = {
    **{"speed": 0.3, "alpha": 0.003, "pitch": 0.002},
    **{"pitch_rate": 0.003, "dihedral": 0.002, "dihedral_rate": 0.003},
}
TYPED = [f"--noise={name}={v if name == 'speed' else v / DEG}" for name, v in NOISE.items()]
AIR = "moderate:40000"
#: Sizes of a gain for severe turbulence.
MILD = {
    **{"speed": 20.0, "alpha": 5 * DEG, "pitch": 5 * DEG, "pitch_rate": 3 * DEG},
    **{"dihedral": 5 * DEG, "dihedral_rate": 20 * DEG, "throttle": 40.0},
    **{"aileron_center": 20 * DEG, "aileron_outer": 20 * DEG},
    **{"elevator_center": 3 * DEG, "elevator_outer": 3 * DEG},
}


@pytest.fixture(scope="module")
def linear():
    return model_at(10.0)  # the paper's aircraft at a dihedral angle of 10 deg


@pytest.fixture(scope="module")
def point(linear):
    return linear.point


@pytest.fixture(scope="module")
def gain():
    return exact_gain(10.0)


@pytest.fixture(scope="module")
def kalman(linear):
    return hfa.filter(linear, NOISE, AIR)


def test_the_covariance_is_the_end_of_the_riccati_recursion(point, linear):
    """P of the aircraft's states is that of the Riccati recursion iterated from 0, with Dryden's filters
    in another realization, derivatives by the gusts from differences, and Q by Simpson's rule.
    """
    dt, seconds = 0.25, 1750.0 / point["speed"]  # L/V of Dryden's filters
    found = hfa.filter(linear, NOISE, AIR, dt)
    model = point.model
    columns = []  # derivatives of the rates by the winds, by differences
    for wind in ("headwind", "updraft"):
        sides = []
        for size in (-1e-4, 1e-4):
            winds = [size * (name == wind) for name in model.disturbances]
            vectors = [[*map(ca.SX, of)] for of in (point.x, point.u, model.p)]
            rates = np.array(ca.DM(model.layout.expressions(vectors, (), winds)[0])).ravel()
            sides.append(rates[model.state_places(model.linear)])
        columns.append((sides[1] - sides[0]) / 2e-4)
    # Model of the aircraft with Dryden's filters of u and w, driven by white noise of intensity 1.
    # Figure 7 of MIL-F-8785C at 40,000 ft; u = -headwind, and w = -updraft is positive down.
    sigma = float(np.interp(40000.0, [35000.0, 45000.0], [5.0, 4.2]))
    along = -sigma * np.sqrt(2.0 / seconds)
    across = -sigma * np.sqrt(3.0 / seconds) * np.array([1.0 / (np.sqrt(3.0) * seconds), 1.0])
    A = np.zeros((9, 9))  # 6 linear states, 1 of the filter of u and 2 of that of w
    A[:6, :6] = linear.A
    A[:6, 6] = along * columns[0]
    A[:6, 7:] = np.outer(columns[1], across)
    A[6, 6] = -1.0 / seconds
    A[7:, 7:] = [[0.0, 1.0], [-1.0 / seconds**2, -2.0 / seconds]]
    # Q of a sample, ∫ e^(A t) driven e^(A' t) dt, of the drift of the states and of the air.
    drift = np.diag([*(np.array(list(found.drift.values())) ** 2), 0.0, 0.0, 0.0])
    air = np.diag([0.0] * 6 + [1.0, 0.0, 1.0])
    times = np.linspace(0.0, dt, 201)  # Simpson's rule with 200 intervals of dt / 200
    weights = np.ones(201)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    of_drift, of_air = (
        np.einsum("t,tij->ij", weights, [expm(A * t) @ driven @ expm(A * t).T for t in times])
        for driven in (drift, air)
    )
    of_air[:6], of_air[:, :6] = 0.0, 0.0  # winds are held in a sample
    Q = (of_drift + of_air) * dt / 600.0
    Phi, R = expm(A * dt), np.diag(np.array(list(NOISE.values())) ** 2)
    P = np.zeros((9, 9))  # covariance before a sample, in which all 6 states are measured
    for _ in range(4000):
        S = P[:6, :6] + R
        P = Phi @ (P - P[:, :6] @ np.linalg.solve(S, P[:6])) @ Phi.T + Q
    np.testing.assert_allclose(found.P[:6, :6], P[:6, :6], rtol=1e-5, atol=1e-12)
    after = P[:6, :6] - P[:6, :6] @ np.linalg.solve(P[:6, :6] + R, P[:6, :6])
    assert [*found.estimated.values()] == pytest.approx(np.sqrt(np.diag(after)), rel=1e-4)


#: Sensors in the air, a pitot tube and a vane, all with biases.
IN_THE_AIR = {
    **{"airspeed": hfa.Sensor(0.3, 2.0), "angle_of_attack": hfa.Sensor(0.003, 0.017)},
    **{"pitch": hfa.Sensor(0.002, 0.009), "pitch_rate": hfa.Sensor(0.003, 0.009)},
    **{"dihedral": hfa.Sensor(0.002, 0.009), "dihedral_rate": hfa.Sensor(0.003, 0.009)},
}


def test_the_nonlinear_aircraft_at_its_trim_stays_with_the_slopes_of_the_linear_one(kalman):
    x, slopes = extended_step(kalman, 0.0025)(0.0, 0.0)
    np.testing.assert_allclose(x, 0.0, atol=1e-8)
    np.testing.assert_allclose(slopes, expm(0.0025 * kalman.A), rtol=1e-7, atol=5e-9)


def mild_gain(linear):
    """Return the gain of the sizes `MILD`."""
    return hfa.solve(hfa.game(linear, sizes=MILD, delta=np.inf)).K


def test_pitot_tube_and_vane_measure_the_motion_relative_to_the_air(linear, kalman):
    """C are the slopes of what a pitot tube and a vane measure: a headwind adds to the airspeed, and an
    updraft, over the speed, to the angle of attack. A gain tolerates nearly twice the unknown delay, because
    the effect that a late command lacks is not estimated as a gust.
    """
    noise = {name: sensor.noise for name, sensor in IN_THE_AIR.items()}
    vane = hfa.filter(linear, noise, AIR)
    names = tuple(vane.sensors)
    V, alpha = linear.point["speed"], linear.point["alpha"]
    of_winds = np.zeros((2, len(vane.winds)))  # of airspeed and angle of attack, for level flight
    of_winds[0, vane.winds.index("headwind")] = 1.0
    of_winds[1, vane.winds.index("updraft")] = 1.0 / V
    places = [names.index("airspeed"), names.index("angle_of_attack")]
    np.testing.assert_allclose(vane.C[places, 6:], of_winds @ vane.W, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(vane.C[places, :2], np.eye(2), atol=1e-12)
    assert vane.at_trim[places] == pytest.approx([V, alpha])
    assert "with sensors of angle_of_attack, airspeed" in vane.text()
    assert "with sensors of" not in kalman.text()
    # Without a sensor over the ground, the law sees the speed relative to the wind along the path.
    of_speed = vane.W[vane.winds.index("headwind")]
    np.testing.assert_allclose(vane.sight[0, 6:], of_speed, atol=1e-9)
    assert not kalman.sight[0, 6:].any()
    margins = [known.policy(mild_gain(linear)).margins for known in (kalman, vane)]
    assert margins[1].unknown_delay > 1.8 * margins[0].unknown_delay


def test_biases_are_estimated(point, linear):
    """In ten seconds of light turbulence the biases of a pitot tube, a vane and a gyro are estimated
    within 4 of their standard deviations, and most of each. Before, they are unknown, not stationary.
    """
    kalman = hfa.filter(linear, IN_THE_AIR, "light:20000")
    assert kalman.P_at_begin[-1, -1] == pytest.approx(2.0**2)  # of the pitot tube
    air = Uncertainty(noise=IN_THE_AIR, turbulence=Turbulence("light", 20000.0))
    policy, scenario = kalman.policy(mild_gain(linear)).in_scenario(Scenario(10.0, uncertainty=air))
    drawn = scenario.drawn(5, 0, point)
    flight = hfa.fly(point.model, point, policy, scenario=drawn, predict=False)
    assert flight.departure is None
    names = dict.fromkeys((*point.model.linear, *drawn.sensors))
    true = dict(zip(names, np.mean(drawn.samples, axis=0), strict=True))
    for name, share in (("airspeed", 0.6), ("angle_of_attack", 0.3), ("pitch_rate", 0.1)):
        assert flight.loop.policy.biases[name] == pytest.approx(
            true[name], abs=share * IN_THE_AIR[name].bias
        )


def test_a_loop_whose_sensor_misses_samples_has_no_margins(linear):
    """A vane with a value every .1 s: no margins are given, which would be those of values in all samples,
    and its bias is less known after a minute.
    """
    every_sample, vane = (replace(IN_THE_AIR["angle_of_attack"], every=dt) for dt in (0.01, 0.1))
    told = []
    for each in (every_sample, vane):
        sensors = IN_THE_AIR | {"angle_of_attack": each}
        policy = hfa.filter(linear, sensors, "light:20000").policy(mild_gain(linear))
        told.append(policy.filter.text_of_biases())
        assert (policy.margins is None) == (each is vane)
    assert "No margins: angle_of_attack" in " ".join(policy.texts())
    left = [float(re.search(r"angle_of_attack .*? to (\S+)", text)[1]) for text in told]
    assert left[1] > left[0]


def test_modes_that_no_sensor_observes_are_named():
    """A decaying mode that no sensor observes is noted. One that does not decay is refused with the
    sensor to add, with which the filter is stable.
    """
    states = {name: hfa.Signal(nominal=1.0) for name in ("x", "y")}

    def linear(growth):
        model = hfa.Model(
            "two",
            states,
            {"u": hfa.Signal(nominal=1.0)},
            lambda x, u, p, w: ({"x": -x.x + u.u, "y": growth * x.y}, {}),
        )
        return hfa.trim(model, hold={"u": 0.0}, free=("x", "y")).linearize()

    assert hfa.filter(linear(-0.5), {"x": 0.1}).radius < 1.0
    for growth in (0.0, 0.5):
        with pytest.raises(BadInputError, match="add a sensor of y"):
            hfa.filter(linear(growth), {"x": 0.1})
        assert hfa.filter(linear(growth), {"x": 0.1, "y": 0.1}).radius < 1.0


def flights(point, policy, members, duration, level="moderate"):
    """Return the plan of flights of a policy in turbulence with sensor noise."""
    air = Turbulence(level, 40000.0 if level == "moderate" else 20000.0)
    scenario = Scenario(duration, uncertainty=Uncertainty(noise=NOISE, turbulence=air))
    policy, scenario = policy.in_scenario(scenario)
    envelope = flight_envelope(point.model, point)
    return MonteCarlo(members, 3, point.model, point, policy, scenario, envelope)


def test_the_rms_of_a_flight_is_that_of_the_covariance_from_rest(kalman, gain):
    """Over the second half of six samples. The policy sees V cos(pitch - alpha), the speed along the level
    path of the trim; the speed is larger by V (pitch - alpha)² / 2.
    """
    loop = kalman.policy(gain).loop()
    n, C, total = 9, np.zeros_like(loop.F), 0.0
    climb = np.array([(name == "pitch") - (name == "alpha") for name in [*kalman.states, *"air"]])
    H = kalman.point["speed"] * np.outer(climb, climb)
    for sample in range(6):
        if sample >= 3:
            commands = np.diag(loop.C @ C @ loop.C.T + loop.feed)
            HS = H @ C[:n, :n]
            speed = np.eye(6)[0] * (np.trace(HS) ** 2 / 4.0 + np.trace(HS @ HS) / 2.0)
            total = total + np.concatenate([np.diag(C)[:6] + speed, commands]) / 3.0
        C = loop.closed @ C @ loop.closed.T + loop.N
    np.testing.assert_allclose(loop.rms(6), np.sqrt(total), rtol=1e-6)


def test_a_filter_of_faulty_samples_equals_a_kalman_filter_in_numpy(point, kalman, gain):
    """Commands and estimates are those of a Kalman filter in NumPy, over 120 samples with missing,
    frozen and impossible values, in `faulty_samples.npz`; by `kalman_recursion.py` of commit 199915ecb.
    The estimate begins at the first sample, and anew where most values are impossible; commands are
    then faded in over 1 s. The gain acts on the speed along the horizontal path and on alpha relative
    to the air.
    """
    stored = np.load(Path(__file__).with_name("faulty_samples.npz"))
    policy = kalman.policy(gain, fade=1.0)
    for number, (y, u, x) in enumerate(zip(*map(stored.get, "yux"), strict=True)):
        U = policy(0.01 * number, y)
        np.testing.assert_allclose(U - point.u, u, rtol=1e-4, atol=1e-5)
        estimate = [policy.estimate[name] - point[name] for name in kalman.states]
        np.testing.assert_allclose(estimate, x, rtol=1e-4, atol=1e-5)
    assert policy.unused == stored["unused"] > 50
    assert f"Of {policy.unused} of 120 samples a value was not used." in policy.notes()


def test_commands_fade_in_only_where_the_initial_states_are_unknown(point, kalman, gain):
    """A flight begins at known states: at .05 rad of pitch its first command is far from the trim.
    After a reset, the first command at this value is that of the trim, and a later one is not.
    """
    start = np.zeros(7)
    start[list(point.model.states).index("pitch")] = 0.05
    policy, scenario = kalman.policy(gain).in_scenario(Scenario(0.02, initial=start))
    flight = hfa.fly(point.model, point, policy, scenario=scenario, predict=False)
    assert np.abs(flight.inputs[0] - point.u).max() > 0.3
    policy.reset()
    first, *_, last = (policy(0.0, {"pitch": point["pitch"] + 0.05 + 1e-9 * n}) for n in range(9))
    np.testing.assert_array_equal(first, point.u)
    assert 0.01 < np.abs(last - point.u).max() < 0.1
    with pytest.raises(BadInputError, match="the unknown sensor"):
        policy(0.0, {"pich": 0.0})


@pytest.fixture
def measured(point, kalman):
    """Return the values that the sensors measure at the trim."""
    return np.array([point[name] for name in kalman.sensors])


def test_copies_and_pickles_of_a_filtered_policy_have_memories_of_their_own(
    point, kalman, gain, measured
):
    """After its first sample, a policy, its copy and its pickle return the same second command, and the
    samples of one do not change another. A policy that is reset begins again, with no command.
    """
    policy = kalman.policy(gain)
    policy.begin(point.x)
    policy(0.0, measured + 1e-4 * innovations_of(kalman))
    copied, unpickled = copy.copy(policy), pickle.loads(pickle.dumps(policy))
    estimate = policy.estimate
    later = [other(0.01, measured) for other in (copied, unpickled)]
    assert policy.estimate == estimate
    np.testing.assert_array_equal(later, [policy(0.01, measured)] * 2)
    policy.reset()
    np.testing.assert_allclose(policy(0.0, measured), point.u, atol=1e-12)


def test_a_law_that_plans_is_filtered_with_the_nonlinear_model():
    """No sample of a pendulum that falls from 2.5 rad is left out. The linear model would call every
    later one impossible.
    """
    model = hfa.load_model(f"{ROOT}/examples/pendulum.py:PENDULUM")
    point = hfa.trim(model)
    noise = {"angle": 0.002, "rate": 0.01}
    planned = hfa.state_dependent(model, point, np.eye(2), np.eye(1))
    policy = hfa.filter(point.linearize(), noise, dt=planned.dt).policy(planned)
    scenario = Scenario(0.5, initial=np.array([2.5, 0.0]), uncertainty=Uncertainty(noise=noise))
    policy, scenario = policy.in_scenario(scenario)
    flight = hfa.fly(model, point, policy, scenario=scenario.drawn(3, 0, point), predict=False)
    assert flight.loop.policy.data(model)["unused_samples"] == 0


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"noise": {}}, "requires the noise of its sensors"),
        ({"noise": {"load_factor": 0.01}}, "load_factor depends on the inputs; add --servo"),
        ({"noise": {"speed": 0.0}}, "noise of speed"),
    ],
)
def test_wrong_arguments_of_a_filter_are_refused(linear, given, said):
    """The refusal contains the name of the wrong argument or the form of its text."""
    with pytest.raises(BadInputError, match=said):
        hfa.filter(linear, **given)


def test_commands_of_a_fast_gain_are_faded_in_for_longer(point, kalman, gain):
    """Commands are faded in over 3 s for the exact gain, because filter and gain alone, without the
    aircraft, are unstable with it, and over 1 s for a hundredth of it. A negative `fade` and one that
    is longer than the flight are refused.
    """
    policy = kalman.policy(gain)
    assert policy.margins.compensator_radius > 1.0
    assert "Filter and gain alone are unstable" in policy.margins.text()
    assert (policy.fade, kalman.policy(0.01 * gain).fade) == (3.0, 1.0)
    with pytest.raises(BadInputError, match="at least 0 s"):
        kalman.policy(gain, fade=-1.0)
    with pytest.raises(BadInputError, match="longer than the flight of 5 s"):
        hfa.fly(point.model, point, kalman.policy(gain, fade=9.0), scenario=Scenario(5.0))


def test_a_loop_behind_a_filter_is_stable_up_to_its_margins_and_not_beyond():
    """With a factor on one input, or commands that are later than the filter knows, the loop is stable
    at 99 % of each margin and unstable at 101 %.

    `radius` moves each unit vector of the loop's state by a sample: these are the columns of its map.
    """
    kalman, K = hfa.filter(model_at(15.0), NOISE, AIR), exact_gain(15.0)
    found = kalman.policy(K).margins
    gain = K @ kalman.sight  # of the estimate: 6 states of the aircraft and 3 of the air
    kept = np.eye(9) - kalman.L @ kalman.C
    both = np.zeros((14, 14))  # rates of these 9 states and of 5 held inputs
    both[:9] = np.hstack([kalman.A, kalman.B])

    def radius(factors, delay=0.0):
        whole, rest = int(delay // 0.01), delay % 0.01
        # The older command acts for `rest` of a sample, and the newer one for what remains of it.
        early, late = expm(both * rest)[:9], expm(both * (0.01 - rest))[:9]

        def after(state):
            x, past, predicted = state[:9], state[9:-9].reshape(whole + 1, 5), state[-9:]
            estimate = kept @ predicted + kalman.L @ kalman.C @ x
            u = -gain @ estimate
            commands = np.vstack([u * factors, past])  # the latest first
            for part, age in ((early, whole + 1), (late, whole)):
                x = part @ np.concatenate([x, commands[age]])
            predicted = kalman.Phi @ estimate + kalman.Gamma @ u
            return np.concatenate([x, commands[: whole + 1].ravel(), predicted])

        columns = [after(state) for state in np.eye(18 + 5 * (whole + 1))]
        return np.abs(np.linalg.eigvals(np.array(columns).T)).max()

    for share, is_stable in ((0.99, True), (1.01, False)):
        for margin in (found.gain_low, found.gain_high):
            more = share * (margin - 1.0)
            assert (
                max(radius(1.0 + more * one_input) for one_input in np.eye(5)) < 1.0
            ) == is_stable
        assert (radius(np.ones(5), share * found.unknown_delay) < 1.0) == is_stable
    # Filter and gain alone, without measured values.
    alone = np.linalg.eigvals((kalman.Phi - kalman.Gamma @ gain) @ kept)
    assert found.compensator_radius == pytest.approx(np.abs(alone).max(), rel=1e-9)
    without_limit = replace(found, unknown_delay=None).text()
    assert f"up to {1e3 * found.searched:.4g} ms (" in without_limit


def test_a_gain_whose_loop_is_unstable_is_flown_and_reported(point, kalman, gain):
    """Behind a filter, -K leaves the envelope. The report says that the linear loop is unstable, and
    predicts no rms by it.
    """
    policy = kalman.policy(-gain)
    margins = policy.margins
    assert margins.radius > 1.0
    assert (margins.gain_low, margins.gain_high, margins.unknown_delay) == (1.0, 1.0, 0.0)
    assert (margins.phase, margins.delay) == (0.0, 0.0)
    flown = flights_in_air(flights(point, policy, 2, 20.0))
    assert flown.report().title.startswith("FAIL: 0 of 2 ")
    assert "the filter is unstable" in str(flown)
    assert "linear_rms" not in flown.report().data


@pytest.mark.parametrize("lost", [0, 3, 5])
def test_the_confidence_limits_of_the_departures_are_those_of_the_binomial(lost):
    """`lost` of 5 flights leave the envelope. The 95 % confidence limits of the probability of a
    departure are those at which as many departures or more (lower limit), and as many or fewer (upper
    limit), have a probability of 2.5 %. None or all leave one limit, of 5 %.

    The printed upper limit is rounded up.
    """
    low, high = outside_band(lost, 5)
    tail = 0.025 if 0 < lost < 5 else 0.05
    if lost:
        assert binom.sf(lost - 1, 5, low) == pytest.approx(tail)
    if lost < 5:
        assert binom.cdf(lost, 5, high) == pytest.approx(tail)
    end = "%, 95 %" if lost else "% leave (95 %)"
    printed = float(band_text(lost, 5, "leave").partition(f" {end}")[0].split()[-1])
    assert 100.0 * high <= printed < 100.0 * high + 1.0


def test_a_pass_says_which_rms_is_far_above_its_prediction(point, linear, gain):
    """Behind a filter of still air, flights in light turbulence pass, and the title names the pitch
    rate, whose rms is more than 3 times the predicted one. Behind a filter of this turbulence, the
    title names no state.
    """
    found = {}
    for air in ("light:20000", None):
        plan = flights(point, hfa.filter(linear, NOISE, air).policy(gain), 2, 2.0, "light")
        report = flights_in_air(plan).report()
        ratio = report.data["rms"]["pitch_rate"] / report.data["linear_rms"]["pitch_rate"]
        found[air] = report.title, ratio, report.data["rms_far_above"]
    assert all(title.startswith("PASS") for title, *_ in found.values())
    title, ratio, named = found[None]
    assert ratio > 3.0
    assert named["pitch_rate"]["linear"] == pytest.approx(ratio)
    assert f"pitch_rate {ratio:.2g} times the linear prediction" in title
    assert "rms" not in found["light:20000"][0]
    assert found["light:20000"][2] == {}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("fly --filter --noise speed=.3 --policy none", "give --policy exact"),
        ("export -o c --fade 1", "add --filter"),
    ],
)
def test_wrong_filter_options_are_refused(folder, words, said):
    """A filter without noise or policy, with a command of a state, and noise alone are refused."""
    assert_refused(run(*words.split(), "--dihedral", "10"), 2, said)


def test_the_first_line_says_latency_sensors_and_biases():
    """The first line of flights in air names the latency, the sensors that are no states and the biases,
    and what more delay the linear loop tolerates, or that there are none. No policy has a smaller rms
    than that of the gusts which the delay leaves unanswered: for 30 ms at 10 deg 1.9 deg/s of the pitch
    rate (minimum-phase impulse response of the spectrum).
    """
    words = f"fly --dihedral 10 --filter --turbulence {AIR} --samples 2 --duration .1".split()
    without = run(*words, *TYPED).out.replace("\n", " ")
    assert "with noise (without latency and bias; " in without
    vane = ["--sensors", "aircraft"]  # of the paper's, six with biases
    latency = ["--servo", "20ms", "--rate", "100", "--delay", "10ms", "--bias", "airspeed=2"]
    known = run(*words, *vane, *latency).out.replace("\n", " ")
    for said in (
        "commands 10 ms late, servos of 20 ms, airspeed measured, angle_of_attack measured, 6 biases",
        " ms more in the linear loop",
        "airspeed 2 ft/s to ",
        "No policy whose commands act 10 ms late has an rms of pitch_rate below ",
    ):
        assert said in known
    alone = run(*words[:4], *words[4:6], "--duration", ".1", *TYPED).out.replace("\n", " ")
    assert "1 random flight (seed 0), without latency and bias" in alone
    least = least_rms(model_at(10.0).point, hfa_flight.turbulence_of("severe:40000"), 0.03)
    assert least["pitch_rate"] / DEG == pytest.approx(1.9, abs=0.05)
