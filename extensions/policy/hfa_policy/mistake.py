"""A mistake of a deployment."""

from __future__ import annotations

from typing import NamedTuple


class Mistake(NamedTuple):
    """A mistake of a deployment.

    kind: which.
    proved: whether the files prove it; else they make it likely, or the policy flies clearly better
        where it is undone.
    text: a sentence.
    """

    kind: str
    proved: bool
    text: str

    @property
    def sentence(self) -> str:
        """Return the sentence of a report."""
        return f"{'mistake' if self.proved else 'perhaps'}: {self.text}"
