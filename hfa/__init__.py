"""Trims, exact linear models and games of aircraft, and critics checked against the exact solution.

The stub of this module lists the public names."""

from hfa_support.public_names import public_names
from hfa_support.version import VERSION as __version__  # noqa: F401

__getattr__, __dir__ = public_names(__name__, __file__)
