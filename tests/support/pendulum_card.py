"""A deployment file of a policy of examples/pendulum.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def pendulum_card(
    folder: Path, tables: str, *, observed: str = "rate", gain: float = -0.98
) -> Path:
    """Write the deployment file of u = -1.98 angle + gain observed, and return its path.

    tables: its tables after the action, as TOML
    """
    weights = {"0.weight": np.array([[-1.98, gain]]), "0.bias": np.zeros(1)}
    np.savez(folder / "actor.npz", **weights)
    path = folder / "card.toml"
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
