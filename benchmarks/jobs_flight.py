"""20 s of closed-loop flight with a learning critic, step 1e-4 s: against the same loop written in C, NumPy and JAX."""

from __future__ import annotations

from benchmarks.flight_case import STEPS, FlightCase, c_flight, difference, jax_flight, numpy_flight
from benchmarks.report import Row, in_turn
from hfa_support.native.machine_code import c_compiler

_JOB = "20 s of flight, critic learning, "


def rows(quick: bool = False) -> list[Row]:
    """The loop against each peer that is there; without a compiler on fewer steps."""
    case = FlightCase()
    steps = 2000 if quick else STEPS
    slow, peer = (1000, 100) if quick else (20_000, 1000)
    timing = in_turn(
        lambda: case.fly(False, slow),
        lambda: numpy_flight(case, peer),
        units=slow / STEPS,
        peer_units=peer / STEPS,
        repeats=5,
    )
    found = [Row(_JOB + "no compiler", "NumPy loop", timing, None)]
    if c_compiler() is not None:
        by_hand = c_flight(case, steps)
        timing = in_turn(lambda: case.fly(True, steps), by_hand, repeats=5)
        remark = f"largest relative difference of the two histories {difference(case.fly(True, steps), by_hand()):.1e}"
        found.insert(0, Row(_JOB + "generated C", "C by hand, -O3", timing, 1 / 1.5, remark))
    try:
        by_jax = jax_flight(case, steps)
    except ImportError:
        return found
    timing = in_turn(lambda: case.fly(True, steps), by_jax, repeats=5)
    return [*found, Row(_JOB + "generated C", "JAX scan on the CPU", timing, None)]
