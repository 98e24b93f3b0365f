"""The saturated loop in double precision.

The module computes rates at many states at once, samples and simulations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.march.ending import FAR, FAR_OF_STARTS, EndRule, Outcome, is_at_rest
from hfa_aircraft.march.march import Rows, march, saturated
from hfa_prove.fields import Terms
from hfa_prove.search.obstacles import ValueOf
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.plant import model_limits
from hfa_support.errors import NoSolutionError
from hfa_support.native.bound import RowFunction
from trim.linear.linear_model import LinearModel

#: Simulation steps in the time constant of the fastest mode.
_STEPS = 3.0


def saturated_loop(
    linear: LinearModel, K: np.ndarray, policy: Mapping[str, Terms] | None = None
) -> Loop:
    """Return the closed loop of a polynomial policy about the trim of a linear model.

    K: gain of the linear part of the policy, (m, n)
    policy: input -> terms of the nonlinear part of the policy
    """
    model = linear.point.model
    states = {name: float(value) for name, value in linear.point.states._asdict().items()}
    parameters = {name: signal.start for name, signal in model.parameters.items()}
    held = {name: value for name, value in states.items() if name not in model.linear}
    return Loop(
        model,
        parameters,
        {name: states[name] for name in model.linear},
        {name: float(value) for name, value in linear.point.inputs._asdict().items()},
        held,
        model_limits(model, states, parameters),
        Gain(np.array(K, dtype=float), policy or {}),
    )


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

    def rises(self, slope: ValueOf) -> ValueOf:
        """Return the function z (N, n) -> mask (N,) of the points with V' >= 0 or undefined V'.

        slope: z (N, n) -> gradients (N, n) of V
        """

        def rising(z: np.ndarray) -> np.ndarray:
            with np.errstate(all="ignore"):
                falls = np.sum(slope(z) * self.rates(z), axis=1) < 0.0
            return np.asarray(~falls)

        return rising

    @cached_property
    def closed_matrix(self) -> np.ndarray:
        """Matrix A - B K (n, n) of the linear loop at the trim."""
        _, A, B = self._function(np.zeros(len(self.loop.states)))
        return np.array(A) - np.array(B) @ self.loop.gain.K


#: Descriptions of flights that do not enter the proved set.
NOT_RETURNED = {
    Outcome.LEFT: "flight leaves the limits",
    Outcome.DIVERGED: "flight does not converge",
    Outcome.UNDECIDED: "flight undecided within the time",
}


def outcomes(
    plant: Plant, starts: np.ndarray, holds: Callable[[np.ndarray], np.ndarray], seconds: float
) -> np.ndarray:
    """Return the `Outcome` of a simulation from each initial condition, (N,).

    Outcomes are tested at every step of the classical Runge-Kutta method. A trajectory diverges if
    a state is not finite, or exceeds both `FAR` nominal values and `FAR_OF_STARTS` times the
    largest initial deviation. A trajectory that is nearly at rest after `seconds` has converged to
    another equilibrium.

    starts: initial deviations from the trim, (N, n)
    holds: deviations (N, n) -> mask (N,) of those in the proved set
    seconds: longest duration of each simulation, s
    """
    largest = np.max(np.abs(starts), axis=0, initial=0.0)
    far = np.maximum(FAR * plant.nominal, FAR_OF_STARTS * largest)
    fastest = float(np.max(np.abs(np.linalg.eigvals(plant.closed_matrix))))
    step = 1.0 / (_STEPS * fastest)
    rule = EndRule(far, lambda z: ~plant.beyond(z), holds)
    loop = Rows(lambda z, _: plant.rates(z), starts, step)
    ticks = int(np.ceil(seconds / step)) + 1
    with np.errstate(all="ignore"):  # diverging states overflow
        flown, _ = march(loop, ticks, over=rule.over, keep=False)
        final = flown.states[:, 0]
        result = rule.outcomes(final)
        rests = is_at_rest(plant.rates(final), seconds, plant.nominal)
    result[rests & (result == Outcome.UNDECIDED)] = Outcome.ELSEWHERE
    return result


def refuse_unstable(J: np.ndarray) -> None:
    """Raise NoSolutionError unless every eigenvalue of J (n, n) has a negative real part.

    J: linearization of the loop
    """
    modes = np.linalg.eigvals(J)
    if not np.all(modes.real < 0.0):
        raise NoSolutionError(
            "the loop's linearization is not Hurwitz (largest real part of an eigenvalue: "
            f"{modes.real.max():.3g}); only equilibria with a stable linearization are supported"
        )
