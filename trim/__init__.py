"""Operating points, exact linear models, modes and sweeps, for any aircraft."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
