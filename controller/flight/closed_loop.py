"""Plant, policy, actuators, signals and gust as one loop y' = f(t, y, p).

Only this module knows how the loop is laid out:

    y = [x; actuators; memory of the policy; filter of the gust],
    p = [the plant's; the actuators'; the policy's; noise samples; the gust's].
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.flight.actuators import Actuators
from controller.flight.gusts import Gust
from controller.flight.integrator import Constants
from controller.flight.plants import Plant
from controller.policy.policies import Policy, Seen
from controller.policy.signals import TimeVector, zero
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.errors import BadInputError

_NOTHING = np.zeros(0)
_Z = len(LINEAR_STATES)
_NO_SIGNAL = zero(_Z)


class Expressions(NamedTuple):
    """A loop at (t, y, p): y' and what is seen of it; error z without noise, inputs u, disturbance d, updraft w."""

    rate: ca.SX
    error: ca.SX
    inputs: ca.SX
    disturbance: ca.SX
    updraft: ca.SX


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """x' = plant(x, a, d(t), w(t)),  a' = actuators(a, u),  u = policy(t, x + n(t) - x_d(t)); a = u without actuators.

    reference x_d, disturbance d, noise n: (6,) signals of the states of the linear model, 0 by default. gust: w, none
    by default. samples: (ticks, 6), noise besides n that is held in each tick, none by default. actuators: about the
    inputs U0 (5,) of the trim. tick: s, at which the actuators' faults are looked up.
    """

    plant: Plant
    policy: Policy
    reference: TimeVector = _NO_SIGNAL
    disturbance: TimeVector = _NO_SIGNAL
    noise: TimeVector = _NO_SIGNAL
    gust: Gust | None = None
    samples: np.ndarray | None = None
    actuators: Actuators | None = None
    trim: np.ndarray = field(default_factory=lambda: np.zeros(len(INPUTS)))
    tick: float = 0.0

    def __post_init__(self) -> None:
        """Every signal has six channels, and the actuators hold the trim."""
        if self.actuators is not None:
            self.actuators.refuse_trim(self.trim)
        for name in ("reference", "disturbance", "noise"):
            size = getattr(self, name).size
            if size != _Z:
                raise BadInputError(f"the {name} has {size} channels; it must have {_Z}")

    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """t, y and p to write the loop out in."""
        return ca.SX.sym("t"), ca.SX.sym("y", sum(self._y_sizes)), ca.SX.sym("p", sum(self._p_sizes))

    def at(self, t: ca.SX, y: ca.SX, p: ca.SX) -> Expressions:
        """The loop written out at CasADi expressions."""
        x, moved, memory, air = ca.vertsplit(y, [0, *np.cumsum(self._y_sizes).tolist()])
        of_plant, of_actuators, of_policy, sample, of_air = ca.vertsplit(p, [0, *np.cumsum(self._p_sizes).tolist()])
        error, noise = self.plant.seen(x) - self.reference.at(t), self.noise.at(t)
        if self.samples is not None:
            noise = noise + sample
        actuators = self.actuators
        position, speed = ca.SX(0, 1), ca.SX(0, 1)
        if actuators is not None:
            position, speed = actuators.position(moved, self.trim), actuators.rates(moved)
        updraft = self.updraft(t, y, p)
        moving_air = ca.SX(0, 1) if self.gust is None else ca.SX(updraft)
        seen = Seen(error + noise, self.plant.seen(x) + noise, position, speed, moving_air)
        command = self.policy.control(t, seen, memory, of_policy)
        reachable = command if actuators is None else actuators.reachable(command, self.trim)
        u = command if actuators is None else position
        rates = [self.policy.memory_rate(t, seen, memory, of_policy, reachable)]
        if actuators is not None:
            rates.insert(0, actuators.states_rate(moved, reachable, of_actuators))
        d = self.disturbance.at(t)
        if self.gust is not None:
            rates.append(self.gust.memory_rate(t, air, of_air))
        rate_of_plant = self.plant.rate(x, u, d, updraft, of_plant)
        return Expressions(ca.vertcat(rate_of_plant, *rates), error, u, d, ca.SX(updraft))

    def updraft(self, t: ca.SX, y: ca.SX, p: ca.SX) -> ca.SX | float:
        """w, ft/s; the number 0.0 in still air."""
        if self.gust is None:
            return 0.0
        return ca.SX(self.gust.updraft(t, y[sum(self._y_sizes[:-1]) :], p[sum(self._p_sizes[:-1]) :]))

    def start(self, initial: np.ndarray, memory: np.ndarray | None = None) -> np.ndarray:
        """y(0) for x(0) = `initial`, actuators at trim; memory: of the policy at the start, 0 unless given."""
        n, moved, k, _ = self._y_sizes
        own = np.zeros(k) if memory is None else memory
        if (np.shape(initial), np.shape(own)) != ((n,), (k,)):
            raise BadInputError(
                f"the flight starts with {np.size(initial) + np.size(own)} numbers; plant and policy have {n} and {k}"
            )
        return np.concatenate([initial, np.zeros(moved), own, _NOTHING if self.gust is None else self.gust.start()])

    def constants(self, of_policy: Constants, of_plant: np.ndarray = _NOTHING) -> Constants:
        """Tick -> p, in an array that the next call overwrites."""
        a, b, c, d, size = np.cumsum(self._p_sizes).tolist()
        p = np.zeros(size)
        p[:a] = of_plant

        def every(tick: int) -> np.ndarray:
            if self.actuators is not None:
                p[a:b] = self.actuators.constants(tick * self.tick)
            p[b:c] = of_policy(tick)
            if self.samples is not None:
                p[c:d] = self.samples[tick]
            if self.gust is not None:
                p[d:] = self.gust.constants(tick)
            return p

        return every

    def parts(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x and the memory of the policy in y (..., n)."""
        n, moved, k, _ = self._y_sizes
        return y[..., :n], y[..., n + moved : n + moved + k]

    @property
    def _y_sizes(self) -> tuple[int, int, int, int]:
        moved = 0 if self.actuators is None else self.actuators.size
        air = 0 if self.gust is None else self.gust.memory_size
        return len(self.plant.states), moved, self.policy.memory_size, air

    @property
    def _p_sizes(self) -> tuple[int, int, int, int, int]:
        moved = 0 if self.actuators is None else self.actuators.constants_size
        noise = _Z if self.samples is not None else 0
        air = 0 if self.gust is None else self.gust.constants_size
        return self.plant.constants_size, moved, self.policy.constants_size, noise, air
