"""Checks: critics against the exact game solution, and linear models against the printed
matrices."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
