"""Trims, exact linear models and games of aircraft, and checks of critics.

Critics are compared with the exact solution. The public names are listed in the stub of this
module.
"""

from hfa_support.public_names import public_names, refuse_hidden
from hfa_support.version import VERSION as __version__  # noqa: F401

refuse_hidden(__file__, ("controller", "trim", "verification"))
__getattr__, __dir__ = public_names(__name__, __file__)
