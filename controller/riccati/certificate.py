"""Certificate of a game solution: tests that distinguish the value of the game from other roots.

A root P of the Riccati equation with a residual of 1e-13 may be non-stabilizing, indefinite (delta
below its minimum), or the solution of another game. Only all tests together are sufficient. The
tests are made in normal form. The verdict therefore does not depend on the user's units. Source:
Basar and Bernhard, H-infinity Optimal Control, Theorem 4.11; Zhou, Doyle and Glover, Chapter 13.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controller.riccati.balancing import balanced, largest, largest_or_1, norms, spectrum
from controller.riccati.derivations import (
    SETTLED,
    by_doubling,
    by_eigenvectors,
    inverses,
)
from controller.riccati.normal_form import MODERATE, RANK, NormalForm
from controller.riccati.sensitivity import gain_change, gain_change_bounds
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import spectral_radius
from hfa_support.reporting.checks import RELATIONS, Check, Checked, at_least, at_most, checked
from hfa_support.reporting.results import Result

#: Smallest relative distance to the imaginary axis, four orders above rounding. Nearer to the axis,
#: rounding hides whether the Hamiltonian has n stable eigenvalues.
AXIS_DISTANCE = 1e-12
#: Relative change of the entries of a game by rounding: eight last bits.
ENTRIES = 8.0 * float(np.finfo(float).eps)
RESIDUAL = 1e-10
ASYMMETRY = 1e-12
#: Magnitude of a negative eigenvalue of P, relative to the largest entry, that counts as rounding.
INDEFINITENESS = 1e-10
DISAGREEMENT = 1e-8
#: Largest relative change of K for one unit in the last place of the entries of the game.
GAIN_CHANGE = 1e-2
#: A larger change of K is reported. The bounds of a stack are then replaced by the change itself.
NOTICEABLE = 1e-6
#: Above this limit, the lower bound of the reach from the closed loop is used. Below it, the least
#: reach is searched for.
CLEAR_REACH = 1e3 * RANK

#: Test of the plant: name -> relation, limit, and reason for a failure.
TEST_OF_REACH = {
    "reach": (
        ">",
        RANK,
        "a relative change {:.2g} of A and B makes a mode that does not decay uncontrollable",
    ),
}
#: Tests of P: name -> relation, limit, and reason for a failure.
TESTS_OF_P = {
    "residual": ("<=", RESIDUAL, "the residual of the Riccati equation is {:.2g}"),
    "symmetry": ("<=", ASYMMETRY, "P is not symmetric ({:.2g} relative)"),
    "positive_semidefinite": (
        ">=",
        -INDEFINITENESS,
        "the computed P is indefinite (smallest eigenvalue {:.3g} of the largest entry)",
    ),
    "game_loop_abscissa": ("<", 0.0, "A - S P is not Hurwitz (abscissa {:+.3g} 1/s)"),
    "control_loop_abscissa": ("<", 0.0, "A - B K is not Hurwitz (abscissa {:+.3g} 1/s)"),
}
#: Test of the second derivation: name -> relation, limit, and reason for a failure.
TEST_OF_AGREEMENT = {
    "second_derivation": (
        "<=",
        DISAGREEMENT,
        "the second derivation gives another P (difference {:.2g})",
    ),
}
#: Test of the sensitivity of K: name -> relation, limit, and reason for a failure.
TEST_OF_SENSITIVITY = {
    "gain_change": (
        "<=",
        GAIN_CHANGE,
        "K has no reliable digits: one unit in the last place of the entries of the game changes K"
        " by up to {:.2g}, relative; give slow modes more weight in Q, or set entries that are only"
        " rounding to 0",
    ),
}
TESTS_OF_A_STACK = TEST_OF_REACH | TESTS_OF_P | TEST_OF_AGREEMENT | TEST_OF_SENSITIVITY
#: Name of a test -> its value for one game, or its values (N,) for a stack.
Measured = dict[str, Any]


@dataclass(frozen=True)
class Certificate(Checked, Result):
    """Tests of a solution P of the Riccati equation. The solution is certified if all tests pass.

    checks: the tests
    """

    checks: tuple[Check, ...]

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {"checks": self.checks, "ok": self.ok}


class Loops(NamedTuple):
    """Closed loops A - S X and A - B K of a solution X, for one game or for a stack of games.

    game: (..., n), eigenvalues of A - S X
    control: (..., n), eigenvalues of A - B K, K = B'X
    right: (..., n, n), eigenvectors of A - B K
    left: (..., n, n), inverse of `right`
    """

    game: np.ndarray
    control: np.ndarray
    right: np.ndarray
    left: np.ndarray


class Certified(NamedTuple):
    """Certified solution X of the Riccati equation of one game.

    X: (n, n), solution in the coordinates of `form`
    form: normal form of the game, possibly in other coordinates than those that `NormalForm.of`
        gives
    certificate: the passed tests
    loops: closed loops of X
    """

    X: np.ndarray
    form: NormalForm
    certificate: Certificate
    loops: Loops


def certified_solution(form: NormalForm, given: NormalForm | None = None) -> Certified:
    """Return the certified solution of one game.

    The eigenvectors of the Hamiltonian are tried first (`certified_stack`), then the Schur form
    (`carefully_certified`). The solution is given in the coordinates of the returned form. These
    coordinates may differ from those of the given form.

    given: as for `carefully_certified`

    Raises NoSolutionError as `carefully_certified` does.
    """
    stack = certified_stack(form[None])
    if stack.holds[0]:
        loops = Loops(*(array[0] for array in stack.loops))
        return Certified(stack.X[0], form, Certificate(stack.checks(0)), loops)
    return carefully_certified(form, given)


class CertifiedStack(NamedTuple):
    """Solutions of N games by eigenvectors and doubling, with their tests.

    X: (N, n, n), nan if a test of the game fails; a failure may be due to rounding alone
    holds: (N,), True if all tests of the game pass
    measured: name of a test -> measured values, (N,)
    loops: closed loops of X
    """

    X: np.ndarray
    holds: np.ndarray
    measured: Measured
    loops: Loops

    def checks(self, index: int) -> tuple[Check, ...]:
        """Return the tests of one game.

        index: index of the game in the stack
        """
        values = {name: array[index] for name, array in self.measured.items()}
        distance = values["hamiltonian_axis_distance"]
        stable = values["hamiltonian_split"]
        return (
            *_hamiltonian_checks(distance, 0.0, stable, self.X.shape[-1]),
            *checks_of(TESTS_OF_A_STACK, values),
        )


def certified_stack(form: NormalForm) -> CertifiedStack:
    """Return the solutions of a stack of N games, by eigenvectors and doubling, with their tests.

    form: normal forms of the games

    Raises NoSolutionError if the entries of a game overflow.
    """
    _refuse_overflow(form)
    with np.errstate(all="ignore"):  # a solution that overflows is not certified
        derived = by_eigenvectors(form)
        X = derived.X
        good = (largest(X) <= 1.0 / MODERATE) & (derived.correction <= SETTLED)
        good &= derived.stable == X.shape[-1]
        good &= derived.axis_distance >= AXIS_DISTANCE
        X = np.where(good[:, None, None], X, 0.0)
        loops = closed_loops(form, X, derived.loop)
        measured = measured_solution(form, X, loops)
        measured |= measured_agreement(X, by_doubling(form, derived.eigenvalues))
        measured["game_loop_abscissa"] += derived.spread
        measured["gain_change"] = gain_change_bounds(form, X, *derived.eigenvectors)
        good &= measured["gain_change"] <= NOTICEABLE
        measured["reach"] = shown_reach(form, X, loops)
        hidden = good & ~(measured["reach"] > CLEAR_REACH)
        if hidden.any():
            measured["reach"][hidden] = sought_reach(form[hidden])
        for name, (relation, limit, _) in TESTS_OF_A_STACK.items():
            good &= RELATIONS[relation](measured[name], limit)
    measured["hamiltonian_axis_distance"] = derived.axis_distance
    measured["hamiltonian_split"] = derived.stable
    return CertifiedStack(np.where(good[:, None, None], X, np.nan), good, measured, loops)


def carefully_certified(form: NormalForm, given: NormalForm | None = None) -> Certified:
    """Return the certified solution of one game by the Schur form and refined doubling.

    The coordinates of `turned` are tried first, then the coordinates of `levelled`.

    given: the game in the coordinates of its entries, if `form` is already `turned`

    Raises NoSolutionError if the game's entries overflow, if the inputs do not reach a mode that
    does not decay, or if the tests fail in all coordinates, with the reason of the last failure.
    """
    _refuse_overflow(form)
    reached = reach_checks(form)
    refuse_failures(reached)
    turned = form.turned()
    try:
        X, accurate, checks = _certified_in(turned)
    except NoSolutionError:
        levelled = form.levelled()
        if levelled is turned:
            raise
        X, accurate, checks = _certified_in(levelled, form)
    change = gain_change(accurate, X, given or form)
    sensitivity = checks_of(TEST_OF_SENSITIVITY, {"gain_change": change})
    refuse_failures(sensitivity)
    certificate = Certificate(checks[:2] + reached + checks[2:] + sensitivity)
    return Certified(X, accurate, certificate, closed_loops(accurate, X))


def reach_checks(form: NormalForm) -> tuple[Check, ...]:
    """Return the check of stabilizability, as a tuple with one check.

    The effect of the inputs on every mode that does not decay must exceed rounding errors.

    form: normal form of the game before `turned`, which would replace exact zeros with rounding
        errors
    """
    return checks_of(TEST_OF_REACH, {"reach": sought_reach(form[None])[0]})


def sought_reach(form: NormalForm) -> np.ndarray:
    """Return the smallest effect of the inputs on a mode that does not decay, for N games, (N,).

    The measure is `least_reach` of A and B.
    """
    from controller.riccati.reach import least_reach

    return least_reach(form.A, form.B)


def shown_reach(form: NormalForm, X: np.ndarray, loops: Loops) -> np.ndarray:
    """Return a lower bound of `least_reach` of each game, (N,), from the closed loop A - B K.

    For every unit vector w and every λ with Re λ >= 0, w*[A - λI, B] [I; -K] = w*(A - B K - λI).
    The norm of this row is at least the distance of λ from the eigenvalues of A - B K, divided by
    the condition number of the eigenvectors (Bauer and Fike). The bound is relative to |A| + |B| +
    |λ|, for the least favorable |λ|. Rounding is subtracted.

    form: normal forms of N games
    X: (N, n, n), solutions of the games
    loops: closed loops of X
    """
    decay = -loops.control.real.max(axis=-1)
    condition = norms(loops.right) * norms(loops.left)
    gains = np.sqrt(1.0 + norms(form.B.mT @ X) ** 2)
    sizes = norms(form.A) + norms(form.B) + np.abs(loops.control).max(axis=-1) + decay
    rounding = X.shape[-1] * np.finfo(float).eps * condition
    return decay / (condition * gains * sizes) - rounding


def _certified_in(
    form: NormalForm, given: NormalForm | None = None
) -> tuple[np.ndarray, NormalForm, tuple[Check, ...]]:
    """Return the solution X computed in the coordinates of `form`, the form, and the tests of X."""
    from controller.riccati.careful_derivations import by_refined_doubling, by_schur

    checks = hamiltonian_checks(form, given)
    refuse_failures(checks)
    X = by_schur(form)
    checks += solution_checks(form, X)
    refuse_failures(checks)
    checks += agreement_checks(X, by_refined_doubling(form))
    refuse_failures(checks)
    return X, form, checks


def hamiltonian_checks(form: NormalForm, given: NormalForm | None = None) -> tuple[Check, ...]:
    """Return the checks of the eigenvalues of H = [[A, -S], [-Q, -A']].

    H must have n eigenvalues on each side of the imaginary axis, and none near the axis.

    given: form before `levelled`, if `form` is the result of `levelled`, otherwise None. If the
        other checks pass, a further check shows that rounding of the given entries cannot move an
        eigenvalue to the axis. Levelling enlarges the effect of this rounding.

    Raises NoSolutionError if entries of H overflow.
    """
    _refuse_overflow(form)
    of_hamiltonian = spectrum(form.hamiltonian)
    stable = int(np.sum(of_hamiltonian.eigenvalues.real < 0.0))
    distance, frequency = of_hamiltonian.nearest_to_axis()
    checks = _hamiltonian_checks(distance, frequency, stable, len(form.A))
    if given is None or not all(check.ok for check in checks):
        return checks
    frequencies = np.unique(np.append(np.abs(of_hamiltonian.eigenvalues.imag), frequency))
    change = distance_by_entries(given, form, frequencies)
    reason = (
        f"a relative change {change:.2g} of A, B, E and Q may put an eigenvalue of the"
        " Hamiltonian on the imaginary axis"
    )
    return (*checks, at_least("hamiltonian_entries", change, ENTRIES, reason))


def is_clearly_split(form: NormalForm) -> bool:
    """Return whether a bound shows that both `hamiltonian_checks` of the eigenvalues hold.

    The eigenvalues are as far from the imaginary axis as required if the smallest |Re λ|, divided
    by the condition number of the eigenvectors, is (Bauer and Fike). If the result is False, the
    checks may nevertheless hold.
    """
    if not form.is_finite:
        return False
    H, _ = balanced(form.hamiltonian)
    values, vectors = np.linalg.eig(H)
    with np.errstate(all="ignore"):  # nothing is shown by a condition number that overflows
        condition = norms(vectors) * norms(inverses(vectors))
        distance = np.abs(values.real).min() / condition
        is_halved = np.sum(values.real < 0.0) == len(form.A)
        return bool(is_halved and distance >= AXIS_DISTANCE * norms(H))


def distance_by_entries(given: NormalForm, levelled: NormalForm, frequencies: np.ndarray) -> float:
    """Return the smallest relative change of entries that may give the Hamiltonian an eigenvalue
    jω.

    The result is the least over the frequencies ω of 1 / ρ(|(H - jω I)⁻¹| |H|), or 0 if H - jω I
    is singular. The entries are those of A, B B', E E' and Q. The inverse is computed in the
    levelled coordinates, and |H| contains the magnitudes of the terms of the entries of H. The
    result does not depend on units.

    Source: Higham, Accuracy and Stability of Numerical Algorithms, Section 7.2.
    """
    n = len(given.A)
    into = levelled.T * given.units  # from the given to the levelled coordinates
    back = np.linalg.inv(into)
    zero = np.zeros((n, n))
    to_levelled = np.block([[into, zero], [zero, back.T]])
    to_given = np.block([[back, zero], [zero, into.T]])
    largest_growth = 0.0
    for frequency in frequencies:
        shifted = levelled.hamiltonian - 1j * frequency * np.eye(2 * n)
        try:
            inverse = np.linalg.inv(shifted)
            growth = np.abs(to_given @ inverse @ to_levelled) @ given.hamiltonian_sizes
            radius = spectral_radius(growth)
        except np.linalg.LinAlgError:  # singular, or overflow
            return 0.0
        largest_growth = max(largest_growth, radius)
    return 1.0 / largest_growth


def _hamiltonian_checks(
    distance: float, frequency: float, stable: int, n: int
) -> tuple[Check, ...]:
    near = (
        f"a change of {distance:.2g} of the Hamiltonian, relative, puts an eigenvalue on the"
        f" imaginary axis at {frequency:.4g} rad/s"
    )
    split = f"the Hamiltonian has {stable} stable eigenvalues instead of {n}"
    return (
        at_least("hamiltonian_axis_distance", distance, AXIS_DISTANCE, near),
        checked("hamiltonian_split", stable, n, split, relation="=="),
    )


def solution_checks(form: NormalForm, X: np.ndarray) -> tuple[Check, ...]:
    """Return the checks of the solution X of one game: equation, symmetry, sign and both closed
    loops.

    If X is not finite, only a failed check of the equation is returned.
    """
    if not np.all(np.isfinite(X)):
        reason = "P has entries that are not finite"
        return (at_most("residual", np.nan, RESIDUAL, reason),)
    return checks_of(TESTS_OF_P, measured_solution(form, X, closed_loops(form, X)))


def agreement_checks(X: np.ndarray, second_X: np.ndarray) -> tuple[Check, ...]:
    """Return the check that two derivations of the solution agree, max |X - X2| / max |X|.

    The result is a tuple with this one check.
    """
    return checks_of(TEST_OF_AGREEMENT, measured_agreement(X, second_X))


def closed_loops(form: NormalForm, X: np.ndarray, game: np.ndarray | None = None) -> Loops:
    """Return the closed loops A - S X and A - B K of finite solutions X, K = B'X.

    form: normal form of one game, or of a stack of games
    X: (..., n, n)
    game: (..., n), eigenvalues of A - S X, or None to compute them
    """
    if game is None:
        game = np.linalg.eigvals(form.A - form.S @ X)
    control, right = np.linalg.eig(form.A - form.B @ (form.B.mT @ X))
    return Loops(game, control, right, inverses(right))


def measured_solution(form: NormalForm, X: np.ndarray, loops: Loops) -> Measured:
    """Return test -> measured value for the tests `TESTS_OF_P` of finite solutions X.

    Each value is a number for one game, and an array (N,) for a stack of games.
    """
    size = largest_or_1(X)
    return {
        "residual": form.relative_residual(X),
        "symmetry": largest(X - X.mT) / size,
        "positive_semidefinite": np.linalg.eigvalsh(X)[..., 0] / size,
        "game_loop_abscissa": loops.game.real.max(axis=-1),
        "control_loop_abscissa": loops.control.real.max(axis=-1),
    }


def measured_agreement(X: np.ndarray, second_X: np.ndarray) -> Measured:
    """Return the measured value of the test that two solutions agree (`TEST_OF_AGREEMENT`).

    The value is a number for one game, and an array (N,) for a stack of games.
    """
    return {"second_derivation": largest(X - second_X) / largest_or_1(X)}


def checks_of(tests: Mapping[str, tuple[str, float, str]], measured: Measured) -> tuple[Check, ...]:
    """Return the checks of one game, from the measured values of its tests.

    tests: name -> (relation, limit, reason for a failure)
    measured: name -> measured value
    """
    checks = []
    for name, (relation, limit, reason) in tests.items():
        value = float(measured[name])
        checks.append(checked(name, value, limit, reason.format(value), relation=relation))
    return tuple(checks)


def _refuse_overflow(form: NormalForm) -> None:
    if not form.is_finite.all():
        raise NoSolutionError(
            "the computation overflows, because the entries of the game differ too much in size; "
            "check the scaling of A, B, E, Q and R"
        )


def refuse_failures(checks: tuple[Check, ...]) -> None:
    """Raise NoSolutionError with the reason of the first failed check."""
    for check in checks:
        if not check.ok:
            raise NoSolutionError(check.reason)
