"""Version of the program. `pyproject.toml` reads it from this module.

Importing this module is faster than reading the metadata of the installation. Resumable results
record the version, because another version may compute other numbers.
"""

VERSION = "0.4.0"
