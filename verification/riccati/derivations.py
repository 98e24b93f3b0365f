"""Both derivations and the certificate that holds them against each other and against the equation."""

from __future__ import annotations

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.support.checks import Check
from hfa_model.support.errors import NoSolutionError
from verification.riccati.certificate import Certificate, agreement_check, hamiltonian_checks, solution_checks
from verification.riccati.gare_iteration import iterated_solution
from verification.riccati.gare_schur import schur_solution
from verification.riccati.spectrum import is_hurwitz


def certified_solution(game: Game) -> tuple[np.ndarray, Certificate]:
    """P of A'P + P A + Q - P S P = 0 and its certificate, all of whose tests hold.

    P: (n, n) symmetric, read-only.  Raises NoSolutionError with the reason of the first test that failed; a
    failure of the first derivation is told before the second one is asked.
    """
    checks = hamiltonian_checks(game)
    _refuse_failures(checks)
    P = _first_derivation(game)
    checks += solution_checks(game, P)
    _refuse_failures(checks)
    checks += (agreement_check(game, P, iterated_solution(game)),)
    _refuse_failures(checks)
    P.setflags(write=False)
    return P, Certificate(checks)


def _first_derivation(game: Game) -> np.ndarray:
    """P = 0 where nothing is paid for and A is Hurwitz: there `schur_solution`, asked otherwise, finds rounding."""
    if not game.Q.any() and is_hurwitz(game.A):
        return np.zeros(game.A.shape)
    return schur_solution(game)


def _refuse_failures(checks: tuple[Check, ...]) -> None:
    for check in checks:
        if not check.ok:
            raise NoSolutionError(check.reason)
