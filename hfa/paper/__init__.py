"""What is the paper's alone: its level flight, its game, its identified parameters.

The names stand in the stub beside this file."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
