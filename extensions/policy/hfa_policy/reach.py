"""Which modes of an aircraft the actions of a deployment move about an equilibrium."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hfa_policy.deployed import Deployed
from hfa_policy.equilibrium import Equilibrium
from trim.linear.modes import modes_of

#: Seconds that every flight has to converge, and the longest that it is given.
HORIZON = 60.0
LONGEST = 300.0
#: Time constants of the slowest mode after which a flight has converged to a twentieth.
_SETTLES = 4.0
#: An action moves a mode where a nominal input takes it by this part of the initial conditions.
_MOVES = 0.05
#: A state belongs to the modes that take so large a part in it.
_MOST = 0.5
#: Condition of the eigenvectors beyond which modes are not told apart.
_DEFECTIVE = 1e10


class Reach(NamedTuple):
    """What the actions of a deployment move about an equilibrium.

    judged: (k,), which linear states; all unless a slow or unstable mode is out of their reach.
    loop: the equilibrium in coordinates of the modes that they move, (r); as it is where all are.
    own: a sentence on each slow or unstable mode of the aircraft that no action moves.
    states: names of those that are judged.
    """

    judged: np.ndarray
    loop: Equilibrium
    own: tuple[str, ...]
    states: str


def reach_of(deployed: Deployed, equilibrium: Equilibrium, box: np.ndarray) -> Reach:
    """What the actions move, of deviations within a box (k,)."""
    A, B = equilibrium.A, equilibrium.B
    names = np.array(deployed.model.linear)
    everything = Reach(np.ones(len(A), dtype=bool), equilibrium, (), ", ".join(names))
    values, right = np.linalg.eig(A)
    if np.linalg.cond(right) > _DEFECTIVE:
        return everything
    left = np.linalg.inv(right)
    nominal = np.array([deployed.model.inputs[name].nominal for name in deployed.commanded])
    with np.errstate(divide="ignore"):
        seconds = np.minimum(1.0 / np.abs(values.real), HORIZON)
    by_actions = np.abs(left @ B) @ nominal * seconds
    own = by_actions < _MOVES * (np.abs(left) @ box)
    slow = own & (values.real > -_SETTLES / HORIZON)
    if own.all() or not slow.any():
        return everything
    shares = np.abs(right * left.T)
    judged = shares[:, own].sum(axis=1) < _MOST * shares.sum(axis=1)
    basis = _real(values, right, ~own)
    inverse = np.linalg.inv(np.hstack([basis, _real(values, right, own)]))[: basis.shape[1]]
    loop = replace(
        equilibrium,
        A=inverse @ A @ basis,
        B=inverse @ B,
        K=equilibrium.K @ basis,
        basis=basis,
    )
    return Reach(judged, loop, _sentences(deployed, A, values[slow]), ", ".join(names[judged]))


def _real(values: np.ndarray, vectors: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """A real basis of the chosen modes, (k, number of them)."""
    real = vectors[:, chosen & (values.imag == 0.0)].real
    pairs = vectors[:, chosen & (values.imag > 0.0)]
    return np.hstack([real, pairs.real, pairs.imag])


def _sentences(deployed: Deployed, A: np.ndarray, slow: np.ndarray) -> tuple[str, ...]:
    """Each slow or unstable mode with its time to half or to double."""
    model = deployed.model
    sentences = []
    for mode in modes_of(A, model.linear, model.modes):
        if np.abs(slow - mode.eigenvalue).min() > 1e-6 * max(abs(mode.eigenvalue), 1e-9):
            continue
        how = "is neutral"
        if math.isfinite(mode.time_to_half):
            how = f"halves in {mode.time_to_half:.3g} s"
        elif math.isfinite(mode.time_to_double):
            how = f"doubles in {mode.time_to_double:.3g} s"
        sentences.append(f"no action moves the aircraft's own mode {mode.name}, which {how}")
    return tuple(sentences)


def seconds_to_converge(radius: float, dt: float) -> float:
    """How long flights are flown about an equilibrium: four time constants of the slowest mode of
    the sampled loop, whose spectral radius this is; `HORIZON` at least, `LONGEST` at most."""
    if not 0.0 < radius < 1.0:
        return HORIZON
    return min(max(HORIZON, -_SETTLES * dt / math.log(radius)), LONGEST)
