"""Search for the proof of a gain schedule: its decay rate, and V for a moving scheduling variable.

No proof depends on the samples; `check_schedule` proves the statement.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import scipy.linalg

from controller.game.linear_game import game
from controller.riccati.gare import solve
from hfa_aircraft.model import Model
from hfa_prove.check.schedule import ScheduleProof, check_schedule, real_basis
from hfa_prove.check.trims import SteadyFlight
from hfa_prove.enclosure.ball_function import Undecided
from hfa_prove.fields import Rejected
from hfa_prove.statements.schedule import (
    Flight,
    Gains,
    ScheduleStatement,
    ScheduleWitness,
    in_model_unit,
    unknowns_of,
)
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown
from hfa_support.matrices import LinearTable, spectral_abscissa
from hfa_support.progress import Progress
from hfa_support.reporting.report import Report, Reported
from trim.linear.linearize import linearize
from trim.point.condition import TrimCondition, usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim

#: Limits beyond this value are treated as infinite.
_FAR = 1e300
#: Largest distance between two breakpoints of exact gains: of an angle, deg, and of any other
#: variable, in nominal values.
_STEP_DEG = 2.0
_STEP_NOMINAL = math.radians(_STEP_DEG)


@dataclass(frozen=True)
class Family:
    """Trims of an aircraft at any value of its scheduling variable.

    model: the aircraft with its declared parameter values
    given_condition: the user's trim condition, or None for the condition of the model's trim
    """

    model: Model
    given_condition: TrimCondition | None = None

    def condition(self, scheduling_value: float | None = None) -> TrimCondition:
        """Return the trim condition at a scheduling value, by default at the model's own value."""
        condition = self.given_condition
        if condition is None:
            condition = usual_condition(self.model)
        # A parameter is not in the condition: `point` changes it in the model.
        if scheduling_value is None or self.model.schedule in self.model.parameters:
            return condition.at(None)
        return condition.at(in_model_unit(self.model, scheduling_value))

    def point(self, scheduling_value: float) -> OperatingPoint:
        """Return the trim at a scheduling value, in double precision.

        Raises TrimError if there is no trim.
        """
        model = self.model
        if model.schedule in model.parameters:
            value = in_model_unit(model, scheduling_value)
            model = model.with_parameters(**{model.schedule: value})
        return trim(model, self.condition(scheduling_value))

    def flight(self, low: float, high: float) -> Flight:
        """Return the trims from `low` to `high` in the form of a statement.

        Raises BadInputError if a limit is wider than the model's. Raises TrimError if there is no
        trim at `low`.
        """
        model = self.model
        condition = self.condition()
        imposed = dict(condition.imposed)
        imposed.pop(model.schedule, None)
        limits = {}
        for name, (least, most) in model.limits.items():
            lowest, highest = condition.limits_of(name)
            if name in model.airspeeds:  # a function of signals that have limits
                if (lowest, highest) != (least, most):
                    raise BadInputError(f"a limit of {name} cannot be proved; limit the speed")
                continue
            if lowest < least or highest > most:
                raise BadInputError(
                    f"the limits of {name} are wider than the model's, "
                    f"{model.describe(name, least)} to "
                    f"{model.describe(name, most)}; narrow these limits"
                )
            if np.isfinite((lowest, highest)).any() and name not in model.disturbances:
                limits[name] = (max(lowest, -_FAR), min(highest, _FAR))
        parameters = {name: signal.start for name, signal in model.parameters.items()}
        values = self.point(low).values
        first = {name: float(values[name]) for name in unknowns_of(model, imposed)}
        return Flight(model, parameters, imposed, limits, (low, high), first)

    def check(self, low: float, high: float) -> None:
        """Raise BadInputError unless proofs support the trims from `low` to `high`.

        The conditions are:
        - The model has a scheduling variable, and low < high.
        - No imposed value depends on the scheduling variable.
        - All rates of the trim are 0, and the scheduling variable is not free.
        - As many equations depend on the free variables as there are free variables.
        """
        model = self.model
        if not model.schedule:
            raise BadInputError(
                f"{model.title} has no scheduling variable, which a proof requires; set "
                "`schedule` in the model"
            )
        if not low < high:
            raise BadInputError(
                f"the interval is {low:g} to {high:g}; give two different ends, the lower first"
            )
        if self.given_condition is not None:
            for name, value in self.given_condition.imposed.items():
                if isinstance(value, LinearTable):
                    raise BadInputError(
                        f"{name} depends on the {model.schedule} in this flight condition; give "
                        f"one value with --hold {name}=VALUE"
                    )
        first = self.condition(low)
        self.condition(high)  # raises BadInputError if it is beyond a limit
        if first.rates != dict.fromkeys(model.steady, 0.0) or model.schedule in first.free:
            raise BadInputError(
                f"a proof requires trims at a given {model.schedule} with all rates 0; change "
                "--hold and --free"
            )
        SteadyFlight(self.flight(low, high))


def breakpoints_of(family: Family, low: float, high: float) -> np.ndarray:
    """Return the breakpoints of exact gains from `low` to `high`, equally spaced.

    Their distance is at most `_STEP_DEG` for an angle in deg, and `_STEP_NOMINAL` nominal values
    for any other scheduling variable.
    """
    model = family.model
    if model.schedule_unit == "deg":
        longest = _STEP_DEG
    else:
        longest = _STEP_NOMINAL * model.signals[model.schedule].nominal
    count = max(2, math.ceil((high - low) / longest) + 1)
    return np.linspace(low, high, count)


def exact_gains(family: Family, breakpoints: np.ndarray, **changes: Any) -> Gains:
    """Return the gains of the exact game at scheduling values (g,).

    changes: weights that differ from the default game, name -> value

    Raises NoSolutionError if a breakpoint has no trim or the game there has no solution.
    """
    gains = []
    for breakpoint in breakpoints.tolist():
        point = family.point(breakpoint)
        linear = linearize(point.model, point)
        gains.append(np.asarray(solve(game(linear, **changes)).K, dtype=float))
    return Gains(breakpoints, np.array(gains))


#: Number of samples of the loop in the interval.
_SAMPLES = 161
#: Share of the sampled decay rate that is stated by default.
_STATED_SHARE = 0.99
#: Numbers of intervals between breakpoints of P, for each interval of the gains, and the least gain
#: of the sampled rate for which a finer P is preferred.
_FINENESS = (1, 2, 4, 8, 16, 32)
_FASTER = 1.05
#: Shares of the sampled rate of the scheduling variable that are tried.
_RATE_SHARES = (0.95, 0.85, 0.7, 0.5)
#: Steps of the search for the weight of P, and the power in its norm over the samples.
_TRIES = 40
_POWER = 6.0
#: Condition number of a basis of modes from which on they coincide.
_COINCIDENT = 1e6
#: Number of pieces after which a search stops.
_MOST_PIECES = 1_000_000


@dataclass(frozen=True, eq=False, repr=False)
class ScheduleFound(Reported):
    """A proved statement about a gain schedule.

    statement: the claim
    witness: numbers for the checker
    size: number of pieces of the proof
    open_claim: sentence on a motion of the scheduling variable that is not proved, or ""
    """

    statement: ScheduleStatement
    witness: ScheduleWitness
    size: int
    open_claim: str = ""

    def report(self) -> Report:
        """Return the report that `hfa prove schedule` prints."""
        from hfa_prove.report import found_report

        return found_report(self.statement, self.size, self.open_claim)


def prove_schedule(
    family: Family,
    gains: Gains,
    low: float,
    high: float,
    *,
    decay_rate: float | None = None,
    scheduled_rate: float | Literal["largest"] | None = None,
    progress: Progress | None = None,
) -> ScheduleFound:
    """Return a proved statement about a gain schedule at every scheduling value from `low` to
    `high`.

    family: aircraft and its trims
    gains: the gains, over scheduling values in the user's unit
    decay_rate: decay rate to prove, 1/s, or None for 99 % of the lowest of samples
    scheduled_rate: rate of the scheduling variable to prove, per s, "largest" for one that the
        search finds, or None for a variable that does not move

    Raises BadInputError if proofs do not support the trims. Raises NoSolutionError if the statement
    is not proved; the message states the place and the open claim. A motion that is not proved is
    the `open_claim` of the statement on values that do not move.
    """
    if isinstance(scheduled_rate, str):
        refuse_unknown("scheduled_rate is", scheduled_rate, ("largest",))
    family.check(low, high)
    flight = family.flight(low, high)
    _refuse_uncovered(gains, low, high)

    # Samples of the closed loop, for which the proof object of any statement serves.
    n = len(flight.model.linear)
    without_P = ScheduleWitness(_MOST_PIECES, np.zeros(0), np.zeros((0, n, n)))
    loops = _sampled(ScheduleProof(ScheduleStatement(flight, gains, 0.0), without_P))
    decays = [-spectral_abscissa(C) for C in loops.values]
    slowest_decay = min(decays)
    if decay_rate is None and not slowest_decay > 0.0:
        raise NoSolutionError(
            f"A - B K has an eigenvalue with the real part {-slowest_decay:.6g} 1/s at "
            f"{flight.model.schedule} {loops.breakpoints[decays.index(slowest_decay)]:.6g} "
            f"{flight.model.schedule_unit}, so the loop is not stable"
        )

    stated_decay = _STATED_SHARE * slowest_decay if decay_rate is None else decay_rate
    statement = ScheduleStatement(flight, gains, stated_decay)
    if scheduled_rate is None:
        return _first_proved([(statement, without_P)], progress)
    wanted = None if scheduled_rate == "largest" else scheduled_rate
    try:
        return _first_proved(_with_motion(statement, loops, wanted), progress)
    except NoSolutionError as failure:
        still = _first_proved([(statement, without_P)], progress)
        return replace(
            still, open_claim=f"Not proved for a moving {flight.model.schedule}: {failure}"
        )


def _refuse_uncovered(gains: Gains, low: float, high: float) -> None:
    """Raise BadInputError unless a table of gains covers the interval; a constant gain does."""
    first, last = float(gains.breakpoints[0]), float(gains.breakpoints[-1])
    if first < last and (low < first or high > last):
        raise BadInputError(
            f"the table of gains covers {first:g} to {last:g}, not {low:g} to {high:g}; choose "
            "an interval within the table"
        )


def _first_proved(
    candidates: Iterable[tuple[ScheduleStatement, ScheduleWitness]], progress: Progress | None
) -> ScheduleFound:
    """Return the first of some statements that is proved, with its witness."""
    rejected: Rejected | None = None
    for statement, witness in candidates:
        try:
            size = check_schedule(statement, witness, progress)
        except Rejected as error:
            rejected = error
            continue
        # A check tries less than 2 `size` pieces: those proved, and those that it halved before.
        # 100 more are spare, for a processor whose roundoff requires further pieces.
        stored = ScheduleWitness(2 * size + 100, witness.breakpoints, witness.P)
        return ScheduleFound(statement, stored, size)
    raise NoSolutionError(str(rejected)) from rejected


def _sampled(proof: ScheduleProof) -> LinearTable:
    """Return the closed loop C (n, n), in nominal values of the states, at scheduling values.

    Raises NoSolutionError where no trim is found.
    """
    low, high = proof.statement.flight.range
    guess = np.array(list(proof.statement.flight.first.values()))
    slope = np.zeros_like(guess)
    places, loops = np.linspace(low, high, _SAMPLES), []
    last = low
    model = proof.statement.flight.model
    nominal = model.nominal(model.linear)
    to_nominal = nominal / nominal[:, None]  # factors of C with x in nominal values
    for s in places.tolist():
        try:
            guess, slope, _ = proof.flight.estimate(guess + slope * (s - last), s)
        except Undecided as error:
            raise NoSolutionError(f"{error} at {model.schedule} {s:.6g}") from error
        last = s
        loops.append(to_nominal * proof.loop_at(guess, s))
    return LinearTable(places, np.array(loops))


def _with_motion(
    statement: ScheduleStatement, loops: LinearTable, wanted: float | None
) -> Iterator[tuple[ScheduleStatement, ScheduleWitness]]:
    """Yield statements about a moving scheduling variable with P, the strongest first."""
    # wanted: rate of the scheduling variable, or None for the largest
    flight, gains, decay = statement.flight, statement.gains, statement.decay_rate

    def claim(rate: float, nodes: Any, P: Any) -> tuple[ScheduleStatement, ScheduleWitness]:
        """Return the statement for a rate, and the witness with P (l, n, n) at the nodes (l,)."""
        moving = ScheduleStatement(flight, gains, decay_rate=decay, scheduled_rate=rate)
        nominal = flight.model.nominal(flight.model.linear)
        P_in_units = np.array(P) / np.outer(nominal, nominal)
        return moving, ScheduleWitness(_MOST_PIECES, np.array(nodes, dtype=float), P_in_units)

    # A constant P permits any rate.
    slopes = np.gradient(loops.values, loops.breakpoints, axis=0)
    few = slice(None, None, _SAMPLES // 16)  # 16 samples suffice for a weight
    W = _weight(loops.values[few], slopes[few])
    middle = loops.values[_SAMPLES // 2]
    for weight in (W, _first_weight(middle)):
        P = _lyapunov(middle, weight)
        if all(_is_positive(-(C.T @ P + P @ C)) for C in loops.values):
            place = loops.breakpoints[_SAMPLES // 2]
            yield claim(math.inf if wanted is None else wanted, [place], [P])

    # A P that is linear between nodes permits a higher rate with more nodes.
    best = slowest = 0.0
    improving: list[tuple[float, np.ndarray, np.ndarray]] = []
    for fineness in _FINENESS:
        cuts = [np.linspace(*part, fineness + 1)[:-1] for part in gains.pieces(*flight.range)]
        nodes = np.append(np.concatenate(cuts), flight.high)
        P = np.array([_lyapunov(loop, W) for loop in loops.at(nodes)])
        permitted, at = _permitted_scheduled_rate(loops, nodes, P)
        if permitted >= best:
            slowest = at
        # An infinite rate is that of a constant P, which was tried above.
        if _FASTER * best < permitted < math.inf:
            improving.append((permitted, nodes, P))
            best = permitted
        if wanted is not None and wanted <= permitted:
            yield claim(wanted, nodes, P)
    if wanted is None:
        for permitted, nodes, P in reversed(improving):
            for share in _RATE_SHARES:  # of the rate at samples, as between them it may be less
                yield claim(float(f"{share * permitted:.2g}"), nodes, P)
    name, unit = flight.model.schedule, flight.model.schedule_unit
    asked = "any rate" if wanted is None else f"{wanted:g} {unit}/s"
    raise NoSolutionError(
        f"no Lyapunov function was found for {asked}; those of the search permit {best:.3g} "
        f"{unit}/s, least at {name} {slowest:.6g} {unit}"
    )


def _permitted_scheduled_rate(
    loops: LinearTable, nodes: np.ndarray, P: np.ndarray
) -> tuple[float, float]:
    """Return the largest |ds/dt| for which V = x'P(s) x decreases at all samples, or 0, and the s
    that permits no more.
    """
    permitted, slowest = math.inf, nodes[0]
    for s, C in zip(loops.breakpoints, loops.values, strict=True):
        k = _piece_of(nodes, s)
        slope = (P[k + 1] - P[k]) / (nodes[k + 1] - nodes[k])
        product = C.T @ (P[k] + slope * (s - nodes[k]))
        S = -(product + product.T)
        if not _is_positive(S):
            return 0.0, s
        # V decreases for |ds/dt| < 1 / max |λ| of slope x = λ S x.
        relative_slope = float(np.abs(scipy.linalg.eigh(slope, S, eigvals_only=True)).max())
        if relative_slope * permitted > 1.0:
            permitted, slowest = 1.0 / relative_slope, s
    return permitted, slowest


def _piece_of(nodes: np.ndarray, s: float) -> int:
    """Return the number of the interval between two breakpoints that begins at or before s."""
    return int(np.clip(np.searchsorted(nodes, s, "right") - 1, 0, len(nodes) - 2))


def _is_positive(S: np.ndarray) -> bool:
    """Return whether the symmetric part of S is positive definite, in doubles."""
    return bool(np.linalg.eigvalsh(0.5 * (S + S.T))[0] > 0.0)


def _lyapunov(A: np.ndarray, W: np.ndarray) -> np.ndarray:
    """Return the solution P of A'P + P A = -W."""
    P = scipy.linalg.solve_continuous_lyapunov(A.T, -W)
    return np.asarray((P + P.T) / 2)


def _weight(loops: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Return the W > 0 for which V = x'P x, C'P + P C = -W, permits the largest rate ds/dt found.

    V decreases for |ds/dt| < 1 / max |λ| of W⁻¹ dP/ds. Each step increases W along the vectors of
    large |λ|, relative to the others.

    loops: C at scheduling values, (N, n, n)
    slopes: dC/ds, (N, n, n)
    """
    W = _first_weight(loops[len(loops) // 2])
    best, permitted = np.eye(len(W)), 0.0
    for _ in range(_TRIES):
        try:
            root = np.linalg.cholesky(W)
        except np.linalg.LinAlgError:
            break
        inverse = np.linalg.inv(root)
        total = np.zeros_like(W)
        largest = 0.0
        for C, slope in zip(loops, slopes, strict=True):
            # dP/ds, by the derivative of C'P + P C = -W:
            # C' dP/ds + dP/ds C = -(P dC/ds + its transpose)
            P_C_slope = _lyapunov(C, W) @ slope
            P_slope = _lyapunov(C, P_C_slope + P_C_slope.T)
            sizes, axes = np.linalg.eigh(inverse @ P_slope @ inverse.T)
            largest = max(largest, float(np.abs(sizes).max()))
            # A high power: the samples with the largest |λ| determine the sum.
            total += (axes * np.abs(sizes) ** _POWER) @ axes.T
        if largest == 0.0:  # P does not depend on s, and permits any rate
            return W
        if 1.0 / largest > permitted:
            best, permitted = W, 1.0 / largest
        sizes, axes = np.linalg.eigh(total)
        sizes = (sizes / sizes.max()).clip(0.0) ** (1.0 / _POWER)
        # Along the vector of the largest |λ| W stays, and elsewhere up to half of it goes.
        W = root @ ((axes * (1.0 + sizes)) @ axes.T) @ root.T / 2
    return best


def _first_weight(C: np.ndarray) -> np.ndarray:
    """Return W = -(C'P + P C) with P = T⁻'T⁻¹, T a real basis of the modes of C.

    W > 0 if C is stable. If modes of C coincide, W = 1.
    """
    T = real_basis(*np.linalg.eig(C))
    if np.linalg.cond(T) > _COINCIDENT:
        return np.eye(len(C))
    T_inverse = np.linalg.inv(T)
    P = T_inverse.T @ T_inverse
    return np.asarray(-(C.T @ P + P @ C))
