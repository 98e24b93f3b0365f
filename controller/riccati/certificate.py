"""Certificate of a game solution: tests that distinguish the value of the game from other roots.

A root P of the Riccati equation with a residual of 1e-13 may be non-stabilizing, indefinite (delta
below its minimum), or the solution of another game. Only all tests together are sufficient. The
tests are made in balanced units. The verdict therefore does not depend on the user's units. Source:
Basar and Bernhard, H-infinity Optimal Control, Theorem 4.11; Zhou, Doyle and Glover, Chapter 13.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import largest, largest_or_1
from controller.riccati.form import ROUNDED, Form
from controller.riccati.normal_form import NormalForm
from controller.riccati.step_form import StepForm
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, Checked, at_most
from hfa_support.reporting.results import Result

DISAGREEMENT = 1e-8
#: Largest change of K by the last digits of the game's entries.
GAIN_CHANGE = 0.01
#: A gain that changes A by less than this fraction of |A| is compared with this fraction.
NOTICED = 1e-10


@dataclass(frozen=True)
class Certificate(Checked, Result):
    """Tests of a solution P of the Riccati equation. The solution is certified if all tests pass.

    checks: the tests
    """

    checks: tuple[Check, ...]

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {"checks": self.checks, "ok": self.ok}


class Certified(NamedTuple):
    """Certified solution X of the Riccati equation of one game.

    X: (n, n), solution in the coordinates of `form`
    form: form of the game
    certificate: the passed tests
    """

    X: np.ndarray
    form: Form
    certificate: Certificate


def form_of(game: Game) -> Form:
    """Return the form in which a game is solved."""
    return StepForm.of(game) if game.is_discrete else NormalForm.of(game)


def certified_solution(form: Form) -> Certified:
    """Return the certified solution of a game by a Schur form, confirmed by doubling.

    If an eigenvalue of X is far from 1, the game is solved again in states in which X is nearly the
    identity. Otherwise rounding of a cost of 1e12, of a mode that the inputs barely reach, would
    hide all other modes. The second solution is refined by Newton steps only if it differs from the
    first.

    Raises NoSolutionError with the reason of the first failed test.
    """
    balanced, changed = form, form.perturbed_by_rounding()
    try:
        form, X, turns = form.levelled()
    except NoSolutionError:
        _passed(form.axis_checks())  # they have a better reason
        raise
    if turns and (cause := balanced.obstacle(barely=ROUNDED)):
        raise NoSolutionError(cause)  # the states in which X is level make a cost of rounding
    for turn in turns:
        changed = changed.turned(turn)
    checks = _passed(form.axis_checks())
    X = form.refined(X)
    checks += _passed(form.checks(X))
    second_X = form.by_doubling()
    if not agreement(X, second_X).ok:
        second_X = form.refined(second_X)
    checks += _passed((agreement(X, second_X),))
    checks += _passed((gain_change(form, changed, X),))
    return Certified(X, form, Certificate(checks))


def agreement(X: np.ndarray, second_X: np.ndarray) -> Check:
    """Return the check that two derivations of the solution agree, max |X - X2| / max |X|."""
    difference = largest(X - second_X) / largest_or_1(X)
    apart = f"the second derivation gives another P (difference {difference:.2g})"
    return at_most("second_derivation", difference, DISAGREEMENT, apart)


def gain_change(form: Form, changed: Form, X: np.ndarray) -> Check:
    """Return the check that the last digits of the game's entries determine K.

    One further solution, a Newton step from X, belongs to a game whose entries are changed as by
    rounding. The change of K is measured by its effect on the loop, |B (K2 - K)| / |B K|.

    changed: the further game, in the coordinates of `form`

    Raises NoSolutionError if the further game has no solution.
    """
    K, _ = form.gains(X)
    K2, _ = changed.gains(X + changed.newton_step(X))
    size = max(np.linalg.norm(form.inputs @ K), NOTICED * np.linalg.norm(form.A))
    change = float(np.linalg.norm(form.inputs @ (K2 - K)) / (size or 1.0))
    unsure = (
        f"K changes by {100.0 * change:.2g} % if the entries of the game change in their last digit"
    )
    return at_most("gain_change", change, GAIN_CHANGE, unsure)


def _passed(checks: tuple[Check, ...]) -> tuple[Check, ...]:
    """Return checks. Raises NoSolutionError with the reason of the first one that fails."""
    for check in checks:
        if not check.ok:
            raise NoSolutionError(check.reason)
    return checks
