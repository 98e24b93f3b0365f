"""Version of the program. `pyproject.toml` reads it from this module.

Importing this module is faster than reading the metadata of the installation.
"""

VERSION = "0.4.0"
