"""Names for packages that add an aircraft format or a command.

The public names are listed in the stub of this module.
"""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
