"""The least work of certified games: decompositions and products that their certificate is made
of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.report import Limit, shortest
from controller.riccati.certificate import certified_stack
from controller.riccati.normal_form import NormalForm
from controller.riccati.schur import ordered_basis

#: The second derivation doubles the time no fewer times, each an inverse and eight products.
_DOUBLINGS = 5
_PRODUCTS = 8
#: Products of the residual of P and of the sizes of its terms.
_OF_RESIDUAL = 6


def certificate_limit(forms: Sequence[NormalForm]) -> Limit:
    """Return the time of a game in these stacks of games that their decompositions and products
    take alone.

    An ordered Schur form of the Hamiltonian, its inverse at a frequency for the distance from the
    axis, the inverse and the doublings of a second derivation, the eigenvectors of A - B K and
    their inverse, the eigenvalues of P, and its residual. Products of one step are one call."""
    tasks = [(form, certified_stack(form).X) for form in forms]

    def decompose() -> None:
        for form, X in tasks:
            for hamiltonian in form.hamiltonian:
                ordered_basis(hamiltonian, job=b"N")
            np.linalg.inv(form.hamiltonian.astype(complex))
            np.linalg.inv(form.hamiltonian)
            for _ in range(_DOUBLINGS):
                np.linalg.inv(form.A)
                np.broadcast_to(X, (_PRODUCTS, *X.shape)) @ form.A
            np.linalg.inv(np.linalg.eig(form.A - form.B @ (form.B.mT @ X))[1])
            np.linalg.eigvalsh(X)
            np.broadcast_to(X, (_OF_RESIDUAL, *X.shape)) @ form.A

    games = sum(len(form.A) for form in forms)
    return Limit(shortest(decompose, games), "the algebra of the certificate")
