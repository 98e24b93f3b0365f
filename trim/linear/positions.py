"""Positions of names in a linear model."""

from __future__ import annotations

from collections.abc import Sequence

from hfa_support.errors import BadInputError, refuse_unknown


def positions(what: str, names: Sequence[str] | None, known: tuple[str, ...]) -> list[int]:
    """Return the positions of one or several names among the known ones, or of all for None."""
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
