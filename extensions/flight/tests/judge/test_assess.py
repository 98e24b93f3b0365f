"""Results of `assess` in Python and as JSON, and outcomes of flights."""

import math
from dataclasses import replace

import casadi as ca
import control
import numpy as np
import pytest
from policy_cases import (
    FOLDER,
    GTM,
    ROOT,
    aircraft,
    gtm_deployment,
    model_of,
    stored_deployment,
    trims,
)
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import hfa
from hfa import Deployment, assess
from hfa_flight import Deployed


@pytest.mark.slow  # searches of best flights
def test_starts_without_a_best_flight_are_counted():
    """Costs are compared from where v' = v + v^3 + f, |f| <= 1, can return: v + v^3 < 1.

    f = -2 v + 4 v^3 returns from v^2 < 1/5 alone.
    """
    model = hfa.Model(
        "cubic",
        {"v": hfa.Signal(min=-3.0, max=3.0)},
        {"f": hfa.Signal(min=-1.0, max=1.0)},
        lambda x, u, p, w: ({"v": x.v + x.v**3 + u.f}, {}),
        trim={"v": 0.0},
    )
    o = ca.SX.sym("o")
    weak = Deployment(
        policy={"file": ca.Function("gain", [o], [-2.0 * o + 4.0 * o**3])},
        observation={"v": {}},
        action={"f": {"box": [-1.0, 1.0]}},
        timing={"dt": 0.02},
        cost={"Q": {"v": 1.0}, "R": {"f": 1.0}},
    )
    assessment = assess(model, weak, samples=3, seed=7, box={"v": 1.0}, best=3)  # .25, .79, .55
    costs = assessment.points[0].best
    assert (costs.found, costs.refused, costs.lost, costs.lqr_lost, costs.both) == (2, 1, 1, 0, 1)


@pytest.mark.slow  # a search of best flights
def test_the_cost_ratio_is_that_of_the_closed_form():
    """v' = v + u with u = -8 v held for 20 ms: its cost over (1 + sqrt 2) v(0)^2 of the optimum.

    Without a search the ratio is that to the exact gain, and the first line says so.
    """
    k, dt = 8.0, 0.02
    limits = {"v": hfa.Signal("m/s", 1.0, -10.0, 10.0)}, {"u": hfa.Signal("N", 1.0, -50.0, 50.0)}
    model = hfa.Model("cart", *limits, lambda x, u, p, w: ({"v": x.v + u.u}, {}), trim={"v": 0.0})
    o = ca.SX.sym("o", 1)
    eager = Deployment(
        policy={"file": ca.Function("gain", [o], [-k * o])},
        observation={"v": {}},
        action={"u": {"box": [-50.0, 50.0]}},
        timing={"dt": dt},
        cost={"Q": {"v": 1.0}, "R": {"u": 1.0}},
    )

    def held(t):
        return math.exp(t) - k * (math.exp(t) - 1.0)

    first = quad(lambda t: held(t) ** 2 + k**2, 0.0, dt)[0]
    ratio = first / (1.0 - held(dt) ** 2) / (1.0 + math.sqrt(2.0))
    told = assess(model, eager, samples=5, box={"v": 0.05})
    costs = told.points[0].best
    assert told.ok
    assert f"{ratio:.3g}x the best flight" in told.first_line
    assert costs.policy_over_best.median == pytest.approx(ratio, rel=1e-6)
    assert costs.lqr_over_best.median == pytest.approx(1.0, rel=1e-6)
    other = assess(model, eager, samples=5, box={"v": 0.05}, best=0)
    unsearched = other.points[0].best
    assert not unsearched.searched
    assert unsearched.policy_over_best is None
    assert unsearched.policy_over_lqr.median == pytest.approx(ratio, rel=1e-6)
    assert f"{ratio:.3g}x" in other.first_line
    assert "exact gain" in other.first_line


def stiff_case() -> tuple[hfa.Model, Deployment, float]:
    """Return v' = -v - 40 v^3 + f, its LQR at 5 Hz as a deployment, and the gain.

    At v = 1, the mode is 121 times faster than at the trim.
    """
    model = hfa.Model(
        "stiff",
        {"v": hfa.Signal("m/s", nominal=1.0)},
        {"force": hfa.Signal("m/s^2", min=-2.0, max=2.0, nominal=1.0)},
        lambda x, u, p, w: ({"v": -x.v - 40.0 * x.v**3 + u.force}, {}),
        trim={"v": 0.0},
    )
    linear = hfa.linearize(model, hfa.trim(model))
    K = np.asarray(hfa.solve(hfa.game(linear, [1.0], [1.0])).K).item()
    o = ca.SX.sym("o")
    deployment = Deployment(
        policy={"file": ca.Function("gain", [o], [-K * o])},
        observation={"v": {}},
        action={"force": {}},
        timing={"dt": 0.2},
        cost={"Q": {"v": 1.0}, "R": {"force": 1.0}},
    )
    return model, deployment, K


def stiff_cost(v: float, K: float, sample: float) -> float:
    """Return the cost of 30 s by SciPy, with the tail z'Pz. sample: s, or 0 without a hold."""

    def rate(t: float, y: np.ndarray, u: float | None) -> list[float]:
        force = -K * y[0] if u is None else u
        return [-y[0] - 40.0 * y[0] ** 3 + force, y[0] ** 2 + force**2]

    y = np.array([v, 0.0])
    for _ in range(round(30.0 / sample) if sample else 1):
        span = (0.0, sample or 30.0)
        held = (-K * y[0] if sample else None,)
        y = solve_ivp(rate, span, y, args=held, method="DOP853", rtol=1e-10, atol=1e-13).y[:, -1]
    return float(y[1] + K * y[0] ** 2)  # P = K for B = R = 1


def test_costs_equal_scipys_integrals_of_the_same_flights():
    """Of a policy at 5 Hz, although the aircraft is 121 times faster off the trim.

    The LQR's cost by SciPy is that of one initial condition only, from which SciPy flies the policy.
    """
    model, deployment, K = stiff_case()
    (point,) = hfa.assess(model, deployment, samples=1, best=0).points
    best = point.best
    off = lambda v: stiff_cost(v, K, 0.0) - best.lqr_cost.mean  # noqa: E731
    start = brentq(off, 1e-3, point.place.box[0], xtol=1e-9)
    policy = stiff_cost(start, K, 0.2)
    assert best.cost == pytest.approx((policy, 0.0), rel=2e-3)
    assert best.policy_over_lqr == pytest.approx([policy / best.lqr_cost.mean] * 3, rel=2e-3)
    assert point.integration.is_resolved


def test_flights_that_pass_a_limit_between_samples_leave():
    """The angle passes its limit within the first sample of 0.4 s, and is back at its end."""
    model = hfa.Model(
        "turn",
        {"angle": hfa.Signal("rad", max=0.102), "rate": hfa.Signal("rad/s")},
        {"torque": hfa.Signal("rad/s^2", min=-1.0, max=1.0)},
        lambda x, u, p, w: ({"angle": x.rate, "rate": u.torque}, {}),
        trim={"angle": 0.0},
    )
    always = {"box": [-1, 1], "map": "-0.5 + 0 * a"}  # the angle rises by rate^2 / 1 in 0.2 s
    episode = Deployment({}, {"angle": {}}, {"torque": always}, {"dt": 0.4})
    flights = hfa.environment(model, episode)
    for rate, leaves in ((0.095, True), (0.04, False)):
        flights.reset(seed=0, options={"state": [0.1, rate]})
        *_, terminated, _, info = flights.step(np.zeros(1))
        assert info["X"][0] < 0.102
        assert terminated == leaves
        assert leaves == ("angle above" in info.get("left", ""))


@pytest.mark.parametrize(
    ("table", "name", "entry"),
    [
        ("observation", "speed", {"formula": "sqrt(speed - 45.0)"}),
        ("observation", "speed", {"formula": "1 / (speed - 45.0)", "about": 0.0}),
        ("action", "elevator", {"map": "trim + 0.1 * sqrt(a)"}),
        ("action", "elevator", {"map": "a**a"}),
    ],
)
def test_a_formula_not_smooth_at_trim_is_refused(table, name, entry):
    """A formula that is not smooth at the trim is refused, with its table and name."""
    o = ca.SX.sym("o", 4)
    right = gtm_deployment({"file": ca.Function("gain", [o], [0.1 * o[1:3]])})
    model = model_of(GTM)
    wrong = right.changed(**{table: {**getattr(right, table), name: entry}})
    with pytest.raises(hfa.BadInputError, match=rf"^the deployment: {table}\.{name}: the formula"):
        assess(model, wrong, [45.0])


def test_unmet_requirements_are_listed():
    """Each requirement that the assessment does not meet is listed.

    An unknown requirement is refused.
    """
    told = assess(aircraft("ppo_gtm"), FOLDER / "ppo_gtm.toml", [45.0, 60.0], samples=0, best=0)
    met = {"delay": 0.01, "margin": 0.1, "cost": 1000.0}
    assert replace(told, needs=met).unmet == []
    for needs in ({"delay": 0.02}, {"margin": 0.5}, {"cost": 50.0}):
        assert len(replace(told, needs=needs).unmet) == 1
    with pytest.raises(hfa.BadInputError, match="choose from delay, margin, cost"):
        replace(told, needs={"speed": 1.0}).report()


def test_the_equilibrium_is_the_end_of_a_long_flight():
    model, point = aircraft("ppo_gtm"), trims("ppo_gtm")[0]
    (found,) = assess(model, stored_deployment("ppo_gtm"), [point], samples=0).points
    flight = hfa.fly(model, point, stored_deployment("ppo_gtm"), 100.0, predict=False)
    np.testing.assert_allclose(found.equilibrium.states, flight.states[-1], rtol=1e-4, atol=1e-5)


def test_samples_with_delay_equal_scipys_integration():
    """Commands of the last sample but one, and of the last after half a sample, act in turn."""
    model, point = aircraft("ppo_gtm"), trims("ppo_gtm")[1]
    deployment = stored_deployment("ppo_gtm").changed(timing={"dt": 0.02, "delay": 0.03})
    off = dict(zip(model.states, (1.0, 0.02, 0.05, -0.03), strict=True))
    flight = hfa.fly(model, point, deployment, 0.2, initial=off, predict=False)
    deployed = Deployed(deployment, model)
    trim = deployed.trim_vector(point)
    x, u = np.add(point.states, list(off.values())), np.array(point.inputs)
    oldest, older = u, u  # commanded two samples and one sample ago
    for _ in range(10):
        command = np.array(deployed.command(x, older, trim)).ravel()
        for held in (oldest, older):  # the older command acts from the middle of the sample on
            x = solve_ivp(_rate, (0.0, 0.01), x, args=(model, held, 0.0), rtol=1e-11).y[:, -1]
        oldest, older = older, command
    np.testing.assert_allclose(flight.states[-1], x, rtol=1e-7, atol=1e-7)


def test_a_saturated_equilibrium_is_not_called_stable():
    """A policy that is saturated at its equilibrium fails, the saturated action is named, and no
    cost is reported.
    """
    o = ca.SX.sym("o", 4)
    push = ca.Function("policy", [o], [ca.vertcat(2.0 + 0.1 * o[0], 0.0 * o[1])])
    action = {
        "elevator": {"box": [-1, 1], "map": "trim + 0.001 * a"},
        "throttle": {"map": "trim + a"},
    }
    deployment = gtm_deployment({"file": push}, action=action)
    result = assess(model_of(GTM), deployment, [45.0], samples=0)
    (point,) = result.points
    assert result.first_line.startswith("FAIL: linear loop does not hold at 45 m/s")
    assert "no flight was simulated" in result.first_line
    assert result.findings[0].severity == "failure"
    assert "the action of elevator" in result.findings[0].text
    assert not any("cost" in finding.text for finding in result.findings)
    assert not point.holds


def test_the_steady_state_error_is_named_with_its_sign():
    """The finding names the state with the largest steady-state error, and its sign."""
    model = model_of(GTM)
    o = ca.SX.sym("o", 4)
    for push in (0.01, -0.01):
        biased = ca.Function("biased", [o], [ca.vertcat(0.3 * o[2] + 0.3 * o[3] + push, 0.0)])
        result = assess(model, gtm_deployment({"file": biased}), [45.0], samples=0)
        (text,) = [each.text for each in result.findings if each.text.startswith("steady-state ")]
        name, sign = text.split()[1], text.split()[3][0]
        offset = dict(zip(model.linear, result.points[0].offset, strict=True))[name]
        assert sign == ("+" if offset > 0.0 else "-")


@pytest.mark.parametrize("mean", [100.0, -100.0])
def test_an_observation_clipped_at_the_equilibrium_is_named(mean):
    """An observation that the normalizer clips at the equilibrium is named, on either side."""
    o = ca.SX.sym("o", 4)
    policy = {
        "file": ca.Function("policy", [o], [ca.vertcat(0.1 * o[2], 0.0)]),
        "normalizer": {"mean": [mean, 0.0, 0.0, 0.0], "variance": [1.0] * 4},
    }
    result = assess(model_of(GTM), gtm_deployment(policy), [45.0], samples=0)
    assert ("warning", "the normalizer clips speed at the equilibrium") in result.findings


def test_unusable_arguments_of_assess_are_refused():
    """Wrong operating points and a policy of another aircraft are refused by name."""
    model, deployment = aircraft("ppo_gtm"), stored_deployment("ppo_gtm")
    with pytest.raises(hfa.BadInputError, match="give operating points"):
        assess(model, deployment, ["45"])
    with pytest.raises(hfa.BadInputError, match="points is empty"):
        assess(model, deployment, [])
    with pytest.raises(hfa.BadInputError, match="unknown input 'elevator'"):
        assess(hfa.aircraft(), gtm_deployment({"file": FOLDER / "ppo_raw.zip"}))


Q = {"speed": 0.0025, "alpha": 8.16, "pitch_rate": 1.0, "pitch": 8.16}
R = {"elevator": 1.11, "throttle": 0.00051}


def test_a_required_delay_is_tolerated_or_not():
    """`hfa.assess` fails if a required delay is not tolerated. A wrong box is refused."""
    model = aircraft("ppo_gtm")
    o = ca.SX.sym("o", 4)
    gain = gtm_deployment({"file": ca.Function("gain", [o], [ca.vertcat(0.1 * o[2], 0.0)])})
    result = assess(model, gain, [45.0], samples=0, needs={"delay": 9.0})
    assert not result
    assert "a delay of 9 s is not tolerated" in result.unmet[0]
    assert not assess(model, gain, [45.0], samples=0, needs={"delay": 0.01}).unmet
    for wrong, said in (({"pich": 0.1}, "did you mean pitch"), ({"pitch": -1.0}, "box of pitch")):
        with pytest.raises(hfa.BadInputError, match=said):
            assess(model, gain, [45.0], samples=0, box=wrong)


@pytest.mark.parametrize("delay", [0.0, 0.02])
def test_an_aircraft_with_one_input_is_assessed(delay):
    """A pendulum with one input is assessed and simulated.

    The spectral radius equals that of python-control for A = [0 1; g / l -b / m l²] and held
    inputs, with and without delay. All four flights converge.
    """
    pendulum = hfa.load_model(f"{ROOT}/examples/pendulum.py:PENDULUM")
    gain = np.array([[2.5, 0.5]])
    o = ca.SX.sym("o", 2)
    deployment = Deployment(
        policy={"file": ca.Function("gain", [o], [-ca.DM(gain) @ o])},
        observation={"angle": {}, "rate": {}},
        action={"torque": {"box": [-1.0, 1.0]}},
        timing={"dt": 0.02, "delay": delay},
    )
    point = assess(pendulum, deployment, samples=4).points[0]
    inertia = 0.15 * 0.5**2
    plant = control.ss([[0, 1], [9.81 / 0.5, -0.1 / inertia]], [[0], [1 / inertia]], np.eye(2), 0)
    step = control.c2d(plant, 0.02, "zoh")
    if delay:
        step = control.series(control.ss(0, 1, 1, 0, 0.02), step)
    closed = step.feedback(control.ss([], [], [], gain, 0.02))
    assert point.radius == pytest.approx(np.abs(closed.poles()).max(), abs=1e-9)
    assert point.flights.returned == 4


@pytest.mark.parametrize("raw", [False, True])
def test_equilibria_a_full_turn_apart_are_one(raw):
    """Flights to an angle of a full turn converge, if the loop observes only its sine.

    A policy that observes the angle itself distinguishes the two equilibria.
    """
    pendulum = hfa.load_model(f"{ROOT}/examples/pendulum.py:PENDULUM")
    strong = replace(pendulum, inputs={"torque": hfa.Signal("N m", nominal=1.0, min=-5, max=5)})
    o = ca.SX.sym("o", 2)
    first = ca.sin(o[0]) if raw else o[0]
    deployment = Deployment(
        policy={"file": ca.Function("policy", [o], [-2.5 * first - 0.5 * o[1]])},
        observation={"angle": {} if raw else {"formula": "sin(angle)"}, "rate": {}},
        action={"torque": {"box": [-5.0, 5.0]}},
        timing={"dt": 0.02},
    )
    flown = assess(strong, deployment, samples=12, box={"angle": 6.0}).points[0].flights
    assert flown.starts == 12
    if raw:
        assert 0 < flown.elsewhere < 12
        assert abs(flown.elsewhere_at["angle"]) == pytest.approx(2.0 * np.pi, rel=1e-6)
    else:
        assert (flown.returned, flown.elsewhere) == (12, 0)


def kinked_model():
    """Return the GTM with a kink at every trim.

    The rate of the speed decreases with |pitch rate|.
    """
    gtm = model_of(GTM)

    def equations(x, u, p, w):
        rates, outputs = gtm.equations(x, u, p, w)
        return {**rates, "speed": rates["speed"] - 5.0 * ca.fabs(x.pitch_rate)}, outputs

    source = replace(gtm.source, native=None, reload=None)
    return replace(gtm, name="kinked", equations=equations, source=source)


def test_slopes_at_a_kink_equal_those_of_linearize():
    """At a kink of the aircraft, the assessed equilibrium has the A and B of `linearize`.

    At a kink of the policy, K has the slopes above the trim. A finding names the first kink.
    """
    o = ca.SX.sym("o", 4)
    gain = ca.Function("gain", [o], [ca.vertcat(0.3 * o[2] + 0.5 * ca.fmax(o[3], 0.0), 0.0)])
    model = kinked_model()
    result = assess(model, gtm_deployment({"file": gain}), [45.0], samples=0)
    (point,) = result.points
    linear = hfa.linearize(model, point.point)
    np.testing.assert_array_equal(point.equilibrium.A, linear.A)
    np.testing.assert_array_equal(point.equilibrium.B, linear.B)
    assert point.equilibrium.K[0, 3] == pytest.approx(-0.5, rel=1e-6)
    kinks = [finding.text for finding in result.findings if finding.text.startswith("kink")]
    assert kinks == [f"{linear.kinks[0]} (and 1 more)"]


F16 = f"{ROOT}/examples/f16.py:F16"


def f16_deployment(**tables):
    """Return a deployment for the F-16's elevator that observes alpha, pitch rate and pitch.

    tables: further tables of the deployment
    """
    o = ca.SX.sym("o", 3)
    gain = ca.Function("gain", [o], [50.0 * o[0] + 60.0 * o[1] + 20.0 * o[2]])
    return Deployment(
        policy={"file": gain},
        observation={"alpha": {}, "pitch_rate": {}, "pitch": {}},
        action={"elevator": {"box": [-10.0, 10.0]}},
        timing={"dt": 0.02},
        **tables,
    )


def test_a_trim_at_edge_of_envelope_is_refused():
    """`assess` and `environment` refuse a trim at the lowest altitude.

    `environment` accepts the trim of the F-16 as shipped.
    """
    model = model_of(F16)
    edged = replace(
        model, states={**model.states, "altitude": model.states["altitude"]._replace(min=0.0)}
    )
    for judge in (hfa.assess, hfa.environment):
        with pytest.raises(hfa.BadInputError, match="at the lowest limit of altitude, 0 ft"):
            judge(edged, f16_deployment(), [502.0])
    hfa.environment(model, f16_deployment(), [502.0])


def test_the_first_departure_is_reported():
    """The flight that leaves first is reported, with its initial state, its time and its limit.

    v' = v leaves at 2 after ln(2 / v) s. The first of 40 begins beyond half the box, at 1.
    """
    model = hfa.Model(
        "unstable",
        {"v": hfa.Signal("m/s", min=-2.0, max=2.0, nominal=2.0)},
        {"f": hfa.Signal("m/s^2")},
        lambda x, u, p, w: ({"v": x.v + u.f}, {}),
        trim={"v": 0.0},
    )
    o = ca.SX.sym("o")
    nothing = {"file": ca.Function("policy", [o], [0.0 * o])}
    deployment = Deployment(nothing, {"v": {}}, {"f": {}}, {"dt": 0.01})
    (found,) = assess(model, deployment, samples=40, box={"v": 1.0}, best=0).points
    for flights in (found.flights, found.disturbed):
        assert flights.lost == 40
        left, start = flights.departure, flights.worst_start["v"]
        assert abs(start) > 0.5
        assert (left.state, left.limit) == ("v", math.copysign(2.0, left.value))
        if flights is found.flights:
            expected = math.log(2.0 / abs(start))
            assert expected <= left.time <= expected + 0.01


def _rate(_, x, model, u, d):
    return model.at(x, u).f + d


def test_policies_on_changed_aircraft_keep_trim_values():
    """A policy on a changed aircraft keeps the trim values of the original aircraft.

    The equilibrium with more power of the elevator equals SciPy's root of the equations of motion
    with the policy.
    """
    from scipy.optimize import root

    model = model_of(f"{ROOT}/examples/gtm.py:UNCERTAIN_GTM")
    o = ca.SX.sym("o", 3)
    gain = ca.Function("gain", [o], [ca.vertcat(0.5 * o[0] + 0.6 * o[1] + 0.2 * o[2], 0.0)])
    observed = {"alpha": {}, "pitch_rate": {}, "gamma": {}}
    deployment = gtm_deployment({"file": gain}, observation=observed)
    result = hfa.assess(model, deployment, [45.0], samples=0, vary={"elevator_power": (0.9, 1.1)})
    trim = result.points[0].point
    assert [variation.value for variation in result.variations] == pytest.approx(
        np.linspace(0.9, 1.1, 5)
    )
    changed = model.with_parameters(elevator_power=1.1)
    names = list(model.states)
    rows = [names.index(name) for name in model.linear]

    def rates(linear):
        X = np.array(trim.states)
        X[rows] = linear
        at = dict(zip(names, X, strict=True))
        gamma = changed.outputs_at(X, trim.inputs, ("gamma",))["gamma"]
        moved = 0.5 * (at["alpha"] - trim["alpha"]) + 0.6 * at["pitch_rate"] + 0.2 * gamma
        U = trim.inputs._replace(elevator=trim["elevator"] + moved)
        by_name = changed.rates_at(X, U)
        return [by_name[name] / model.rate_scale(name) for name in model.linear]

    expected = root(rates, np.array(trim.states)[rows], tol=1e-12).x
    found = result.variations[-1].assessed.equilibrium.states[rows]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8)
    nominal = result.variations[2].assessed.equilibrium.states
    np.testing.assert_allclose(nominal, result.points[0].equilibrium.states, atol=1e-12)


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        (
            {"elevator": (0.0, 1.0)},
            "cannot vary elevator: this input is an action of the deployment file",
        ),
        ({"xcg": None}, r"vary\['xcg'\] is None; give \(lowest, highest\)"),
        ({"throttle": (0.0, 9.0)}, "throttle is 2.25; give a value between 0 and 1"),
    ],
)
def test_a_wrong_vary_is_refused_before_trims(vary, said):
    """A wrong name or range in `vary` is refused before the trims are read."""
    model = model_of(F16)
    no_trim = [object()]
    with pytest.raises(hfa.BadInputError, match=said):
        assess(model, f16_deployment(), no_trim, vary=vary)
