"""Use of extensions in tests of the core. A test is skipped if its extension is not installed."""

from importlib.util import find_spec

import pytest


class Extension:
    """Module of an extension, imported when a test first accesses one of its names."""

    def __init__(self, module):
        self._module = module

    def __getattr__(self, name):
        """Return an attribute of the module. The test is skipped if the module is not installed."""
        return getattr(pytest.importorskip(self._module), name)


def needs(*packages):
    """Return a pytest mark that skips a test unless all these packages are installed."""
    missing = [name for name in packages if find_spec(name) is None]
    return pytest.mark.skipif(bool(missing), reason=f"needs {', '.join(missing)}")
