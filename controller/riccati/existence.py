"""Decision whether the value of a game exists: yes, no, or undecided because of rounding."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controller.riccati.balancing import spectrum
from controller.riccati.careful_derivations import by_schur
from controller.riccati.certificate import (
    AXIS_DISTANCE,
    hamiltonian_checks,
    is_clearly_split,
    solution_checks,
)
from controller.riccati.delta_search import Answer
from controller.riccati.normal_form import BACKWARD, NormalForm, ordered_basis
from hfa_support.errors import NoSolutionError

#: Relative change of one entry of a Hamiltonian, or of a sum over its rows, by rounding and by a
#: change of the last bits of A, B, E and Q, divided by the number of its rows.
ROUNDING = 4.0 * float(np.finfo(float).eps)


class StableSubspace(NamedTuple):
    """Stable subspace of a Hamiltonian.

    basis: (2n, n), orthonormal
    error: largest rotation of the subspace by rounding of the Hamiltonian, rad, to first order
    """

    basis: np.ndarray
    error: float


def stable_subspace(form: NormalForm) -> StableSubspace | None:
    """Return the stable subspace of the Hamiltonian with an error bound, or None if it is unknown.

    The result is None if the dimension of the subspace is not n, or if the Schur form fails. The
    error is |D| / sep. D is a relative change `BACKWARD` of the terms of the Hamiltonian, and sep
    is the separation of the stable and unstable blocks of its Schur form. Source: Golub and Van
    Loan, Theorem 7.2.4.
    """
    basis, separation = ordered_basis(form.hamiltonian, job=b"V")
    if basis is None:
        return None
    change = BACKWARD * float(np.linalg.norm(form.hamiltonian_sizes))
    return StableSubspace(basis, change / separation if separation > 0.0 else np.inf)


class Found(NamedTuple):
    """Decision whether the value of a game exists, with its data.

    answer: the decision
    form: normal form in whose coordinates the decision was made
    subspace: stable subspace of the Hamiltonian of `form`, or None if unknown
    """

    answer: Answer
    form: NormalForm
    subspace: StableSubspace | None


def existence(form: NormalForm) -> Answer:
    """Return whether the value of a game exists, does not exist, or is undecided because of
    rounding.

    Let [X1; X2] be a basis of the stable subspace of the Hamiltonian.

    - The value exists if Q = 0 and A is Hurwitz by more than rounding, if every test of P passes,
      or if X1'X2 > 0 by more than rounding and the Hamiltonian has n eigenvalues on each side of
      the imaginary axis.
    - The value does not exist if an eigenvalue of X1'X2 is below 0 by more than rounding, or if at
      some frequency the gain from the disturbance exceeds delta for every input.
    - Otherwise the existence is undecided.

    If X1 is regular, P = X2 X1⁻¹ is the stabilizing solution, and X1'X2 = X1'P X1 has the signs of
    P. As delta falls to its minimum, P grows without bound, but X1 and X2 remain bounded. An
    eigenvalue of X1'X2 then passes through zero.

    Source: Basar and Bernhard, H-infinity Optimal Control, Section 4.5 (conjugate points).
    """
    return value_found(form).answer


def value_found(form: NormalForm) -> Found:
    """Return the decision whether the value of a game exists, with the data of the decision.

    The given coordinates, `turned` and `levelled` are tried in this order, until the existence is
    decided.
    """
    found = _found_in(form)
    if found.answer.exists is None:
        found = _found_in(form.turned())
    if found.answer.exists is None:
        found = _found_in(form.levelled(), form)
    return found


def _found_in(form: NormalForm, given: NormalForm | None = None) -> Found:
    """Return whether the value of a game exists, decided in the coordinates of `form` alone."""
    n = len(form.A)
    if not form.Q.any():
        poles = spectrum(form.A)
        if poles.abscissa < 0.0 and poles.axis_distance() >= AXIS_DISTANCE:  # P = 0
            return Found(Answer(True), form, StableSubspace(np.eye(2 * n, n), 0.0))
    failed = []
    if given is not None or not is_clearly_split(form):
        try:
            failed = [check for check in hamiltonian_checks(form, given) if not check.ok]
        except NoSolutionError as overflow:
            return Found(Answer(None, str(overflow)), form, None)
    subspace = None if failed else stable_subspace(form)
    if subspace is None:
        gain, frequency = shown_gain(form)
        if gain > form.delta:
            reason = (
                f"for every input, the gain from the disturbance is at least {gain:.6g}"
                f" (at {frequency:.4g} rad/s)"
            )
            return Found(Answer(False, reason, gain=gain), form, None)
        reason = failed[0].reason if failed else "rounding hides the stable subspace"
        return Found(Answer(None, reason), form, None)
    signs = subspace.basis[:n].T @ subspace.basis[n:]
    smallest = float(np.linalg.eigvalsh((signs + signs.T) / 2.0)[0])
    # Rounding rotates [X1; X2] by up to the error, and changes X1'X2 by at most twice the error.
    open_below = 2.0 * subspace.error
    if smallest > open_below:
        return Found(Answer(True, excess=smallest), form, subspace)
    if smallest < -open_below:
        reason = "P is indefinite by more than rounding"
        return Found(Answer(False, reason, excess=smallest), form, subspace)
    if solution_that_holds(form) is not None:
        return Found(Answer(True), form, subspace)
    reason = "rounding hides whether the stabilizing solution is positive semidefinite"
    return Found(Answer(None, reason), form, subspace)


def solution_that_holds(form: NormalForm) -> np.ndarray | None:
    """Return P, (n, n), by the Schur form if every test of P passes, otherwise None.

    This P has no certificate. The tests bound the residual of P, but not the error of P. Within
    about 1e-6 of the smallest delta of a stiff plant, the tests may pass although no solution
    exists.
    """
    try:
        X = by_schur(form)
    except NoSolutionError:
        return None
    if all(check.ok for check in solution_checks(form, X)):
        return form.value(X)
    return None


def shown_gain(form: NormalForm) -> tuple[float, float]:
    """Return a lower bound of the L2 gain that no input can reduce further, and its frequency,
    rad/s.

    The gain is that from the disturbance w to (Q^½ x, R^½ u). The result is (0, 0) if no gain is
    shown.

    At the frequency ω the least |Q^½ x|² + |u|² over all u, with x determined by u and w, is w*Φ w.
    Here Φ = -[0 E'] (H - jω I)⁻¹ [E; 0], and H is the Hamiltonian at δ = inf. No game with δ up to
    the square root of an eigenvalue of Φ has a value. If δ equals this square root, an eigenvalue
    of the Hamiltonian is on the imaginary axis. The frequencies tried are 0, the frequencies of the
    Hamiltonian's eigenvalues at the given δ, and the midpoints between these frequencies. Rounding
    in the terms of every entry of H and E is subtracted (Higham, Accuracy and Stability of
    Numerical Algorithms, Section 7.2).

    Source: Zhou, Doyle and Glover, Section 13.4.
    """
    n, k = form.disturbance.shape
    if not k or math.isinf(form.delta):
        return 0.0, 0.0
    undisturbed = form.with_delta(math.inf)
    without = undisturbed.hamiltonian
    sizes = undisturbed.hamiltonian_sizes
    shifts = np.unique(np.abs(spectrum(form.hamiltonian).eigenvalues.imag))
    shifts = np.unique(np.concatenate([[0.0], shifts]))
    frequencies = np.concatenate([shifts, (shifts[1:] + shifts[:-1]) / 2.0])
    size = float(np.abs(form.disturbance).max()) or 1.0
    zero = np.zeros((n, k))
    into = np.vstack([form.disturbance / size, zero])
    out = np.vstack([zero, form.disturbance / size])
    sizes_into = np.vstack([form.sizes.E / size, zero])
    sizes_out = np.vstack([zero, form.sizes.E / size])
    best = (0.0, 0.0)
    for frequency in frequencies:
        shifted = without - 1j * frequency * np.eye(2 * n)
        try:
            columns = np.linalg.solve(shifted, into)
            rows = np.linalg.solve(shifted.T, out).T
        except np.linalg.LinAlgError:
            continue
        gained = -out.T @ columns
        sums = (sizes + frequency * np.eye(2 * n)) @ np.abs(columns) + sizes_into
        bound = np.abs(rows) @ sums + sizes_out.T @ np.abs(columns)
        error = 2 * n * ROUNDING * np.linalg.norm(bound)
        squared = float(np.linalg.eigvalsh((gained + gained.conj().T) / 2.0)[-1]) - float(error)
        if squared > best[0] ** 2:
            best = math.sqrt(squared), float(frequency)
    return best[0] * size, best[1]
