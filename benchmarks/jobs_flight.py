"""20 s of closed-loop flight with a learning critic, step 1e-4 s: against C by hand, NumPy, numba and JAX."""

from __future__ import annotations

from benchmarks.flight_case import STEPS, FlightCase, c_flight, difference, jax_flight, numba_flight, numpy_flight
from benchmarks.report import Row
from benchmarks.timing import in_turn
from hfa_support.native.machine_code import c_compiler

_GENERATED = "20 s of flight, critic learning, generated C"


def rows(quick: bool = False) -> list[Row]:
    """The compiled loop against each peer that is there."""
    case = FlightCase()
    steps = 2000 if quick else STEPS
    return [*_against_c(case, steps), _without_compiler(case, quick), *_against_python(case, steps)]


def _against_c(case: FlightCase, steps: int) -> list[Row]:
    if c_compiler() is None:
        return []
    by_hand = c_flight(case, steps)
    timing = in_turn(lambda: case.fly(True, steps), by_hand, repeats=5)
    remark = f"largest relative difference of the two histories {difference(case.fly(True, steps), by_hand()):.1e}"
    return [Row(_GENERATED, "C by hand, -O3", timing, 1 / 1.5, remark)]


def _without_compiler(case: FlightCase, quick: bool) -> Row:
    steps, peer_steps = (1000, 100) if quick else (20_000, 1000)
    timing = in_turn(
        lambda: case.fly(False, steps),
        lambda: numpy_flight(case, peer_steps),
        units=steps / STEPS,
        peer_units=peer_steps / STEPS,
        repeats=5,
    )
    return Row("20 s of flight, critic learning, no compiler", "NumPy loop", timing, None)


def _against_python(case: FlightCase, steps: int) -> list[Row]:
    found = []
    for name, make in (("numba", numba_flight), ("JAX scan on the CPU", jax_flight)):
        try:
            peer = make(case, steps)
        except ImportError:
            continue
        timing = in_turn(lambda: case.fly(True, steps), peer, repeats=5)
        found.append(Row(_GENERATED, name, timing, None))
    return found
