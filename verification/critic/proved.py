"""Type of the proof in a verdict on a critic, for type checkers only."""

from __future__ import annotations

from typing import Protocol


class Proved(Protocol):
    """Proved bound on the errors of a nonlinear critic in a box of states.

    error: proved upper bound of the relative error.
    fraction: factor on the box for which the bound is proved, or 0 if nothing is proved.
    is_of_all: True if the bound covers all errors that are compared.
    where: the part of the box, in words.
    """

    @property
    def error(self) -> float: ...  # noqa: D102
    @property
    def fraction(self) -> float: ...  # noqa: D102
    @property
    def is_of_all(self) -> bool: ...  # noqa: D102
    @property
    def where(self) -> str: ...  # noqa: D102
