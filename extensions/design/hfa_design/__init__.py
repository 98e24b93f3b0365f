"""Design of controllers with actuators, integrated outputs and weights."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
