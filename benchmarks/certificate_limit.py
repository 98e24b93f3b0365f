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
    axis, the inverses of a second derivation, the eigenvalues of A - S P and of P, the eigenvectors
    of A - B K and their inverse."""
    tasks = [(form, certified_stack(form).X) for form in forms]

    def decompose() -> None:
        for form, X in tasks:
            for hamiltonian in form.hamiltonian:
                ordered_basis(hamiltonian, job=b"N")
            np.linalg.inv(form.hamiltonian.astype(complex))
            for _ in range(_INVERSES):
                np.linalg.inv(form.hamiltonian)
            np.linalg.eigvals(form.A - form.S @ X)
            np.linalg.inv(np.linalg.eig(form.A - form.B @ (form.B.mT @ X))[1])
            np.linalg.eigvalsh(X)

    games = sum(len(form.A) for form in forms)
    return Limit(shortest(decompose, games), "the decompositions of the certificate")
