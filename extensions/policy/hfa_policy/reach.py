"""Which modes of an aircraft a deployment moves and observes about an equilibrium."""

from __future__ import annotations

import math
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
#: An observation shows a mode where the mode, grown to the box of initial conditions, changes it by
#: this part of what the whole box does.
_SHOWS = 0.05
#: A state belongs to the modes that take so large a part in it.
_MOST = 0.5
#: Condition of the eigenvectors beyond which modes are not told apart.
_DEFECTIVE = 1e10


class Reach(NamedTuple):
    """The modes about an equilibrium that a deployment is judged by.

    judged: (k,), which linear states; all unless a slow mode is out of reach.
    loop: the equilibrium in coordinates of the modes within reach, (r); as it is where all are.
    own: a sentence on each slow mode of the aircraft out of reach.
    states: names of those that are judged.
    """

    judged: np.ndarray
    loop: Equilibrium
    own: tuple[str, ...]
    states: str


def reach_of(deployed: Deployed, equilibrium: Equilibrium, box: np.ndarray) -> Reach:
    """Return the modes that actions move and observations show, of deviations within a box (k,).

    Mode i with eigenvalue λ, left eigenvector w' and right eigenvector v, w'v = 1, is out of reach
    where it does not double within ten seconds and one of two ratios is below 0.05:

        Σ_j |w'B_j| n_j min(1 / |Re λ|, 60 s) / Σ_l |w_l| b_l
        max_j |C_j v| / (Σ_l |C_jl| b_l max_l (|v_l| / b_l))

    with the nominal inputs n, the box b and the slopes C of the observations by the states. The
    first is the motion by held nominal inputs over that by the box, the second the part of its
    range by which an observation changes. Where no slow mode is out of reach, all are judged.
    """
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
    unmoved = by_actions < _MOVES * (np.abs(left) @ box)
    grown = np.abs(right / box[:, None]).max(axis=0)
    shown = _share_of_range(equilibrium.C, right / grown, box)
    diverges = values.real >= _SETTLES / HORIZON
    own = (unmoved | (shown < _SHOWS)) & ~diverges
    slow = own & (values.real > -_SETTLES / HORIZON)
    if own.all() or not slow.any():
        return everything
    shares = np.abs(right * left.T)
    judged = shares[:, own].sum(axis=1) < _MOST * shares.sum(axis=1)
    basis = _real(values, right, ~own)
    inverse = np.linalg.inv(np.hstack([basis, _real(values, right, own)]))[: basis.shape[1]]
    loop = equilibrium.in_basis(basis, inverse)
    sentences = _sentences(deployed, A, values[slow], unmoved[slow])
    return Reach(judged, loop, sentences, ", ".join(names[judged]))


def _share_of_range(C: np.ndarray, modes: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return the largest part of its range in a box by which each mode, a column of (k, r), changes
    an observation, (r,)."""
    changes = np.abs(C @ modes)
    ranges = np.abs(C) @ box
    seen = ranges > 0.0
    return np.asarray((changes[seen] / ranges[seen, None]).max(axis=0, initial=0.0))


def _real(values: np.ndarray, vectors: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """A real basis of the chosen modes, (k, number of them)."""
    real = vectors[:, chosen & (values.imag == 0.0)].real
    pairs = vectors[:, chosen & (values.imag > 0.0)]
    return np.hstack([real, pairs.real, pairs.imag])


def _sentences(
    deployed: Deployed, A: np.ndarray, slow: np.ndarray, unmoved: np.ndarray
) -> tuple[str, ...]:
    """Each slow mode out of reach with its time to half or to double. unmoved: by actions."""
    model = deployed.model
    sentences = []
    for mode in modes_of(A, model.linear, model.modes):
        apart = np.abs(slow - mode.eigenvalue)
        if apart.min() > 1e-6 * max(abs(mode.eigenvalue), 1e-9):
            continue
        out_of = "no action moves" if unmoved[np.argmin(apart)] else "no observation shows"
        how = "is neutral"
        if math.isfinite(mode.time_to_half):
            how = f"halves in {mode.time_to_half:.3g} s"
        elif math.isfinite(mode.time_to_double):
            how = f"doubles in {mode.time_to_double:.3g} s"
        sentences.append(f"{out_of} the aircraft's own mode {mode.name}, which {how}")
    return tuple(sentences)


def seconds_to_converge(radius: float, dt: float) -> float:
    """How long flights are flown about an equilibrium: four time constants of the slowest mode of
    the sampled loop, whose spectral radius this is; `HORIZON` at least, `LONGEST` at most."""
    if not 0.0 < radius < 1.0:
        return HORIZON
    return min(max(HORIZON, -_SETTLES * dt / math.log(radius)), LONGEST)
