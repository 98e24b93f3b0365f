"""Checks of critics against the exact game solution, and of linear models against printed
matrices."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
