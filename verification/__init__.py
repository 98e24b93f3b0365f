"""Is it true: the exact game solution with its certificate, and everything that is checked against
it."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
