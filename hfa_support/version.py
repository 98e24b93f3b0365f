"""Version of the program, which `pyproject.toml` reads here.

The metadata of the installation would be slower to import. Resumable results record the version,
because another one may give other numbers.
"""

VERSION = "0.4.0"
