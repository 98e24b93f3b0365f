"""A cart with limited position, speed without limits, and a limited force."""

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
