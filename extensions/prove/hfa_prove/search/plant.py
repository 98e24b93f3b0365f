"""The saturated loop in double precision.

The module computes rates at many states at once, samples and simulations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.march.ending import FAR
from hfa_aircraft.march.march import saturated
from hfa_prove.statements.loop import Loop
from hfa_support.native.bound import RowFunction

#: Simulation steps in the time constant of the fastest mode.
_STEPS = 3.0


@dataclass(frozen=True, eq=False)
class Plant:
    """Evaluation of the closed loop at deviations z of the states from its trim.

    loop: the closed loop with its limits
    """

    loop: Loop

    @cached_property
    def nominal(self) -> np.ndarray:
        """Nominal values of the moving states, (n,)."""
        signals = self.loop.model.signals
        return np.array([signals[name].nominal for name in self.loop.states])

    @cached_property
    def input_ends(self) -> np.ndarray:
        """Lowest and highest permitted deviation of each input from the trim, (m, 2)."""
        pairs = [self.loop.limits.get(name, (-np.inf, np.inf)) for name in self.loop.inputs]
        at = np.array(list(self.loop.inputs.values()))
        return np.array(pairs).reshape(-1, 2) - at[:, None]

    @cached_property
    def limited(self) -> tuple[str, ...]:
        """Names of the moving states and outputs that have limits."""
        loop = self.loop
        return tuple(name for name in (*loop.states, *loop.model.outputs) if name in loop.limits)

    def limited_signals(self, z: np.ndarray) -> dict[str, tuple[np.ndarray, float, float]]:
        """Return limited state or output -> deviations (N,) at z (N, n), lowest and highest one.

        Outputs are linearized at the trim.
        """
        values = z @ self.limited_rows.T
        ends = self.permitted_deviations.tolist()
        return {
            name: (values[:, i], low, high)
            for i, (name, (low, high)) in enumerate(zip(self.limited, ends, strict=True))
        }

    @cached_property
    def limited_rows(self) -> np.ndarray:
        """Gradients (k, n) in z of the signals `limited`, at the trim."""
        rows = np.vstack([np.eye(len(self.loop.states)), self._outputs[1]])
        return np.asarray(rows[[self._signals.index(name) for name in self.limited]])

    @cached_property
    def permitted_deviations(self) -> np.ndarray:
        """Lowest and highest permitted deviation of each signal in `limited`, (k, 2)."""
        at = dict(zip(self._signals, (*self.loop.trim.values(), *self._outputs[0]), strict=True))
        pairs = [np.array(self.loop.limits[name]) - at[name] for name in self.limited]
        return np.array(pairs).reshape(-1, 2)

    @property
    def _signals(self) -> list[str]:
        return [*self.loop.states, *self.loop.model.outputs]

    @cached_property
    def _outputs(self) -> tuple[np.ndarray, np.ndarray]:
        """Values (p,) of all outputs at the trim, and their Jacobian (p, n) in z.

        The inputs follow the policy without saturation.
        """
        z, v, states, inputs = self._symbols()
        names = tuple(self.loop.model.outputs)
        parameters = list(self.loop.parameters.values())
        _, y = self.loop.model.layout.expressions((states, inputs, parameters), names)
        if not names:
            return np.zeros(0), np.zeros((0, z.numel()))
        closed = ca.substitute(y, v, self.command(z))
        function = ca.Function("outputs", [z], [closed, ca.jacobian(closed, z)])
        values, slopes = function(np.zeros(z.numel()))
        return np.array(values).ravel(), np.array(slopes)

    def _symbols(self) -> tuple[ca.SX, ca.SX, list[Any], list[Any]]:
        """Return symbols of z and of the input deviations, and all states and inputs.

        The states and inputs are expressions in these symbols.
        """
        loop = self.loop
        z = ca.SX.sym("z", len(loop.states))
        v = ca.SX.sym("v", len(loop.inputs))
        moving = zip(loop.trim.items(), ca.vertsplit(z), strict=True)
        values = dict(loop.held) | {name: at + part for (name, at), part in moving}
        states = [values[name] for name in loop.model.states]
        parts = zip(loop.inputs.values(), ca.vertsplit(v), strict=True)
        return z, v, states, [at + part for at, part in parts]

    def command(self, z: ca.SX) -> ca.SX:
        """Return the deviation u - u0 (m,) that the policy commands at z, before saturation."""
        curved = ca.SX.zeros(len(self.loop.inputs))
        for index, name in enumerate(self.loop.inputs):
            for coefficient, exponents in self.loop.gain.terms.get(name, ()):
                powers = [z[i] ** power for i, power in enumerate(exponents) if power]
                curved[index] += coefficient * prod(powers)
        return curved - ca.DM(self.loop.gain.K) @ z

    def saturated(self, command: ca.SX) -> ca.SX:
        """Return a command u - u0 (m,) limited such that the inputs are within their limits."""
        low = ca.DM(self.input_ends[:, 0])
        high = ca.DM(self.input_ends[:, 1])
        return saturated(command, low, high)

    @cached_property
    def _function(self) -> ca.Function:
        loop = self.loop
        z, v, states, inputs = self._symbols()
        parameters = list(loop.parameters.values())
        f, _ = loop.model.layout.expressions((states, inputs, parameters), ())
        rows = [list(loop.model.states).index(name) for name in loop.states]
        f = f[rows]
        command = self.command(z)
        held = self.saturated(command)
        closed = ca.substitute(f, v, held)
        slopes = [ca.substitute(ca.jacobian(f, part), v, command) for part in (z, v)]
        return ca.Function("loop", [z], [closed, *slopes])

    @cached_property
    def _rates(self) -> RowFunction:
        z = ca.SX.sym("z", len(self.loop.states))
        return RowFunction(ca.Function("rates", [z], [ca.densify(self._function(z)[0])]))

    def beyond(self, z: np.ndarray) -> np.ndarray:
        """Return the mask (N,) of deviations z (N, n) beyond a limit of a state or output.

        Outputs are linearized at the trim.
        """
        signals = z @ self.limited_rows.T
        low, high = self.permitted_deviations.T
        return ~np.all((signals >= low) & (signals <= high), axis=1)

    def away(self, z: np.ndarray) -> np.ndarray:
        """Return the mask (N,) of deviations z (N, n) beyond a limit or `FAR` nominal values.

        Deviations that are not finite are included.
        """
        return self.beyond(z) | ~np.all(np.abs(z) <= FAR * self.nominal, axis=1)

    def rates(self, z: np.ndarray) -> np.ndarray:
        """Return z' (N, n) at state deviations z (N, n)."""
        return self._rates(z)[0]

    @cached_property
    def J(self) -> np.ndarray:
        """Matrix A - B K (n, n) of the linear loop at the trim."""
        _, A, B = self._function(np.zeros(len(self.loop.states)))
        return np.array(A) - np.array(B) @ self.loop.gain.K
