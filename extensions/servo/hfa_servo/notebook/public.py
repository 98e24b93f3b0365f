"""Access to the module `hfa` from the functions for notebooks."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def public() -> Any:
    """Return the module `hfa`.

    The module is imported at the call, because this extension may be loaded while `hfa` is
    imported.
    """
    return import_module("hfa")
