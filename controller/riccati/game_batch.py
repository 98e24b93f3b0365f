"""Exact solutions of many games with different A and B and the same weights."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.certificate import carefully_certified, certified_stack
from controller.riccati.normal_form import NormalForm
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.matrices import LARGEST
from hfa_support.reporting.report import Reported

#: Games of one stack: enough to forget the cost of a call, few enough for the cache.
TOGETHER = 250


@dataclass(frozen=True, eq=False, repr=False)
class GameBatch(Reported):
    """Certified solutions of N games.

    P: (N, n, n), nan if not certified
    K: (N, m, n), nan if not certified
    certified: (N,), True if the solution of the game is certified
    reasons: N lines, the reason for a missing certificate, or "" for a certified solution
    """

    P: np.ndarray
    K: np.ndarray
    certified: np.ndarray
    reasons: tuple[str, ...]


@checks_arguments
def solve_games(A: np.ndarray, B: np.ndarray, like: Game) -> GameBatch:
    """Return the certified solutions of N games with different A and B and the same weights.

    A: (N, n, n)
    B: (N, n, m)
    like: game with E, Q, R and delta of all games

    Raises BadInputError for wrong shapes, and with the index of the first plant that has an invalid
    entry.
    """
    A = np.asarray(A, dtype=float)
    B = np.asarray(B, dtype=float)
    _refuse_bad_plants(A, B, like)
    P = np.full_like(A, np.nan)
    K = np.full_like(B.mT, np.nan)

    def solve(first: int) -> list[str]:
        """Write P and K of `TOGETHER` games, and return the reasons for missing certificates.

        first: index of the first of these games
        """
        part = slice(first, first + TOGETHER)
        form = NormalForm.of_plants(A[part], B[part], like)
        finite = np.flatnonzero(form.is_finite)
        sound = form if len(finite) == len(form.A) else form[finite]
        X = certified_stack(sound).X
        P[first + finite] = sound.value(X)
        K[first + finite] = sound.gain(X)
        reasons = ["" for _ in form.A]
        failed = np.flatnonzero(np.isnan(K[part]).any(axis=(1, 2)))
        for i in failed.tolist():
            try:
                careful = carefully_certified(form[i])
            except NoSolutionError as failure:
                reasons[i] = str(failure)
                continue
            P[first + i] = careful.form.value(careful.X)
            K[first + i] = careful.form.gain(careful.X)
        return reasons

    with ThreadPoolExecutor(os.cpu_count()) as pool:  # LAPACK runs beside other threads
        reasons = tuple(chain.from_iterable(pool.map(solve, range(0, len(A), TOGETHER))))
    certified = np.array([not reason for reason in reasons])
    return GameBatch(P, K, certified, reasons)


def _refuse_bad_plants(A: np.ndarray, B: np.ndarray, like: Game) -> None:
    """Raise BadInputError if A and B are not (N, n, n) and (N, n, m), or if a plant is invalid."""
    if A.ndim != 3 or B.ndim != 3 or A.shape[:2] != B.shape[:2] or A.shape[1] != A.shape[2]:
        raise BadInputError(
            f"A has shape {A.shape} and B has shape {B.shape}; give stacks (N, n, n) and (N, n, m)"
        )
    sound = (np.abs(A) <= LARGEST).all(axis=(1, 2)) & (np.abs(B) <= LARGEST).all(axis=(1, 2))
    suspects = [*range(min(len(A), 1)), *np.flatnonzero(~sound)[:1]]
    for i in suspects:
        try:
            replace(like, A=A[i], B=B[i])
        except BadInputError as error:
            raise BadInputError(f"model {i} of the batch: {error}") from error
