"""What an aircraft is to every package: the declaration of a model, how it is loaded and
converted."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
