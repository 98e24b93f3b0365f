"""A learned critic against the exact solution of the same game: how far off, and does it do what it should."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import casadi as ca
import numpy as np

from controller.analysis.cost import CHANGE, SIGNLESS, flight_cost, saddle_checks
from controller.game.basis import Basis, basis
from controller.game.critic_file import History
from controller.game.learning_result import LearningResult, settled_at
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units, spectrum
from controller.riccati.certificate import INDEFINITENESS, relative_residual
from controller.riccati.frequency_response import disk_margin
from controller.riccati.gare import solve_game
from hfa_support.errors import refuse_unless_positive
from hfa_support.progress import Progress
from hfa_support.reporting.checks import Check, at_least, at_most, below
from verification.critic.candidate import Candidate, from_stored
from verification.critic.check_result import CriticCheck, history_errors
from verification.critic.critic_errors import Box, critic_errors, ordinary_box
from verification.critic.diagnosis import diagnose
from verification.critic.network_check import FLIGHTS, network_checks

#: Default limit of the errors of P, K, V, its slopes and the policies, and of the Riccati residual.
LIMIT = 1e-6
#: With a larger limit the saddle checks, which see errors beyond it, are left out.
SADDLE_LIMIT = 1e-5


def check_critic(
    game: Game,
    candidate: Candidate,
    *,
    limit: float = LIMIT,
    box: Box | None = None,
    run: LearningResult | None = None,
    predefined_time: float | None = None,
    at_dihedral: Callable[[float], Game] | None = None,
    flights: int = FLIGHTS,
    plant: ca.Function | None = None,
) -> CriticCheck:
    """Compare a critic with the exact solution of its game.

    Checked: errors of P and K (norms and entries), of V, its slopes and both policies over a box of states, stability
    of A - B K and A - S P, P > 0, Riccati residual, saddle point, L2 gain below delta; for a run also the rank of its
    data, which is taken from it, and its `settling_time` against T_w. limit: of the errors and the residual. box:
    default `ordinary_box`. at_dihedral: degrees -> the game there, to recognize a critic of another angle. Of a network
    the box is searched, and it is flown from there `flights` times, also on a nonlinear plant (z, u) -> z'.
    With a limit above `SADDLE_LIMIT` there are no saddle checks: they would refuse what the limit allows.
    Raises NoSolutionError when the game itself has no certified solution to compare with.
    """
    exact, box = solve_game(game), box or ordinary_box(game)
    refuse_unless_positive("limit", limit)
    flight = flight_cost(game, exact, candidate.K)
    gain, too_large = flight.gain, f"the closed loop has an L2 gain of {flight.gain:.4g}, not below delta"
    K, P, finite = candidate.K, candidate.P, candidate.finite
    abscissa = spectrum(game.A - game.B @ K).abscissa if finite else math.inf
    errors, network = critic_errors(game, candidate, exact, limit, box), None
    searched: tuple[Check, ...] = ()
    if candidate.nonlinear is not None:
        flights = flights if abscissa < 0.0 else 0
        searched, network = network_checks(game, candidate, exact, box.half_widths, limit, flights=flights, plant=plant)
    checks = [
        *errors,
        below("control_loop_abscissa", abscissa, 0.0, f"A - B K is not Hurwitz (abscissa {abscissa:+.3g} 1/s)"),
        *(_value_checks(game, P, exact.P, limit) if P is not None and finite else ()),
        *((below("l2_gain", gain, game.delta, too_large),) if math.isfinite(game.delta) and finite else ()),
        *(run_checks(game, run, candidate.functions, predefined_time) if run is not None else ()),
        *searched,
    ]
    diagnosis = poor_data(run) if run is not None else ""
    if not diagnosis and not all(check.ok for check in (*errors, *searched)):
        diagnosis = worthless_start(game, run, candidate.functions) if run is not None else ""
        found = diagnose(game, exact, candidate, limit, at_dihedral, box.half_widths) if finite else ""
        diagnosis = diagnosis or found
    return CriticCheck(
        exact=exact,
        candidate=candidate,
        checks=tuple(_explained(checks, diagnosis)),
        learned_margin=disk_margin(game, K) if abscissa < 0.0 else None,
        exact_margin=disk_margin(game, exact.K),
        flight=flight,
        diagnosis=diagnosis,
        box=box,
        network=network,
    )


def check_history(
    game: Game,
    history: History,
    *,
    limit: float = LIMIT,
    box: Box | None = None,
    predefined_time: float | None = None,
    progress: Progress | None = None,
    at_dihedral: Callable[[float], Game] | None = None,
) -> CriticCheck:
    """`check_critic` of the last row of a history, and the errors of every row; somebody's own W(t), P(t) or K(t).

    predefined_time: T_w, s, by which every error must be within the limit for good; None: no such check.
    """
    last = from_stored(game, history.last, basis(history.basis, len(game.A)))
    check = check_critic(game, last, limit=limit, box=box, at_dihedral=at_dihedral)
    errors = history_errors(game, check.exact, history, limit, predefined_time, progress, check.box)
    return replace(check, checks=(*check.checks, *errors.checks()), history=errors)


def _value_checks(game: Game, P: np.ndarray, exact: np.ndarray, limit: float) -> tuple[Check, ...]:
    """Whether P is a value: stabilizing, not indefinite, a root of the Riccati equation, a saddle point."""
    units = balanced_units(game)
    squared = np.outer(units, units)
    balanced, scaled = in_units(game, units), P * squared
    residual, smallest = relative_residual(balanced, scaled), _smallest_eigenvalue(scaled)
    least = _least_eigenvalue(balanced, exact * squared, limit)
    abscissa, change = spectrum(game.A - game.S @ P).abscissa, _saddle_change(limit)
    return (
        below("game_loop_abscissa", abscissa, 0.0, f"A - S P is not Hurwitz (abscissa {abscissa:+.3g} 1/s)"),
        at_least(
            "P_smallest_eigenvalue",
            smallest,
            least,
            f"P is indefinite (smallest eigenvalue {smallest:.3g} of its size)",
        ),
        at_most("riccati_residual", residual, limit, f"the Riccati equation is left with a residual of {residual:.2g}"),
        *(
            _saddle_checks(balanced, scaled, exact * squared, change)
            if change is not None and (game.Q.any() or P.any())
            else ()
        ),
    )


def _saddle_checks(game: Game, P: np.ndarray, exact: np.ndarray, change: float) -> tuple[Check, ...]:
    """`saddle_checks` of P, none where rounding of the exact P alone fails them; all in balanced units."""
    initial = np.ones(len(P))
    found = saddle_checks(game, P, initial, change)
    if all(check.ok for check in found) or not exact.any():
        return found
    return found if all(check.ok for check in saddle_checks(game, exact, initial, change)) else ()


def _least_eigenvalue(game: Game, exact: np.ndarray, limit: float) -> float:
    """What `_smallest_eigenvalue` of a right P may be; game and exact P in balanced units.

    The value of a state that costs nothing may be 0, which rounding makes negative; the certificate allows the same.
    A limit above the default allows |P - P*| <= limit |P*|, which moves eigenvalues by no more (Weyl).
    """
    costs = np.linalg.eigvalsh(game.Q)
    least = 0.0 if costs[0] > SIGNLESS * costs[-1] else -INDEFINITENESS
    if limit <= LIMIT or not exact.any():
        return least
    allowed = limit * float(np.linalg.norm(exact) / np.abs(exact).max())
    return min(least, _smallest_eigenvalue(exact) - allowed)


def _smallest_eigenvalue(P: np.ndarray) -> float:
    """Of (P + P')/2, as a part of the largest entry."""
    return float(np.linalg.eigvalsh((P + P.T) / 2.0)[0] / np.abs(P).max()) if np.any(P) else 0.0


def _saddle_change(limit: float) -> float | None:
    """The change of cost under which errors within the limit hide, if it is small enough for a parabola."""
    if limit <= CHANGE:
        return CHANGE
    return 10.0 * limit if limit <= SADDLE_LIMIT else None


def _explained(checks: Iterable[Check], diagnosis: str) -> Iterable[Check]:
    """The first failed check carries the diagnosis, so that the reason stands where a reader looks first."""
    told = not diagnosis
    for check in checks:
        if not check.ok and not told:
            told = True
            yield check._replace(reason=f"{check.reason}: {diagnosis}")
        else:
            yield check


#: Relative Riccati residual, in balanced units, below which a run counts as settled.
SETTLED = 1e-9


def run_checks(game: Game, run: LearningResult, functions: Basis, predefined_time: float | None) -> tuple[Check, ...]:
    """The richness of the data, as the run says it; the settling time only of a law that promises one."""
    rank = run.excitation
    rich = at_least("data_rank", rank.rank, rank.size, f"the data have rank {rank.rank} of {rank.size}")
    if predefined_time is None:
        return (rich,)
    settled = settling_time(game, run, functions)
    late = f"the residual settles at {settled:.4g} s" if math.isfinite(settled) else "the residual does not settle"
    return (rich, at_most("settling_time", settled, predefined_time, f"{late}, not within T_w = {predefined_time:g} s"))


def settling_time(game: Game, run: LearningResult, functions: Basis) -> float:
    """First time from which the Riccati residual of the run's P(t) stays within `SETTLED`, s; inf when it does not.

    Computed from the recorded weights, with `certificate.relative_residual` in balanced units: whatever the law
    measures is not asked.
    """
    units = balanced_units(game)
    balanced, squared = in_units(game, units), np.outer(units, units)
    residuals = np.array([relative_residual(balanced, functions.matrix(weights) * squared) for weights in run.weights])
    return settled_at(run.times, residuals, SETTLED)


def poor_data(run: LearningResult) -> str:
    """What a rank below the number of weights means, or ""."""
    if run.excitation.rank >= run.excitation.size:
        return ""
    return (
        f"the data have rank {run.excitation.rank} of {run.excitation.size}: whatever their residual, they do not "
        "determine the weights"
    )


def worthless_start(game: Game, run: LearningResult, functions: Basis) -> str:
    """What a start without a value means for every law but `certified`, which discounts it, or ""."""
    start = spectrum(game.A - game.B @ game.gain(functions.matrix(run.weights[0]))).abscissa
    if start < 0.0 or run.law == "certified":
        return ""
    return (
        f"the run starts from a policy that does not stabilize (abscissa of A - B K {start:+.3g} 1/s) and has "
        "no value to learn from; give initial_weights of a stabilizing one"
    )
