"""Equilibrium of the sampled loop.

The equilibrium (X, U) satisfies f(X, U) = f(X0, U0) in the linear states and U = command(X, U).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_support.matrices import spectral_radius
from hfa_support.reporting.results import Matrix
from trim.linear.kinks import linearization_at
from trim.point.operating_point import OperatingPoint

_MOST_STEPS = 60
_MOST_HALVES = 30
#: Residual, in nominal rates, below which a point counts as an equilibrium.
_STEADY = 1e-9


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Equilibrium of the sampled loop and its linearization.

    u are the commanded inputs, x the linear states.

    states: X, (n,). States outside the linear model have their trim values.
    inputs: U, (m,).
    K: (m', k), -∂u/∂x.
    K_inputs: (m', m'), ∂u/∂u_before, with respect to the previous inputs.
    A: (k, k), of the aircraft.
    B: (k, m'), of the aircraft.
    clips: descriptions of saturated actions and inputs.
    clipped_observations: names of the observations that the normalizer clips.
    """

    states: np.ndarray
    inputs: np.ndarray
    K: Matrix
    K_inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    clips: tuple[str, ...] = ()
    clipped_observations: tuple[str, ...] = ()

    @property
    def gain(self) -> Matrix | None:
        """Gain (I - K_inputs)⁻¹ K of u = -gain x once the commands follow the state, (m', k).

        None for a policy whose inputs do not settle at a constant state, such as an integrator.
        """
        if not spectral_radius(self.K_inputs) < 1.0:
            return None
        return np.linalg.solve(np.eye(len(self.K_inputs)) - self.K_inputs, self.K)


class EquilibriumSearch:
    """Search for the equilibrium at one trim, in linear states and commanded inputs.

    At the equilibrium, the linear states have the same rates as at the trim.
    """

    def __init__(self, deployed: Deployed, point: OperatingPoint) -> None:
        self.deployed = deployed
        self.point = point
        model = point.model
        self.model = model
        self.trim = deployed.trim_vector(point)
        self.rows = model.state_places(model.linear)
        self.columns = model.input_places(deployed.commanded)
        self.base = np.concatenate([point.states, point.inputs])
        self.moving = [*self.rows, *(len(model.states) + column for column in self.columns)]
        rate_scales = [model.rate_scale(name) for name in model.linear]
        input_scales = [model.inputs[name].nominal for name in deployed.commanded]
        state_scales = [model.states[name].nominal for name in model.linear]
        self.residual_scales = np.array([*rate_scales, *input_scales])
        self.scales = np.array([*state_scales, *input_scales])
        self.steady = model.at(point.states, point.inputs).f[self.rows]

    def at_trim(self) -> Equilibrium:
        """Return the linearization at the trim, which need not be an equilibrium."""
        return self._found(self.base)

    def _moved(self, z: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Return the point after scaled steps of the moving entries."""
        moved = z.copy()
        moved[self.moving] += steps * self.scales
        return moved

    def _scaled_system(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the scaled residual and its Jacobian with respect to scaled steps."""
        residual, jacobian = self._system(z)
        scaled = jacobian * self.scales / self.residual_scales[:, None]
        return residual / self.residual_scales, scaled

    def equilibrium(self) -> Equilibrium | None:
        """Return the equilibrium that Newton's method finds from the trim, or None."""
        z = self.base
        residual, jacobian = self._scaled_system(z)
        size = _finite_norm(residual)
        for _ in range(_MOST_STEPS):
            if size <= _STEADY * 1e-3 or not (np.isfinite(size) and np.isfinite(jacobian).all()):
                break
            step = np.linalg.lstsq(jacobian, -residual, rcond=1e-12)[0]
            for _ in range(_MOST_HALVES):
                trial = self._moved(z, step)
                following, slopes = self._scaled_system(trial)
                if _finite_norm(following) < size:
                    break
                step = step / 2.0
            else:
                break
            z, residual, jacobian = trial, following, slopes
            size = _finite_norm(residual)
        return self._found(z) if size <= _STEADY else None

    def _parts(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        n = len(self.model.states)
        return z[:n], z[n:]

    def _slopes(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the commanded inputs (m',) and their slopes (m', k) and (m', m')."""
        X, U = self._parts(z)
        commanded, by_states, by_inputs = self.deployed.command_slopes(X, U, self.trim)
        u = np.array(commanded).ravel()[self.columns]
        by_linear = np.array(by_states)[np.ix_(self.columns, self.rows)]
        return u, by_linear, np.array(by_inputs)[np.ix_(self.columns, self.columns)]

    def _system(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residual (k + m',) of the equilibrium conditions and its Jacobian."""
        X, U = self._parts(z)
        count = len(self.moving)
        try:
            plant = self.model.at(X, U)
        except FloatingPointError:
            return np.full(count, np.nan), np.full((count, count), np.nan)
        u, by_states, by_inputs = self._slopes(z)
        residual = np.concatenate([plant.f[self.rows] - self.steady, U[self.columns] - u])
        A = plant.A[np.ix_(self.rows, self.rows)]
        B = plant.B[np.ix_(self.rows, self.columns)]
        lower = np.hstack([-by_states, np.eye(len(self.columns)) - by_inputs])
        return residual, np.vstack([np.hstack([A, B]), lower])

    def _found(self, z: np.ndarray) -> Equilibrium:
        X, U = self._parts(z)
        plant, _ = linearization_at(self.model, X, U)
        _, by_states, by_inputs = self._slopes(z)
        return Equilibrium(
            states=X,
            inputs=U,
            K=-by_states,
            K_inputs=by_inputs,
            A=plant.A[np.ix_(self.rows, self.rows)],
            B=plant.B[np.ix_(self.rows, self.columns)],
            clips=self._clips(X, U),
            clipped_observations=self._clipped_observations(X, U),
        )

    def _clips(self, X: np.ndarray, U: np.ndarray) -> tuple[str, ...]:
        """Return descriptions of the actions and inputs that are saturated at given X and U."""
        deployed = self.deployed
        observation = self._observed(X, U)
        _, raw, action = (np.array(part).ravel() for part in deployed.stages(observation))
        low, high = deployed.deployment.box
        words = []
        if not deployed.deployment.actor.stated.action.squash:
            at_ends = ((raw <= low) | (raw >= high)).tolist()
            for name, is_at_end in zip(deployed.commanded, at_ends, strict=True):
                if is_at_end:
                    words.append(f"the action of {name} at the end of its box")
        unlimited = np.array(deployed.unlimited_inputs(action, X, U, self.trim)).ravel()
        limits = Limits.of(self.model, tuple(self.model.inputs))
        is_limited = limits.at_lowest(unlimited) | limits.at_highest(unlimited)
        for name, column in zip(deployed.commanded, self.columns, strict=True):
            if is_limited[column]:
                words.append(f"{name} at its limit")
        return tuple(words)

    def _clipped_observations(self, X: np.ndarray, U: np.ndarray) -> tuple[str, ...]:
        normalizer = self.deployed.deployment.normalizer
        if normalizer is None:
            return ()
        normal = np.array(self.deployed.stages(self._observed(X, U))[0]).ravel()
        names = [*self.deployed.deployment.observation]
        clipped = np.flatnonzero(np.abs(normal) >= normalizer.clip).tolist()
        return tuple(dict.fromkeys(names[number] for number in clipped))

    def _observed(self, X: np.ndarray, U: np.ndarray) -> np.ndarray:
        """Return the inputs of the policy at X and U."""
        return np.array(self.deployed.observe(X, U, self.trim)).ravel()


def _finite_norm(values: np.ndarray) -> float:
    """Return the norm of a vector, inf if it is not a finite number."""
    norm = float(np.linalg.norm(values))
    return norm if np.isfinite(norm) else np.inf
