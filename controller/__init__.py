"""Control of the aircraft: zero-sum games, their exact solution, critics and learners."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
