"""Control of the aircraft: the game, the critics that learn its value, and the closed loop."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
