"""Trims, exact linear models and games of aircraft, and critics checked against the exact solution.

The stub of this module lists the public names."""

import warnings
from typing import Any

from hfa_support.public_names import public_names
from hfa_support.version import VERSION as __version__  # noqa: F401

_public, __dir__ = public_names(__name__, __file__)
#: Names that moved to `hfa.paper`; they answer for one version.
_MOVED = ("default_parameters", "level_flight", "level_model", "published_game")


def __getattr__(name: str) -> Any:
    """A public name."""
    if name in _MOVED:
        message = f"hfa.{name} is hfa.paper.{name} now; the old name goes with the next version"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        return getattr(_public("paper"), name)
    return _public(name)
