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
from hfa_support.arguments import checks_arguments, need
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


class ModeError(NoSolutionError):
    """Raised if a mode that no input reaches, or an undamped mode without cost, is the reason why
    no delta has a solution.
    """


class DeltaMin(NamedTuple):
    """Bounds of delta_min = inf{δ : a solution exists}: refused < delta_min <= value.

    value / refused is at most 1 + 1e-6, or more if rounding hides the minimum (`uncertain`). Both
    are 0 if the disturbance does not affect the cost.

    value: smallest delta found to have a solution
    refused: largest delta below `value` shown to have no solution, or 0 if there is none
    condition: for a generalized plant, the condition that fails just below `value`, or "none"; ""
        for other games
    """

    value: float
    refused: float
    condition: str = ""

    def margin(self, delta: float) -> float:
        """Return the ratio delta / delta_min, or inf if delta_min is 0.

        If the ratio is above 1, the game with this delta has a value.
        """
        return delta / self.value if self.value > 0.0 else math.inf

    @property
    def uncertain(self) -> bool:
        """True if rounding leaves delta_min uncertain by more than the tolerance of the search.

        The result is also True if delta_min is not 0 and no delta was shown to have no solution.
        """
        return self.value > self.refused * (1.0 + 2.0 * TOLERANCE)

    def advice(self, delta: float) -> str:
        """Return a clause for an error message that compares a delta with delta_min.

        The clause recommends a larger delta unless delta exceeds delta_min by at least `CLOSE`
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
def minimum_delta(game: Game) -> DeltaMin:
    """Return bounds of the smallest δ for which a game has a value.

    The bounds differ by 1e-6 relative, or by more if rounding hides the minimum.

    The delta of the game itself does not affect the result.

    Raises NoSolutionError if no δ has a solution. The message names the responsible mode if one is
    found.

    >>> import hfa
    >>> from controller import minimum_delta
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], delta=2.0)
    >>> round(minimum_delta(game).value, 4)
    1.0
    """
    need(game, Game, "minimum_delta: game", "a game: hfa.game(linear, Q, R, delta)")
    return smallest_delta_of(NormalForm.of(game))


def smallest_delta_of(form: NormalForm, progress: Progress | None = None) -> DeltaMin:
    """Return bounds of the smallest δ for which a game has a value, by bisection of log δ on
    `existence`.

    The set of δ with a value is an interval (delta_min, inf]. A larger δ makes the disturbance more
    expensive. The search begins at twice the L2 gain of the LQR policy, an upper bound of
    delta_min. If the LQR policy cannot be certified, the policy of the game is used instead. Both
    bounds are 0 if the disturbance does not affect the cost.

    form: normal form of the game
    progress: called during the search, or None

    Source: Basar and Bernhard, H-infinity Optimal Control, Theorem 4.11.

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

    def existence_at(delta: float) -> Answer:
        nonlocal highest
        if delta * size <= highest.gain:
            return highest
        answer = existence(inside.with_delta(delta * size))
        highest = max(highest, answer, key=lambda each: each.gain)
        return answer

    value, refused, _ = smallest_delta(existence_at, begin, TOLERANCE, progress)
    return DeltaMin(value * size, refused * size)


def why_refused(form: NormalForm, failure: str, progress: Progress | None = None) -> str:
    """Return the reason why a game has no certified solution, and what to change, as one sentence.

    form: normal form of the game
    failure: text of the failed test of the certificate
    progress: called by the search for delta_min, or None

    Raises NoSolutionError if no delta has a solution.
    """
    smallest = smallest_delta_of(form, progress)
    verdict = f"not certified: {failure}"
    if form.delta <= smallest.refused:
        verdict = f"no value of the game: {existence(form).reason or failure}"
    return f"{verdict}; {smallest.advice(form.delta)}"


def _some_solution(form: NormalForm) -> Certified:
    """Return the certified solution of the game for delta = inf, or otherwise for its own delta."""
    (reached,) = reach_checks(form)
    if not reached.ok:
        raise lqr_failure(form, reached.reason)
    inside = form.turned()
    try:
        return certified_solution(inside.with_delta(math.inf), form.with_delta(math.inf))
    except NoSolutionError as error:
        try:
            return certified_solution(inside, form)
        except NoSolutionError:
            raise lqr_failure(form, str(error)) from error


def lqr_failure(form: NormalForm, failure: str) -> NoSolutionError:
    """Return why A'P + P A + Q - P B R⁻¹ B' P = 0 has no certified stabilizing solution.

    The error is a `ModeError` if a mode is the reason.

    form: normal form of the game
    failure: text of the failed test of the certificate, for the case that no other reason is found
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
        return ModeError(cause.sentence)
    faint = cause.faint("the inputs reach", "Q shows")
    advice = f"; {faint}; change B or Q" if faint else ""
    return NoSolutionError(
        f"the problem without disturbance (delta = inf) is not certified: {failure}{advice}"
    )


class Obstacle(NamedTuple):
    """Reason why no delta has a solution, and the modes for which the conditions nearly fail.

    sentence: the reason, or "" if there is none
    reach: smallest relative change of A and B that makes an unstable mode uncontrollable, 1 if
        there is no such mode
    mode: name of this mode
    shown: smallest relative change of A and Q^½ that puts a mode without cost on the imaginary axis
    undamped: name of this second mode
    """

    sentence: str
    reach: float
    mode: str
    shown: float
    undamped: str

    def faint(self, reach: str, show: str) -> str:
        """Return a clause on the mode that the inputs barely reach, or that barely has a cost.

        The clause describes the mode with the smaller of `reach` and `shown`. The clause is "" if
        both are above `BARELY`.

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
    """Return the reason why a game has no solution even without disturbance, if a reason is found.

    The Riccati equation without disturbance has a stabilizing solution if and only if two matrices
    have full column rank:

    - [A' - λI; B'] for every eigenvalue λ of A with Re λ >= 0, otherwise the reason is `unreached`
    - [A - λI; Q] for every λ with Re λ = 0, otherwise the reason is `hidden`

    An unstable mode without cost is not an obstacle. P is then the least cost among the policies
    for which the state converges to 0. A mode that rounding may have moved off the axis is also
    treated as a mode on the axis. Source: Zhou, Doyle and Glover, Theorem 13.7.

    form: normal form of the game
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
    """Return the eigenvalues of A and first-order bounds of their errors by rounding of A."""
    # The bound is y'|D|x / |y'x| for a change D of the entries by rounding. The bound is at most
    # `_NEAR_AXIS` times the norm of A, and has this value for a defective A. Source: Golub and Van
    # Loan, Section 7.2.2.
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
    """Return the name of a mode for a message, "mode with eigenvalue 0.5 ± 1i"."""
    real = eigenvalue.real if abs(eigenvalue.real) > error else 0.0
    text = f"mode with eigenvalue {real:.4g}"
    if abs(eigenvalue.imag) > error:
        text += f" ± {abs(eigenvalue.imag):.4g}i"
    return text


def dependence(A: np.ndarray, value: complex, rows: np.ndarray, size: float) -> float:
    """Return the smallest singular value of [A' - λI; rows], relative to the norm of A.

    The rows are first scaled to the norm of A. If the matrix does not have full column rank, the
    result is of the order of rounding.

    A: (n, n)
    value: λ
    rows: (p, n)
    size: norm of A
    """
    scaled = rows * (size / (float(np.linalg.norm(rows, 2)) or 1.0))
    stacked = np.vstack([A.T - value * np.eye(len(A)), scaled])
    return float(np.linalg.svd(stacked, compute_uv=False)[-1]) / size
