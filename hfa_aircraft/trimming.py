"""What a model knows about its own trims: initial values, alternatives and explanations."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hfa_support.reporting.report import Report


@dataclass(frozen=True, eq=False)
class Trimming:
    """What a model knows about its own trims.

    alternatives: groups of names, of which a trim imposes one, such as speed and mach. Imposing
        another name of the group frees the imposed one.
    begin: function (imposed values by name) -> initial values of the other variables in a trim
        search. Values are numbers or arrays. The first name of a group of alternatives receives its
        exact value. None for the declared initial values.
    explain: function (imposed values, solve) -> reason why no trim exists, in terms of the aircraft
        (`trim.point.diagnosis`), or ""; None for no explanation
    describe: function (operating point, its report) -> the report with the aircraft's own
        description of the trim in place of its outputs; None for the outputs
    """

    alternatives: tuple[tuple[str, ...], ...] = ()
    begin: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None
    explain: Callable[[Mapping[str, float], Callable[..., Any]], str] | None = None
    describe: Callable[[Any, Report], Report] | None = None

    def initial(self, imposed: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the initial values that `begin` computes, variable -> number or array.

        imposed: name -> imposed value or parameter
        """
        return {} if self.begin is None else self.begin(imposed)

    def without_alternatives(
        self, imposed: Mapping[str, Any], names: Iterable[str]
    ) -> dict[str, Any]:
        """Return the imposed values that can be imposed together with some other names.

        imposed: name -> value
        names: names that will also be imposed
        """
        released: set[str] = set()
        for group in self.alternatives:
            if not set(group).isdisjoint(names):
                released |= set(group).difference(names)
        return {name: value for name, value in imposed.items() if name not in released}

    def with_first_alternatives(self, imposed: Mapping[str, Any]) -> dict[str, Any]:
        """Return the imposed values, with each group of alternatives expressed by its first name.

        For example, the speed replaces kcas. A group is unchanged if the imposed values do not
        determine its first name.

        imposed: name -> number or array
        """
        if not self.alternatives:
            return dict(imposed)
        begun = self.initial(imposed)
        values = dict(imposed)
        for group in self.alternatives:
            others = set(group[1:]).intersection(imposed)
            if len(others) == 1 and group[0] not in imposed and group[0] in begun:
                values = {name: value for name, value in values.items() if name not in others}
                values[group[0]] = begun[group[0]]
        return values
