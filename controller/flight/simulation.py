"""A closed loop compiled and simulated: one loop over its ticks, from which histories and sums are made."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.flight.actuators import LONGEST_STEP
from controller.flight.closed_loop import ClosedLoop, Constants
from controller.flight.envelope import ALPHA, Envelope, limited_names
from controller.flight.limit_cycle import is_driven, limit_cycle
from controller.flight.plants import UPDRAFT, Plant
from controller.flight.scenario import Scenario
from controller.policy.policies import FlownLaw, OpenLoop
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.native.bound import BoundFunction
from hfa_support.native.machine_code import machine_code
from hfa_support.progress import Progress
from hfa_support.reporting.fields import Shown
from trim.point.operating_point import OperatingPoint

#: Runs at least this long are worth compiling to machine code.
COMPILE_FROM_STEPS = 50_000
#: Steps that are handed on at once, and the most parts into which the modes of a law divide one.
_ROWS, _MOST_PARTS = 1000, 10_000


@dataclass(frozen=True, repr=False)
class Flight(Shown):
    """What was flown, one row a step.

    times: (N,), s. states: (N, n) of the plant, deviations. errors: (N, k), z = x - x_d, without noise.
    inputs: (N, m), deviations. disturbances: (N, k). memory: (N, l), the policy's own states. limited: (N, n), the
    states with alpha through the air in place of alpha. winds: disturbance of the model that is not 0 -> (N,).
    """

    times: np.ndarray
    states: np.ndarray
    errors: np.ndarray
    inputs: np.ndarray
    disturbances: np.ndarray
    memory: np.ndarray
    limited: np.ndarray
    winds: dict[str, np.ndarray]

    @property
    def updrafts(self) -> np.ndarray:
        """The updraft of the air, (N,)."""
        return self.winds.get(UPDRAFT, np.zeros(len(self.times)))

    @classmethod
    def joined(cls, parts: list[Flight], count: int | None = None) -> Flight:
        """One after the other; so many rows."""
        names = [each.name for each in fields(cls) if each.name != "winds"]
        whole = {name: np.concatenate([getattr(part, name) for part in parts])[:count] for name in names}
        air = {name: np.concatenate([part.winds[name] for part in parts])[:count] for name in parts[0].winds}
        return cls(**whole, winds=air)


class CompiledLoop:
    """A loop compiled once and simulated many times by the classical Runge-Kutta method of order 4.

    fastest: mode of the law, 1/s, that divides each step into as many parts as it needs; BadInputError when these are
    too many. flights: how many are to come, which decides whether machine code pays.
    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, Table II.1.2.
    """

    def __init__(self, loop: ClosedLoop, fastest: float = 0.0, flights: int = 1) -> None:
        self.loop, scenario = loop, loop.scenario
        parts = max(1, math.ceil(fastest * scenario.step / LONGEST_STEP - 1e-9))
        if parts > _MOST_PARTS:
            most = LONGEST_STEP * _MOST_PARTS / scenario.step
            raise BadInputError(
                f"the law has a mode of {fastest:.4g} 1/s; at a step of {scenario.step:g} s it must be below {most:.3g}"
                " 1/s: make the step shorter"
            )
        arguments = loop.symbols()
        now = loop.at(*arguments)
        self.rate = ca.Function("loop_rate", [*arguments], [ca.densify(now.rate)], {"cse": True})
        seen = ca.densify(ca.vertcat(now.error, now.inputs, now.disturbance, now.winds, now.angle))
        self._ends = np.cumsum([each.numel() for each in (now.error, now.inputs, now.disturbance, now.winds)]).tolist()
        self._observed = ca.Function("loop_seen", [*arguments], [seen], {"cse": True})
        self._command = ca.Function("command", [*arguments], [ca.densify(now.command)]) if scenario.delay else None
        self._alpha = list(loop.plant.model.states).index(ALPHA) if now.angle.numel() else -1  # type: ignore[attr-defined]
        tick = _tick(self.rate, self._observed, scenario.step, scenario.steps_per_tick, parts)
        whole = flights * scenario.ticks * scenario.steps_per_tick * parts
        self._tick = BoundFunction(machine_code(tick) if whole >= COMPILE_FROM_STEPS else tick)

    def blocks(self, start: np.ndarray, constants: Constants, ticks: int | None = None) -> Iterator[Flight]:
        """The rows at the beginnings of all steps, some ticks at a time, and at last that of the end.

        start: y(0). constants: tick -> p. ticks: those of the scenario unless given. Numbers may not be finite.
        """
        scenario, each = self.loop.scenario, self.loop.scenario.steps_per_tick
        ticks = scenario.ticks if ticks is None else ticks
        now, held = self._tick.inputs
        after = self._tick.results[0].reshape(each, len(now))
        seen = self._tick.results[1].reshape(each, -1)
        last, y, p, sent, tick = after[-1, 1:], start, held, list[np.ndarray](), 0
        while tick < ticks:
            count = min(max(1, _ROWS // each), ticks - tick)
            rows, observed = np.empty((count * each + 1, len(now) - 1)), np.empty((count, *seen.shape))
            rows[0], later = y, rows[1:].reshape(count, each, -1)
            for place in range(count):
                p = constants(tick)
                now[0], now[1:] = tick * each * scenario.step, y
                if self._command is not None:
                    self._hand_over(tick, now, p, sent)
                held[:] = p
                self._tick()
                later[place], observed[place] = after[:, 1:], seen
                tick, y = tick + 1, last
            yield self._flight((tick - count) * each, rows[:-1], observed.reshape(count * each, -1))
        end = np.array(self._observed(ticks * scenario.tick, y, p)).T
        yield self._flight(ticks * each, y[None].copy(), end)

    def _hand_over(self, tick: int, now: np.ndarray, p: np.ndarray, sent: list[np.ndarray]) -> None:
        """Write the commands of so many ticks ago into p, between which the loop interpolates: 0, the trim, before the
        delay has passed."""
        sent.append(np.array(self._command(now[0], now[1:], p)).ravel())  # type: ignore[misc]
        due, calm = tick - self.loop.scenario.delayed_ticks, np.zeros(self.loop.trim.size)
        early, late = (sent[due], sent[due + 1]) if due >= 0 else (calm, calm)
        p[p.size - 1 - 2 * calm.size :] = [now[0], *early, *late]

    def _flight(self, first: int, y: np.ndarray, observed: np.ndarray) -> Flight:
        """Rows y (N, n) and what was observed there, from step `first` on."""
        states, memory = self.loop.parts(y)
        errors, inputs, disturbances, winds, angle = np.split(observed, self._ends, axis=1)
        limited = states
        if self._alpha >= 0:
            limited = states.copy()
            limited[:, self._alpha] = angle[:, 0]
        times = self.loop.scenario.step * np.arange(first, first + len(y))
        air = dict(zip(self.loop.wind_names, winds.T, strict=True))
        return Flight(times, states, errors, inputs, disturbances, memory, limited, air)

    def fly(
        self,
        initial: np.ndarray,
        constants: Constants,
        *,
        memory: np.ndarray | None = None,
        ticks: int | None = None,
        stop: Callable[[Flight], np.ndarray] | None = None,
        progress: Progress | None = None,
    ) -> Flight:
        """From x(0) = `initial`, memory(0) = `memory`; constants: of the policy. ticks: those of the scenario unless
        given.

        stop: rows -> which of them end the flight, with the tick of the first one. NoSolutionError, naming the time,
        when a number is no longer finite and no `stop` asks about it.
        """
        scenario, parts, count = self.loop.scenario, list[Flight](), 0
        last, end = (scenario.ticks if ticks is None else ticks), math.inf
        for block in self.blocks(self.loop.start(initial, memory), self.loop.constants(constants), last):
            parts.append(block)
            over = ~np.isfinite(block.states).all(axis=1) if stop is None else stop(block)
            if end == math.inf and over.any():
                first = count + int(np.argmax(over))
                if stop is None:
                    raise NoSolutionError(
                        f"the flight left every bound at t = {first * scenario.step:.6g} s; the loop is unstable or the"
                        " step too long"
                    )
                end = math.ceil(first / scenario.steps_per_tick) * scenario.steps_per_tick
            count += len(block.times)
            if progress is not None:
                progress(last if end < count else count // scenario.steps_per_tick, last)
            if end < count:
                break
        return Flight.joined(parts, None if end == math.inf else int(end) + 1)


def _tick(rate: ca.Function, observed: ca.Function, step: float, count: int, parts: int) -> ca.Function:
    """([t; y], p) -> [t; y] after each of the steps of a tick, and what is observed at the beginning of each."""
    now, p, h = ca.SX.sym("now", 1 + rate.numel_in(1)), ca.SX.sym("p", rate.numel_in(2)), step / parts
    t, y = now[0], now[1:]
    k1 = rate(t, y, p)
    k2 = rate(t + h / 2, y + h / 2 * k1, p)
    k3 = rate(t + h / 2, y + h / 2 * k2, p)
    k4 = rate(t + h, y + h * k3, p)
    later = ca.vertcat(t + h, y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    seen = ca.densify(observed(t, y, p))
    x, held = ca.MX.sym("x", now.numel()), ca.MX.sym("p", p.numel())
    if parts == 1:
        one = ca.Function("step", [now, p], [ca.densify(later), seen], {"cse": True})
    else:
        whole = ca.vertcat(now, p)
        part = ca.Function("part", [whole], [ca.densify(ca.vertcat(later, p))], {"cse": True}).fold(parts)
        moved = part(ca.vertcat(x, held))[: now.numel()]
        one = ca.Function("step", [x, held], [moved, observed(x[0], x[1:], held)])
    many = one.mapaccum("steps", count)
    return ca.Function("tick", [x, held], list(many(x, ca.repmat(held, 1, count))))


class Summary(NamedTuple):
    """What is kept of a flight of T seconds, n states, k of the linear model, m inputs.

    left: index of the state that left the envelope first, -1 when none did; of alpha, through the air.
    flown: T, s, up to the first step outside. rms_error: sqrt(1/T ∫ z² dt), (k,), of the true error, without noise.
    peak_error: max |z|, (k,), over ground. peak_angle_of_attack: max |α_a - α0|, rad, through the air, from trim; 0 of
    a model without alpha. effort: sqrt(1/T ∫ u² dt), (m,), of each input's deviation from trim. lowest_input,
    highest_input: min U and max U, (m,), absolute. final: x at the end, (n,), a deviation from trim. memory: the
    policy's own states at the end. cycle: the input or state that still oscillates at the end, -1 when none does.
    """

    left: int
    flown: float
    rms_error: np.ndarray
    peak_error: np.ndarray
    peak_angle_of_attack: float
    effort: np.ndarray
    lowest_input: np.ndarray
    highest_input: np.ndarray
    final: np.ndarray
    memory: np.ndarray
    cycle: int


class SummedLoop:
    """A law on a plant about a trim, whose flights are summed up: the members of a Monte Carlo, the points of a map.

    scenario: one of the flights, which differ in numbers alone. flights: how many are to come.
    """

    def __init__(
        self, plant: Plant, point: OperatingPoint, law: FlownLaw, scenario: Scenario, envelope: Envelope, flights: int
    ) -> None:
        self._plant, self._law, self._envelope = plant, law, envelope
        self._states, self._inputs = np.array(point.states), np.array(point.inputs)
        self._compiled = CompiledLoop(self._loop(scenario), law.fastest, flights)

    def _loop(self, scenario: Scenario) -> ClosedLoop:
        return ClosedLoop(self._plant, self._law.policy, scenario, self._inputs)

    def rate(self, states: np.ndarray, scenario: Scenario) -> np.ndarray:
        """x' at t = 0, (n,), of deviations x."""
        loop = self._loop(scenario)
        p = loop.constants(self._law.constants)(0)
        return np.array(self._compiled.rate(0.0, loop.start(states, self._law.memory), p)).ravel()[: len(states)]

    def fly(
        self,
        scenario: Scenario,
        of_plant: np.ndarray | None = None,
        lost: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> Summary:
        """One flight; of_plant: constants of the plant.

        It ends at the first step outside the envelope. With `lost`, states (N, n) -> (N,), only its sums end there, and
        it goes on to the first tick that is lost.
        """
        loop, law, moving = self._loop(scenario), self._law, scenario.moving_air
        (n, k, m), step, steps = self._plant.sizes, scenario.step, scenario.ticks * scenario.steps_per_tick
        squares, peak, efforts, angle = np.zeros(k), np.zeros(k), np.zeros(m), 0.0
        lowest, highest, left, flown = np.full(m, np.inf), np.full(m, -np.inf), -1, scenario.duration
        names, watched = limited_names(self._envelope.model, moving), list[Flight]()
        settles = lost is None and not isinstance(law.policy, OpenLoop) and not is_driven(scenario, flown / 2)
        alpha = list(self._envelope.model.states).index(ALPHA) if ALPHA in self._envelope.model.states else None
        constants = loop.constants(law.constants, np.zeros(0) if of_plant is None else of_plant)
        final, memory = np.zeros(n), law.memory
        for block in self._compiled.blocks(loop.start(scenario.initial, law.memory), constants):
            final, memory = block.states[-1], block.memory[-1]
            if left < 0:
                gone = self._envelope.departure(block.times, block.limited + self._states, moving)
                count = len(block.times)
                if gone is not None:
                    left, flown, count = names.index(gone.state), gone.time, int(np.argmax(block.times >= gone.time))
                    final, memory = block.states[count], block.memory[count]
                counted = slice(min(count, steps - round(block.times[0] / step)))  # the last row begins no step
                z, u = block.errors[counted], block.inputs[counted]
                squares, efforts = (a + step * np.einsum("ij,ij->j", x, x) for a, x in ((squares, z), (efforts, u)))
                peak = np.fmax(peak, np.abs(z).max(axis=0, initial=0.0))
                lowest = np.fmin(lowest, u.min(axis=0, initial=np.inf))
                highest = np.fmax(highest, u.max(axis=0, initial=-np.inf))
                if alpha is not None:
                    angle = max(angle, float(np.abs(block.limited[counted, alpha]).max(initial=0.0)))
                if settles and block.times[-1] >= scenario.duration / 2:
                    watched.append(block)
            if lost is None and left >= 0:
                break
            if lost is not None and (over := lost(block.states[:: scenario.steps_per_tick])).any():
                final = block.states[:: scenario.steps_per_tick][int(np.argmax(over))]
                break
        cycle = limit_cycle(self._envelope.model, scenario, Flight.joined(watched)) if settles and left < 0 else None
        among = (*self._envelope.model.inputs, *self._envelope.model.states)
        lasted = flown or 1.0  # turbulence may be outside at the start: the sums are 0
        return Summary(
            left,
            flown,
            np.sqrt(squares / lasted),
            peak,
            angle,
            np.sqrt(efforts / lasted),
            lowest + self._inputs,
            highest + self._inputs,
            final,
            memory,
            -1 if cycle is None else among.index(cycle.name),
        )
