"""What is the paper's alone: its level flight, its game, its identified parameters."""

from controller.hfa_game import published_game as published_game
from hfa_model.parameters import default_parameters as default_parameters
from trim.hfa.level_flight import level_flight as level_flight
from trim.linear.linearize import level_model as level_model
