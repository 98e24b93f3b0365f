"""Decision whether the value of a game exists: yes, no, or left open by rounding."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controller.riccati.balancing import spectrum
from controller.riccati.careful_derivations import by_schur
from controller.riccati.certificate import (
    AXIS_DISTANCE,
    hamiltonian_checks,
    solution_checks,
)
from controller.riccati.delta_search import Answer
from controller.riccati.normal_form import BACKWARD, NormalForm
from controller.riccati.schur import ordered_basis
from hfa_support.errors import NoSolutionError

#: What rounding, and a change of the last bits of A, B, E and Q, make of one entry of a Hamiltonian
#: or of a sum over its rows, relative, times the number of its rows.
ROUNDING = 4.0 * float(np.finfo(float).eps)


class StableSubspace(NamedTuple):
    """Stable subspace of a Hamiltonian.

    basis: (2n, n), orthonormal
    error: largest rotation, rad, due to rounding of the Hamiltonian, to first order
    """

    basis: np.ndarray
    error: float


def stable_subspace(form: NormalForm) -> StableSubspace | None:
    """Return the stable subspace of the Hamiltonian, with its error.

    The result is None where its dimension is not n. The error is |D| / sep, with D a relative
    change `BACKWARD` of the terms of the Hamiltonian, and sep the separation of the two halves of
    its Schur form. Source: Golub and Van Loan, Theorem 7.2.4.
    """
    basis, separation = ordered_basis(form.hamiltonian, job=b"V")
    if basis is None:
        return None
    change = BACKWARD * float(np.linalg.norm(form.hamiltonian_sizes))
    return StableSubspace(basis, change / separation if separation > 0.0 else np.inf)


class Found(NamedTuple):
    """Existence of the value of a game.

    answer: whether it exists
    form: the game in the coordinates of that decision
    subspace: stable subspace of its Hamiltonian, or None where not known
    """

    answer: Answer
    form: NormalForm
    subspace: StableSubspace | None


def existence(form: NormalForm) -> Answer:
    """Return whether the value of a game exists.

    It exists where the Hamiltonian splits and X1'X2 > 0 for the basis [X1; X2] of its stable
    subspace, or where every test of P holds. Where X1 is regular, P = X2 X1⁻¹ is the stabilizing
    solution, and X1'X2 = X1'P X1 has its signs. As delta falls to its minimum, P grows without
    bound while X1 and X2 stay bounded: an eigenvalue of X1'X2 passes through zero. So the minimum
    is visible where P itself is lost. Where P is singular, an eigenvalue is zero at every delta;
    there the tests of P can show existence, but not refute it.

    It does not exist where an eigenvalue of X1'X2 is below 0 by more than rounding, or where the
    gain from the disturbance exceeds delta at some frequency for every input. Source: Basar and
    Bernhard, H-infinity Optimal Control, Section 4.5 (conjugate points).
    """
    return value_found(form).answer


def value_found(form: NormalForm) -> Found:
    """Return `existence` with its coordinates, the first of three in which rounding does not leave
    it open."""
    found = _found_in(form)
    if found.answer.exists is None:
        found = _found_in(form.turned())
    if found.answer.exists is None:
        found = _found_in(form.levelled(), form)
    return found


def _found_in(form: NormalForm, given: NormalForm | None = None) -> Found:
    """Return `value_found` in these coordinates alone.

    given: as for `hamiltonian_checks`
    """
    n = len(form.A)
    if not form.Q.any():
        poles = spectrum(form.A)
        if poles.abscissa < 0.0 and poles.axis_distance() >= AXIS_DISTANCE:  # P = 0
            return Found(Answer(True), form, StableSubspace(np.eye(2 * n, n), 0.0))
    try:
        failed = [check for check in hamiltonian_checks(form, given) if not check.ok]
    except NoSolutionError as overflow:
        return Found(Answer(None, str(overflow)), form, None)
    subspace = None if failed else stable_subspace(form)
    if subspace is None:
        gain, frequency = shown_gain(form)
        if gain > form.delta:
            reason = (
                f"against every input the disturbance gains at least {gain:.6g},"
                f" at {frequency:.4g} rad/s"
            )
            return Found(Answer(False, reason, gain=gain), form, None)
        reason = failed[0].reason if failed else "rounding hides the stable subspace"
        return Found(Answer(None, reason), form, None)
    signs = subspace.basis[:n].T @ subspace.basis[n:]
    smallest = float(np.linalg.eigvalsh((signs + signs.T) / 2.0)[0])
    # Rounding turns [X1; X2] by up to the error, and X1'X2 by no more than twice that.
    open_below = 2.0 * subspace.error
    if smallest > open_below:
        return Found(Answer(True), form, subspace)
    if smallest < -open_below:
        reason = "P is indefinite by more than rounding"
        return Found(Answer(False, reason), form, subspace)
    if solution_that_holds(form) is not None:
        return Found(Answer(True), form, subspace)
    reason = "rounding hides whether the stabilizing solution is positive semidefinite"
    return Found(Answer(None, reason), form, subspace)


def solution_that_holds(form: NormalForm) -> np.ndarray | None:
    """Return P of the first derivation, (n, n), where every test of P holds, else None.

    It serves a search, without a certificate. The tests bound the residual of P, not its error, so
    that within about 1e-6 of the smallest delta of a stiff plant rounding can pass them. A bound of
    the error by Lyapunov matrices, with rounding of every entry in it, leaves plants open that 60
    digits solve.
    """
    try:
        X = by_schur(form)
    except NoSolutionError:
        return None
    if all(check.ok for check in solution_checks(form, X)):
        return form.value(X)
    return None


def shown_gain(form: NormalForm) -> tuple[float, float]:
    """Return a lower bound of the gain from the disturbance under all inputs, and its frequency,
    rad/s.

    Rounding is subtracted; the result is 0 where no gain is shown. The least of |Q^½ x|² + |u|²
    over all u, where x follows from u and w at the frequency ω, is w*Φ w with Φ = -[0 E'] (H - jω
    I)⁻¹ [E; 0] and H the Hamiltonian at δ = inf. No δ up to the root of an eigenvalue of Φ has a
    value. At that root the Hamiltonian has the eigenvalue jω, and below it another one on the axis.
    The frequencies are those of the eigenvalues at this δ, and others between them and 0. The bound
    of the error covers rounding in the terms of every entry of H and E: |rows| |H| |columns|
    (Higham, Accuracy and Stability of Numerical Algorithms, Section 7.2). Source: Zhou, Doyle and
    Glover, Section 13.4.
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
