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
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hfa_flight.air.delay import in_samples
from hfa_flight.policies.deployment.deployment import MOST_SAMPLES
from hfa_flight.policies.deployment.equilibrium import NominalLoop
from hfa_support.matrices import balanced, spectral_radius
from trim.linear.frequency_response import System, in_continuous_time
from trim.linear.margins import ClosedLoop, DiskMargin, LoopMargin, disk_of, single_margin

#: Largest delay that is searched, s.
MOST_SECONDS = 3.0


@dataclass(frozen=True, eq=False)
class Chain:
    """Sampled loop s⁺ = F s + G v with the command u = C s, closed by v = u.

    F: (N, N).
    G: (N, m).
    C: (m, N).
    states: number of aircraft states, the first entries of s.
    dt: sample time, s.
    start: (N, states), matrix from the deviations of the states to s at the first sample.
    acting: durations of the parts of a sample, s, with the matrices (m, N) from s to the inputs
        that act in them in the closed loop.
    """

    F: np.ndarray
    G: np.ndarray
    C: np.ndarray
    states: int
    dt: float
    start: np.ndarray
    acting: tuple[tuple[float, np.ndarray], ...] = ()

    @property
    def closed(self) -> np.ndarray:
        """Closed-loop matrix F + G C."""
        return self.F + self.G @ self.C

    @cached_property
    def radius(self) -> float:
        """Spectral radius of the closed loop, inf if its matrix is not finite."""
        closed = self.closed
        return spectral_radius(closed) if np.isfinite(closed).all() else math.inf


def held(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrices of a plant with held inputs, x⁺ = Φ x + Γ u.

    Φ = exp(A dt), and Γ = ∫ exp(A t) dt B over [0, dt].
    """
    from scipy.linalg import expm

    n, m = B.shape
    transition = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * dt)
    return transition[:n, :n], transition[:n, n:]


class LateHold(NamedTuple):
    """Plant x⁺ = Φ x + Γ_late u_new + Γ_early u_old, whose input changes within the sample."""

    Phi: np.ndarray
    late: np.ndarray
    early: np.ndarray


def held_late(A: np.ndarray, B: np.ndarray, dt: float, change: float) -> LateHold:
    """Return the matrices of a plant whose held input changes within a sample.

    dt: sample time, s
    change: time at which the input changes, s after the sample
    """
    Phi, Gamma = held(A, B, dt)
    if not change:
        return LateHold(Phi, Gamma, np.zeros_like(Gamma))
    Phi_after, late = held(A, B, dt - change)
    return LateHold(Phi, late, Phi_after @ held(A, B, change)[1])


def chain_of(nominal: NominalLoop, dt: float, delay: float) -> Chain:
    """Return the sampled loop of a linear aircraft and policy.

    dt, delay: sample time and delay, s
    """
    whole, rest = in_samples(delay, dt)
    plant = held_late(nominal.A, nominal.B, dt, rest)
    n, m = nominal.B.shape
    size = n + (whole + 1) * m
    newest, oldest = slice(n, n + m), slice(size - m, size)  # commands in s
    F, G, C = np.zeros((size, size)), np.zeros((size, m)), np.zeros((m, size))
    C[:, :n] = -nominal.K
    C[:, oldest] += nominal.K_inputs
    F[:n, :n] = plant.Phi
    F[:n, oldest] = plant.early
    F[n + m :, n : size - m] = np.eye(size - m - n)  # a command is one sample older
    G[newest] = np.eye(m)
    if whole:
        before_oldest = slice(size - 2 * m, size - m)
        F[:n, before_oldest] = plant.late
        late_input = np.eye(size)[before_oldest]
    else:
        G[:n] = plant.late
        late_input = C
    acting = [(rest, np.eye(size)[oldest]), (dt - rest, late_input)]
    parts = tuple(part for part in acting if part[0] > 0.0)
    return Chain(F, G, C, n, dt, np.eye(size, n), parts)


class Delays(NamedTuple):
    """Effect of delays on a loop.

    radii: spectral radius with delays of 0, 1, 2, ... samples, up to `searched`.
    limit: first unstable delay in complete samples, s, not below the deployed delay, or None if
        there is none up to `searched`.
    searched: longest delay that was examined, s.
    """

    radii: tuple[float, ...]
    limit: float | None
    searched: float


def searched_delays(nominal: NominalLoop, dt: float, deployed_delay: float) -> Delays:
    """Return the effect of delays of whole samples, up to the first unstable one.

    The first unstable delay is not below the deployed delay. With a longer delay, the loop may be
    stable again. If no delay is unstable, the delays reach `MOST_SAMPLES` samples, `MOST_SECONDS`
    or the deployed delay.

    dt, deployed_delay: s
    """
    deployed = in_samples(deployed_delay, dt)
    first = deployed.whole + (not deployed.is_whole)
    most = max(first, min(MOST_SAMPLES, math.ceil(MOST_SECONDS / dt)))
    radii: list[float] = []
    for samples in range(most + 1):
        radii.append(chain_of(nominal, dt, samples * dt).radius)
        if samples >= first and radii[-1] >= 1.0:
            return Delays(tuple(radii), samples * dt, samples * dt)
    return Delays(tuple(radii), None, most * dt)


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
    """Return M = I/2 + C (z I - closed)⁻¹ G as a continuous-time system in s."""
    closed, units = balanced(chain.closed)
    half = 0.5 * np.eye(len(chain.C))
    steps = System(closed, chain.G / units[:, None], chain.C * units, half)
    return ClosedLoop(*in_continuous_time(steps), dt=chain.dt)
