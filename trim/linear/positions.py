"""Positions of signals, given by name, in the vectors of a linear model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from hfa_support.errors import BadInputError, refuse_unknown


def positions(what: str, names: Sequence[str] | None, known: tuple[str, ...]) -> list[int]:
    """Return the positions of names in a list of known names.

    what: kind of the names in messages: "state"
    names: one name or several; None for all known names
    known: the known names

    Raises BadInputError for an unknown name, and for a repeated name.
    """
    chosen: Any = known if names is None else names
    if isinstance(chosen, str) or not isinstance(chosen, Iterable):
        chosen = [chosen]
    chosen = list(chosen)
    positions = {name: index for index, name in enumerate(known)}
    for index, name in enumerate(chosen):
        if not isinstance(name, str) or name not in positions:
            refuse_unknown(f"unknown {what}", name, known)
        if name in chosen[:index]:
            raise BadInputError(f"{what} {name} is named twice; remove one {name}")
    return [positions[name] for name in chosen]
