"""Smallest delta for which a game has a value, and reasons why no delta has one."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.certificate import Certified, certified_solution, reach_checks
from controller.riccati.delta_search import Answer, smallest_delta
from controller.riccati.existence import existence
from controller.riccati.frequency_response import square_root, system_gain
from controller.riccati.gain_sweep import swept_gain
from controller.riccati.normal_form import RANK, NormalForm
from controller.riccati.reach import loses_rank, not_decaying, on_axis
from hfa_support.arguments import checks_arguments
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: Relative accuracy of delta_min.
TOLERANCE = 1e-6
#: Gains below this fraction of the disturbance's size may be rounding.
FAINT = 1e-9
#: If delta exceeds delta_min by a smaller fraction, the poor conditioning of P may be the reason
#: why a test fails.
CLOSE = 0.01
#: A refusal names an unstable mode whose reach, or a mode whose cost in Q, is below this fraction.
BARELY = 1e-5
#: Largest change of an eigenvalue by rounding, as a fraction of |A|.
_NEAR_AXIS = 1e-6


class DeltaMin(NamedTuple):
    """Bracket refused < delta_min <= value, with delta_min = inf{δ : a solution exists}.

    value / refused <= 1 + 1e-6, or more if rounding hides the minimum (`uncertain`). Both are 0 if
    the disturbance does not affect the cost.

    value: smallest delta found to have a solution
    refused: largest delta shown to have no solution
    condition: for a generalized plant, the condition that fails just below `value`, or "none"
    """

    value: float
    refused: float
    condition: str = ""

    def margin(self, delta: float) -> float:
        """Return delta / delta_min, or inf if delta_min is 0.

        The game has a value if the result is above 1.
        """
        return delta / self.value if self.value > 0.0 else math.inf

    @property
    def uncertain(self) -> bool:
        """True if rounding leaves delta_min uncertain by more than the tolerance of the search."""
        return self.value > self.refused * (1.0 + 2.0 * TOLERANCE)

    def advice(self, delta: float) -> str:
        """Return a sentence that compares delta with delta_min.

        The sentence recommends a larger delta unless delta exceeds delta_min by at least `CLOSE`
        (relative).
        """
        what = "; choose a larger delta"
        excess = self.margin(delta) - 1.0
        if self.refused < delta < self.value:  # a value may or may not exist
            verb = "rounding leaves" if self.uncertain else "lies"
            between = f"between {self.refused:.9g} and {self.value:.9g}"
            where = f"too close to delta_min, which {verb} {between}"
        elif delta < self.value:
            where = f"below delta_min = {self.value:.7g}"
        elif excess < CLOSE:
            where = f"only {100.0 * excess:.2g} % above delta_min = {self.value:.7g}"
        else:
            where = f"well above delta_min = {self.value:.7g}"
            what = ""
        return f"delta = {delta:.9g} is {where}{what}"


@checks_arguments
def minimum_delta(game: Game, progress: Progress | None = None) -> DeltaMin:
    """Return a bracket of the smallest δ for which a game has a value, to 1e-6 relative.

    The delta of the game itself does not affect the result.

    progress: called during the search

    Raises NoSolutionError if no δ has a solution. The message names the responsible mode if one is
    found.

    >>> import hfa
    >>> from controller import minimum_delta
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], delta=2.0)
    >>> round(minimum_delta(game).value, 4)
    1.0
    """
    return smallest_delta_of(NormalForm.of(game), progress)


def smallest_delta_of(form: NormalForm, progress: Progress | None = None) -> DeltaMin:
    """Return a bracket of the smallest δ of a normal form, by bisection of log δ on `existence`.

    The set of δ with a value is an interval (delta_min, inf], because a larger δ makes the
    disturbance more expensive. The search begins at twice the L2 gain of the LQR policy, an upper
    bound of delta_min, or of the policy of the game if the LQR policy cannot be certified. Source:
    Basar and Bernhard, H-infinity Optimal Control, Theorem 4.11.

    Raises NoSolutionError if no δ has a solution.
    """
    found = _some_solution(form)
    inside = found.form
    if not inside.disturbance.any():
        return DeltaMin(0.0, 0.0)
    # The disturbance is scaled to size 1 by a power of two, which causes no rounding.
    size = 2.0 ** round(math.log2(np.linalg.norm(inside.disturbance, 2)))
    K = inside.B.T @ found.X
    loop = inside.A - inside.B @ K
    E = inside.disturbance / size
    C = np.vstack([square_root(inside.Q), K])
    gain = swept_gain(loop, E, C).gain
    if not FAINT < gain < math.inf:
        gain = system_gain(loop, E, C, np.zeros((len(C), E.shape[1])))
    if gain == 0.0:
        return DeltaMin(0.0, 0.0)
    begin = 2.0 * gain if math.isfinite(gain) else 1.0

    highest = Answer(False)

    def ask(delta: float) -> Answer:
        nonlocal highest
        if delta * size <= highest.gain:
            return highest
        answer = existence(inside.with_delta(delta * size))
        highest = max(highest, answer, key=lambda each: each.gain)
        return answer

    value, refused, _ = smallest_delta(ask, begin, TOLERANCE, progress)
    return DeltaMin(value * size, refused * size)


def why_refused(form: NormalForm, failure: str, progress: Progress | None = None) -> str:
    """Return a sentence with the reason why a game has no certified solution, and the change to
    make.

    failure: the failed test of the certificate

    Raises NoSolutionError if no delta has a solution.
    """
    smallest = smallest_delta_of(form, progress)
    verdict = f"not certified: {failure}"
    if form.delta <= smallest.refused:
        verdict = f"no value of the game: {existence(form).reason or failure}"
    return f"{verdict}; {smallest.advice(form.delta)}"


def _some_solution(form: NormalForm) -> Certified:
    """Return the solution for delta = inf or, if it cannot be certified, for the delta of the game.

    Raises NoSolutionError with the reason if neither solution is certified.
    """
    (reached,) = reach_checks(form)
    if not reached.ok:
        raise NoSolutionError(lqr_obstacle(form, reached.reason))
    inside = form.turned()
    try:
        return certified_solution(inside.with_delta(math.inf))
    except NoSolutionError as error:
        try:
            return certified_solution(inside)
        except NoSolutionError:
            raise NoSolutionError(lqr_obstacle(form, str(error))) from error


def lqr_obstacle(form: NormalForm, failure: str) -> str:
    """Return the reason why A'P + P A + Q - P B R⁻¹ B' P = 0 has no stabilizing solution, as one
    line.

    failure: the failed test of the certificate
    """
    unreached = (
        "within rounding (A, B) is not stabilizable: no input reaches the {}; change B or leave"
        " that mode out of A"
    )
    hidden = (
        "within rounding (A, Q) is not detectable: the undamped {} has no cost; give it weight in Q"
    )
    cause = obstacle(form, unreached, hidden)
    if cause.sentence:
        return cause.sentence
    faint = cause.faint("the inputs reach", "Q shows")
    advice = f"; {faint}; change B or Q" if faint else ""
    return f"the problem without disturbance (delta = inf) is not certified: {failure}{advice}"


class Obstacle(NamedTuple):
    """Reason why no delta has a solution, and the modes nearest to such a reason.

    sentence: the reason, or "" if there is none
    reach: least relative change of A and B that makes an unstable mode uncontrollable
    mode: name of this mode
    shown: least relative change of A and Q^½ that leaves an eigenvalue on the axis without cost
    undamped: name of the mode of this eigenvalue
    """

    sentence: str
    reach: float
    mode: str
    shown: float
    undamped: str

    def faint(self, reach: str, show: str) -> str:
        """Return a clause on the mode with the smallest reach or cost.

        The clause is "" if both `reach` and `shown` of the obstacle are above `BARELY`.

        reach: subject and verb for the reach, such as "the inputs reach"
        show: subject and verb for the cost, such as "Q shows"
        """
        reached = self.reach, f"{reach} the {self.mode}"
        part, text = min(reached, (self.shown, f"{show} the {self.undamped}"))
        if part > BARELY:
            return ""
        size = f"only {part:.2g}" if part > RANK else f"less than {RANK:g}"
        return f"{text} by {size} of the size of the matrices"


def obstacle(form: NormalForm, unreached: str, hidden: str) -> Obstacle:
    """Return the reason why no solution exists without disturbance.

    The Riccati equation without disturbance has a stabilizing solution if and only if two matrices
    have full column rank:

    - [A' - λI; B'] for every eigenvalue λ of A with Re λ >= 0, otherwise the reason is `unreached`
    - [A - λI; Q] for every λ with Re λ = 0, otherwise the reason is `hidden`

    An unstable mode without cost is not an obstacle. P is then the least cost among the policies
    for which the state converges to 0. A mode that rounding may have moved off the axis is also
    treated as a mode on the axis. Source: Zhou, Doyle and Glover, Theorem 13.7.

    unreached, hidden: sentences with {} for the name of the mode
    """
    size = float(np.linalg.norm(form.A, 2)) or 1.0
    sentence = ""
    least_reach = 1.0
    least_mode = ""
    least_shown = 1.0
    undamped = ""
    paid = square_root(form.Q)
    for eigenvalue, error in _eigenvalues(form.A, size):
        shown = dependence(form.A.T, 1j * eigenvalue.imag, paid, size)
        if shown < least_shown:
            least_shown = shown
            undamped = _mode_text(1j * eigenvalue.imag, error)
        mode = _mode_text(eigenvalue, error)
        if eigenvalue.real >= -error:
            unstable = complex(max(eigenvalue.real, 0.0), eigenvalue.imag)
            reach = dependence(form.A, unstable, form.B.T, size)
            if (reach, mode) < (least_reach, least_mode):
                least_reach = reach
                least_mode = mode
            if not sentence and loses_rank(form.A, form.B.T, eigenvalue, not_decaying):
                sentence = unreached.format(mode)
        near_axis = abs(eigenvalue.real) <= error
        if near_axis and not sentence and loses_rank(form.A.T, form.Q, eigenvalue, on_axis):
            sentence = hidden.format(mode)
    return Obstacle(sentence, least_reach, least_mode, least_shown, undamped)


def _eigenvalues(A: np.ndarray, size: float) -> list[tuple[complex, float]]:
    """Return each eigenvalue of A with a bound of its change by rounding of A, to first order.

    The bound is y'|D|x / |y'x| for a change D of the entries by rounding, at most `_NEAR_AXIS`
    times the norm `size` of A. For a defective A every bound has this largest value. Source: Golub
    and Van Loan, Section 7.2.2.
    """
    values, right = np.linalg.eig(A)
    most = _NEAR_AXIS * size
    try:
        left = np.linalg.inv(right)
        moved = np.einsum("ij,jk,ki->i", np.abs(left), np.abs(A), np.abs(right))
        errors = np.minimum(8.0 * len(A) * np.finfo(float).eps * moved, most)
    except np.linalg.LinAlgError:
        errors = np.full(len(A), most)
    return list(zip(values.tolist(), errors.tolist(), strict=True))


def _mode_text(eigenvalue: complex, error: float) -> str:
    """Return "mode with eigenvalue 0.5 ± 1i" for a message.

    A real or imaginary part of at most `error` is treated as 0.
    """
    real = eigenvalue.real if abs(eigenvalue.real) > error else 0.0
    text = f"mode with eigenvalue {real:.4g}"
    if abs(eigenvalue.imag) > error:
        text += f" ± {abs(eigenvalue.imag):.4g}i"
    return text


def dependence(A: np.ndarray, value: complex, rows: np.ndarray, size: float) -> float:
    """Return the smallest singular value of [A' - λI; rows], divided by the norm `size` of A.

    The rows are first scaled to the norm of A. If the matrix does not have full column rank, the
    result is of the order of rounding.
    """
    scaled = rows * (size / (float(np.linalg.norm(rows, 2)) or 1.0))
    stacked = np.vstack([A.T - value * np.eye(len(A)), scaled])
    return float(np.linalg.svd(stacked, compute_uv=False)[-1]) / size
