"""Compiled equations of a JSBSim aircraft, with and without gusts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from hfa_jsbsim.properties import is_zero


class EquationsOfMotion:
    """Equations (x, u, p, w) -> (rates by state, outputs by name), for numbers or expressions.

    still: function (x, u, p) -> (rates, outputs) as columns, without gusts.
    gusty: function without arguments that returns (x, u, p, w) -> (rates, outputs), called only if
        gusts are not 0.
    """

    def __init__(
        self,
        still: ca.Function,
        gusty: Callable[[], ca.Function],
        rates: list[str],
        outputs: list[str],
    ) -> None:
        self.still = still
        self._gusty = gusty
        self._rates = rates
        self._outputs = outputs

    def __call__(self, x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the rates by state and the outputs by name.

        x, u, p, w: sequences of numbers or expressions; w are the gusts
        """
        is_still = all(is_zero(gust) for gust in w)
        vectors = (x, u, p) if is_still else (x, u, p, w)
        columns = [ca.vertcat(*vector) if len(vector) else ca.DM(0, 1) for vector in vectors]
        rates, outputs = (self.still if is_still else self._gusty())(*columns)
        if isinstance(rates, ca.DM):  # of numbers
            split = [column.full().ravel().tolist() for column in (rates, outputs)]
        else:
            split = [ca.vertsplit(column) for column in (rates, outputs)]
        return (
            dict(zip(self._rates, split[0], strict=True)),
            dict(zip(self._outputs, split[1], strict=True)),
        )
