"""The public names of `hfa`, for the functions of a notebook."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def public() -> Any:
    """Return the module `hfa`. An extension cannot import it when it is loaded itself."""
    return import_module("hfa")
