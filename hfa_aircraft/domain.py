"""States at which the equations of a model are valid."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, eq=False)
class Domain:
    """States at which the equations of a model are valid, beside the limits of its signals.

    range: state -> (largest absolute value, source). Larger values cause a warning.
    envelope: function (x, p) of a trim -> limits of the states in flight, as state -> (lowest,
        highest), if they differ from min and max. x and p have fields by name.
    check: function of a state x, with fields by name, that raises BadInputError outside the domain
    """

    range: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    envelope: Callable[[Any, Any], Mapping[str, tuple[float, float]]] | None = None
    check: Callable[[Any], None] | None = None

    def limits_about(self, x: Any, p: Any) -> Mapping[str, tuple[float, float]]:
        """Return the limits of the states in flight about a trim that `envelope` changes.

        x, p: state and parameters of the trim, with fields by name
        """
        return {} if self.envelope is None else self.envelope(x, p)

    def refuse_outside(self, x: Any) -> None:
        """Raise BadInputError for a state outside the domain, with fields by name."""
        if self.check is not None:
            self.check(x)
