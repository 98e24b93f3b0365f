"""The environment `hfa/Flexible-v0`, which the import of this module registers with Gymnasium.

>>> import gymnasium
>>> env = gymnasium.make("hfa.gym:hfa/Flexible-v0", points=[0.17])  # doctest: +SKIP
"""

from __future__ import annotations

from typing import Any

import gymnasium

import hfa


def flexible(**arguments: Any) -> gymnasium.Env:
    """Return `hfa.environment` of the paper's aircraft.

    arguments: those of `hfa.environment`, without the model
    """
    return hfa.environment(hfa.aircraft(), **arguments)


gymnasium.register("hfa/Flexible-v0", flexible)
