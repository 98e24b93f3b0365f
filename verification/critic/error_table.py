"""Errors of a critic over time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.settling import settled_at
from hfa_support.reporting.results import Result, Vector, plain

#: What is computed for each row of a table of critics, and the head of its column and curve.
COLUMNS = {
    "P_rel_error": "error of P",
    "K_rel_error": "error of K",
    "riccati_residual": "Riccati residual",
    "largest_error": "largest error",
}


@dataclass(frozen=True, eq=False)
class ErrorTable(Result):
    """Errors of a critic at each time of its history.

    times: (N,), s.
    errors: by the names of `COLUMNS`, (N,) each; nan where P is not known.
    decides: whose column must settle.
    limit: of that column.
    predefined_time: T_w, s; None when none is promised.
    """

    keys = "time=times limit settling_time predefined_time predefined_time_kept"

    times: Vector
    errors: Mapping[str, np.ndarray]
    decides: str
    limit: float
    predefined_time: float | None = None

    @property
    def settling_time(self) -> float:
        """First time from which the deciding column stays within the limit, s; inf when it does
        not."""
        return settled_at(self.times, self.errors[self.decides], self.limit)

    @property
    def predefined_time_kept(self) -> bool | None:
        """Whether it settles in the time that is promised."""
        if self.predefined_time is None:
            return None
        return self.settling_time <= self.predefined_time

    def as_data(self) -> dict[str, Any]:
        """The errors by their names, among the entries."""
        data = super().as_data()
        return {"time": data.pop("time"), **plain(self.errors), **data}

    @property
    def sentence(self) -> str:
        """When it settles, in words."""
        what = f"the {COLUMNS[self.decides]}"
        if math.isfinite(self.settling_time):
            return f"{what} stays within {self.limit:g} from {self.settling_time:.4g} s on"
        last = self.errors[self.decides][-1]
        return f"{what} ends at {last:.3g} and does not settle within {self.limit:g}"
