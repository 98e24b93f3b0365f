"""The version, which `pyproject.toml` reads here (the installed metadata are slower to import);
resumable results record it, because another version may give other numbers."""

VERSION = "0.4.0"
