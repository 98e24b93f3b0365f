"""Positions of named signals in a linear model."""

from __future__ import annotations

from collections.abc import Sequence

from hfa_support.errors import BadInputError, refuse_unknown


def positions(what: str, names: Sequence[str] | None, known: tuple[str, ...]) -> list[int]:
    """Return the positions of one or several names in the list `known`, or all positions for None.

    what: kind of the names in messages: "state"

    Raises BadInputError for an unknown name, and for a repeated name.
    """
    chosen = known if names is None else names
    if isinstance(chosen, str):
        chosen = (chosen,)
    positions = {name: index for index, name in enumerate(known)}
    for index, name in enumerate(chosen):
        if name not in positions:
            refuse_unknown(f"unknown {what}", name, known)
        if name in chosen[:index]:
            raise BadInputError(f"{what} {name} is named twice; name it once")
    return [positions[name] for name in chosen]
