"""A plant of one state v and one input f with its deployments, and an oscillator."""

import math

import casadi as ca
import numpy as np

import hfa


def scalar(rate, most=math.inf, force=math.inf):
    """Return v' = rate(v, f) with |v| <= most and |f| <= force, and the trim v = 0."""
    return hfa.Model(
        "scalar",
        {"v": hfa.Signal("m/s", 1.0, -most, most)},
        {"f": hfa.Signal("m/s^2", 1.0, -force, force)},
        lambda x, u, p, w: ({"v": rate(x.v, u.f)}, {}),
        trim={"v": 0.0},
    )


def deployed(policy, dt, box=None, **others):
    """Return f = policy(v), held for dt.

    box: range of f, or None for its limits
    others: tables of the deployment in place of these
    """
    o = ca.SX.sym("o")
    tables = {
        "policy": {"file": ca.Function("policy", [o], [policy(o)])},
        "observation": {"v": {}},
        "action": {"f": {} if box is None else {"box": box}},
        "timing": {"dt": dt},
        "cost": {"Q": {"v": 1.0}, "R": {"f": 1.0}},
    }
    return hfa.Deployment(**tables | others)


def oscillator(high=9.0):
    """Return x' = v, v' = -w^2 x - 2 v with x from -1 to `high`, of 1 Hz."""
    w = 2.0 * np.pi
    return hfa.Model(
        "oscillator",
        {"x": hfa.Signal("m", min=-1.0, max=high), "v": hfa.Signal("m/s", nominal=6.0)},
        {"force": hfa.Signal("N", min=-1.0, max=1.0)},
        lambda x, u, p, _: ({"x": x.v, "v": -w * w * x.x - 2.0 * x.v + u.force}, {}),
    )
