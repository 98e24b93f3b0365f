"""Zero-sum games, their exact solution, critics and learners."""

from .critic.critic_file import critic_in as critic_in
from .expansion.expansion_report import (
    expansion_report as expansion_report,
)
from .expansion.radius import Radius as Radius, radii_of as radii_of
from .game.basis import basis as basis
from .hfa_game import load_game as load_game
from .riccati.smallest_delta import minimum_delta as minimum_delta
from .riccati.solution_report import solution_report as solution_report
