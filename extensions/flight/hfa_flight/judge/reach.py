"""Modes of an aircraft at an equilibrium that a deployment can move and observe."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.equilibrium import Equilibrium
from trim.linear.modes import modes_of

#: Least and largest duration of a flight, s.
HORIZON = 60.0
LONGEST = 300.0
#: Number of time constants of the slowest mode after which a flight has converged.
_SETTLES = 4.0
#: The actions move a mode if nominal inputs move it by this fraction of the initial-condition box.
_MOVES = 0.05
#: An observation shows a mode with the size of the box if it changes by this fraction of its range.
_SHOWS = 0.05
#: A state belongs to the modes that contribute at least this fraction to it.
_MOST = 0.5
#: A policy does not change a mode if it moves the eigenvalue by at most this fraction.
_SAME = 0.1
#: Condition number of the eigenvectors above which modes cannot be separated.
_DEFECTIVE = 1e10


class OwnMode(NamedTuple):
    """Slow mode of the aircraft that a deployment does not change.

    name: name of the mode, with its time to half or to double.
    growth: real part of its eigenvalue, 1/s.
    why: reason why the deployment cannot change the mode, or "" if the deployment can change the
        mode.
    """

    name: str
    growth: float
    why: str = ""


class Reach(NamedTuple):
    """Modes at an equilibrium that count in the assessment of a deployment.

    A mode is out of reach if the actions do not move the mode or the observations do not show the
    mode.

    decisive: (k,), mask of the linear states that count. All count unless a slow mode is out of
        reach.
    loop: the equilibrium in coordinates of the r modes that count, or the equilibrium itself if all
        modes count.
    own: slow modes of the aircraft that are out of reach.
    """

    decisive: np.ndarray
    loop: Equilibrium
    own: tuple[OwnMode, ...]


def reach_of(deployed: Deployed, equilibrium: Equilibrium, box: np.ndarray) -> Reach:
    """Return the modes within reach, for deviations within a box (k,).

    Mode i has the eigenvalue λ, the left eigenvector w' and the right eigenvector v, w'v = 1. A
    mode is out of reach if it does not double within ten seconds and one of two ratios is below
    0.05:

        Σ_j |w'B_j| n_j min(1 / |Re λ|, 60 s) / Σ_l |w_l| b_l
        max_j |C_j v| / (Σ_l |C_jl| b_l max_l (|v_l| / b_l))

    n are the nominal inputs, b is the box, and C are the derivatives of the observations with
    respect to the states. The first ratio is the motion of the mode under constant nominal inputs,
    relative to the box. The second is the change of an observation, relative to its range.

    All modes count if no slow mode is out of reach, if all modes are out of reach, or if the modes
    cannot be separated. Otherwise all modes out of reach are removed from the loop, including fast
    ones. The fast ones decay and hardly change the radius of the loop, but would dominate a
    relative cost because their cost is almost zero.
    """
    A = equilibrium.A
    B = equilibrium.B
    everything = Reach(np.ones(len(A), dtype=bool), equilibrium, ())
    values, right = np.linalg.eig(A)
    if np.linalg.cond(right) > _DEFECTIVE:
        return everything
    left = np.linalg.inv(right)
    nominal = np.array([deployed.model.inputs[name].nominal for name in deployed.commanded])
    with np.errstate(divide="ignore"):
        seconds = np.minimum(1.0 / np.abs(values.real), HORIZON)
    motions = np.abs(left @ B) @ nominal * seconds
    is_unmoved = motions < _MOVES * (np.abs(left) @ box)
    grown = np.abs(right / box[:, None]).max(axis=0)
    shares_of_range = _share_of_range(equilibrium.C, right / grown, box)
    diverges = values.real >= _SETTLES / HORIZON
    out_of_reach = (is_unmoved | (shares_of_range < _SHOWS)) & ~diverges
    slow = out_of_reach & (values.real > -_SETTLES / HORIZON)
    if out_of_reach.all() or not slow.any():
        return everything
    participation = np.abs(right * left.T)
    of_removed = participation[:, out_of_reach].sum(axis=1)
    decisive = of_removed < _MOST * participation.sum(axis=1)
    kept = _real(values, right, ~out_of_reach)
    inverse = np.linalg.inv(np.hstack([kept, _real(values, right, out_of_reach)]))
    loop = equilibrium.in_basis(kept, inverse[: kept.shape[1]])
    slow_modes = [
        mode._replace(why="no action moves" if no_action_moves else "no observation shows")
        for value, no_action_moves in zip(values[slow], is_unmoved[slow], strict=True)
        for mode in _own_modes(deployed, A, value)
    ]
    return Reach(decisive, loop, tuple(dict.fromkeys(slow_modes)))


def left_alone(
    deployed: Deployed, equilibrium: Equilibrium, slowest: complex, dt: float
) -> OwnMode | None:
    """Return the slow mode of the aircraft that the policy hardly changes, or None.

    The eigenvalue of this mode differs by at most 10 % from the slowest eigenvalue of the sampled
    loop, converted to continuous time.

    slowest: eigenvalue of the sampled loop with the largest absolute value
    dt: sample time, s
    """
    if slowest == 0.0 or not np.isfinite(slowest):
        return None
    of_loop = complex(np.log(slowest)) / dt
    values = np.linalg.eigvals(equilibrium.A)
    nearest = complex(values[np.argmin(np.abs(values - of_loop))])
    is_same = abs(of_loop - nearest) <= _SAME * abs(nearest)
    if not is_same or abs(nearest.real) >= _SETTLES / HORIZON:
        return None
    modes = _own_modes(deployed, equilibrium.A, nearest)
    return modes[0] if modes else None


def _share_of_range(C: np.ndarray, modes: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return the largest change of an observation caused by each mode, (r,)."""
    changes = np.abs(C @ modes)
    ranges = np.abs(C) @ box
    seen = ranges > 0.0
    return np.asarray((changes[seen] / ranges[seen, None]).max(axis=0, initial=0.0))


def _real(values: np.ndarray, vectors: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Return a real basis of the space of the chosen modes, (k, r), one column for each mode."""
    real = vectors[:, chosen & (values.imag == 0.0)].real
    pairs = vectors[:, chosen & (values.imag > 0.0)]
    return np.hstack([real, pairs.real, pairs.imag])


def _own_modes(deployed: Deployed, A: np.ndarray, value: complex) -> list[OwnMode]:
    """Return the modes of the aircraft that belong to one eigenvalue or its conjugate."""
    model = deployed.model
    found = []
    for mode in modes_of(A, model.linear, model.modes):
        apart = min(abs(value - mode.eigenvalue), abs(value - np.conj(mode.eigenvalue)))
        if apart > 1e-6 * max(abs(mode.eigenvalue), 1e-9):
            continue
        how = "neutral"
        if math.isfinite(mode.time_to_half):
            how = f"halves in {mode.time_to_half:.3g} s"
        elif math.isfinite(mode.time_to_double):
            how = f"doubles in {mode.time_to_double:.3g} s"
        found.append(OwnMode(f"{mode.name} ({how})", mode.eigenvalue.real))
    return found


def seconds_to_converge(radius: float, dt: float) -> float:
    """Return the duration of flights about an equilibrium, s.

    The duration is four time constants of the slowest mode of the sampled loop, within [`HORIZON`,
    `LONGEST`]. For a loop that is not stable, the duration is `HORIZON`.

    radius: spectral radius of the sampled loop
    dt: sample time, s
    """
    if not 0.0 < radius < 1.0:
        return HORIZON
    return min(max(HORIZON, -_SETTLES * dt / math.log(radius)), LONGEST)
