"""What all packages share: errors, files, reports, jobs and native code."""

from importlib import import_module
from typing import Any

from hfa_support.public_names import public_names

_public, __dir__ = public_names(__name__, __file__)


def __getattr__(name: str) -> Any:
    """A public name; for one version also `Model` and `Signal`, which users' files imported from
    here."""
    if name in ("Model", "Signal"):
        return getattr(import_module("hfa_aircraft"), name)
    return _public(name)
