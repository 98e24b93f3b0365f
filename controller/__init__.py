"""How the aircraft is controlled: the game, the critics that learn its value, and the simulated
closed loop."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
