"""Names for a package that adds an aircraft format or a command.

The stub of this module lists the public names."""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
