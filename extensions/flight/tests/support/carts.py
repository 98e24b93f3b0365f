"""A cart with limited position, speed without limits, and a limited force; and a damped one."""

import numpy as np

import hfa


def cart(force=1.0):
    """Return a double integrator with bounded input.

    force: limit of the input, N
    """
    return hfa.Model(
        "cart",
        {"position": hfa.Signal("m", min=-20.0, max=20.0), "velocity": hfa.Signal("m/s")},
        {"force": hfa.Signal("N", min=-force, max=force)},
        lambda x, u, p, w: ({"position": x.velocity, "velocity": u.force}, {}),
        trim={"position": 0.0},
    )


def best_of_cart(start, **more):
    """Return the best flight of the cart with Q = I and R = 1, |force| <= 1 N, |position| <= 20 m."""
    model = cart()
    return hfa.optimize(model, hfa.trim(model), start, np.eye(2), np.eye(1), **more)


#: v' = -v + u, x' = v: the step response of v is 1 - exp(-t).
DAMPED = hfa.Model(
    "cart",
    {"position": hfa.Signal("ft"), "speed": hfa.Signal("ft/s")},
    {"force": hfa.Signal("lbf", min=-100.0, max=100.0)},
    lambda x, u, p, w: ({"position": x.speed, "speed": u.force - x.speed}, {}),
    trim={"position": 0.0, "speed": 0.0},
    steady=("speed",),
)
