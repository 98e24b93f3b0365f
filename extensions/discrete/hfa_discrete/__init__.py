"""Discrete-time games: exact solution, verdicts on critics, and Q-learning."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
