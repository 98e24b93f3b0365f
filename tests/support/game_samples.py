"""Games for tests of the exact solution."""

from __future__ import annotations

from collections.abc import Iterable

from hfa import Game
from hfa.extend import Check
from hfa.paper import published_game
from hfa_model import published_models


def game_models() -> dict[str, Game]:
    """Return the games of the two printed linear models, by name."""
    return {
        f"published-{model.dihedral_deg:g}": published_game(model.A, model.B)
        for model in published_models()
    }


def failed_names(checks: Iterable[Check]) -> set[str]:
    """Return the names of the checks that fail."""
    return {check.name for check in checks if not check.ok}
