"""Plans of flights are equal only where nothing differs that decides their results."""

from dataclasses import replace

import numpy as np
import pytest

import hfa
from hfa_flight import OneMinusCosine, Uncertainty
from hfa_flight.policies.given import policy_and_scenario
from hfa_flight.samples.monte_carlo import MonteCarlo
from hfa_flight.simulate.envelope import flight_envelope


@pytest.fixture(scope="module")
def planned():
    """Return a function (policy, changes of the scenario, changes of the plan) -> plan."""
    model = hfa.aircraft()
    point = hfa.trim(model, dihedral=0.2)
    usual = hfa.Scenario(0.3, initial=np.zeros(7), uncertainty=Uncertainty(noise={"speed": 0.3}))

    def plan(given=None, scenario=None, **changes):
        policy, scenario = policy_and_scenario(given, point, replace(usual, **(scenario or {})))
        plan = MonteCarlo(3, 1, model, point, policy, scenario, flight_envelope(model, point, None))
        return replace(plan, **changes)

    return plan


def test_plans_of_flights_differ_in_each_thing_that_decides(planned):
    """Seed, number, every field of a scenario, limits, and every argument of a policy decide flights; the
    share that must pass does not.
    """
    usual = planned()
    model, point = usual.model, usual.point
    noise = {"speed": 0.3}
    gain, other_gain = np.zeros((5, 6)), np.eye(5, 6)
    kalman = hfa.filter(point.linearize(), dict.fromkeys(model.linear, 0.1), dt=0.01)
    laws = (
        [
            hfa.predictive(model, point, margin=margin, dt=dt, budget=budget, horizon=0.1)
            for margin, dt, budget in (
                (0.01, 0.01, 1.0),
                (0.02, 0.01, 1.0),
                (0.01, 0.02, 1.0),
                (0.01, 0.01, 2.0),
            )
        ]
        + [hfa.state_dependent(model, point, limit_weight=weight) for weight in (0.0, 0.1)]
        + [hfa.state_dependent(model, point, R=np.eye(5))]
    )
    inside = [
        hfa.keep_inside(laws[4], model, point, limits={"alpha": (-0.3, h)}) for h in (0.3, 0.31)
    ]
    scenarios = [
        {"duration": 0.4},
        {"step": 0.002},
        {"tick": 0.005},
        {"initial": np.array([0.1, 0, 0, 0, 0, 0, 0])},
        {"errors": {"panel_mass": 1.1}},
        {"delay": 0.02},
        {"sample": 0.02},
        {"gust": OneMinusCosine(40.0, 3.0, 68.0)},
        {"gust": OneMinusCosine(40.0, 3.1, 68.0)},
        {"uncertainty": Uncertainty(noise={"speed": 0.31})},
        {"uncertainty": Uncertainty(noise=noise, errors={"panel_mass": 0.1})},
        {"uncertainty": Uncertainty(noise=noise, errors={"panel_mass": 0.2})},
    ]
    plans = [
        usual,
        *(planned(scenario=changes) for changes in scenarios),
        planned(members=4),
        planned(seed=2),
        planned(envelope=flight_envelope(model, point, {"alpha": (-0.3, 0.3)})),
        planned({"throttle": [(0.1, 1.0)]}),
        planned({"throttle": [(0.2, 1.0)]}),
        *map(planned, (gain, other_gain, *laws, *inside)),
        *(planned(kalman.policy(gain, fade=fade)) for fade in (0.1, 0.2)),
        planned(lambda t, X: point.u),
        planned(lambda t, X: point.u),
    ]
    assert len({*plans}) == len(plans)
    assert planned(share=0.5) == usual == planned()
    assert planned(gain) == planned(1.0 * gain)


def test_models_that_differ_in_outputs_alone_do_not_share_flights(planned):
    """The angle of attack of a model that gives three times that of the aircraft is another one."""
    model = hfa.aircraft()

    def tripled(*arguments):
        rates, outputs = model.equations(*arguments)
        return rates, {**outputs, "angle_of_attack": 3.0 * outputs["angle_of_attack"]}

    gusts = {
        "gust": OneMinusCosine(40.0, 3.0, 68.0),
        "uncertainty": Uncertainty({}, {"speed": 0.3}),
    }
    peaks = []
    for each in (model, replace(model, equations=tripled)):
        flights = hfa.fly(
            each,
            hfa.trim(each, dihedral=0.2),
            np.zeros((5, 6)),
            scenario=hfa.Scenario(0.3, **gusts),
            samples=2,
            initial={"alpha": 0.01},
        )
        peaks.append(flights.flown["peak_deviation"][:, 1])
    assert peaks[1].min() > 2.9 * peaks[0].max()
