"""A law that is ready to fly: a policy, what it is handed in each tick, and what it remembers at the start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from controller.game.array_file import real_array
from controller.game.learning_result import LearningResult
from controller.policy.policies import GainPolicy, Policy, gain_constants
from controller.policy.signals import zero
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.errors import BadInputError
from hfa_support.reporting.fields import Shown

_SHAPE = len(INPUTS), len(LINEAR_STATES)


@dataclass(frozen=True, eq=False, repr=False)
class FlownLaw(Shown):
    """u and memory' of `policy`, with p = table[k] in tick k, the last row staying, and memory(0) = memory.

    table: (N, k). memory: (m,). identity: JSON data that decides what it does. certified_from: s, when what is learned
    takes over from a baseline; 0 when it is used from the start. learned: the learning behind it, None for a law that
    was given. fastest: of its own modes, 1/s, as far as it is known; decides how it is integrated.
    """

    name: str
    policy: Policy
    table: np.ndarray
    memory: np.ndarray
    identity: Mapping[str, object] = field(default_factory=dict)
    certified_from: float = 0.0
    learned: LearningResult | None = None
    fastest: float = 0.0

    @property
    def online(self) -> bool:
        """Whether what it is handed changes in flight."""
        return len(self.table) > 1

    def constants(self, tick: int) -> np.ndarray:
        """p in a tick, (k,)."""
        row: np.ndarray = self.table[min(tick, len(self.table) - 1)]
        return row

    @property
    def gains(self) -> np.ndarray:
        """K in each tick, (N, 5, 6), of a `GainPolicy`; (0, 5, 6) of another."""
        if not isinstance(self.policy, GainPolicy):
            return np.zeros((0, *_SHAPE))
        return self.table.reshape(-1, *_SHAPE[::-1]).transpose(0, 2, 1)


def gain_law(
    name: str, gains: np.ndarray, certified_from: float = 0.0, learned: LearningResult | None = None
) -> FlownLaw:
    """u = -K z. gains: K (5, 6), or that of each tick (N, 5, 6); else BadInputError."""
    K = real_array("the gain", gains)
    if K.ndim not in (2, 3) or K.shape[-2:] != _SHAPE or not np.all(np.isfinite(K)):
        raise BadInputError(f"the gain has shape {np.shape(gains)}; give {_SHAPE[0]} x {_SHAPE[1]} finite numbers")
    table = np.array([gain_constants(each) for each in K.reshape(-1, *_SHAPE)])
    policy = GainPolicy(zero(len(INPUTS)))
    return FlownLaw(name, policy, table, np.zeros(0), {"K": K}, certified_from, learned)
