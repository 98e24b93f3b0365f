"""For which disturbance weights the game has a value: the smallest delta, and why there may be none
at all."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import RANK, normal_form, reached, stable_basis
from controller.riccati.certificate import (
    ON_THE_AXIS,
    certified_solution,
    first_derivation,
    hamiltonian_checks,
    solution_checks,
)
from controller.riccati.frequency_response import bounded_real_gain, swept_gain
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: An eigenvalue of X1'X2 up to this is rounding, a hundred times that of a well-conditioned Schur
#: form,
SIGNLESS = 1e-13
#: and in proportion more where the condition of the Hamiltonian exceeds this.
WELL_CONDITIONED = 1e4
#: Of delta_min, relative.
TOLERANCE = 1e-6
#: Of the size of the disturbance: smaller gains may be rounding; a search ends below the other.
FAINT, LEAST = 1e-9, 1e-12
#: Closer to delta_min than this share of it, P is ill-conditioned enough to blame for a test that
#: fails.
CLOSE = 0.01
#: An unstable mode that the input reaches by less than this part is named where the game is
#: refused.
BARELY = 1e-5
#: A mode that rounding may have moved off the axis by this part of |A| is looked for on the axis
#: too.
_NEAR_AXIS = 1e-6


def has_value(game: Game) -> bool | None:
    """The Hamiltonian splits, and X1'X2 >= 0 for the basis [X1; X2] of its stable subspace; None:
    rounding hides it.

    Where X1 is regular P = X2 X1⁻¹ is the stabilizing solution, and X1'X2 = X1'P X1 has its signs.
    As delta falls to its minimum P grows without bound while X1 and X2 stay within one: an
    eigenvalue of X1'X2 passes through zero. That makes the minimum visible where P itself is lost.
    Where P is singular an eigenvalue is zero at every delta; there the tests of P itself can say
    yes, though not no. Source: Basar and Bernhard, H-infinity Optimal Control, Section 4.5
    (conjugate points)."""
    form = normal_form(game)
    n = len(form.A)
    distance, split = hamiltonian_checks(game)
    if distance.value <= ON_THE_AXIS or not split.ok:
        return False
    basis = stable_basis(form.hamiltonian)
    if basis is None or not distance.ok:
        return None
    product = basis[:n].T @ basis[n:]
    smallest = float(np.linalg.eigvalsh((product + product.T) / 2.0)[0])
    signless = SIGNLESS * max(1.0, float(np.linalg.cond(form.hamiltonian)) / WELL_CONDITIONED)
    return (
        smallest > 0.0
        if abs(smallest) > signless
        else (solution_that_holds(game) is not None or None)
    )


def solution_that_holds(game: Game) -> np.ndarray | None:
    """P of the first derivation, (n, n), where every test of P alone holds: for a search, without a
    certificate."""
    with suppress(NoSolutionError):
        P = first_derivation(game)
        if all(check.ok for check in solution_checks(game, P)):
            return P
    return None


class DeltaMin(NamedTuple):
    """delta_min = inf{δ : there is a solution}, bracketed: refused < delta_min <= value.

    value / refused <= 1 + 1e-6, or more where rounding hides the minimum (`uncertain`).  Both are 0
    when the disturbance does not reach what is paid for. condition: of a generalized plant, the one
    that ends there, or "none"."""

    value: float
    refused: float
    condition: str = ""

    def margin(self, delta: float) -> float:
        """delta / delta_min: above 1 the game has a value."""
        return delta / self.value if self.value > 0.0 else math.inf

    @property
    def uncertain(self) -> bool:
        """Whether rounding leaves delta_min open by more than the tolerance of the search."""
        return self.value > self.refused * (1.0 + 2.0 * TOLERANCE)

    def advice(self, delta: float) -> str:
        """Where delta stands and what to change when a solution at this delta fails a test."""
        what = "ask for a larger delta"
        if self.refused < delta < self.value:  # there a value may exist or not
            known = "rounding leaves" if self.uncertain else "lies"
            where = f"too close to delta_min, which {known} between {self.refused:.9g} and {self.value:.9g}"
        elif delta < self.value:
            where = f"below delta_min = {self.value:.7g}"
        elif (excess := self.margin(delta) - 1.0) < CLOSE:
            where = f"only {100.0 * excess:.2g} % above delta_min = {self.value:.7g}"
        else:
            where, what = (
                f"well above delta_min = {self.value:.7g}",
                "check the scaling of A, B, Q and R",
            )
        return f"delta = {delta:.9g} is {where}; {what}"


def minimum_delta(problem: Game, progress: Progress | None = None) -> DeltaMin:
    """The smallest δ of a game, to 1e-6 relative: bisection of log δ.

    By `has_value`; the delta of the game itself plays no part.

    The set of good δ is an interval (delta_min, inf]: a disturbance that pays more can do less. The
    search starts above the L2 gain of the LQR policy, which is never below delta_min because that
    policy attains it. Where that policy cannot be certified the policy of the game itself serves as
    well. Raises NoSolutionError when neither can, naming the mode if one is found that rules out
    every solution. Source: Basar and Bernhard, H-infinity Optimal Control, Theorem 4.11."""
    game, _ = reached(problem)
    K = game.gain(_some_solution(game, problem))
    if not game.E.any():
        return DeltaMin(0.0, 0.0)
    # A disturbance of the size of 1; a power of two leaves the digits alone.
    size = 2.0 ** round(math.log2(np.linalg.norm(game.E, 2)))
    sized = replace(game, E=game.E / size, delta=math.inf)
    gain = swept_gain(sized, K).gain
    if not FAINT < gain < math.inf:
        gain = bounded_real_gain(sized, K)
    if gain == 0.0:
        return DeltaMin(0.0, 0.0)
    begin = 2.0 * gain if math.isfinite(gain) else 1.0
    found = bracketed(lambda delta: has_value(sized.with_delta(delta)), begin, TOLERANCE, progress)
    return DeltaMin(found[0] * size, found[1] * size)


def bracketed(
    good: Callable[[float], bool | None],
    upper: float,
    tolerance: float,
    progress: Progress | None = None,
) -> tuple[float, float]:
    """The smallest good δ and a δ just below it that is not, by bisection of log δ, begun at a δ
    that should be good.

    good: None where rounding hides the answer. The lower end is 0 or has False; both are 0 where
    all are good. NoSolutionError where none up to 1e12 times the first is good."""
    told, most = progress or (lambda *_: None), upper * 1e12
    while not good(upper):
        upper *= 4.0
        if not upper < most:
            raise NoSolutionError(
                f"no delta up to {most:.4g} will do; check the scaling of A, B, Q and R"
            )
    lower = upper / 4.0
    while good(lower):
        lower, upper = lower / 4.0, lower
        if upper < LEAST:
            return 0.0, 0.0
    steps = math.ceil(math.log2(math.log(upper / lower) / math.log1p(tolerance)))
    for step in range(steps):
        told(step, steps)
        middle = math.sqrt(lower * upper)
        lower, upper = (lower, middle) if good(middle) else (middle, upper)
    told(steps, steps)
    share = tolerance
    while good(lower) is not False:  # among rounding yes and no come in any order
        if share > 1.0:
            return upper, 0.0
        lower, share = lower / (1.0 + share), 2.0 * share
    return upper, lower


def _some_solution(game: Game, given: Game) -> np.ndarray:
    """P of the problem without disturbance, or else of the game itself; given: in the user's
    coordinates."""
    try:
        return certified_solution(game.with_delta(math.inf))[0]
    except NoSolutionError as error:
        try:
            return certified_solution(game)[0]
        except NoSolutionError:
            raise NoSolutionError(lqr_obstacle(given, str(error))) from error


def lqr_obstacle(game: Game, failure: str) -> str:
    """One line on why A'P + P A + Q - P B R⁻¹ B' P = 0 has no stabilizing solution; failure: of its
    certificate."""
    unreached = (
        "(A, B) is not stabilizable: no input reaches the {}; change B or leave that mode out of A"
    )
    hidden = "(A, Q) is not detectable: the undamped {} costs nothing; give Q weight on it"
    found, share, mode = obstacle(game, unreached, hidden)
    advice = "check the scaling of A, B, Q, R"
    if share <= BARELY:
        advice = f"the inputs reach the {mode} by only {share:.2g} of their size; change B"
    return (
        found
        or f"the problem without disturbance (delta = inf) is not certified: {failure}; {advice}"
    )


def obstacle(game: Game, unreached: str, hidden: str) -> tuple[str, float, str]:
    """Which of two sentences is true of a mode, with its name, or ""; the mode that is not stable
    and that the input reaches least: how well, relative, and its name.

    The Riccati equation without disturbance has a stabilizing solution exactly when [A - λI, B] has
    full rank for every eigenvalue λ of A with Re λ >= 0 (stabilizable; else unreached) and [A - λI;
    Q] for every λ with Re λ = 0 (else hidden). An unstable mode outside Q is no obstacle: P is then
    the least cost among the policies that bring the state to rest. A mode that rounding may have
    moved off the axis is looked for on it too. Source: Zhou, Doyle and Glover, Theorem 13.7."""
    form = normal_form(game.with_delta(math.inf))
    size, said, least = float(np.linalg.norm(form.A, 2)) or 1.0, "", (1.0, "")
    for value in np.linalg.eigvals(form.A):
        for at in {value, 1j * value.imag} if abs(value.real) <= _NEAR_AXIS * size else {value}:
            real, imag = (
                float(f"{part / size:.12f}") * size + 0.0 for part in (at.real, abs(at.imag))
            )
            text = f"mode with eigenvalue {real:.4g}" + f" ± {imag:.4g}i" * (imag > 0.0)
            if at.real >= -RANK * size:
                share = dependence(form.A, at, form.B.T, size)
                least = min(least, (share, text))
                said = said or (unreached.format(text) if share <= RANK else "")
            if abs(at.real) <= RANK * size and dependence(form.A.T, at, form.Q, size) <= RANK:
                said = said or hidden.format(text)
    return said, *least


def dependence(A: np.ndarray, value: complex, rows: np.ndarray, size: float) -> float:
    """Smallest singular value of [A' - λI; rows], relative, the rows brought to the size of A
    first: 0 or rounding where it has no full column rank."""
    scaled = rows * (size / (float(np.linalg.norm(rows, 2)) or 1.0))
    stacked = np.vstack([A.T - value * np.eye(len(A)), scaled])
    return float(np.linalg.svd(stacked, compute_uv=False)[-1]) / size
