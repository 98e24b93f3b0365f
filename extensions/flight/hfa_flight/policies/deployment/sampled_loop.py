"""Exact sampled loop at an equilibrium, with held inputs and delayed commands.

For a delay of d samples plus a fraction f of a sample, the state is
s = (x_k; u_{k-1}; ...; u_{k-d-1}), and

    x_{k+1} = Φ x_k + Γ_late u_{k-d} + Γ_early u_{k-d-1},    u_k = -K x_k + K_inputs u_{k-d-1}.

Γ_early acts during the first f dt of a sample and Γ_late during the remainder. u_{k-d-1} is the
input just before the sample. Source: Franklin, Powell and Workman, Digital Control of Dynamic
Systems, Section 4.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Slope, slope_at_trim
from controller.critic.features import symbols_for
from hfa_aircraft.limits import Limits
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_support.errors import BadInputError
from hfa_support.matrices import balanced
from hfa_support.reporting.results import Matrix
from trim.linear.delays import Chain, chain_of
from trim.linear.frequency_response import System, in_continuous_time
from trim.linear.margins import ClosedLoop, DiskMargin, LoopMargin, disk_of, single_margin
from trim.linear.nonsmooth import linearization_at
from trim.point.operating_point import OperatingPoint

#: Largest numbers of Newton steps of a search, and of halvings of a step.
_MOST_STEPS = 60
_MOST_HALVINGS = 30
#: Residual, in nominal rates, below which a point counts as an equilibrium.
_STEADY = 1e-9


class NominalLoop(NamedTuple):
    """Linear aircraft x' = A x + B u with the sampled policy u = -K x + K_inputs u_before.

    x are deviations of the linear states and u of the commanded inputs, each in nominal values;
    u_before are the inputs just before the sample.

    A: (k, k), 1/s.
    B: (k, m'), 1/s.
    K: (m', k).
    K_inputs: (m', m').
    """

    A: np.ndarray
    B: np.ndarray
    K: np.ndarray
    K_inputs: np.ndarray


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Equilibrium of the sampled loop and its linearization.

    states: X, (n,). States outside the linear model have their trim values.
    inputs: U, (m,).
    K: (m', k), -∂u/∂x of the commanded inputs u and the linear states x; at a kink, where u has no
        slope, the mean of its sides (`is_nonsmooth`), as of a critic.
    nominal: the linearization in nominal values.
    clips: descriptions of saturated actions and inputs.
    clipped_observations: names of the observations that the normalizer clips.
    """

    states: np.ndarray
    inputs: np.ndarray
    K: Matrix
    nominal: NominalLoop
    clips: tuple[str, ...] = ()
    clipped_observations: tuple[str, ...] = ()
    is_nonsmooth: bool = False


class _Residual(NamedTuple):
    """Residual of the equilibrium conditions at a point z = (X; U), in nominal rates and inputs.

    z: (n + m,)
    values: (k + m',), rates of the linear states beside those at the trim, and inputs beside the
        commanded ones.
    """

    z: np.ndarray
    values: np.ndarray

    @property
    def size(self) -> float:
        """Norm of the residual, inf if it is not a finite number."""
        norm = float(np.linalg.norm(self.values))
        return norm if math.isfinite(norm) else math.inf


class EquilibriumSearch:
    """Search for the equilibrium at one trim, in linear states and commanded inputs.

    At the equilibrium, the linear states have the same rates as at the trim.
    """

    def __init__(self, deployed: Deployed, point: OperatingPoint) -> None:
        """Prepare the search for a deployment at a trim."""
        self.deployed = deployed
        self.point = point
        model = point.model
        self.model = model
        self.trim = deployed.trim_vector(point)
        # Places of the linear states in X, and of the commanded inputs in U.
        self.rows = model.state_places(model.linear)
        self.columns = model.input_places(deployed.commanded)
        # The trim as z = (X; U), and the places in z that the search changes.
        self.base = np.concatenate([point.states, point.inputs])
        self.moving = [*self.rows, *(len(model.states) + column for column in self.columns)]
        # Nominal values of the linear states, the commanded inputs and the residuals.
        self.state_scales = model.nominal(model.linear)
        self.input_scales = model.nominal(deployed.commanded)
        rate_scales = [model.rate_scale(name) for name in model.linear]
        self.residual_scales = np.array([*rate_scales, *self.input_scales])
        self.scales = np.array([*self.state_scales, *self.input_scales])
        self.steady_rates = model.at(point.states, point.inputs).f[self.rows]

    def at_trim(self) -> Equilibrium:
        """Return the linearization at the trim, which need not be an equilibrium."""
        return self._linearized_at(self.base)

    def equilibrium(self) -> Equilibrium | None:
        """Return the equilibrium that Newton's method finds from the trim, or None."""
        here = self._residual_at(self.base)
        for _ in range(_MOST_STEPS):
            # It goes on to a thousandth of the accepted residual.
            if here.size <= _STEADY * 1e-3:
                break
            following = self._after_newton_step(here)
            if following is None:
                break
            here = following
        return self._linearized_at(here.z) if here.size <= _STEADY else None

    def _after_newton_step(self, here: _Residual) -> _Residual | None:
        """Return a point with a smaller residual, after a Newton step that is halved if it is
        too long, or None.
        """
        try:
            jacobian = self._jacobian_at(here.z)
        except BadInputError:  # a slope is not finite
            return None
        if not np.isfinite(jacobian).all():
            return None
        step = np.linalg.lstsq(jacobian, -here.values, rcond=1e-12)[0]
        for halvings in range(_MOST_HALVINGS):
            z = here.z.copy()
            z[self.moving] += step / 2.0**halvings * self.scales
            following = self._residual_at(z)
            if following.size < here.size:
                return following
        return None

    def _slope_at(self, z: np.ndarray) -> Slope:
        """Return the slope of the commanded inputs at a point by the entries of z that move."""
        command = self.deployed.command
        d, count = symbols_for([command], len(self.moving)), len(self.model.states)
        at = ca.DM(z) + ca.DM(np.eye(len(z))[:, self.moving]) @ d
        u = command(at[:count], at[count:], ca.DM(self.trim))[self.columns]
        return slope_at_trim(u, d, self.scales, self.input_scales, "slope of the policy")

    def _residual_at(self, z: np.ndarray) -> _Residual:
        """Return the scaled residual of the equilibrium conditions at a point z = (X; U)."""
        X, U = np.split(z, [len(self.model.states)])
        try:
            rates = self.model.at(X, U).f[self.rows]
        except FloatingPointError:
            return _Residual(z, np.full(len(self.moving), np.nan))
        u = np.array(self.deployed.command(X, U, self.trim)).ravel()[self.columns]
        values = np.concatenate([rates - self.steady_rates, U[self.columns] - u])
        return _Residual(z, values / self.residual_scales)

    def _jacobian_at(self, z: np.ndarray) -> np.ndarray:
        """Return the derivatives of the scaled residual by the scaled entries of z that move.

        Raises BadInputError if the slope of the policy is not finite.
        """
        X, U = np.split(z, [len(self.model.states)])
        plant = self.model.at(X, U)
        A = plant.A[np.ix_(self.rows, self.rows)]
        B = plant.B[np.ix_(self.rows, self.columns)]
        slope = self._slope_at(z).mean
        rows = np.vstack([np.hstack([A, B]), np.eye(len(slope), len(self.moving), len(A)) - slope])
        return np.asarray(rows * self.scales / self.residual_scales[:, None])

    def _linearized_at(self, z: np.ndarray) -> Equilibrium:
        """Return the linearization at a point (X; U), and what is saturated or clipped there."""
        X, U = np.split(z, [len(self.model.states)])
        plant, _ = linearization_at(self.model, X, U)
        slope = self._slope_at(z)
        by_states, by_inputs = np.split(slope.mean, [len(self.rows)], axis=1)
        A = plant.A[np.ix_(self.rows, self.rows)]
        B = plant.B[np.ix_(self.rows, self.columns)]
        x, u = self.state_scales, self.input_scales  # nominal values
        deployed = self.deployed
        # Normalized observations, output of the network and action.
        stages = deployed.stages(deployed.observe(X, U, self.trim))
        normalized, raw, action = (np.array(stage).ravel() for stage in stages)
        return Equilibrium(
            states=X,
            inputs=U,
            K=-by_states,
            nominal=NominalLoop(
                A=A * x / x[:, None],
                B=B * u / x[:, None],
                K=-by_states * x / u[:, None],
                K_inputs=by_inputs * u / u[:, None],
            ),
            clips=(
                *self._actions_at_ends(raw),
                *self._inputs_at_limits(deployed.unlimited_inputs(action, X, U, self.trim)),
            ),
            clipped_observations=self._clipped_observations(normalized),
            is_nonsmooth=slope.is_nonsmooth,
        )

    def _actions_at_ends(self, raw: np.ndarray) -> list[str]:
        """Return descriptions of the actions that the ends of their boxes clip.

        raw: output of the network, (m',)
        """
        deployment = self.deployed.deployment
        if deployment.actor.declared.action.squash:  # smooth, so nothing is clipped
            return []
        low, high = deployment.box
        at_ends = zip(self.deployed.commanded, (raw <= low) | (raw >= high), strict=True)
        return [f"the action of {name} at the end of its box" for name, is_at in at_ends if is_at]

    def _inputs_at_limits(self, unlimited: ca.DM) -> list[str]:
        """Return descriptions of the commanded inputs that are at a control limit or beyond.

        unlimited: commands before they are clipped, (m,)
        """
        U = np.array(unlimited).ravel()
        limits = Limits.of(self.model, tuple(self.model.inputs))
        is_at = np.logical_or(*limits.at_limits(U))
        commanded = zip(self.deployed.commanded, self.columns, strict=True)
        return [f"{name} at its limit" for name, column in commanded if is_at[column]]

    def _clipped_observations(self, normalized: np.ndarray) -> tuple[str, ...]:
        """Return the names of the observations that the normalizer clips.

        normalized: observations before the clip, (k,)
        """
        normalizer = self.deployed.deployment.normalizer
        if normalizer is None:
            return ()
        names = self.deployed.deployment.observation
        is_clipped = np.abs(normalized) >= normalizer.clip
        return tuple(name for name, clipped in zip(names, is_clipped, strict=True) if clipped)


def chain_of_loop(nominal: NominalLoop, dt: float, delay: float) -> Chain:
    """Return the sampled loop of a linear aircraft and policy.

    dt, delay: sample time and delay, s
    """
    A, B, K, K_inputs = nominal
    # The input just before a sample is the oldest command.
    return chain_of(A, B, lambda x, earlier: K_inputs @ earlier[-1] - K @ x, dt, delay)


class Margins(NamedTuple):
    """Margins of a stable sampled loop, opened at the commanded inputs.

    inputs: margins of each commanded input, with the other loops closed.
    disk: disk margin for simultaneous changes of all inputs.
    """

    inputs: tuple[LoopMargin, ...]
    disk: DiskMargin


def chain_margins(chain: Chain) -> Margins:
    """Return the margins of a stable loop at z = exp(jω dt), for ω up to π / dt."""
    loop = _closed_loop(chain)
    loops = tuple(single_margin(loop, i) for i in range(len(chain.C)))
    return Margins(loops, disk_of(loop))


def _closed_loop(chain: Chain) -> ClosedLoop:
    """Return M = S - I/2 of the sensitivity S = I + C (z I - closed)⁻¹ G, as a system in s."""
    closed, units = balanced(chain.closed)
    half = 0.5 * np.eye(len(chain.C))
    in_z = System(closed, chain.G / units[:, None], chain.C * units, half)
    return ClosedLoop(*in_continuous_time(in_z), dt=chain.dt)
