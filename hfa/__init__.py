"""Trims, exact linear models and games of aircraft, and critics checked against the exact solution.

The names that a user's script needs stand in the stub beside this file."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
