"""Search for the mistake in a wrong critic.

A mistake, or another game that the critic may solve, is named if its reversal removes almost all of
the error. The permitted remaining part is larger for common mistakes in noisy data, and for
networks, which are compared by approximations.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import FUNCTIONS, Critic
from controller.game.basis import basis
from controller.game.zero_sum import Game
from controller.riccati.certificate import form_of
from hfa_support.errors import BadInputError
from verification.critic_errors import SMALL, Exact, matrix_errors
from verification.judged_game import JudgedGame
from verification.reasons.hypotheses import (
    DEGREE,
    EXACT,
    OF_NETWORKS,
    WITH_NOISE,
    Demands,
    Hypothesis,
    View,
    error_of,
    of_columns,
    of_matrix,
    of_rows,
    of_weights,
)
from verification.reasons.other_games import ROUNDING, Answer, OtherGames

#: A P with a smaller residual is a root of the Riccati equation, although possibly the wrong one.
_ROOT = 1e-9
#: If K differs more from the gain that P implies, relatively, K and P do not belong together. A
#: smaller difference may be rounding.
_APART = 0.05
_NOT_TOGETHER = (
    "K is not the gain that P implies: the stored K and P do not belong together, or not to this "
    "plant and R"
)
#: Largest relative error of P with which a network counts as right, and least error of its policy
#: with which the policy counts as wrong.
NEAR = 0.1
FAR = 0.3
#: Number of states at which a network is fitted over the box.
_SAMPLES = 2000


#: An explanation is preferred to later ones whose remaining error is smaller by at most this
#: factor.
_AS_GOOD = 10.0
#: If an explanation leaves a smaller part of the permitted error, other games are not searched.
_CLEAR = 1.0 / 3.0


class Cause(NamedTuple):
    """Mistake that explains an error.

    share: remaining part of the error, relative to the permitted part.
    error: remaining error, relative to the exact matrix.
    says: sentence on the mistake, or "" if no mistake is found.
    """

    share: float
    error: float
    says: str


_NO_CAUSE = Cause(math.inf, math.inf, "")


def named(view: View, hypotheses: Iterable[Hypothesis], demands: Demands) -> Cause:
    """Return the first hypothesis that explains nearly as much of the error as the best hypothesis.

    If no hypothesis explains enough, or if the error is a rounding error, the text of the result is
    "".

    hypotheses: hypotheses in the order of preference
    demands: thresholds for naming a mistake
    """
    before = min(error_of(view, view.judged), 1.0)
    if before <= ROUNDING:
        return _NO_CAUSE
    strictness = 1.0
    if before <= demands.least:
        strictness = demands.left[""] / EXACT.left[""]
    causes = []
    for hypothesis in hypotheses:
        if not is_confirmed(view, hypothesis, demands):
            continue
        error = error_of(view, hypothesis.undo)
        share = error / before / demands.left[hypothesis.fitted] * strictness
        causes.append(Cause(share, error, hypothesis.says))
    errors = [cause.error for cause in causes if cause.share <= 1.0]
    if not errors:
        return _NO_CAUSE
    good = min(_AS_GOOD * min(errors), before * WITH_NOISE.left[""])
    return next(cause for cause in causes if cause.error <= max(good, ROUNDING))


def is_confirmed(view: View, hypothesis: Hypothesis, demands: Demands) -> bool:
    """Return whether enough entries of the critic agree with their values under a hypothesis."""
    errors = view.entry_errors(hypothesis)
    right = np.count_nonzero(errors <= demands.entry)
    return bool(right >= demands.share * len(errors))


def named_with_noise(view: View, hypotheses: Sequence[Hypothesis]) -> str:
    """Return the text of the hypothesis that explains most of the error of noisy data, or "".

    The text includes the remaining error. The error is first measured relative to each entry, then
    with the weights of the view.
    """
    for weighted in (view.relative(), view):
        cause = named(weighted, hypotheses, WITH_NOISE)
        if cause.says:
            return f"{cause.says}; an error of {cause.error:.2g} is left"
    return ""


def diagnose(
    judged: JudgedGame,
    critic: Critic,
    limit: float,
    box: np.ndarray,
    others: OtherGames,
) -> str:
    """Return a sentence that names the mistake in a critic, or "" if no mistake is recognized.

    judged: the game to be solved, and its exact solution
    critic: P and K, K alone, or a network
    limit: largest relative error of a correct P
    box: half-widths of the box of states, (n,), used for a network
    others: other games that the critic may solve (`other_games`)
    """
    game = judged.game
    exact = judged.exact
    if critic.network:
        return _of_network(judged, critic, box, others.of_network)
    value, gain = _views(game, critic, exact.P, exact.K)
    if value is None or critic.P is None:
        return _of_view(gain, _usual(game, gain, critic), others.of_matrix(gain))
    P_is_right = all(check.ok for check in matrix_errors(game, "P", critic.P, exact, limit))
    if P_is_right and critic.feedback is not None and critic.is_quadratic:
        return _rounded(gain)
    if P_is_right:
        mistake = _beyond_quadratic(critic) or _of_view(gain, _usual(game, gain, critic))
    else:
        mistake = _of_view(value, _usual(game, value, critic), others.of_matrix(value))
    if mistake:
        return mistake
    # |K - K_P| with the gain K_P that the critic's P implies, relative to |K| of the solution.
    difference = error_of(gain, gain.exact + gain.judged - judged.game.gain(critic.P))
    if difference > _APART:
        return _NOT_TOGETHER
    return "" if P_is_right else _another_root(judged, critic.P)


def _of_view(
    view: View, usual: Sequence[Hypothesis], other_games: Iterable[Hypothesis] = ()
) -> str:
    """Return the text of the best explanation of the error in a matrix, or ""."""
    cause = named(view, usual, EXACT)
    if not cause.says:
        cause = named(view, other_games, EXACT)
    return cause.says or named_with_noise(view, usual)


def _usual(game: Game, view: View, critic: Critic) -> list[Hypothesis]:
    """Return hypotheses of common mistakes in a matrix of a critic."""
    hypotheses = list(of_matrix(game, view))
    if view.kind == "P" and critic.weights is not None and critic.basis is not None:
        hypotheses += of_weights(critic.weights, view.exact, critic.basis)
    return hypotheses


def _views(game: Game, critic: Critic, P: np.ndarray, K: np.ndarray) -> tuple[View | None, View]:
    """Return the critic's and the exact matrix P, and the critic's and the exact gain K."""
    units = form_of(game).units
    inputs = np.outer(np.sqrt(np.diag(game.R)), units)
    value = None
    if critic.P is not None:
        value = View("P", critic.P, P, np.outer(units, units), alike(P, units))
    return value, View("K", critic.K, K, inputs, alike(P, units))


def alike(P: np.ndarray, units: np.ndarray) -> np.ndarray:
    """Return units (n,) in which each state contributes equally to the value, 1 / √P_ii.

    For a state with almost no cost, the given unit is returned.

    P: exact matrix of the value, (n, n)
    units: units of the states, (n,)
    """
    diagonal = np.diag(P)
    costs = diagonal * units**2
    known = costs > SMALL * costs.max()
    return np.where(known, 1.0 / np.sqrt(np.where(known, diagonal, 1.0)), units)


def _rounded(gain: View) -> str:
    """Return the sentence for a critic whose P is within the limit, but not the gain of this P."""
    return (
        "P is right within the limit; the K that follows from it is off by "
        f"{error_of(gain, gain.judged):.2g}: it needs more digits of P"
    )


def _beyond_quadratic(critic: Critic) -> str:
    """Return a sentence on the largest weight of a basis function that is not quadratic, or ""."""
    if critic.weights is None or critic.basis is None:
        return ""
    beyond = critic.basis.quadratic_size
    if not critic.weights[beyond:].any():
        return ""
    index = beyond + int(np.argmax(np.abs(critic.weights[beyond:])))
    return (
        f"weight {index + 1} is {critic.weights[index]:.6g}: on a linear plant the value is "
        "quadratic, and every weight beyond the quadratic ones must be 0"
    )


def _another_root(judged: JudgedGame, P: np.ndarray) -> str:
    """Return a sentence that P is another root of the Riccati equation, or "" if P is not."""
    residual = float(judged.residuals(P[None])[0])
    loop = judged.game_loop(P)
    if residual > _ROOT or loop.ok:
        return ""
    return (
        f"this is another root of the Riccati equation: its residual is {residual:.2g}, but "
        f"{loop.reason}"
    )


# Networks.


def _of_network(
    judged: JudgedGame,
    critic: Critic,
    box: np.ndarray,
    others: Callable[[View], Iterator[Hypothesis]],
) -> str:
    """Return a sentence on the mistake that explains most of a network's error, or ""."""
    game = judged.game
    exact = judged.exact
    own_policy = "policy" in critic.network and not critic.implies_policy
    at_origin = _network_views(exact, Answer(critic.P, critic.K), critic, box)
    over_box = _network_views(exact, nearest_linear(game, critic, box), critic, box)
    origin_errors = [error_of(view, view.judged) for view in at_origin]
    box_errors = [error_of(view, view.judged) for view in over_box]
    judged_errors = [origin_errors[0]]
    if own_policy:
        judged_errors.append(origin_errors[-1])
    if max(judged_errors) <= SMALL:
        has_constant = np.any(np.array(critic.policy(np.zeros(len(box)))))
        if has_constant and box_errors[-1] <= SMALL:
            return "it is right except for a constant in u"
        return "it solves the linear game at the origin, and differs from its solution away from it"
    parts = slice(None) if own_policy else slice(-1)  # a K that follows from P is not judged
    causes = [_NO_CAUSE]
    for view in (*at_origin[parts], *over_box[parts]):
        hypotheses = list(of_matrix(game, view))
        if view.kind == "P" and "V" not in critic.network:
            hypotheses += of_rows(view, "slope", DEGREE)
            hypotheses += of_columns(view, "state", DEGREE)
        causes.append(named(view, hypotheses, OF_NETWORKS))
    if min(causes).share > _CLEAR:
        causes += _of_variants(game, exact, critic, box)
    if min(causes).share > _CLEAR:
        for view in over_box[parts]:
            causes.append(named(view, others(view), OF_NETWORKS))
    if not own_policy and box_errors[0] <= NEAR and box_errors[-1] > FAR:
        rule = "the step that it implies" if critic.implies_policy else "u = -½ R⁻¹B'∂V/∂z"
        says = (
            f"V is close, but its policy is off by {box_errors[-1]:.2g}: {rule} amplifies small "
            "errors of V"
        )
        causes.append(Cause(1.0, box_errors[0], says))
    return min(causes).says


def _of_variants(game: Game, exact: Exact, critic: Critic, box: np.ndarray) -> Iterator[Cause]:
    """Yield how well another reading of a network's file explains the error, for each reading."""
    views = [
        _network_views(exact, Answer(critic.P, critic.K), critic, box)[0],
        _network_views(exact, nearest_linear(game, critic, box), critic, box)[0],
    ]
    for says, read in critic.variants.items():
        with contextlib.suppress(BadInputError):  # the file no longer exists
            variant = read()
            undone = [Answer(variant.P, variant.K), nearest_linear(game, variant, box)]
            for view, answer in zip(views, undone, strict=True):
                undone_matrix = Hypothesis(says, answer.of_kind(view.kind))
                yield named(view, [undone_matrix], OF_NETWORKS)


def _network_views(exact: Exact, answer: Answer, critic: Critic, box: np.ndarray) -> list[View]:
    """Return views of a network's matrix P, if there is one, and of the network's gain K."""
    # For a network of V, the weights of an entry of P are products of two half-widths of the box.
    # The weights of a row of another matrix are the half-widths, divided by the weighted norm of
    # the exact row.

    def by_row(matrix: np.ndarray) -> np.ndarray:
        sizes = np.linalg.norm(matrix * box, axis=1, keepdims=True)
        return box / np.maximum(sizes, SMALL * sizes.max())

    units = alike(exact.P, box)
    views = []
    if answer.P is not None:
        weights = np.outer(box, box) if "V" in critic.network else by_row(exact.P)
        views.append(View("P", answer.P, exact.P, weights, units))
    views.append(View("K", answer.K, exact.K, by_row(exact.K), units))
    return views


def nearest_linear(game: Game, critic: Critic, box: np.ndarray) -> Answer:
    """Return the quadratic V and the linear u closest to a network over a box.

    Both are fitted by least squares at random states of the box. Constant terms, and linear terms
    of V, are fitted too and then omitted. P of the result is None if the network is a policy.

    box: half-widths of the box of states, (n,)
    """
    n = len(box)
    z = np.random.default_rng(2).uniform(-1.0, 1.0, (_SAMPLES, n))
    symbols = critic.symbols
    names = [name for name in FUNCTIONS if name in critic.network]
    outputs = ca.vertcat(*(critic.network[name](symbols) for name in names))
    samples = np.array(ca.Function("samples", [symbols], [outputs])((z * box).T)).T
    samples = np.nan_to_num(samples, posinf=0.0, neginf=0.0)
    ones = np.ones((_SAMPLES, 1))
    fitted, *_ = np.linalg.lstsq(np.hstack([z, ones]), samples, rcond=None)
    slopes = fitted[:-1].T / box
    if "gradient" not in names:
        return Answer(None, -slopes)
    P = slopes[:n] / 2.0
    if "V" in names:
        quadratic = basis("quadratic", n)
        terms = np.hstack([quadratic.psi(z), z, ones])
        weights, *_ = np.linalg.lstsq(terms, samples[:, 0], rcond=None)
        P = quadratic.matrix(weights) / np.outer(box, box)
    K = -slopes[-len(critic.K) :] if "policy" in names else game.gain(P)
    return Answer(P, K)
