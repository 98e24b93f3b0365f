"""Check whether forces depend on the simulation time."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

#: State of a steady flight, and times, s, at which its forces are compared.
_USUAL = {
    "speed": 300.0,
    "alpha": 0.05,
    "pitch": 0.05,
    "altitude": 5000.0,
    "throttle": 0.5,
    "gravity": 32.17,
    **{f"rpm{number}": 1500.0 for number in range(9)},
    **{f"engine{number}": 1.0 for number in range(9)},
    **{f"tank{number}": 100.0 for number in range(99)},
}
_TIMES = (0.37, 5.3, 61.7, 1234.5)


def depends_on_time(rates: ca.SX, time: ca.SX, symbols: Sequence[ca.SX]) -> bool:
    """Return whether time derivatives in a typical steady flight change with the simulation time.

    rates: time derivatives, expressions of `time` and `symbols`
    symbols: all other symbols in `rates`
    """
    function = ca.Function("rates", [time, ca.vertcat(*symbols)], [rates])
    usual = [_USUAL.get(symbol.name(), 0.0) for symbol in symbols]
    at_start = function(0.0, usual)
    return any(not ca.is_equal(function(later, usual), at_start) for later in _TIMES)
