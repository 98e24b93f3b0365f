"""Proofs that a game has a value, and that it has none.

Sources: Zhou, Doyle and Glover, Robust and Optimal Control, Theorems 13.7 and 13.20 and Chapter 16;
Basar and Bernhard, H-infinity Optimal Control, Theorems 3.7 and 4.11.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    BITS,
    Near,
    ball_matrix,
    identity,
    is_positive_definite,
    norm,
    precision,
    stacked,
)
from controller.riccati.candidate import Candidate, half_plane_in_doubles
from controller.riccati.equation import Equation
from controller.riccati.lyapunov import NotProvedError, change_along, stability_of
from controller.riccati.rationals import (
    MOST_STATES,
    RationalGame,
    boundary_root,
    unreachable_modes,
    unstable_root,
)
from hfa_support.errors import NoSolutionError

if TYPE_CHECKING:
    from flint import arb_mat


#: Largest |F'Y + Y F + 1| of the loop F at X. With the 3/4 that remain, |Z| <= ζ Y.
DEFECT = 0.25


class Stabilizing(NamedTuple):
    """Ball that contains the stabilizing solution P: the loop of both players is stable.

    P: (n, n)
    gains: of P, of both players, (m + k, n)
    near: P and the gains, `Near`, if the proof is by doubles
    """

    equation: Equation
    P: arb_mat
    gains: arb_mat
    near: tuple[Near, Near] | None


def stabilizing(candidate: Candidate) -> Stabilizing:
    """Return the ball about X that is proved to contain the stabilizing solution.

    Raises NotProvedError if the candidate does not prove it.
    """
    from flint import arb

    equation, X, gains, residual, loop, Y = candidate
    near = (Near.of(X), Near.of(gains)) if isinstance(loop, Near) else None
    X, gains = ball_matrix(X), ball_matrix(gains)
    try:
        judged, at = (equation, X) if near is None else (equation.in_doubles, near[0])
        sensitivity = judged.sensitivity(at, loop)
    except ZeroDivisionError:
        raise NotProvedError("the weight at X may be singular") from None
    # The loop is stable if Y > 0 decreases along it.
    one = Near(np.eye(equation.n)) if isinstance(loop, Near) else identity(equation.n)
    defect = norm(change_along(loop, Y, is_discrete=equation.is_discrete) + one)
    if not (defect < DEFECT and is_positive_definite(Y)):
        raise NotProvedError("the loop of both players at X")
    # The solution is proved to be X + Z with -ζ Y <= Z <= ζ Y.
    size, zeta = norm(Y), 4 * norm(residual)
    largest_change = zeta * size  # of X
    loop_change = sensitivity.loop * largest_change
    if not sensitivity.weight * largest_change <= 0.5:
        raise NotProvedError("the weight near X")
    # The loop F + G of X + Z has the defect of F and |G'Y + Y G|, in discrete time
    # |G'Y F + F'Y G + G'Y G|: less than 1 together. Half of the latter, times ζ, bounds the
    # quadratic term q(Z) of the residual at X + Z, as |q(Z)| <= |Z| |G|, in discrete time
    # |Z| |G| |F|: |r| + |q(Z)|, with the residual r at X, is then at most 1/2 ζ.
    twice_through = 2 * norm(loop) + loop_change if equation.is_discrete else 2
    further_defect = size * loop_change * twice_through
    if not further_defect < 0.5:
        raise NotProvedError("the loop of both players near X")
    # This Z solves F'Z + Z F + r + q(Z) = 0, linear but for the small q(Z), in discrete time
    # likewise: F'(ζ Y ± Z) + (ζ Y ± Z) F <= 0, and so ζ Y ± Z >= 0, also with the smaller ζ of
    # ζ (1 - defect) = |r| + |q(Z)|.
    zeta = (norm(residual) + further_defect * zeta / 2) / (1 - defect)
    # |Z_ij| <= s_i s_j with the roots s of the diagonal of ζ Y.
    diagonal = (
        np.diag(Y.middle).tolist() if isinstance(Y, Near) else [Y[i, i] for i in range(equation.n)]
    )
    s = ball_matrix([[(zeta * entry).sqrt().upper() for entry in diagonal]])
    plus_minus = arb(0, 1)  # all numbers from -1 to 1
    ones = ball_matrix(np.ones((gains.nrows(), 1)))
    of_gains = ones * s * (sensitivity.gains * norm(s) * plus_minus)
    if near is not None:  # |Z| <= |s|² in the norm of Frobenius
        of_X = norm(s) ** 2
        near = near[0].widened(of_X), near[1].widened(sensitivity.gains * of_X)
    return Stabilizing(equation, X + s.transpose() * s * plus_minus, gains + of_gains, near)


def why_not_the_value(found: Stabilizing) -> str:
    """Return "" if the stabilizing solution is proved to be the value of the game, or why it is
    proved not to be. That the game without disturbance has a value is a premise, which is not
    proved here.

    Proved are two conditions:
    - The input of each player costs this player: R > 0 and δ² > 0, in discrete time R + B'P B > 0
      and δ² - E'P E > 0.
    - The loop without disturbance, A - B K, is stable.

    Raises NotProvedError if the ball proves neither.
    """
    equation, P, gains, near = found
    if near is not None and all(met for met, _ in _conditions(equation.in_doubles, *near)):
        return ""
    is_decided = True
    for is_met, reason in _conditions(equation, P, gains):
        if is_met is False:
            return reason
        is_decided = is_decided and is_met is True
    if not is_decided:
        raise NotProvedError("a player pays, or the loop without disturbance is not stable")
    return ""


def _conditions(equation: Equation, P: Any, gains: Any) -> Iterator[tuple[bool | None, str]]:
    """Yield whether each condition of `why_not_the_value` is met, None if neither is proved, and
    what it means if it is not.
    """
    of_inputs, of_disturbances = equation.weights(P)
    inputs_gain = "in one step, an input gains cost: R + B'P B is indefinite"
    yield is_positive_definite(of_inputs), inputs_gain
    if of_disturbances is None:
        return  # A - B K is the loop of both players, which is stable for any `Stabilizing`
    delta, loop = equation.delta, equation.control_loop(gains)
    yield (
        is_positive_definite(of_disturbances),
        f"in one step, the disturbance gains more than {delta:.6g} squared of its cost",
    )
    yield (
        stability_of(loop, is_discrete=equation.is_discrete),
        f"for every input, the gain from the disturbance is at least {delta:.6g}",
    )


#: An eigenvalue whose real part is below this fraction of its size may be on the axis. It proposes
#: frequencies only: the signs of a Hermitian form decide.
MAYBE_ON_AXIS = 1e-4
#: Changes of basis, with the digits of doubles, after which a Hermitian form must be diagonal.
_CONGRUENCES = 4


class ModeError(NoSolutionError):
    """Raised if a mode that no input reaches, or an undamped mode without cost, is the reason why
    no delta has a solution.
    """


def why_no_value(equation: Equation, frequency: float | None = None, *, in_bits: bool) -> str:
    """Return that the gain from the disturbance is proved too large at some frequency, or "".

    equation: of the game
    frequency: at which it may be too large, rad/s or rad/step
    in_bits: whether eigenvalues are computed in many bits, for what doubles do not see
    """
    if frequency is not None and (reason := too_large_at(equation, frequency)):
        return reason
    values = half_plane_eigenvalues(equation, in_bits=in_bits)
    between = between_eigenvalues(values, is_discrete=equation.is_discrete)
    return next(filter(None, (too_large_at(equation, middle) for middle in between)), "")


def too_large_at(equation: Equation, frequency: float) -> str:
    """Return that the gain from the disturbance is proved too large at a frequency, or "".

    The signs of the Hermitian form of the pencil (`_has_other_signs`) then differ from those of a
    game with a value.

    frequency: rad/s, in discrete time rad/step
    """
    if not _has_other_signs(equation, frequency):
        return ""
    if not equation.is_disturbed:
        return "the cost has no lower bound: some input makes it as negative as it likes"
    unit = "rad/step" if equation.is_discrete else "rad/s"
    return (
        f"for every input, the gain from the disturbance is at least {equation.delta:.6g}"
        f" (at {frequency:.4g} {unit})"
    )


def between_eigenvalues(values: np.ndarray, *, is_discrete: bool) -> list[float]:
    """Return frequencies between those of the eigenvalues that may be on the stability boundary.

    Those in the widest gaps come first, rad/s, in discrete time rad/step.

    values: eigenvalues of `half_plane_matrix`
    """
    values = values[np.isfinite(values)]
    near_axis = np.abs(values.real) <= MAYBE_ON_AXIS * np.abs(values)
    frequencies = np.unique(np.abs(values.imag[near_axis]))
    if is_discrete:
        frequencies = np.append(2.0 * np.arctan(frequencies), math.pi)
    ends = [0.0, *frequencies.tolist()]
    gaps = sorted(pairwise(ends), key=lambda gap: gap[0] - gap[1])
    # An end may be noise: the geometric mean is far from a high one, the other from a low one.
    geometric = [math.sqrt(low) * math.sqrt(high) for low, high in gaps]
    between = *geometric, *((low + high) / 2.0 for low, high in gaps)
    # Both ends are tried, too. The number of frequencies bounds the work.
    return list(dict.fromkeys([0.0, *between, ends[-1]]))[: len(values) + 2]


def half_plane_eigenvalues(equation: Equation, *, in_bits: bool) -> np.ndarray:
    """Return the eigenvalues of `half_plane_matrix`, rounded to doubles, or none if that fails.

    in_bits: whether they are computed with the bits of `precision`
    """
    from flint import acb_mat

    with np.errstate(all="ignore"):
        try:
            if in_bits:
                values = acb_mat(equation.half_plane_matrix()).eig(algorithm="approx")
                return np.array([complex(value) for value in values])
            return np.linalg.eigvals(half_plane_in_doubles(equation))
        except (np.linalg.LinAlgError, ValueError, ZeroDivisionError):
            return np.zeros(0, dtype=complex)


def _has_other_signs(equation: Equation, frequency: float) -> bool:
    """Return whether the Hermitian form of the pencil at z is proved to have other signs than that
    of a game with a value.

    A value X makes [[-S, A - z], [(A - z)*, Q]], in discrete time [[0, A - z, G], [(A - z)*, Q, C],
    [G', C', W]], congruent to that of the stable loop, [[-S, F - z], [(F - z)*, 0]], in discrete
    time beside the weight W + G'X G: n of its signs are positive, in discrete time n + m.
    """
    from flint import acb, acb_mat

    n = equation.n
    if equation.is_discrete:
        z, positive = acb(0, frequency).exp(), n + equation.B.ncols()
        A, G, Q, W, C = (equation.A, equation.G, equation.Q, equation.W, equation.C)
        blocks = [[A * 0, A, G], [A.transpose(), Q, C], [G.transpose(), C.transpose(), W]]
    else:
        z, positive = acb(0, frequency), n
        A, S, Q = equation.blocks()
        blocks = [[-S, A], [A.transpose(), Q]]
    form = acb_mat(stacked(blocks))
    for k in range(n):
        form[k, n + k] -= z
        form[n + k, k] -= z.conjugate()
    for _ in range(_CONGRUENCES):
        middle = np.array([[complex(entry) for entry in row] for row in form.tolist()])
        if not np.isfinite(middle).all():
            return False
        values, V = np.linalg.eigh(middle)
        with np.errstate(all="ignore"):
            V = V / np.sqrt(np.abs(values))
        form = acb_mat(V.conj().T.tolist()) * form * acb_mat(V.tolist())
        rest = form - acb_mat(np.diag(np.sign(values)).tolist())
        if sum(abs(entry) ** 2 for entry in rest.entries()) < 1:
            return int((values > 0.0).sum()) != positive
    return False


def refuse_modes(game: Game) -> None:
    """Raise ModeError if no delta has a value because of one mode, decided in rationals.

    Without a disturbance, the stabilizing solution exists if and only if the inputs reach all
    modes that are not stable, and all undamped modes have a cost.
    """
    if len(game.A) > MOST_STATES:
        return
    exact, discount = RationalGame.of(game), game.discount
    # A mode that no input reaches and that is not stable.
    unreached = unreachable_modes(exact.A, exact.B)
    unstable = unstable_root(unreached, discount, is_discrete=game.is_discrete)
    if unstable is not None:
        mode = _mode_text(unstable * math.sqrt(discount), game)
        raise ModeError(
            f"(A, B) is not stabilizable: no input reaches the {mode}; change B or leave that mode"
            " out of A"
        )
    # An undamped mode without cost, which is found only with R⁻¹ and without a discount.
    if exact.R.rank() < exact.R.nrows() or discount != 1.0:
        return
    plain = exact.without_cross_weights
    without_cost = unreachable_modes(plain.A.transpose(), plain.Q)
    undamped = boundary_root(without_cost, is_discrete=game.is_discrete)
    if undamped is not None:
        raise ModeError(
            f"(A, Q) is not detectable: the undamped {_mode_text(undamped, game)} has no cost; give"
            " it weight in Q"
        )


def _mode_text(value: complex, game: Game) -> str:
    """Return the name of a mode for a message, "mode with eigenvalue 0.5 ± 1i"."""
    pair = f" ± {abs(value.imag):.4g}i" if value.imag else ""
    whose = " of sqrt(discount) A" if game.is_discrete else ""
    return f"mode with eigenvalue {value.real + 0.0:.4g}{pair}{whose}"


def has_semidefinite_weights(game: Game) -> bool:
    """Return whether [[Q, N], [N', R]] is proved positive semidefinite, without its rows of zeros.

    False proves nothing: it is also the answer for weights that are symmetric up to rounding only.
    """
    weights = game.weights
    if not np.array_equal(weights, weights.T):
        return False
    has_weight = weights.any(1)
    if not has_weight.any():
        return True
    with precision(BITS):
        return is_positive_definite(weights[np.ix_(has_weight, has_weight)]) is True
