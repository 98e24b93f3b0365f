"""A solution of the game Riccati equation together with a certificate that holds, or the reason why not."""

from __future__ import annotations

import numpy as np

from controller.game import Game
from hfa_model.errors import NoSolutionError
from verification.certificate import Certificate, agreement_check, hamiltonian_checks, solution_checks
from verification.checks import Check
from verification.gare_iteration import iterated_solution
from verification.gare_schur import schur_solution


def certified_solution(game: Game) -> tuple[np.ndarray, Certificate]:
    """P of A'P + P A + Q - P S P = 0 and its certificate, all of whose tests hold.

    P: (n, n) symmetric, read-only.  Raises NoSolutionError with the reason of the first test that failed.
    """
    P, checks = _first_derivation(game)
    checks += (agreement_check(game, P, iterated_solution(game)),)
    _refuse_failures(checks)
    P.setflags(write=False)
    return P, Certificate(checks)


def has_value(game: Game) -> bool:
    """True when every test of the certificate holds that needs no second derivation.

    Meant for searches over delta: within 1e-4 of the smallest delta the second derivation would need hundreds
    of steps, while the sign of P and the spectrum of the Hamiltonian still decide at once.
    """
    try:
        _first_derivation(game)
    except NoSolutionError:
        return False
    return True


def _first_derivation(game: Game) -> tuple[np.ndarray, tuple[Check, ...]]:
    checks = hamiltonian_checks(game)
    _refuse_failures(checks)
    P = schur_solution(game)
    checks += solution_checks(game, P)
    _refuse_failures(checks)
    return P, checks


def _refuse_failures(checks: tuple[Check, ...]) -> None:
    for check in checks:
        if not check.ok:
            raise NoSolutionError(check.reason)
