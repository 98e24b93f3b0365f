"""One flight of one policy, in `optimize`, `assess`, `fly` and an environment."""

import json
import re

import numpy as np
import pytest
from cli import hfa as run
from policy_cases import GTM, Q, R, model_of

import hfa

WEIGHTS = np.diag(list(Q.values())), np.diag(list(R.values()))
DT = 0.005
ACTIONS = {
    "elevator": {"box": [-1, 1], "map": "trim + a"},
    "throttle": {"box": [-50, 50], "map": "trim + a"},
}


@pytest.fixture(scope="module")
def model():
    return model_of(GTM)


@pytest.fixture(scope="module")
def gain(model):
    """Return the LQR gain at 45 m/s, which the deployments of this file sample and hold."""
    linear = hfa.trim(model, speed=45.0).linearize()
    return np.array(hfa.solve(hfa.game(linear, Q=Q, R=R)).K)


def deployment_of(gain, folder):
    """Return the path of a deployment of a gain, u = -K x, at 200 Hz."""
    np.savez(folder / "gain.npz", K=gain)
    hfa.Deployment(
        {"file": folder / "gain.npz"},
        {name: {} for name in Q},
        ACTIONS,
        {"dt": DT},
        cost={"Q": Q, "R": R},
    ).save(folder / "policy.toml")
    return folder / "policy.toml"


def in_environment(model, deployment, point, start, gain, seconds):
    """Return the sum of the rewards, the last states, and when the flight left its limits, or None."""
    env = hfa.environment(model, hfa.Deployment.load(deployment), [point], seconds=seconds)
    _, info = env.reset(options={"state": point.x + start})
    total, over, has_left = 0.0, False, False
    while not (over or has_left):
        _, reward, has_left, over, info = env.step(-gain @ (info["X"] - point.x))
        total += reward
    left_at = float(re.search("at ([0-9.]+) s", info["left"])[1]) if has_left else None
    return total, info["X"], left_at


def cost_of_rewards(total, start, end):
    """Return the cost ∫ x'Qx + u'Ru of an episode from the sum of its rewards, without delay.

    Of held inputs the sum at the samples is exact, of states it is the rule of rectangles, which
    differs from that of trapezoids by the weights of the first and the last sample.
    """
    return -total - 0.5 * DT * (start @ WEIGHTS[0] @ start - end @ WEIGHTS[0] @ end)


def of_gtm(command, *words):
    """Return the JSON of a command on the aircraft at 45 m/s."""
    return json.loads(run(command, "--aircraft", GTM, "--at", "45", *words, "--json").out)


@pytest.mark.slow
@pytest.mark.parametrize(("sign", "is_back"), [(1.0, True), (-1.0, False)])
def test_four_commands_fly_the_same_flight(model, gain, tmp_path, sign, is_back):
    """`optimize`, `assess`, `fly` and the environment agree on cost, end and departure of a flight.

    `optimize` and `assess` add the cost-to-go at the end, and agree with `fly` to 1e-6. The rewards of
    the environment are the cost at the samples: it is converted, and agrees to 0.2 %.

    sign: -1 for the opposite gain, with which the flight leaves its limits (is_back: False)
    """
    policy = str(deployment_of(sign * gain, tmp_path))
    weights = [
        f"--{name}=" + ",".join(f"{state}={value}" for state, value in entries.items())
        for name, entries in (("Q", Q), ("R", R))
    ]
    table = of_gtm("optimize", "--policy", policy, "--starts", "1", *weights)
    (row,) = table["flights"]
    optimized = row["policies"][-1]
    assessed = of_gtm("assess", policy, "--samples", "1")["points"][0]
    point = hfa.trim(model, speed=45.0)
    seconds = optimized["seconds"] if is_back else 4.0
    flown = hfa.fly(
        model, point, policy, seconds, initial=row["start"], weights=WEIGHTS, predict=False
    )
    start = np.array(list(row["start"].values()))
    total, end, left_at = in_environment(model, policy, point, start, sign * gain, seconds)

    assert optimized["converges"] == is_back
    assert assessed["costs"]["not_converged"] == (not is_back)
    assert flown.returned == is_back
    if not is_back:
        assert flown.departure.time == pytest.approx(optimized["departure"]["time"], abs=DT)
        assert flown.departure.time == pytest.approx(left_at, abs=DT)
        return
    assert (left_at, flown.departure, optimized["departure"]) == (None, None, None)
    np.testing.assert_allclose(end, flown.states[-1], rtol=1e-6, atol=1e-7)
    cost = cost_of_rewards(total, start, end - point.x)
    assert cost == pytest.approx(flown.cost, rel=2e-3)
    whole = flown.cost + flown.cost_to_go
    assert optimized["cost"] == pytest.approx(whole, rel=1e-6)
    assert assessed["costs"]["cost"]["mean"] == pytest.approx(whole, rel=1e-6)
