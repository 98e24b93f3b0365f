"""Extensions in tests of the core: a test that uses one is skipped where it is not installed."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import pytest


class Extension:
    """A module that is imported when a test first uses a name of it."""

    def __init__(self, module: str) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        """A name of the module; the test is skipped where there is no such module."""
        return getattr(pytest.importorskip(self._module), name)


def needs(*packages: str) -> pytest.MarkDecorator:
    """Return the mark of a test that needs extensions, by the names of their packages."""
    missing = [name for name in packages if find_spec(name) is None]
    return pytest.mark.skipif(bool(missing), reason=f"needs {', '.join(missing)}")
