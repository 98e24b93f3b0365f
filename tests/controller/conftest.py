"""The Monte Carlo that several test files fly."""

from __future__ import annotations

import numpy as np
import pytest
from member_plans import a_critic, everything_plan

from controller import Game, MonteCarlo
from studies.section5.critic_policy import CriticPolicy
from trim import OperatingPoint


@pytest.fixture
def plan(point: OperatingPoint, gain: np.ndarray) -> MonteCarlo:
    return everything_plan(point, gain)


@pytest.fixture
def critic(game: Game) -> CriticPolicy:
    return a_critic(game)
