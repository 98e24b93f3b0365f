"""The closed loop in double precision, at many states at once. No proof depends on the values."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import cached_property

import casadi as ca
import numpy as np

from hfa_aircraft.march.ending import FAR
from hfa_prove.enclosure.program import Program
from hfa_prove.enclosure.slopes import Intervals, jacobian, values_at
from hfa_prove.search.clock import Clock
from hfa_prove.statements.loop import Gain, Loop
from hfa_support.native.bound import RowFunction

#: Number of operations of a loop above which fewer samples are used.
_OPERATIONS = 6000


class LoopValues:
    """A closed loop at deviations z of its states from an equilibrium.

    loop: the closed loop with its limits
    x: states at the equilibrium, (n,)
    clock: called at each evaluation of the rates, or None. It may raise OutOfTimeError.
    """

    def __init__(self, loop: Loop, x: np.ndarray, clock: Clock | None = None) -> None:
        self.loop = loop
        self._clock = clock
        self._x = x
        states = ca.SX.sym("x", len(loop.states))
        rates, outputs = loop.rates(states)
        self._function = ca.Function("values", [states], [ca.vertcat(rates, outputs)])
        #: Share of the usual number of samples; below 1 for a loop with many operations.
        self.share = min(1.0, _OPERATIONS / self._function.n_instructions())

    @cached_property
    def _program(self) -> Program:
        """Program x -> rates and limited outputs, which evaluates networks as matrix products."""
        return Program(self._function, self.loop.model.name)

    @cached_property
    def _rows(self) -> RowFunction:
        return RowFunction(self._function)

    def _values(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rates (N, n) and the limited outputs (N, p) at states x (N, n)."""
        is_network = not isinstance(self.loop.policy, Gain)
        values = values_at(self._program, x) if is_network else self._rows(x)[0]
        n = x.shape[1]
        return values[:, :n], values[:, n:]

    @cached_property
    def J(self) -> np.ndarray:
        """Jacobian of the rates at the equilibrium, (n, n)."""
        at = Intervals(self._x, np.zeros_like(self._x))
        return jacobian(self._program, at).slopes.middle[: len(self._x)]

    @property
    def nominal(self) -> np.ndarray:
        """Nominal values of the moving states, (n,)."""
        return self.loop.nominal

    def rates(self, z: np.ndarray) -> np.ndarray:
        """Return z' (N, n) at state deviations z (N, n)."""
        if self._clock is not None:
            self._clock(0.0, 1.0, "samples of V'")
        return self._values(z + self._x)[0]

    @cached_property
    def limited(self) -> tuple[str, ...]:
        """Names of the moving states and outputs that have limits."""
        loop = self.loop
        return tuple(name for name in (*loop.states, *loop.model.outputs) if name in loop.limits)

    def _signals(self, z: np.ndarray) -> np.ndarray:
        """Return the values (N, k) of the signals `limited` at state deviations z (N, n)."""
        x = z + self._x
        has_limits = [name in self.loop.limits for name in self.loop.states]
        outputs = self._values(x)[1] if self.loop.limited_outputs else x[:, :0]
        return np.hstack([x[:, has_limits], outputs])

    def beyond(self, z: np.ndarray) -> np.ndarray:
        """Return the mask (N,) of deviations z (N, n) beyond a limit of a state or output."""
        signals = self._signals(z)
        low, high = self.loop.ends(self.limited).T
        return ~np.all((signals >= low) & (signals <= high), axis=1)

    def away(self, z: np.ndarray) -> np.ndarray:
        """Return the mask (N,) of deviations z (N, n) beyond a limit or `FAR` nominal values.

        Deviations that are not finite are included.
        """
        return self.beyond(z) | ~np.all(np.abs(z) <= FAR * self.nominal, axis=1)


class DisturbedValues(LoopValues):
    """A closed loop under the extreme disturbance that increases V fastest at each state.

    loop: the closed loop with its disturbances
    x: states at the equilibrium without disturbance, (n,)
    gradients: deviations z (N, n) -> ∂V/∂z (N, n)
    """

    def __init__(
        self, loop: Loop, x: np.ndarray, gradients: Callable[[np.ndarray], np.ndarray]
    ) -> None:
        super().__init__(loop, x)
        self._gradients = gradients

    @cached_property
    def _disturbed(self) -> RowFunction:
        """Function x -> rates for every combination of extreme disturbances, one after another."""
        x = ca.SX.sym("x", len(self._x))
        ends = itertools.product(*((-size, size) for size in self.loop.disturbances.values()))
        rates = [self.loop.disturbed_rates(x, each)[0] for each in ends]
        return RowFunction(ca.Function("disturbed", [x], [ca.densify(ca.vertcat(*rates))]))

    def rates(self, z: np.ndarray) -> np.ndarray:
        """Return z' (N, n) at state deviations z (N, n) under the worst extreme disturbance."""
        each = self._disturbed(z + self._x)[0].reshape(len(z), -1, z.shape[1])
        rises = np.einsum("kvn,kn->kv", each, self._gradients(z))
        return np.asarray(each[np.arange(len(z)), np.argmax(rises, axis=1)])
