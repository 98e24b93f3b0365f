"""The version of this toolchain, which `pyproject.toml` reads here: the installed metadata are slower to import."""

VERSION = "0.2.0"


def toolchain_version() -> str:
    """The version; what can be resumed records it, because another version may give other numbers."""
    return VERSION
