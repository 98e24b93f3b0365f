"""A mistake of a deployment."""

from __future__ import annotations

from typing import NamedTuple


class Mistake(NamedTuple):
    """A mistake of a deployment.

    kind: such as "scale" or "no normalizer".
    proved: whether the files prove it. Otherwise they make it likely, or its repair clearly
        improves the flights.
    text: one sentence about it.
    """

    kind: str
    proved: bool
    text: str

    @property
    def sentence(self) -> str:
        """Return the sentence of a report."""
        return f"{'mistake' if self.proved else 'perhaps'}: {self.text}"
