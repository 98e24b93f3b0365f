"""Level flight, game and identified parameters of the paper.

The public names are listed in the stub of this module.
"""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
