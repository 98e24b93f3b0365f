"""Declaration, loading and unit conversion of aircraft models, used by all packages."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
