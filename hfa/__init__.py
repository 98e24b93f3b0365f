"""Trims, exact linear models and games of aircraft, and checks of critics.

Critics are compared with the exact solution. The public names are listed in the stub of this
module.
"""

from hfa_support.public_names import public_names
from hfa_support.version import VERSION as __version__  # noqa: F401

_instead = {
    **{name: f"the command `hfa {name}`" for name in ("export", "regenerate", "report")},
    "poles": "linear.poles()",
    "load_game": "controller.load_game(FILE)",
    **dict.fromkeys(("delta_min", "hinf"), "hfa.solve(game).delta_min"),
}
__getattr__, __dir__ = public_names(__name__, __file__)
