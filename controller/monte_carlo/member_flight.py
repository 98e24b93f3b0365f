"""One member of a Monte Carlo in the air: the loop compiled once for all members, its summary kept as it flies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.flight.closed_loop import ClosedLoop, expressions
from controller.flight.integrator import COMPILE_FROM_STEPS, runge_kutta_step
from controller.monte_carlo.member_draws import Draws, draws_of, turbulence
from controller.monte_carlo.monte_carlo_plan import MonteCarlo
from hfa_model.native.bound import BoundFunction
from hfa_model.native.machine_code import machine_code
from hfa_model.native.per_thread import cached_per_thread
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES

_X, _Z, _U = len(STATES), len(LINEAR_STATES), len(INPUTS)


class Summary(NamedTuple):
    """What is kept of a flight of T seconds.

    left: index into `STATES` of the state that left the envelope, -1 when none did. flown: T, s, up to the first step
    outside. rms_error: sqrt(1/T ∫ z² dt), (6,), of the true error, without noise. peak_error: max |z|, (6,).
    effort: sqrt(1/T ∫ u² dt), (5,), of each input's deviation from trim. final: X at the end, absolute, (7,). memory:
    the policy's own states at the end.
    """

    left: int
    flown: float
    rms_error: np.ndarray
    peak_error: np.ndarray
    effort: np.ndarray
    final: np.ndarray
    memory: np.ndarray


class MemberLoop:
    """The loop of a plan as one function of the member's parameters, noise and turbulence."""

    def __init__(self, plan: MonteCarlo) -> None:
        self.plan = plan
        use_machine_code = plan.members * plan.course.ticks * plan.course.steps_per_tick >= COMPILE_FROM_STEPS
        step, self._sizes = _watched_step(plan)
        ticks = step.fold(plan.course.steps_per_tick)
        self._tick = BoundFunction(machine_code(ticks) if use_machine_code else ticks)

    def fly(self, draws: Draws) -> Summary:
        """The flight of one member."""
        plan, sizes = self.plan, self._sizes
        air = draws.air
        y = np.concatenate([plan.course.initial, plan.law.memory, np.zeros(0) if air is None else air.start()])
        constants = np.concatenate([plan.uncertain_plant.constants(draws.parameters), plan.law.constants])
        now, after = self._tick.inputs[0], self._tick.results[0]
        now[:] = np.concatenate([[0.0], y, np.zeros(sizes.sums), constants, np.zeros(sizes.held)])
        held = now[len(now) - sizes.held :]
        for tick in range(plan.course.ticks):
            held[:_Z] = draws.noise[tick]
            if air is not None:
                held[_Z:] = air.constants(tick)
            self._tick()
            now[:] = after
            if now[0] < (tick + 1 - 1e-6) * plan.course.tick:  # time stands still outside the envelope
                break
        return self._summary(now.copy())

    def _summary(self, now: np.ndarray) -> Summary:
        course, memory_size = self.plan.course, len(self.plan.law.memory)
        ends = np.cumsum([1, _X, memory_size, self._sizes.y - _X - memory_size, _Z, _Z, _U])
        t, x, memory, _, squares, peak, efforts, _ = np.split(now, ends)
        final = x + np.array(self.plan.point.states)
        with np.errstate(invalid="ignore"):
            excess = np.maximum(final - course.highest, course.lowest - final) / (course.highest - course.lowest)
        excess = np.where(np.isfinite(excess), excess, np.inf)
        held = excess.max() <= 0.0
        flown = course.duration if held else float(t[0])  # the clock of the loop is a sum of steps
        return Summary(
            left=-1 if held else int(np.argmax(excess)),
            flown=flown,
            rms_error=np.sqrt(squares / flown),
            peak_error=peak,
            effort=np.sqrt(efforts / flown),
            final=final,
            memory=memory,
        )


@cached_per_thread(maxsize=4)
def member_loop(plan: MonteCarlo) -> MemberLoop:
    """The loop of a plan, compiled at the first call in a thread."""
    return MemberLoop(plan)


def fly_member(plan: MonteCarlo, member: int) -> tuple[Draws, Summary]:
    """Draw and fly one member."""
    draws = draws_of(plan, member)
    return draws, member_loop(plan).fly(draws)


@dataclass(frozen=True)
class _Held:
    """Noise that is held during a tick, as a signal of the loop."""

    value: Any
    size = _Z

    def at(self, t: Any) -> Any:
        return self.value


class _Sizes(NamedTuple):
    """Lengths of y, of the sums of the summary, and of what is held during a tick."""

    y: int
    sums: int
    held: int


def _watched_step(plan: MonteCarlo) -> tuple[ca.Function, _Sizes]:
    """[t; y; ∫z² dt; max |z|; ∫u² dt; constants; held] -> the same one step later; as it is once x is outside.

    The summary takes z and u at the beginning of each step, where the Runge-Kutta step has them anyway.
    """
    course, law, uncertain = plan.course, plan.law, plan.uncertain_plant
    gust = turbulence(plan, 0)
    filters, noises = (gust.memory_size, gust.constants_size) if gust is not None else (0, 0)
    sizes = _Sizes(_X + law.policy.memory_size + filters, 2 * _Z + _U, _Z + noises)
    fixed = uncertain.constants_size + law.policy.constants_size
    lengths = [1, sizes.y, _Z, _Z, _U, fixed, sizes.held]
    whole = ca.SX.sym("s", sum(lengths))
    t, y, squares, peak, effort, constants, held = ca.vertsplit(whole, np.cumsum([0, *lengths]).tolist())
    loop = ClosedLoop(
        plant=uncertain.plant(constants[: uncertain.constants_size]),
        policy=law.policy,
        reference=course.reference,
        disturbance=course.disturbance,
        noise=_Held(held[:_Z]),
        gust=gust,
    )
    now = expressions(loop, t, y, ca.vertcat(constants[uncertain.constants_size :], held[_Z:]))
    everything = ca.vertcat(constants, held)
    rate = ca.Function("rate", [t, y, everything], [ca.densify(now.rate)])
    moved = runge_kutta_step(rate)(ca.vertcat(t, y), everything, course.step)
    X = y[:_X] + ca.DM(np.array(plan.point.states))
    lowest, highest = ca.DM(course.lowest), ca.DM(course.highest)
    inside = ca.mmin(ca.logic_and(lowest <= X, highest >= X))
    before = ca.vertcat(t, y, squares, peak, effort)
    after = ca.vertcat(
        moved,
        squares + course.step * now.error**2,
        ca.fmax(peak, ca.fabs(now.error)),
        effort + course.step * now.inputs**2,
    )
    result = ca.vertcat(ca.if_else(inside, after, before), everything)
    return ca.Function("watched_step", [whole], [result], {"cse": True}), sizes
