"""Flight simulation: plant, policy and gusts combined in one loop."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
