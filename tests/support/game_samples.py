"""Games for tests of the exact solution."""

from dataclasses import replace

from hfa.paper import published_game
from hfa_model import published_models


def game_models():
    """Return the games of the two printed linear models, by name."""
    return {
        f"published-{model.dihedral_deg:g}": published_game(model.A, model.B)
        for model in published_models()
    }


def failed_names(checks):
    """Return the names of the checks that fail."""
    return {check.name for check in checks if not check.ok}


def in_steps(game, discount=1.0):
    """Return the game in discrete time with the same matrices, of an unknown sample time."""
    return replace(game, dt=True, discount=discount)
