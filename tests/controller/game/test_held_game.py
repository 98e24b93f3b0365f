"""Games of samples with commands under way, and of aircraft with servos."""

import numpy as np
import pytest
from cli import answer, assert_refused, hfa as run
from known_models import model_at
from scipy.linalg import expm

import hfa

MODEL = hfa.with_servos(hfa.aircraft(), hfa.Servo(0.02))
LINEAR = hfa.trim(MODEL, dihedral=0.1).linearize()


def test_servos_are_states_between_command_and_aircraft():
    """With servos of 20 ms the trim is that without, each position is that of its input, and the linear
    model is that of the aircraft behind first-order lags. A rate limit holds far from the trim.
    """
    alone = hfa.trim(hfa.aircraft(), dihedral=0.1).linearize()
    np.testing.assert_allclose(LINEAR.point.x, [*alone.point.x, *alone.point.u], rtol=1e-9)
    lags = np.eye(5) / 0.02
    np.testing.assert_allclose(
        LINEAR.A, np.block([[alone.A, alone.B], [np.zeros((5, 6)), -lags]]), atol=1e-12
    )
    np.testing.assert_allclose(LINEAR.B, np.vstack([np.zeros((6, 5)), lags]), atol=1e-12)
    limited = hfa.with_servos(hfa.aircraft(), {"elevator_outer": hfa.Servo(0.02, rate=0.5)})
    point = hfa.trim(limited, dihedral=0.1)
    inputs = point.inputs._replace(elevator_outer=point.inputs.elevator_outer + 0.1)
    assert limited.at(point.states, inputs).f[-1] == pytest.approx(0.5)
    assert MODEL.at(LINEAR.point.states, inputs).f[-1] == pytest.approx(0.1 / 0.02)
    with pytest.raises(hfa.BadInputError, match="the unknown input 'rudder'"):
        hfa.with_servos(hfa.aircraft(), {"rudder": hfa.Servo(0.02)})
    with pytest.raises(hfa.BadInputError, match="lag of a servo"):
        hfa.Servo(0.0)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_the_value_of_a_delayed_game_is_the_cost_of_its_flight(count):
    """z'Pz is the integral of the cost of a linear flight, in steps of .5 ms, in which the command of a
    sample of 10 ms acts `count` samples late; it is higher than without a delay.
    """
    dt, parts = 0.01, 20
    game = hfa.game(LINEAR, rate=1.0 / dt, delay=count * dt, delta=np.inf)
    solution = hfa.solve(game)
    (n, m), weights = LINEAR.B.shape, hfa.game(LINEAR)
    step = expm(np.block([[LINEAR.A, LINEAR.B], [np.zeros((m, n + m))]]) * (dt / parts))[:n]
    z = np.array([5.0, 0.05, *np.zeros(9)])
    start = np.append(z, np.zeros(count * m))
    under_way, cost = [np.zeros(m)] * count, 0.0
    for _ in range(500):
        under_way.append(-solution.K @ np.concatenate([z, *under_way]))
        u = under_way.pop(0)
        for part in range(parts + 1):  # trapezoidal rule
            share = 0.5 if part in (0, parts) else 1.0
            cost += share * (z @ weights.Q @ z + u @ weights.R @ u) * dt / parts
            z = z if part == parts else step @ np.append(z, u)
    assert start @ solution.P @ start == pytest.approx(cost, rel=1e-3)
    prompt = hfa.solve(hfa.game(LINEAR, rate=1.0 / dt, delta=np.inf)).P
    assert (start @ solution.P @ start > start[:n] @ prompt @ start[:n]) == bool(count)


def test_a_game_with_latency_is_solved_and_its_gain_verified(folder):
    """The command solves the game of 100 samples a second with servos and a delay, of 16 states, and
    accepts the gain of its file for this game; a part of it is not accepted.
    """
    words = ["--dihedral", "10", "--servo", "20ms", "--delay", "10ms", "--rate", "100"]
    data = answer("solve", *words, "-o", "latency.json")
    linear = hfa.trim(MODEL, dihedral=np.radians(10.0)).linearize()
    K = hfa.solve(hfa.game(linear, rate=100.0, delay=0.01)).K
    np.testing.assert_allclose(data["K"], K, rtol=1e-6)
    assert run("verify", *words, "--weights", "latency.json").code == 0
    assert run("verify", *words[:2], *words[4:], "--weights", "latency.json").code != 0
    without = model_at(10.0)
    assert np.shape(K) == (5, len(without.states) + 5 + 5)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--delay 10ms", "requires a rate"),
        ("--delay 13ms --rate 100", "not a whole number of samples"),
        ("--delay 10mm --rate 100", "give a time in s"),
        ("--servo 0", "above 0"),
        ("--servo 20ms:-3", "above 0"),
        ("--rate 100 --order 2", "continuous time"),
    ],
)
def test_wrong_latencies_are_refused(words, said):
    """A delay without samples or between them, and a servo without a lag, are refused."""
    assert_refused(run("solve", "--dihedral", "10", *words.split()), 2, said)
