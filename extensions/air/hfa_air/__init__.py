"""The `unsteady` dynamics of the flexible aircraft: apparent mass of the air and lagged lift."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
