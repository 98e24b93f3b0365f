"""Small scheduled controllers with simple numbers, for tests."""

from __future__ import annotations

import numpy as np

from hfa import Model
from hfa_flight import ScheduledController


def small_controller(aircraft: Model, **changed: object) -> ScheduledController:
    """Return a controller with three angles, one state and one input.

    All entries of matrix number k = 0, 1, ... at angle number i = 0, 1, 2 are 10 k + i.

    changed: fields that differ
    """
    angles = np.radians([5.0, 10.0, 20.0])
    shapes = {"A": (1, 1), "B": (1, 4), "C": (1, 1), "D": (1, 4), "W": (1, 1)}
    stacks = {
        name: np.arange(3.0)[:, None, None] + 10.0 * number * np.ones(shape)
        for number, (name, shape) in enumerate(shapes.items())
    }
    settings = {
        "name": "small",
        "feedback": "output",
        "breakpoints": angles,
        **stacks,
        "states": ("dihedral_integral",),
        "measurements": ("pitch_rate", "dihedral"),
        "commands": ("dihedral_command", "dihedral_command_rate"),
        "inputs": ("aileron_outer",),
        "trim_states": np.ones((3, 7)),
        "trim_inputs": np.ones((3, 5)),
        "command_filter": (0.5, 2.0),
        "about": {"description": "a test"},
    }
    return ScheduledController(**(settings | changed), model=aircraft)  # type: ignore[arg-type]


def integrating_controller(aircraft: Model, **changed: object) -> ScheduledController:
    """Return the controller u = -k (e + 0.3 (dihedral - r)), e' = dihedral - r.

    k increases with the angle.

    changed: fields that differ
    """
    gains = np.array([0.02, 0.03, 0.04])[:, None, None]
    one = np.ones((3, 1, 1))
    row = np.array([0.0, 1.0, -1.0, 0.0])
    parts = {"A": 0.0 * one, "B": one * row, "C": -gains, "D": -0.3 * gains * row, "W": 0.0 * one}
    return small_controller(aircraft, **(parts | changed))
