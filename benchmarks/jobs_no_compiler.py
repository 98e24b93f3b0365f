"""Why 20 times NumPy is out of reach without a compiler: what compiled code makes of the loop, and what was tried."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np

from benchmarks.flight_case import STEP, STEPS, Contestant, FlightCase, c_flight, jax_flight, numba_flight, numpy_flight
from benchmarks.report import Row
from benchmarks.timing import in_turn
from controller.flight.closed_loop import CompiledLoop
from controller.flight.integrator import integrate
from controller.policy.critic_policy import CriticPolicy, powers
from controller.policy.signals import zero
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import c_compiler


def rows(quick: bool = False) -> list[Row]:
    """For orientation, without a target."""
    case = FlightCase()
    return [*_limits(case, quick), _without_stack(case, quick), *_attempts(case, quick)]


def _limits(case: FlightCase, quick: bool) -> list[Row]:
    """What compiled code makes of the loop, as a fraction of NumPy's time."""
    steps, peer_steps = (500, 100) if quick else (STEPS, 1000)
    contestants: dict[str, Callable[..., Contestant]] = {"numba": numba_flight, "JAX": jax_flight}
    if c_compiler() is not None:
        contestants |= {
            "C by hand, -O3": c_flight,
            "C by hand, -O3, the stack left out": partial(c_flight, flags=("-O3", "-DSAMPLES=0")),
            "C by hand, -O3 -march=native -ffast-math": partial(
                c_flight, flags=("-O3", "-march=native", "-ffast-math")
            ),
        }
    found = []
    for name, make in contestants.items():
        try:
            compiled = make(case, steps)
        except ImportError:
            continue
        timing = in_turn(
            compiled,
            lambda: numpy_flight(case, peer_steps),
            units=steps / STEPS,
            peer_units=peer_steps / STEPS,
            repeats=1 if quick else 5,
        )
        found.append(Row(f"20 s of flight, critic learning, {name}", "NumPy loop", timing, None))
    return found


def _without_stack(case: FlightCase, quick: bool) -> Row:
    """What would be left if the stack of Eq. (46) cost nothing: not the same flight, only its time.

    The weights stay where they are (p = 0), because without the stack they run away.
    """
    loop = replace(case.compiled.loop, policy=_NoStack(case.law, zero(6)))
    rate = CompiledLoop(loop).rate
    steps, peer_steps = (1000, 100) if quick else (20_000, 1000)

    def fly() -> None:
        frozen = np.zeros(1)
        integrate(
            rate,
            case.start,
            lambda tick: frozen,
            step=STEP,
            steps_per_tick=1000,
            ticks=steps // 1000,
            compile_code=False,
        )

    timing = in_turn(
        fly, lambda: numpy_flight(case, peer_steps), units=steps / STEPS, peer_units=peer_steps / STEPS, repeats=5
    )
    return Row(
        "20 s of flight, critic learning, no compiler, the stack left out", "NumPy loop with its stack", timing, None
    )


class _NoStack(CriticPolicy):
    """The policy of a critic that has recorded nothing."""

    @property
    def _stack(self) -> ca.Function:  # type: ignore[override]
        weights = ca.SX.sym("W", self.memory_size)
        return ca.Function("stack", [weights], [ca.SX.zeros(self.memory_size)])


def _attempts(case: FlightCase, quick: bool) -> list[Row]:
    """The stack of Eq. (46), half of the loop's time in the virtual machine, written in other ways."""
    calls, repeats = (100, 1) if quick else (20_000, 7)
    plain = CriticPolicy(case.law, zero(6))._stack
    found = []
    for name, function in (
        ("its power as exp(0.2 log abs(e))", _by_logarithm(case)),
        ("written out", _written_out(case)),
    ):
        timing = in_turn(
            _many(function, case, calls), _many(plain, case, calls), units=calls, peer_units=calls, repeats=repeats
        )
        found.append(Row(f"stack of Eq. (46) in the virtual machine, {name}", "as it is", timing, None))
    return found


def _many(function: ca.Function, case: FlightCase, calls: int) -> Callable[[], None]:
    bound = BoundFunction(function)
    bound.inputs[0][:] = case.start[6:]

    def run() -> None:
        for _ in range(calls):
            bound()

    return run


def _by_logarithm(case: FlightCase) -> ca.Function:
    """The same numbers to rounding, with a logarithm and an exponential for each power."""
    law, W = case.law, ca.MX.sym("W", case.law.basis.size)
    stored = law.history.at(np.zeros(law.basis.size))
    regressors, (alpha1, alpha2) = ca.DM(stored.regressors), law.gains
    e = ca.mtimes(regressors, W) + ca.DM(stored.residuals)
    size = ca.fabs(e)
    low = ca.exp((1 - law.settings.eta) * ca.log(size))
    push = ca.sign(e) * ((alpha1 + 1) * low + (alpha2 + 1) * size**2 / (low + np.finfo(float).tiny))
    return ca.Function("stack", [W], [ca.mtimes(regressors.T, push)])


def _written_out(case: FlightCase) -> ca.Function:
    """One scalar operation after the other."""
    law, W = case.law, ca.SX.sym("W", case.law.basis.size)
    stored = law.history.at(np.zeros(law.basis.size))
    regressors = ca.SX(ca.DM(stored.regressors))
    e = ca.mtimes(regressors, W) + ca.DM(stored.residuals)
    return ca.Function("stack", [W], [ca.mtimes(regressors.T, powers(e, *law.gains, law.settings.eta))])
