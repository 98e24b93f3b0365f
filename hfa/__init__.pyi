"""Trims, exact linear models and games of aircraft, and critics checked against the exact
solution."""

from controller.critic.critic import (
    from_gain as from_gain,
    from_value as from_value,
    from_weights as from_weights,
)
from controller.critic.network import from_network as from_network
from controller.game.zero_sum import Game as Game
from controller.hfa_game import published_game as published_game
from controller.learning.certified import learn as learn
from controller.riccati.gare import solve_game as solve_game
from hfa_aircraft import Model as Model, Signal as Signal
from hfa_model.choice import aircraft as aircraft
from hfa_model.parameters import default_parameters as default_parameters
from hfa_support.errors import BadInputError as BadInputError, NoSolutionError as NoSolutionError
from trim.hfa.level_flight import level_flight as level_flight
from trim.linear.linear_model import level_model as level_model, linearize as linearize
from trim.point.solve import find_operating_point as find_operating_point
from trim.sweeps.sweep import sweep as sweep
from verification.critic.critic_check import check_critic as check_critic
