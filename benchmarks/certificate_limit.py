"""The least work of certified games: the decompositions that their certificate is made of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.report import Limit, shortest
from controller.riccati.certificate import certified_stack
from controller.riccati.normal_form import NormalForm
from controller.riccati.schur import ordered_basis

#: The matrix sign function has settled in no fewer steps, each an inverse.
_INVERSES = 6


def certificate_limit(forms: Sequence[NormalForm]) -> Limit:
    """Return the time of a game in these stacks of games that their decompositions take alone.

    An ordered Schur form of the Hamiltonian, its inverse at a frequency for the distance from the
    axis, the inverses of a second derivation, the eigenvalues of A, of both closed loops and of P,
    and for each mode that does not decay the rank test of its reach."""
    tasks = [(form, certified_stack(form).X, _rank_tests(form)) for form in forms]

    def decompose() -> None:
        for form, X, rank_tests in tasks:
            for hamiltonian in form.hamiltonian:
                ordered_basis(hamiltonian, job=b"N")
            np.linalg.inv(form.hamiltonian.astype(complex))
            for _ in range(_INVERSES):
                np.linalg.inv(form.hamiltonian)
            gains = form.B.mT @ X
            for matrices in (form.A, form.A - form.S @ X, form.A - form.B @ gains):
                np.linalg.eigvals(matrices)
            np.linalg.eigvalsh(X)
            np.linalg.qr(rank_tests, mode="r")

    games = sum(len(form.A) for form in forms)
    return Limit(shortest(decompose, games), "the decompositions of the certificate")


def _rank_tests(form: NormalForm) -> np.ndarray:
    """[A' - λI; B'] of every eigenvalue λ of A with Re λ >= 0 and Im λ >= 0, (K, n + m, n)."""
    values = np.linalg.eigvals(form.A)
    game, number = np.nonzero((values.real >= 0.0) & (values.imag >= 0.0))
    tests = np.concatenate([form.A.mT, form.B.mT], axis=1)[game].astype(complex)
    n = form.A.shape[-1]
    tests[:, :n] -= values[game, number][:, None, None] * np.eye(n)
    return tests
