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
from typing import NamedTuple

import numpy as np

from controller.riccati.loop_margins import LoopMargin, single_margin
from controller.riccati.margins import ClosedLoop, DiskMargin, disk_of
from hfa_flight.air.delay import in_samples
from hfa_flight.policies.deployment.deployment import MOST_SAMPLES
from hfa_flight.policies.deployment.equilibrium import Equilibrium

#: Largest delay that is searched, s.
MOST_SECONDS = 3.0


class Chain(NamedTuple):
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

    @property
    def slowest(self) -> complex:
        """Eigenvalue of the closed loop with the largest absolute value.

        The value is inf if the matrix is not finite.
        """
        closed = self.closed
        if not np.isfinite(closed).all():
            return math.inf
        values = np.linalg.eigvals(closed)
        return complex(values[np.argmax(np.abs(values))])

    @property
    def radius(self) -> float:
        """Spectral radius of the closed loop."""
        return abs(self.slowest)


def held(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrices of a plant with held inputs, x⁺ = Φ x + Γ u.

    Φ = exp(A dt), and Γ = ∫ exp(A t) dt B over [0, dt].
    """
    from scipy.signal import cont2discrete

    nothing = np.zeros((0, len(A))), np.zeros((0, B.shape[1]))
    Phi, Gamma, *_ = cont2discrete((A, B, *nothing), dt)
    return Phi, Gamma


def chain_of(equilibrium: Equilibrium, dt: float, delay: float) -> Chain:
    """Return the sampled loop at an equilibrium.

    dt, delay: sample time and delay, s
    """
    whole, early_time = in_samples(delay, dt)
    n, m = equilibrium.B.shape
    blocks = whole + 1
    size = n + blocks * m
    before = slice(size - m, size)
    Phi, Gamma = held(equilibrium.A, equilibrium.B, dt)
    late = Gamma
    early = np.zeros_like(Gamma)
    if early_time:
        Phi_after, late = held(equilibrium.A, equilibrium.B, dt - early_time)
        early = Phi_after @ held(equilibrium.A, equilibrium.B, early_time)[1]
    F = np.zeros((size, size))
    G = np.zeros((size, m))
    C = np.zeros((m, size))
    F[:n, :n] = Phi
    F[:n, before] += early
    if whole:
        F[:n, n + (whole - 1) * m : n + whole * m] += late
    else:
        G[:n] = late
    G[n : n + m] = np.eye(m)
    for block in range(1, blocks):
        begin = n + block * m
        F[begin : begin + m, begin - m : begin] = np.eye(m)
    start = np.eye(size, n)
    C[:, :n] = -equilibrium.K
    C[:, before] += equilibrium.K_inputs
    delayed = C if whole == 0 else np.eye(size)[n + (whole - 1) * m : n + whole * m]
    acting = [(early_time, np.eye(size)[before]), (dt - early_time, delayed)]
    parts = tuple(part for part in acting if part[0] > 0.0)
    return Chain(F, G, C, n, dt, start, parts)


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


def delays(equilibrium: Equilibrium, dt: float, deployed_delay: float) -> Delays:
    """Return the effect of delays up to the first unstable one.

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
        radii.append(chain_of(equilibrium, dt, samples * dt).radius)
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


def margins(chain: Chain) -> Margins:
    """Return the margins of a stable loop at z = exp(jω dt), for ω up to π / dt."""
    loop = _closed_loop(chain)
    loops = tuple(single_margin(loop, i) for i in range(len(chain.C)))
    return Margins(loops, disk_of(loop))


def _closed_loop(chain: Chain) -> ClosedLoop:
    """Return M = I/2 + C (z I - closed)⁻¹ G as a continuous-time system in s."""
    # z is replaced by (1 + s) / (1 - s). This maps the axis s = jω to the unit circle.
    closed = chain.closed
    one = np.eye(len(closed))
    total = closed + one
    enters = np.linalg.solve(total, chain.G)
    leaves = np.linalg.solve(total.T, chain.C.T).T
    return ClosedLoop(
        A=np.linalg.solve(total, closed - one),
        B=math.sqrt(2.0) * enters,
        C=math.sqrt(2.0) * leaves,
        D=0.5 * np.eye(len(chain.C)) - chain.C @ enters,
        dt=chain.dt,
    )
