"""Proofs about loops of an aircraft: schedules and regions of attraction."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
