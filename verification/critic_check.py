"""Verdict on a learned critic, compared with the exact solution of its game."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.critic.critic import Critic, from_parts
from controller.critic.critic_file import critic_in, part_by_shape
from controller.critic.reading import Reading
from controller.critic.training_run import TrainingRun
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution, solve
from hfa_support.arguments import ArrayLike
from hfa_support.errors import (
    BadInputError,
    NoSolutionError,
    numbers_in,
    refuse_unless_positive,
    refuse_unless_whole,
    shown,
)
from hfa_support.matrices import labels_of
from hfa_support.progress import Progress
from hfa_support.reporting.parts import Part
from trim.linear.linear_model import LinearModel
from verification.box import Box, usual_box
from verification.critic_errors import LIMIT, critic_errors, is_gain_right
from verification.linear_checks import LinearLoop, value_check
from verification.verdict import Section, Verdict, bias_text

if TYPE_CHECKING:
    from verification.nonlinear_game import NonlinearComparison


#: Default number of initial conditions from which a critic that is not quadratic is simulated, and
#: largest duration of a proof, s of the processor.
FLIGHTS = 100
SECONDS = 10.0
#: What is given as a critic.
_CRITICS = (
    "a critic: write hfa.from_gain(game, K), hfa.from_value(game, P), hfa.from_weights(game, W, "
    "basis=...), hfa.from_network(game, NETWORK) or hfa.read_critic(FILE, game)"
)


def verify(
    game: Game,
    critic: Critic | Solution | TrainingRun | ArrayLike | str | Path,
    *,
    limit: float = LIMIT,
    box: ArrayLike | None = None,
    flights: int = FLIGHTS,
    limit_seconds: float = SECONDS,
    linear: LinearModel | None = None,
    taylor: bool | None = None,
    progress: Progress | None = None,
) -> Verdict:
    """Return the verdict on a critic, compared with the exact solution of its game.

    The checks are:
    - errors of P and K, in norms and entry by entry
    - errors of V, its gradient and the policies in a box of states
    - stability of A - B K
    - P not indefinite, and an L2 gain below delta

    Of a critic that is not quadratic, it is first proved how much it costs, by bounds of its error
    (`verification.network.theorem`). If this fails, it is simulated from states in the box.

    In discrete time, the policy of a quadratic V is optimal for one step, followed by V. A - B K
    and √α (A - B K) must be stable: if the exact policy does not stabilize, the exact critic fails.

    With the linear model of an aircraft, a polynomial of higher degree is judged on the nonlinear
    game, and so is a network with `taylor`: its coefficients up to its degree, and flights from the
    largest part of the box (1, 1/2, 1/4, ...) from which the exact policy converges, which must
    cost at most 5 % more. On the linear game, only its linear part, P and K, is then judged. The
    critic passes if both pass.

    game: the game, in continuous or in discrete time
    critic: the critic, from `hfa.from_gain`, `from_value`, `from_weights`, `from_network` or
        `hfa.read_critic`; or the name of its file; or K, P or W as an array, told by its shape;
        or a solution, or a training run
    limit: limit of the errors and the residual
    box: half-widths (n,) of the box of states; by default typical deviations of the paper's
        aircraft, the limits of the states that a model declares, or balanced units
    flights: number of initial conditions from which a critic that is not quadratic is simulated, if
        its cost is not proved
    limit_seconds: largest duration of this proof, s of the processor; 0 for no proof
    linear: the linear model of the game at a trim of an aircraft, or None
    taylor: whether the critic is judged on the nonlinear game, which requires `linear` and a critic
        that is not quadratic; by default only a polynomial is
    progress: called with (parts done, parts, text) of the comparison there, or None

    Raises NoSolutionError if the game has no certified solution, and BadInputError if `game` is not
    a game, `critic` is not a critic, or the limit is not positive.

    >>> import hfa
    >>> game = hfa.paper.published_game(hfa.paper.level_model(hfa.aircraft(), 0.2))
    >>> K = hfa.solve(game).K
    >>> hfa.verify(game, hfa.from_gain(game, -K)).reason
    'the gain has the wrong sign: the policy is u = -K z'
    """
    refuse_unless_positive("limit", limit)
    refuse_unless_whole("flights", flights, 0)
    if not limit_seconds >= 0.0:
        raise BadInputError(f"limit_seconds is {shown(limit_seconds)}; give a number of at least 0")
    judged = _critic(game, critic, linear)
    exact = solve(game)
    if taylor and (linear is None or judged.is_quadratic):
        missing = "linear=LINEAR of an aircraft" if linear is None else "a network"
        raise BadInputError(f"verify: taylor requires {missing}")
    in_box = usual_box(game) if box is None else _given_box(box, game)
    widths = in_box.half_widths

    # A polynomial, or on request a network, is judged on the nonlinear game and by its linear part.
    nonlinear, nonlinear_part = None, None
    on_nonlinear_game = judged.has_weights if taylor is None else taylor  # a polynomial has weights
    if linear is not None and not judged.is_quadratic and on_nonlinear_game:
        nonlinear, nonlinear_part = _on_nonlinear_game(
            judged, linear, exact, limit, in_box, flights, progress
        )

    # On the linear game, the errors, the loop and the box are judged.
    compared = judged if nonlinear is None else judged.linear_part
    errors = critic_errors(compared, exact, limit, widths)
    loop = LinearLoop(exact, judged, widths, is_exact=all(check.ok for check in errors))
    findings = None  # searched and simulated, of another critic that is not quadratic
    if nonlinear is None and not judged.is_quadratic:
        from verification.network.search import findings_of

        worst = loop.suboptimality.worst
        findings = findings_of(exact, judged, worst, widths, limit, flights, limit_seconds)

    checks = [*errors, *loop.checks]
    if findings is not None and judged.is_nonsmooth and findings.proof.is_found:
        checks = errors  # K has mean slopes, and its loop is not that of the policy
    if judged.P is not None and judged.is_finite:
        checks.append(value_check(exact, judged.P, widths, limit))
    sections: list[Section | LinearLoop] = [
        Section((f"{in_box.name.capitalize()}: {in_box.about}",), {"box": in_box}),
        loop,
    ]
    if findings is not None:
        checks += findings.checks
        sections.append(findings.section)
    if nonlinear_part is not None:
        sections.append(Section(nonlinear_part))
    elif judged.is_layer and findings is None:
        sections.append(_polynomial_section(judged))

    reason = ""
    if any(check.kind == "error" and not check.ok for check in checks):
        reason = judged.declared.other_game or _reason(exact, compared, widths, limit)
        reason = reason or judged.declared.assumed
    above = 100.0 * loop.suboptimality.high  # of a linear policy, proved
    if findings is not None:  # of a network, simulated or proved
        above = findings.flown.cost_above_optimum_flown_percent
        if not findings.flown.flights and findings.proof.is_found:
            above = 100.0 * findings.proof.excess
    return Verdict(
        critic=judged,
        exact=exact,
        checks=tuple(checks),
        limit=limit,
        reason=reason,
        cost_above_optimum_percent=above,
        box=in_box,
        flights=None if findings is None else findings.flown.flights,
        proof=None if findings is None else findings.proof,
        worst_flight=None if findings is None else findings.flown.worst,
        searched=0 if findings is None else findings.states,
        sections=tuple(sections),
        nonlinear=nonlinear,
        suboptimality=loop.suboptimality if findings is None else None,
    )


def _given_box(box: ArrayLike, game: Game) -> Box:
    """Return the box with these half-widths, refused unless each state has a positive one."""
    widths = numbers_in("box", box)
    count = len(game.A)
    if widths.shape != (count,) or not np.all(widths > 0.0):
        given = shown(widths.tolist())
        raise BadInputError(f"verify: box is {given}; give {count} positive half-widths")
    return Box(widths, "given")


def _on_nonlinear_game(
    critic: Critic,
    linear: LinearModel,
    exact: Solution,
    limit: float,
    box: Box,
    flights: int,
    progress: Progress | None,
) -> tuple[NonlinearComparison | None, Part]:
    """Return the comparison with the nonlinear game, or None, and the part of a report on it, which
    says why there is no comparison.
    """
    from verification.nonlinear_game import compare_with_nonlinear

    if exact.game.is_discrete:
        return None, ("Nonlinear game: not compared in discrete time",)
    try:
        compared = compare_with_nonlinear(critic, linear, exact, limit, box, flights, progress)
    except (BadInputError, NoSolutionError) as error:
        return None, (f"Nonlinear game: not compared: {error}",)
    return compared, compared.part()


def _critic(game: Game, given: object, linear: LinearModel | None) -> Critic:
    """Return the critic that is judged: read from a file, made of an array or a result, or `given`.

    Raises BadInputError for another object, and if the game is in the other kind of time.
    """
    if isinstance(given, (str, Path)):
        return critic_in(given, game, Reading(linear=linear))
    if isinstance(given, (list, tuple)) or hasattr(given, "__array__"):
        array: Any = given if labels_of(given) else numbers_in("critic", given)
        instead = "write hfa.from_value(game, P) or hfa.from_gain(game, K)"
        return from_parts(game, {part_by_shape(array, game, instead): array})
    if not isinstance(given, (Critic, Solution, TrainingRun)):
        raise BadInputError(f"critic is {shown(given)}; give {_CRITICS}")
    # A result has H in discrete time alone; of a critic, the time may be unknown (None).
    is_discrete = given.is_discrete if isinstance(given, Critic) else given.H is not None
    if is_discrete is not None and is_discrete != game.is_discrete:
        kinds = {False: "continuous", True: "discrete"}
        raise BadInputError(
            f"the critic was made with a game in {kinds[is_discrete]} time, but the game is in "
            f"{kinds[game.is_discrete]} time; make the critic with this game"
        )
    if isinstance(given, TrainingRun):
        return given.critic(game)
    if isinstance(given, Solution):
        return from_parts(game, {"P": given.P, "K": given.K})
    return given


def _reason(exact: Solution, critic: Critic, box: np.ndarray, limit: float) -> str:
    """Return the mistake in a wrong critic, and the bias of a network, or "".

    box: half-widths, (n,)
    """
    from verification.reasons import reason_for

    if not critic.is_finite:
        return ""
    if not critic.network or critic.weights is not None:  # matrices, or a polynomial
        return reason_for(exact, critic, limit)

    # Of a network, in this order: slopes that are all 0, a bias, and a mistake in K.
    if critic.P is not None:
        if not critic.P.any():
            return "V of the network has no curvature at the trim"
    elif len(critic.K) == 1 and not critic.K.any():
        return "the output, read as u, has no slope at the trim; if it is V: --network V=NAME"
    is_biased = np.any(np.abs(critic.u(0.0 * box)) > limit * np.abs(exact.K) @ box)
    says = bias_text(critic, exact) if is_biased else ""
    if not says and critic.is_nonsmooth:
        return (
            "the policy has a nonsmooth point at the trim, and K has the mean slopes of both sides"
        )
    if is_gain_right(critic.K, exact, limit):
        return says
    return "; ".join(filter(None, (says, reason_for(exact, critic, limit))))


def _polynomial_section(critic: Critic) -> Section:
    """Return the section of a report on a network with one layer, whose value is a polynomial."""
    data = {
        "output": "V",
        "precision": critic.precision,
        "value_at_origin": critic.constant,
        "origin": critic.origin,
    }
    text = f"Polynomial, {critic.precision} weights, V(0) = {critic.constant:.4g}"
    return Section((text,), {"network": data})
