"""The least work of certified games: decompositions and products of their certificate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.report import Limit, shortest
from controller.riccati.balancing import units_of
from controller.riccati.certificate import certified_stack
from controller.riccati.normal_form import NormalForm

#: The second derivation doubles the time no fewer times, each an inverse and eight products.
_DOUBLINGS = 5
_PRODUCTS = 8
#: Products of the residual of P and of the sizes of its terms.
_OF_RESIDUAL = 6


def certificate_limit(forms: Sequence[NormalForm]) -> Limit:
    """Return the time of a game in these stacks that its decompositions and products take alone.

    The decompositions are the balancing of the Hamiltonian; its eigenvectors and their inverse,
    which bound the distance from the axis and take less time than its ordered Schur form; the
    inverse and the doublings of a second derivation; the eigenvectors of A - B K and their inverse;
    and the eigenvalues of P. The products of one step and of the residual are one call.
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
