"""Least time of a certified game solution: the time of its matrix operations alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.report import Limit, shortest
from controller.riccati.balancing import units_of
from controller.riccati.certificate import certified_stack
from controller.riccati.normal_form import NormalForm

#: Least number of doublings in the second derivation. Each has an inverse and eight products.
_DOUBLINGS = 5
_PRODUCTS = 8
#: Products in the residual of P and in the magnitudes of its terms.
_OF_RESIDUAL = 6


def certificate_limit(forms: Sequence[NormalForm]) -> Limit:
    """Return the least time of a certified game solution: that of its matrix operations alone.

    These operations are timed:

    - the balancing of the Hamiltonian
    - the eigenvectors and the inverse of the Hamiltonian, for a bound on the distance of its
      eigenvalues from the imaginary axis
    - the inverses and products of the doubling iteration, which computes P a second time
    - the eigenvectors of A - B K and their inverse
    - the eigenvalues of P

    The products of one doubling are computed in one call, as are the products of the residual.

    forms: stacks of games of equal size
    """
    tasks = [(form, certified_stack(form).X) for form in forms]

    def decompose() -> None:
        for form, X in tasks:
            units_of(form.A, form.S, form.Q)
            np.linalg.eig(form.hamiltonian)
            np.linalg.inv(form.hamiltonian)
            for _ in range(_DOUBLINGS):
                np.linalg.inv(form.A)
                np.broadcast_to(X, (_PRODUCTS, *X.shape)) @ form.A
            right = np.linalg.eig(form.A - form.B @ (form.B.mT @ X))[1]
            for _ in range(2):
                np.linalg.inv(right)
            np.linalg.eigvalsh(X)
            np.broadcast_to(X, (_OF_RESIDUAL, *X.shape)) @ form.A

    games = sum(len(form.A) for form in forms)
    return Limit(shortest(decompose, games), "the algebra of the certificate")
