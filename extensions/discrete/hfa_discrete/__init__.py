"""Discrete-time games: exact solution, comparison of critics with it, and Q-learning."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
