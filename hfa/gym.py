"""The environment `hfa/Flexible-v0`, which the import of this module registers with Gymnasium.

>>> import gymnasium
>>> env = gymnasium.make("hfa.gym:hfa/Flexible-v0", points=[0.17])  # doctest: +SKIP
"""

from __future__ import annotations

import math
from typing import Any

import gymnasium

import hfa

#: Dihedral angle of the trim at which episodes of `hfa/Flexible-v0` begin, rad.
DIHEDRAL = math.radians(10.0)


def flexible(**arguments: Any) -> gymnasium.Env:
    """Return `hfa.environment` of the paper's aircraft.

    arguments: those of `hfa.environment`, without the model
    """
    return hfa.environment(hfa.aircraft(), **arguments)


gymnasium.register("hfa/Flexible-v0", flexible, kwargs={"points": [DIHEDRAL]})
