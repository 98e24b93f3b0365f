"""The value and the policy of a nonlinear game do not depend on units."""

import numpy as np
import pytest

import hfa

#: Powers of ten of the units of both states, the input, the disturbance, time and cost.
UNITS = [(0, 0, 0, 0, 0, 0), (3, -4, 5, -3, 1, 6), (-7, 2, -6, 4, -2, -7), (5, 8, -1, 7, 3, 8)]


def expansion_in(powers):
    """Return the expansion of a pendulum with a gust, and its units of states, input and cost."""
    x1, x2, u, w, t, cost = (10.0**power for power in powers)

    def rates(x, control, p, gust):
        angle, rate, torque = x.angle * x1, x.rate * x2, control.torque * u
        turned = -0.4 * rate + angle - angle**3 / 6.0 + 0.3 * angle * rate + torque
        turned += 0.5 * gust.gust * w
        return {"angle": t * rate / x1, "rate": t * turned / x2}, {}

    model = hfa.Model(
        name="pendulum",
        states={
            "angle": hfa.Signal("1", nominal=1.0 / x1),
            "rate": hfa.Signal("1", nominal=1.0 / x2),
        },
        inputs={"torque": hfa.Signal("1", nominal=1.0 / u)},
        disturbances={"gust": hfa.Signal("1", nominal=1.0 / w)},
        equations=rates,
        trim={"angle": 0.0},
    )
    linear = hfa.linearize(model, hfa.trim(model), disturbances=("gust",))
    states = np.array([x1, x2])
    Q, R = cost * t * np.diag(states**2), np.array([[cost * t * u**2]])
    game = hfa.game(linear, Q=Q, R=R, delta=5.0 * w * np.sqrt(cost * t), E=linear.E)
    return hfa.expand(linear, hfa.solve(game), 4), states, np.array([u]), cost


@pytest.mark.parametrize("powers", UNITS[1:])
def test_values_and_policies_scale_with_the_units(powers):
    """V and u at a deviation are the same in all units, and so are the radii."""
    exact, *_ = expansion_in(UNITS[0])
    found, states, inputs, cost = expansion_in(powers)
    for z in ([0.4, -0.3], [-0.1, 0.8]):
        assert float(found.V(z / states)) / cost == pytest.approx(float(exact.V(z)), rel=1e-9)
        u = np.array(found.policy(z / states)).ravel() * inputs
        assert u == pytest.approx(np.array(exact.policy(z)).ravel(), rel=1e-9)
    for radius, right in zip(found.radii, exact.radii, strict=True):
        assert radius.c / cost == pytest.approx(right.c, rel=1e-6)
        assert radius.extents * states == pytest.approx(right.extents, rel=1e-6)
