"""Proofs of gain schedules at every point of an interval."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
