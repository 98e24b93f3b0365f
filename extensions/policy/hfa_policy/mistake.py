"""Mistakes of a deployment."""

from __future__ import annotations

from typing import NamedTuple


class Mistake(NamedTuple):
    """Mistake of a deployment.

    kind: type of mistake, such as "scale" or "no normalizer".
    proved: True if the files prove it. Otherwise the files make it likely, or correcting it clearly
        improves the flights.
    text: description in one sentence.
    """

    kind: str
    proved: bool
    text: str

    @property
    def sentence(self) -> str:
        """Return the line of the report, which begins with "mistake" or "perhaps"."""
        return f"{'mistake' if self.proved else 'perhaps'}: {self.text}"
