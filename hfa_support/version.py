"""The version of this toolchain. What can be resumed bears it, because another version may give other numbers."""

from __future__ import annotations

from functools import cache


@cache
def toolchain_version() -> str:
    """As the installed distribution has it, such as "0.1.0"."""
    from importlib.metadata import version

    return version("hfa-toolchain")
