"""Extensions in tests of the core: a test that uses one is skipped where it is not installed."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import pytest


class Extension:
    """A module of an extension. It is imported when a test first uses one of its names."""

    def __init__(self, module: str) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Any:
        """Return a name of the module. The test is skipped if the module does not exist."""
        return getattr(pytest.importorskip(self._module), name)


def needs(*packages: str) -> pytest.MarkDecorator:
    """Return the mark of a test that needs extensions, by the names of their packages."""
    missing = [name for name in packages if find_spec(name) is None]
    return pytest.mark.skipif(bool(missing), reason=f"needs {', '.join(missing)}")
