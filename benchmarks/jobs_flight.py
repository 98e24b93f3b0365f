"""20 s of closed-loop flight with a learning critic, step 1e-4 s: against the same loop written in C."""

from __future__ import annotations

from benchmarks.flight_case import STEPS, FlightCase, c_flight, difference
from benchmarks.report import Row, in_turn
from hfa_support.native.machine_code import c_compiler


def rows(quick: bool = False) -> list[Row]:
    """The loop against C by hand, where there is a compiler."""
    if c_compiler() is None:
        return []
    case, steps = FlightCase(), 2000 if quick else STEPS
    by_hand = c_flight(case, steps)
    timing = in_turn(lambda: case.fly(True, steps), by_hand, repeats=5)
    remark = f"largest relative difference of the two histories {difference(case.fly(True, steps), by_hand()):.1e}"
    return [Row("20 s of flight, critic learning, generated C", "C by hand, -O3", timing, 1 / 1.5, remark)]
