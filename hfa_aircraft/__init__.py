"""The aircraft for every package: the declaration of a model, its loading and conversion."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
