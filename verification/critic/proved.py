"""Type of the proof in a verdict, for type checkers alone."""

from __future__ import annotations

from typing import Protocol


class Proved(Protocol):
    """The proved bound on the errors of a nonlinear critic.

    error: proved upper bound of the relative error.
    fraction: size of the part of the box in which the bound holds, as a factor on the box, or 0
        where nothing is proved.
    is_of_all: whether it covers all errors that are compared.
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
