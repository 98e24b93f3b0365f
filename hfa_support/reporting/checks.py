"""Checks: a measured value, its limit, and the reason for a failure."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from hfa_support.errors import refuse_unknown
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Cell, Table

#: Relation between value and limit -> function. A value of nan satisfies none.
RELATIONS: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
}


@dataclass(frozen=True)
class Check(Result):
    """A number that must satisfy `value relation limit`.

    name: name of the quantity
    value: the measured number
    limit: the limit
    ok: whether the relation is satisfied
    reason: reason for a failure, or "" if `ok`.
    relation: "<=", "<", ">=", ">" or "=="
    kind: "error", "rest" (of an equilibrium), "stability", "game loop", "cost", "gain", "data" or
        "".
    """

    name: str
    value: float
    limit: float
    ok: bool
    reason: str
    relation: str = "<="
    kind: str = ""

    @property
    def sentence(self) -> str:
        """Sentence with the value and its limit, for reports and error messages."""
        return f"{self.name} is {self.value:.3g} and must be {self.relation} {self.limit:.3g}"

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "name": self.name,
            "value": self.value,
            "limit": self.limit,
            "ok": self.ok,
            "reason": self.reason,
        }


class Checked:
    """Base class of results that consist of checks. The result passes if all its checks pass."""

    if TYPE_CHECKING:

        @property
        def checks(self) -> tuple[Check, ...]:
            """All checks of this result."""

    @property
    def ok(self) -> bool:
        """True if every check passes."""
        return all(check.ok for check in self.checks)

    def __bool__(self) -> bool:
        return self.ok

    def __getitem__(self, name: str) -> float:
        """Return the measured value of the check with this name.

        Raises BadInputError for an unknown name.
        """
        values = {check.name: check.value for check in self.checks}
        refuse_unknown("unknown check", name, values)
        return values[name]


def checked(
    name: str, value: float, limit: float, reason: str = "", kind: str = "", relation: str = "<="
) -> Check:
    """Return a check that passes if `value relation limit` is true.

    A value of nan fails.

    name: name of the quantity
    value: the measured number
    limit: the limit
    reason: reason for a failure
    kind: as in `Check`
    relation: a key of `RELATIONS`, for example "<="
    """
    ok = RELATIONS[relation](float(value), float(limit))
    return Check(name, float(value), float(limit), ok, "" if ok else reason, relation, kind)


#: Functions that return a check of value <= limit, value >= limit, and value < limit.
at_most = partial(checked, relation="<=")
at_least = partial(checked, relation=">=")
below = partial(checked, relation="<")


def checks_block(checks: Iterable[Check]) -> tuple[Table | str, ...]:
    """Return a table of the checks, followed by a line with the reason for each failed check."""
    listed = tuple(checks)
    rows = [
        (check.name, f"{check.value:.3g}", f"{check.limit:.3g}", verdict_text(check.ok))
        for check in listed
    ]
    reasons = [f"FAIL {check.name}: {check.reason}" for check in listed if not check.ok]
    return Table(("check", "value", "limit", "verdict"), rows), *reasons


def verdict_text(ok: bool) -> str:
    """Return the table cell PASS or FAIL."""
    return Cell("PASS", "good") if ok else Cell("FAIL", "bad")
