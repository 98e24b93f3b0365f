"""Proofs about loops of an aircraft: schedules, games, regions of attraction, bounds of cost."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
