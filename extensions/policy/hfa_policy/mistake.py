"""Mistakes of a deployment."""

from __future__ import annotations

from typing import NamedTuple


class Mistake(NamedTuple):
    """Mistake of a deployment.

    kind: type of mistake, such as "scale" or "no normalizer".
    proved: True if the files prove the mistake, False if the files make the mistake likely, or if
        the correction clearly improves the flights.
    text: description in one sentence.
    """

    kind: str
    proved: bool
    text: str

    @property
    def sentence(self) -> str:
        """Return the line of the report: "mistake: ..." if proved, otherwise "perhaps: ..."."""
        return f"{'mistake' if self.proved else 'perhaps'}: {self.text}"
