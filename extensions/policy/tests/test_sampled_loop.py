"""Sampled loop, margins and cost, compared with python-control and SciPy."""

import dataclasses
import math
import warnings

import casadi as ca
import control
import numpy as np
import pytest
from policy_cases import GTM, gtm_deployment, model_of
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov, solve_lyapunov

import hfa
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.sampled_loop import (
    Chain,
    chain_of,
    delays,
    held,
    margins,
    slowest_swing,
)
from hfa_policy.assessor import Assessor
from hfa_policy.cost_above_optimum import cost_above_optimum, lqr_at
from hfa_policy.reach import _own_modes
from hfa_policy.trims import trims_of

DT = 0.02
Q = {"speed": 0.0025, "alpha": 8.16, "pitch_rate": 1.0, "pitch": 8.16}
R = {"elevator": 1.11, "throttle": 0.00051}


def linear_case(scale=1.0):
    """Return the LQR of the GTM as a deployment, its equilibrium and its gain.

    scale: factor on the gain
    """
    model = model_of(GTM)
    (point,) = trims_of(model, [45.0])
    linear = hfa.linearize(model, point)
    game = hfa.game(linear, Q, R)
    K = scale * hfa.solve(game).K
    o = ca.SX.sym("o", 4)
    gain = ca.Function("gain", [o], [-ca.DM(K) @ o])
    deployment = gtm_deployment({"file": gain}, cost={"Q": Q, "R": R}, timing={"dt": DT})
    deployed = Deployed(deployment, model)
    assessor = Assessor(deployed, (point,), samples=0)
    equilibrium = assessor.places(assessor.flight())[0].equilibrium
    np.testing.assert_allclose(equilibrium.K, K, rtol=1e-10)
    return deployed, equilibrium, K


@pytest.fixture(scope="module")
def case():
    return linear_case()


def test_slowest_swing_is_half_the_slowest_period():
    """`slowest_swing` is half the period of the slowest mode that is not well damped.

    The modes are at 0.5 and 3 rad/s. If the slower mode is well damped, the faster mode counts.
    """
    for damping, expected in ((0.05, math.pi / 0.5), (0.8, math.pi / 3.0)):
        real = -0.5 * damping / math.sqrt(1.0 - damping**2)
        slow, fast = np.array([[real, 0.5], [-0.5, real]]), np.array([[-0.2, 3.0], [-3.0, -0.2]])
        A = np.block([[slow, np.zeros((2, 2))], [np.zeros((2, 2)), fast]])
        Phi, _ = held(A, np.zeros((4, 1)), DT)
        loop = Chain(Phi, np.zeros((4, 1)), np.zeros((1, 4)), 4, DT, np.eye(4))
        assert slowest_swing(loop) == pytest.approx(expected)


def test_the_delayed_loop_equals_python_control(case):
    """The spectral radius with a delay equals that of python-control's loop with unit delays."""
    _, equilibrium, K = case
    plant = control.c2d(control.ss(equilibrium.A, equilibrium.B, np.eye(4), 0), DT, "zoh")
    samples = 3
    shift = control.ss(np.zeros((2, 2)), np.eye(2), np.eye(2), 0, DT)
    late = plant
    for _ in range(samples):
        late = control.series(shift, late)
    closed = late.feedback(control.ss([], [], [], K, DT))
    radius = np.abs(closed.poles()).max()
    assert chain_of(equilibrium, DT, samples * DT).radius == pytest.approx(radius, abs=1e-9)


def test_half_a_sample_delay_equals_twice_the_rate(case):
    """A loop with half a sample of delay has the spectral radius of a loop at half the sample time.

    In the loop for comparison, the delay is one sample and the command changes every second sample.
    """
    _, equilibrium, K = case
    Phi, Gamma = held(equilibrium.A, equilibrium.B, DT / 2)
    early = Phi @ Phi
    twice = np.zeros((6, 6))
    twice[:4, :4] = early - Gamma @ K
    twice[:4, 4:] = Phi @ Gamma
    twice[4:, :4] = -K
    radius = np.abs(np.linalg.eigvals(twice)).max()
    assert chain_of(equilibrium, DT, DT / 2).radius == pytest.approx(radius, abs=1e-12)


def test_margins_equal_python_control(case):
    """Gain, phase and disk margins agree with python-control."""
    _, equilibrium, K = case
    found = margins(chain_of(equilibrium, DT, 0.0))
    Phi, Gamma = held(equilibrium.A, equilibrium.B, DT)
    grid = np.geomspace(1e-3, math.pi / DT, 4000)
    for loop in range(2):
        other = 1 - loop
        closed = Phi - Gamma[:, [other]] @ K[[other]]
        single = control.ss(closed, Gamma[:, [loop]], K[[loop]], 0, DT)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            gain, phase, *_ = control.stability_margins(single)
        if math.isfinite(gain):  # at half the sampling rate, python-control finds no margin
            assert found.inputs[loop].gain_high == pytest.approx(gain, rel=1e-9)
        assert found.inputs[loop].phase == pytest.approx(phase, rel=1e-9)
        disk = control.disk_margins(single, grid)[0]
        assert found.inputs[loop].disk == pytest.approx(disk, rel=1e-5)
    both = control.ss(Phi, Gamma, K, 0, DT)
    disk = control.disk_margins(both, np.geomspace(0.1, math.pi / DT, 300))[0]
    assert found.disk.disk <= disk * (1.0 + 1e-9)
    assert found.disk.disk == pytest.approx(disk, rel=1e-3)


def integrated_weights(A, B, Q, R, dt):
    """Return Q, N and R of the integral over a sample, and A and B of a sample, by quadrature."""
    n = len(A)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    total = np.zeros((n + B.shape[1],) * 2)
    both = np.zeros_like(total)
    both[:n, :n], both[n:, n:] = Q, R
    for node, weight in zip(nodes, weights, strict=True):
        Phi, Gamma = held(A, B, 0.5 * dt * (1.0 + node))
        along = np.vstack([np.hstack([Phi, Gamma]), np.eye(len(total))[n:]])
        total += 0.5 * dt * weight * along.T @ both @ along
    return total[:n, :n], total[:n, n:], total[n:, n:], *held(A, B, dt)


def test_costs_equal_scipy():
    """The largest and mean costs above the optimum, in percent, agree with SciPy's Lyapunov
    solutions.

    They are compared for continuous control and for the sampled loop, whose cost is the integral.
    The optimum of the sampled loop is SciPy's Riccati solution.
    """
    deployed, equilibrium, K = linear_case(1.3)
    lost = cost_above_optimum(deployed, equilibrium, chain_of(equilibrium, DT, 0.0))
    game = lqr_at(deployed, equilibrium)
    optimum = hfa.solve(game).P
    closed = game.A - game.B @ K
    value = solve_lyapunov(closed.T, -(game.Q + K.T @ game.R @ K))
    shares = np.linalg.eigvals(np.linalg.solve(optimum, value)).real - 1.0
    assert lost.worst == pytest.approx(100.0 * shares.max(), abs=1e-7)
    assert lost.mean == pytest.approx(100.0 * shares.mean(), abs=1e-7)
    cost, cross, price, Phi, Gamma = integrated_weights(game.A, game.B, game.Q, game.R, DT)
    optimum = solve_discrete_are(Phi, Gamma, cost, price, s=cross)
    closed = Phi - Gamma @ K
    value = solve_discrete_lyapunov(closed.T, cost - cross @ K - K.T @ cross.T + K.T @ price @ K)
    shares = np.linalg.eigvals(np.linalg.solve(optimum, value)).real - 1.0
    assert lost.sampled_worst == pytest.approx(100.0 * shares.max(), abs=1e-6)
    assert lost.sampled_mean == pytest.approx(100.0 * shares.mean(), abs=1e-6)


def deployment_that_observes_its_elevator(share, dt):
    """Return a stable deployment of the GTM, whose elevator follows its own value just before.

    share: factor of the observed elevator in the new elevator
    """
    _, _, K = linear_case()
    before = ca.DM([[share], [0.0]])
    o = ca.SX.sym("o", 5)
    policy = ca.Function("policy", [o], [-ca.DM(K) @ o[:4] + before @ o[4:]])
    observed = ("speed", "alpha", "pitch_rate", "pitch", "elevator")
    return gtm_deployment(
        {"file": policy},
        observation={name: {} for name in observed},
        cost={"Q": Q, "R": R},
        timing={"dt": dt},
    )


def test_the_cost_of_an_observed_input_is_the_limit_of_fast_sampling():
    """With an observed input, the continuous cost is the limit of the cost of the sampled loop."""
    deployment = deployment_that_observes_its_elevator(0.4, 1e-4)
    (loop,) = hfa.assess(model_of(GTM), deployment, [45.0], samples=0).points
    assert loop.cost.worst > 5.0
    assert loop.cost.worst == pytest.approx(loop.cost.sampled_worst, rel=0.03)
    assert loop.cost.mean == pytest.approx(loop.cost.sampled_mean, rel=0.2)


def test_an_integrator_has_no_cost_in_continuous_time():
    """The inputs of an integrator do not settle at a constant state: only the sampled cost exists."""
    deployment = deployment_that_observes_its_elevator(1.0, DT)
    (loop,) = hfa.assess(model_of(GTM), deployment, [45.0], samples=0).points
    assert math.isnan(loop.cost.worst)


def test_a_loop_of_wrong_sign_is_unstable_undelayed(case):
    """A loop with a wrong sign is unstable, and its first unstable delay is 0."""
    deployed, _, _ = case
    flipped = deployed.deployment.action["elevator"] | {"map": "trim - a"}
    action = {**deployed.deployment.action, "elevator": flipped}
    wrong = Deployed(deployed.deployment.changed(action=action), deployed.model)
    assessor = Assessor(wrong, trims_of(deployed.model, [45.0]), samples=0)
    (point,) = assessor.assessed()
    assert point.radius > 1.0
    assert point.delays.limit == 0.0
    assert not point.holds


def test_delays_are_searched_upward(case):
    """The delay limit is the first whole number of samples at which the loop is unstable."""
    _, equilibrium, K = case
    found = delays(equilibrium, DT, 0.0)
    limit = round(found.limit / DT)
    assert len(found.radii) == limit + 1
    assert all(radius < 1.0 for radius in found.radii[:-1])
    assert found.radii[-1] >= 1.0
    assert found.limit - DT < found.fine <= found.limit
    assert chain_of(equilibrium, DT, found.fine).radius >= 1.0
    assert chain_of(equilibrium, DT, found.fine - 0.06 * DT).radius < 1.0
    stable = dataclasses.replace(equilibrium, K=0.0 * K)
    for dt, deployed, searched in ((DT, 0.0, 2.0), (0.4, 0.0, 3.2), (0.4, 4.0, 4.0)):
        none = delays(stable, dt, deployed)
        assert (none.limit, none.fine, none.searched) == (None, None, pytest.approx(searched))
        assert len(none.radii) == round(searched / dt) + 1


def test_both_eigenvalues_of_a_pair_belong_to_its_mode(case):
    """An eigenvalue finds its mode, whichever sign its imaginary part has."""
    deployed, equilibrium, _ = case
    values = np.linalg.eigvals(equilibrium.A)
    assert (values.imag < 0.0).any()
    for value in values:
        (mode,) = _own_modes(deployed, equilibrium.A, value)
        assert mode.growth == pytest.approx(value.real)
