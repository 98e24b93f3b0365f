"""The sampled loop about an equilibrium, exact: inputs held between the samples, commands late.

With the state s = (x_k; u_{k-1}; ...; u_{k-d-1}) of a delay of d samples and a part f of one,

    x_{k+1} = Φ x_k + Γ_late u_{k-d} + Γ_early u_{k-d-1},    u_k = -K x_k + K_inputs u_{k-d-1},

where Γ_early acts during the first f dt and Γ_late during the rest of a sample; u_{k-d-1} is the
input that acts just before the sample. Source: Franklin, Powell and Workman, Digital Control of
Dynamic Systems, Section 4.3.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controller.riccati.frequency_response import frequency_grid
from controller.riccati.loop_margins import LoopMargin, margin_of
from controller.riccati.margins import (
    DiskMargin,
    Response,
    best_scaling,
    disk_of,
    disk_sizes,
    scaled_norm,
)
from hfa_policy.deployment import MOST_SAMPLES
from hfa_policy.equilibrium import Equilibrium

#: Seconds of delay up to which the delay that is lost is sought.
MOST_SECONDS = 3.0
#: Parts of a sample in which the last one is searched.
_PARTS = 20
#: A delay within this part of a sample of a whole number of them is that number.
_WHOLE = 1e-9


class Chain(NamedTuple):
    """s⁺ = F s + G v,  u = C s: the loop where v = u, cut open where it is not.

    F: (N, N), G: (N, m), C: (m, N).
    states: how many of s are states of the aircraft; the first.
    dt: s.
    """

    F: np.ndarray
    G: np.ndarray
    C: np.ndarray
    states: int
    dt: float

    @property
    def closed(self) -> np.ndarray:
        """F + G C."""
        return self.F + self.G @ self.C

    @property
    def radius(self) -> float:
        """The spectral radius of the closed loop; inf where its gains are too large to compute
        with."""
        closed = self.closed
        if not np.isfinite(closed).all():
            return math.inf
        return float(np.abs(np.linalg.eigvals(closed)).max())


def held(A: np.ndarray, B: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Φ = exp(A dt), Γ = ∫ exp(A t) dt B over [0, dt]."""
    from scipy.linalg import expm

    n, m = B.shape
    moved = expm(dt * np.vstack([np.hstack([A, B]), np.zeros((m, n + m))]))
    return moved[:n, :n], moved[:n, n:]


def chain_of(equilibrium: Equilibrium, dt: float, delay: float) -> Chain:
    """The sampled loop about an equilibrium. delay: s."""
    samples = delay / dt
    whole = round(samples) if abs(samples - round(samples)) <= _WHOLE else math.floor(samples)
    early_time = max(0.0, delay - whole * dt) if samples - whole > _WHOLE else 0.0
    n, m = equilibrium.B.shape
    blocks = whole + 1
    size = n + blocks * m
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
    F[:n, size - m :] += early
    if whole:
        F[:n, n + (whole - 1) * m : n + whole * m] += late
    else:
        G[:n] = late
    G[n : n + m] = np.eye(m)
    for block in range(1, blocks):
        begin = n + block * m
        F[begin : begin + m, begin - m : begin] = np.eye(m)
    C[:, :n] = -equilibrium.K
    C[:, size - m :] += equilibrium.K_inputs
    return Chain(F, G, C, n, dt)


class Delays(NamedTuple):
    """What delays do to a loop.

    radii: spectral radius with 0, 1, 2, ... whole samples of delay, up to the first that is lost.
    limit: s, the first delay in whole samples, from the deployed one on, that is lost; None where
        none is up to `searched`.
    fine: s, the first delay that is lost, to a twentieth of a sample; None likewise.
    searched: s, the longest that was looked at.
    """

    radii: tuple[float, ...]
    limit: float | None
    fine: float | None
    searched: float


def delays(equilibrium: Equilibrium, dt: float, deployed_delay: float) -> Delays:
    """Search upward from the deployed delay, sample by sample: a loop that is lost at one delay may
    be stable again at a longer one."""
    first = math.ceil(deployed_delay / dt - _WHOLE)
    most = max(first, min(MOST_SAMPLES, math.ceil(MOST_SECONDS / dt)))
    radii: list[float] = []
    for samples in range(most + 1):
        radii.append(chain_of(equilibrium, dt, samples * dt).radius)
        if samples >= first and radii[-1] >= 1.0:
            fine = _first_lost(equilibrium, dt, deployed_delay, samples)
            return Delays(tuple(radii), samples * dt, fine, samples * dt)
    return Delays(tuple(radii), None, None, most * dt)


def _first_lost(equilibrium: Equilibrium, dt: float, deployed_delay: float, samples: int) -> float:
    """The first delay of the last sample before `samples` that is lost, in parts of it."""
    for part in range(1, _PARTS):
        delay = (samples - 1 + part / _PARTS) * dt
        if delay >= deployed_delay and chain_of(equilibrium, dt, delay).radius >= 1.0:
            return delay
    return samples * dt


class Margins(NamedTuple):
    """Of a stable sampled loop, cut where its commands enter the aircraft.

    inputs: of each commanded input, the others closed.
    disk: of all at once.
    """

    inputs: tuple[LoopMargin, ...]
    disk: DiskMargin


def margins(chain: Chain) -> Margins:
    """Margins of a stable loop: z = exp(jω dt), ω up to half the sampling rate."""
    M = _shifted_sensitivity(chain)
    grid = _grid(chain)
    count = len(chain.C)
    loops = tuple(
        _with_peak(margin_of(lambda w, i=i: M(w, i)[:, 0], grid), M, grid, i) for i in range(count)
    )
    coarse = disk_of(M, grid)
    if count == 1:
        disk = DiskMargin(loops[0].disk, *disk_sizes(loops[0].disk), coarse.frequency)
    else:
        disk = _refined(coarse, M, grid)
    return Margins(loops, disk)


def _shifted_sensitivity(chain: Chain) -> Response:
    """M = S - I/2 = I/2 + C (z I - closed)⁻¹ G."""
    closed = chain.closed
    half = 0.5 * np.eye(len(chain.C))

    def response(frequencies: np.ndarray, loop: int | None = None) -> np.ndarray:
        loops = slice(None) if loop is None else slice(loop, loop + 1)
        z = np.exp(1j * np.asarray(frequencies) * chain.dt)
        resolvent = z[:, None, None] * np.eye(len(closed)) - closed
        enters = np.broadcast_to(chain.G[:, loops], (len(z), *chain.G[:, loops].shape))
        return half[loops, loops] + chain.C[loops] @ np.linalg.solve(resolvent, enters)

    return response


def _grid(chain: Chain) -> np.ndarray:
    """Frequencies from 0 to a little beyond half the sampling rate, where the loci cross the real
    axis, with every resonance."""
    highest = math.pi / chain.dt
    open_poles = np.linalg.eigvals(chain.F)
    poles = np.concatenate([np.linalg.eigvals(chain.closed), open_poles])
    poles = poles[np.abs(poles) > 1e-6]
    rates = np.log(poles.astype(complex)) / chain.dt
    grid = frequency_grid(rates[np.abs(rates) > 0.0])
    even = np.linspace(0.0, highest, 400)
    inside = np.concatenate([grid[grid < highest], even[:-1]])
    return np.append(np.unique(inside), [highest * (1.0 - 1e-7), highest * (1.0 + 1e-7)])


def _peak(size: object, grid: np.ndarray, sizes: np.ndarray) -> tuple[float, float]:
    """The highest value near the highest one of a grid, and where it is."""
    from scipy.optimize import minimize_scalar

    top = int(np.argmax(sizes))
    ends = (grid[max(top - 1, 0)], grid[min(top + 1, len(grid) - 1)])
    found = minimize_scalar(
        lambda frequency: -size(frequency),  # type: ignore[operator]
        bounds=ends,
        method="bounded",
        options={"xatol": 1e-7 * max(ends[1], 1e-12)},
    )
    if -found.fun > sizes[top]:
        return float(-found.fun), float(found.x)
    return float(sizes[top]), float(grid[top])


def _with_peak(margin: LoopMargin, M: Response, grid: np.ndarray, loop: int) -> LoopMargin:
    """The margin of one loop with the disk of its peak between the frequencies of the grid."""
    sizes = np.abs(M(grid, loop)[:, 0, 0])
    peak, _ = _peak(lambda w: abs(M(np.array([w]), loop)[0, 0, 0]), grid, sizes)
    return margin._replace(disk=min(1.0 / peak, 2.0))


def _refined(coarse: DiskMargin, M: Response, grid: np.ndarray) -> DiskMargin:
    """The disk of the peak between the frequencies of the grid."""

    def size(frequency: float) -> float:
        matrix = M(np.array([frequency]))[0]
        return float(scaled_norm(matrix, best_scaling(matrix)))

    near = int(np.argmin(np.abs(grid - coarse.frequency)))
    sizes = np.zeros(len(grid))
    sizes[near] = 1.0 / coarse.disk
    peak, frequency = _peak(size, grid, sizes)
    alpha = min(1.0 / peak, 2.0)
    return DiskMargin(alpha, *disk_sizes(alpha), frequency)
