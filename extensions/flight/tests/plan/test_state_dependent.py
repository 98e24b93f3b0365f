"""Policy of the state-dependent game, and the filter that keeps rates inside their limits."""

import casadi as ca
import numpy as np
import pytest
from cli import answer, hfa as hfa_command
from policy_cases import GTM as GTM_FILE
from scipy.linalg import solve_continuous_are

import hfa
from hfa_flight import GainPolicy

GTM = hfa.load_model(GTM_FILE)
LEVEL = hfa.trim(GTM)
#: x'' = -x - x³ + u: A(z) = [0 1; -(1 + x²) 0] on the ray, because the mean of 3 s² x² is x².
DUFFING = hfa.Model(
    "duffing",
    {"position": hfa.Signal("m"), "rate": hfa.Signal("m/s", min=-1.5, max=1.5)},
    {"force": hfa.Signal("N", min=-20.0, max=20.0)},
    lambda x, u, p, w: ({"position": x.rate, "rate": -x.position - x.position**3 + u.force}, {}),
)
AT_REST = hfa.trim(DUFFING)


def test_the_command_solves_the_riccati_equation_of_the_state():
    """u = -R⁻¹B'P(z) z without the filter (limit_weight 0), with P by SciPy and A(z) by hand:
    A(z) z is that of x'' = -x - x³ + u.
    """
    policy = hfa.state_dependent(DUFFING, AT_REST, np.eye(2), np.eye(1), limit_weight=0.0)
    state = [-1.0, 0.3]
    x = state[0]
    A = np.array([[0.0, 1.0], [-(1.0 + x * x), 0.0]])
    P = solve_continuous_are(A, np.array([[0.0], [1.0]]), np.eye(2), np.eye(1))
    assert policy(0.0, state) == pytest.approx(-P[1] @ state, abs=1e-9)


def test_the_gradient_at_the_trim_is_the_exact_gain_of_the_game():
    """The gradient at the trim is K of the exact solution for a finite delta too. Half the smallest
    delta is refused with a message that states the smallest.
    """
    game = hfa.game(hfa.linearize(GTM, LEVEL), Q=np.eye(4), R=np.eye(2), delta=50.0)
    exact = hfa.solve(game)
    policy = hfa.state_dependent(GTM, LEVEL, game.Q, game.R, delta=50.0)
    np.testing.assert_allclose(policy.K, exact.K, rtol=1e-7)
    with pytest.raises(hfa.NoSolutionError, match=f"{exact.delta_min:.3g}"):
        hfa.state_dependent(GTM, LEVEL, game.Q, game.R, delta=0.5 * exact.delta_min)


def duffing_flight(policy, start):
    """Return a flight of 8 s of the Duffing oscillator, not compared with its linear model."""
    return hfa.fly(DUFFING, AT_REST, policy, 8.0, initial=start, predict=False)


def test_keep_inside_keeps_a_rate_inside_its_limit():
    """The flight of a gain exceeds the limit of the rate, 1.5 m/s. Behind `keep_inside`, which changes
    commands near the limit, it converges; the rate exceeds 90 % of the limit, and never the limit.
    """
    gain = hfa.lqr([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], [100.0, 1.0], [0.1])
    policy = GainPolicy("gain", np.array(gain.K))
    start = {"position": 2.0}
    assert duffing_flight(policy, start).departure.state == "rate"
    kept = hfa.keep_inside(policy, DUFFING, AT_REST)
    flight = duffing_flight(kept, start)
    assert flight.departure is None
    assert 0.9 * 1.5 < np.abs(flight["rate"]).max() < 1.5
    assert np.abs(flight.states[-1]).max() < 1e-2
    assert flight.policy["changed_samples"] > 0


def test_the_command_keeps_the_limits_of_envelope_inside():
    """`hfa fly --keep-inside` changes commands for a pitch rate limited by --envelope to 3 deg/s,
    which the exact policy alone exceeds with 3.4. None is changed for the 39 deg/s of the model.
    """
    words = "fly --dihedral 10 --policy exact --initial alpha=3 --duration 0.3"
    limited = f"{words} --envelope pitch_rate=-3:3"
    assert hfa_command(*limited.split()).code == 1
    for command, is_changed in ((words, False), (limited, True)):
        policy = answer(*command.split(), "--keep-inside")["policy"]
        assert (policy["changed_samples"] > 0) is is_changed


def test_with_a_delay_a_sampled_policy_acts_on_the_predicted_state():
    """`keep_inside` predicts the state over the delay: a network whose commands act a sample late
    flies as without delay from the state that this sample reaches, also where the limit of the
    rate changes commands.
    """
    o = ca.SX.sym("o", 2)

    def flown(seconds, delay, start):
        network = hfa.Deployment(
            policy={"file": ca.Function("policy", [o], [-20.0 * o[0] - 3.0 * ca.tanh(o[1])])},
            observation={"position": {}, "rate": {}},
            action={"force": {"map": "a"}},
            timing={"dt": 0.1, "delay": delay},
        )
        kept = hfa.keep_inside(network, DUFFING, AT_REST)
        # predict=False: no comparison with the linear model.
        return hfa.fly(DUFFING, AT_REST, kept, seconds, initial=start, predict=False)

    late = flown(2.1, delay=0.1, start={"position": 1.0})
    after_delay = int(np.searchsorted(late.time, 0.1 - 1e-9))
    start = dict(zip(DUFFING.states, late.states[after_delay].tolist(), strict=True))
    prompt = flown(2.0, delay=0.0, start=start)
    np.testing.assert_allclose(late.states[-1], prompt.states[-1], atol=1e-5)
    assert late.policy["changed_samples"] > 0
