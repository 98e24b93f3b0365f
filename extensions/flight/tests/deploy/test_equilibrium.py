"""Equilibria of a policy on a linear aircraft, compared with their closed forms."""

import casadi as ca
import numpy as np

import hfa

A = np.array([[-2.0, 0.1], [-10.0, -0.5]])
B = np.array([[3.0, 0.0], [0.0, 20.0]])
K = np.array([[0.4, 0.01], [-0.2, 0.05]])
#: Nominal values of the states and of the inputs, and the gain between deviations divided by them.
X, U = np.array([0.2, 100.0]), np.array([0.1, 0.5])
NOMINAL_K = K * X / U[:, None]
OFFSET = np.array([0.01, -0.03])
START = {"alpha": 0.1, "speed": 100.0, "altitude": 1000.0}


def glide(x, u, p, w):
    """Return the rates z' = A z + B v of deviations z of alpha and speed, and v of the inputs."""
    z = np.array([x.alpha - 0.1, x.speed - 100.0])
    v = np.array([u.elevator - 0.05, u.throttle - 0.5])
    alpha_rate, speed_rate = A @ z + B @ v
    return {"alpha": alpha_rate, "speed": speed_rate, "altitude": 50.0 * z[0]}, {}


GLIDER = hfa.Model(
    "glider",
    {
        "alpha": hfa.Signal("rad", nominal=0.2, min=-0.5, max=0.7),
        "speed": hfa.Signal("ft/s", nominal=100.0, min=10.0, max=300.0),
        "altitude": hfa.Signal("ft", nominal=1000.0),
    },
    {
        "elevator": hfa.Signal("rad", nominal=0.1, min=-0.2, max=0.3),
        "throttle": hfa.Signal("1", nominal=0.5, min=0.0, max=1.0),
    },
    glide,
    trim=START,
    linear=("alpha", "speed"),
)
POINT = hfa.trim(GLIDER)


def assessed(act, observed=("alpha", "speed"), model=GLIDER, **settings):
    """Return the assessment of a policy of the observed deviations from the trim, without flights."""
    o = ca.SX.sym("o", len(observed))
    deployment = hfa.Deployment(
        policy={"file": ca.Function("policy", [o], [act(o)]), **settings.get("policy", {})},
        observation={name: {} for name in observed},
        action=settings.get("action", {"elevator": {}, "throttle": {}}),
        timing={"dt": 0.2},
    )
    return hfa.assess(model, deployment, [hfa.trim(model)], samples=0)


def equilibrium(*act, **settings):
    """Return the equilibrium that the assessment of a policy finds; arguments as of `assessed`."""
    (point,) = assessed(*act, **settings).points
    return point.equilibrium


def test_the_equilibrium_balances_the_offset_of_the_policy():
    """With u = c - K x, c = OFFSET, the equilibrium is x = -(A - B K)^-1 B c. `nominal` has A, B and K of
    deviations that are divided by the nominal values X and U. The policy does not feed back the inputs
    of the last sample, so that their gain `K_inputs` is 0.
    """
    found = equilibrium(lambda o: ca.DM(OFFSET) - ca.DM(K) @ o)
    x = -np.linalg.solve(A - B @ K, B @ OFFSET)
    np.testing.assert_allclose(found.states - POINT.states, [*x, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.inputs - POINT.inputs, OFFSET - K @ x, atol=1e-9)
    np.testing.assert_allclose(found.K, K, atol=1e-9)
    loop = found.nominal
    for name, value in (("A", A * X / X[:, None]), ("B", B * U / X[:, None]), ("K", NOMINAL_K)):
        np.testing.assert_allclose(getattr(loop, name), value, atol=1e-9, err_msg=name)
    assert not loop.K_inputs.any()
    assert (found.clips, found.clipped_observations) == ((), ())


def test_a_kink_at_the_equilibrium_leaves_out_linear_figures():
    """A gain that is K for positive deviations and K / 3 for negative ones, whatever CasADi's
    derivative at 0: K has the mean of both, and no margins are stated.
    """

    def kinked(o):
        return -ca.DM(K) @ ca.if_else(o > 0.0, o, o / 3.0)

    (point,) = assessed(kinked).points
    np.testing.assert_allclose(point.equilibrium.K, 2.0 / 3.0 * K, rtol=1e-9)
    assert point.margins is None
    assert "no linear figures" in point.remarks[0]


def test_a_saturated_equilibrium_fails_and_its_actions_are_named():
    """An equilibrium at the end of an action's box or at a limit of an input does not pass.

    The actions are constant. -0.9 is beyond the elevator's box, whose end -0.8 moves the elevator from
    .05 to its limit -.2. The throttle has no box: 0.6 moves it from .5 beyond its limit 1.
    """
    action = {"elevator": {"box": [-0.8, 0.8], "map": "trim + 0.3125 * a"}, "throttle": {}}
    both = ("the action of elevator at the end of its box", "elevator at its limit")
    for raw, clips in (([-0.9, 0.49], both), ([0.0, 0.6], ("throttle at its limit",))):
        told = assessed(lambda o, raw=raw: ca.DM(raw) + 0.0 * o, action=action)
        (point,) = told.points
        assert point.equilibrium.clips == clips
        assert not told.ok
        assert not point.holds
        assert "no flight was simulated" in told.first_line
