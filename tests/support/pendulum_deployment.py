"""Deployment file of a policy for the pendulum in examples/pendulum.py."""

import numpy as np


def pendulum_deployment(folder, tables, *, observed="rate", gain=-0.98):
    """Write a deployment file of the policy u = -1.98 angle + gain observed, and return its path.

    tables: further tables of the file, as TOML
    observed: name of the second observation
    """
    weights = {"0.weight": np.array([[-1.98, gain]]), "0.bias": np.zeros(1)}
    np.savez(folder / "actor.npz", **weights)
    path = folder / "deployment.toml"
    path.write_text(f"""
[policy]
file = "actor.npz"
[observation]
angle = {{}}
{observed} = {{}}
[action]
torque = {{box = [-3.0, 3.0], map = "trim + a"}}
{tables}""")
    return path
