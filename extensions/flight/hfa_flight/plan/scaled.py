"""A problem of best flights in nominal units, as a predictive policy uses it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hfa_flight.plan.problem import FlightProblem, usual_box
from hfa_flight.plan.smooth import smooth_slopes
from hfa_support.errors import BadInputError, NoSolutionError, shown

#: Norm above which the exponential of a longer hold is computed by doubling a shorter hold.
_LARGEST_NORM = 0.5


class Hold(NamedTuple):
    """Linear model and cost over one hold.

      z⁺ = A z + B v,    ∫ z'Qz + v'Rv dt = [z; v]' W [z; v]

    A: (n, n)
    B: (n, m)
    W: (n + m, n + m)
    """

    A: np.ndarray
    B: np.ndarray
    W: np.ndarray

    def back(self, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the optimal gain K of the hold, v = -K z, and P before the hold.

        P: matrix of the least cost z'Pz after the hold, (n, n)
        """
        n = len(self.A)
        input_weight = self.W[n:, n:] + self.B.T @ P @ self.B
        K = np.linalg.solve(input_weight, self.B.T @ P @ self.A + self.W[n:, :n])
        before = self.W[:n, :n] + self.A.T @ P @ self.A - K.T @ input_weight @ K
        return K, 0.5 * (before + before.T)

    def infinite_horizon(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the gain K and the matrix P of the optimum over infinitely many equal holds.

        P is the solution of the discrete Riccati equation: `back` returns the same P.

        Raises NoSolutionError if the held model cannot be stabilized.
        """
        from scipy.linalg import LinAlgError, solve_discrete_are

        n = len(self.A)
        Q, N, R = self.W[:n, :n], self.W[:n, n:], self.W[n:, n:]
        try:
            P = solve_discrete_are(self.A, self.B, Q, R, s=N)
        except (LinAlgError, ValueError) as error:
            raise NoSolutionError(f"no linear optimum with a zero-order hold: {error}") from error
        return self.back(P)


def hold_of(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, seconds: float) -> Hold:
    """Return z' = A z + B v and ∫ z'Qz + v'Rv dt over a hold.

    seconds: duration of the hold, s
    """
    from scipy.linalg import block_diag, expm

    n, m = B.shape
    rates = np.zeros((n + m, n + m))  # of (z; v) in a hold, with v' = 0
    rates[:n] = np.hstack([A, B])
    size = float(np.abs(rates).sum(axis=1).max()) * seconds
    _, exponent = math.frexp(size / _LARGEST_NORM)  # size / _LARGEST_NORM < 2^exponent, 0 for 0
    doublings = max(0, exponent)
    # The exponential of this block matrix contains e^(rates t), and e^(-rates' t) times the
    # integral W of the cost (Van Loan, IEEE Transactions on Automatic Control 23 (1978) 395).
    of_both = np.block([[-rates.T, block_diag(Q, R)], [np.zeros_like(rates), rates]])
    exponential = expm(of_both * seconds / 2**doublings)
    transition = exponential[n + m :, n + m :]  # of (z; v)
    W = transition.T @ exponential[: n + m, n + m :]
    for _ in range(doublings):  # the cost of both halves, and the transition over both
        W = W + transition.T @ W @ transition
        transition = transition @ transition
    return Hold(transition[:n, :n], transition[:n, n:], 0.5 * (W + W.T))


#: Fraction of half of its range by which half of the inputs' ranges moves a state that they reach.
_SHARE_OF_RANGE = 0.1


class SignalCounts(NamedTuple):
    """Numbers k of states of the linear model, n of followed states and m of moving inputs."""

    linear: int
    followed: int
    inputs: int


class LinearCost(NamedTuple):
    """Linear model z' = A z + B v and its running cost z'Qz + v'Rv."""

    A: np.ndarray
    B: np.ndarray
    Q: np.ndarray
    R: np.ndarray


@dataclass(frozen=True, eq=False)
class ScaledProblem:
    """Linear model, weights and limits of a problem, divided by nominal values.

    z (n,) are the deviations of the followed states, v (m,) those of the moving inputs. The first k
    followed states are those of the linear model. The others are carried: states outside it on
    which its rates depend, such as the altitude.

    problem: aircraft, trim, weights and limits
    """

    problem: FlightProblem

    @cached_property
    def counts(self) -> SignalCounts:
        """Numbers of states and inputs."""
        problem = self.problem
        return SignalCounts(len(problem.states), len(problem.followed), len(problem.inputs))

    @cached_property
    def linear(self) -> LinearCost:
        """Linear model of the n followed states. The weights of carried states are 0."""
        n = self.counts.followed
        slopes = np.array(smooth_slopes(self.problem)(0.0))  # at the trim: all deviations are 0
        Q, R, _ = self.problem.scaled_weights()
        return LinearCost(slopes[:, :n], slopes[:, n:], Q, R)

    @cached_property
    def P(self) -> np.ndarray:
        """Matrix of the least cost z'Pz of the linear model without limits, (n, n)."""
        return self.problem.scaled_weights()[2]

    @cached_property
    def linear_states(self) -> LinearCost:
        """Linear model of its k states, without the carried ones."""
        k = self.counts.linear
        A, B, Q, R = self.linear
        return LinearCost(A[:k, :k], B[:k], Q[:k, :k], R)

    @cached_property
    def poles(self) -> np.ndarray:
        """Poles of the aircraft, 1/s, (k,)."""
        return np.asarray(np.linalg.eigvals(self.linear_states.A))

    @cached_property
    def loop_poles(self) -> np.ndarray:
        """Poles of the loop of the linear optimum, 1/s, (k,)."""
        linear = self.problem.linear
        return np.asarray(np.linalg.eigvals(linear.A - linear.B @ self.problem.K))

    @cached_property
    def fastest(self) -> float:
        """Magnitude of the fastest pole of the aircraft, 1/s; 0 for integrators alone."""
        return float(np.abs(self.poles).max())

    @cached_property
    def box(self) -> np.ndarray:
        """Half-widths of the usual box of initial deviations, (k,)."""
        return usual_box(self.problem) / self.problem.nominal.states[: self.counts.linear]

    def suboptimality_weight(self, P: np.ndarray) -> float:
        """Return the relative increase of the mean cost z'Pz over the usual box, against the
        linear optimum without holds.

        P: (k, k) or (n, n)
        """
        k = self.counts.linear
        # The mean of z'Pz over a box with half-widths h is the sum of P_ii h_i² / 3.
        mean, least = (np.diag(matrix)[:k] @ self.box**2 for matrix in (P, self.P))
        return float(mean / least - 1.0)

    @cached_property
    def state_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest deviations of the followed states, (n,) each."""
        lowest, highest = self.problem.state_limits
        nominal = self.problem.nominal.states
        return lowest / nominal, highest / nominal

    @cached_property
    def input_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest deviations of the inputs, (m,) each."""
        lowest, highest = self.problem.input_limits
        nominal = self.problem.nominal.inputs
        return lowest / nominal, highest / nominal

    def reached(self, dt: float) -> np.ndarray:
        """Return a mask of the followed states that half of the inputs' ranges moves in dt seconds
        by a tenth of half of the states' ranges, (n,). States without limits, and carried ones, do
        not count.
        """
        k, n, _ = self.counts
        lowest, highest = self.input_limits
        half_ranges = 0.5 * (highest - lowest)
        # An input without limits moves by its nominal value.
        steps = np.where(np.isfinite(half_ranges), half_ranges, 1.0)
        moves = np.abs(hold_of(*self.linear_states, dt).B) @ steps
        below, above = (limit[:k] for limit in self.state_limits)
        rooms = 0.5 * (above - below)
        return np.pad(np.isfinite(rooms) & (moves >= _SHARE_OF_RANGE * rooms), (0, n - k))


#: Number of holds of a plan. With samples of at least _SLOW_SAMPLE seconds, it is twice this
#: number, and the longest hold is longer by the factor _LONGER_HOLDS.
HOLDS = 36
_SLOW_SAMPLE = 0.02
_LONGER_HOLDS = 2.0
#: Largest product of the sample time and the fastest pole of the aircraft.
_RESOLVED = 0.7
#: Largest sample time that may be asked, relative to that of the rule.
_COARSEST = 5.0
#: Largest relative increase of the least linear cost over the usual box: by holding the inputs for
#: ever, and by the holds of a plan that ends with z'Pz.
_HOLD_PRICE = 0.005
_GRID_PRICE = 0.01
#: Numbers of samples from which on holds are longer than a sample, the first that fits is taken.
_FINE = (8, 16)
#: Largest product of a hold of several samples and the fastest pole. In longer holds, states exceed
#: limits between the nodes. Largest number of samples of a hold.
_LONGEST_HOLD = 0.4
_MOST_SAMPLES = 64
#: Largest horizon, in time constants of the slowest pole of the linear loop, and in those of the
#: fastest growing pole of the aircraft. A plan is an open-loop flight, and errors grow with it.
_HORIZON = 4.0
_UNSTABLE_HORIZON = 10.0
#: Sample times, s, the longest first.
_SAMPLE_TIMES = tuple(a * 10.0**e for e in (0, -1, -2, -3, -4) for a in (5, 2, 1))


class Holds(NamedTuple):
    """Holds of one plan.

    samples: numbers of samples of the holds, (N,)
    seconds: durations, (N,)
    linear: linear model and cost of each hold
    weights: W of each hold, (N, n + m, n + m)
    """

    samples: np.ndarray
    seconds: np.ndarray
    linear: list[Hold]
    weights: np.ndarray


class Grid:
    """Holds of successive plans: the holds of a plan split those of the plan one sample earlier.

    A hold ends at a multiple of its own number of samples, a power of two that grows with the
    distance. The inputs of a plan are thus also inputs of the next plan, except the last ones.

    scaled: the problem in nominal units
    dt: sample time, the first hold, s
    fine: number of samples from which on holds are longer than one sample
    count: number N of holds
    longest: largest number of samples of a hold, a power of two
    asked: horizon that was cut, s, or None
    """

    def __init__(
        self,
        scaled: ScaledProblem,
        dt: float,
        fine: int,
        count: int,
        longest: int,
        asked: float | None = None,
    ) -> None:
        self.scaled, self.dt, self.asked = scaled, dt, asked
        self._fine, self._count, self._longest = fine, count, longest
        #: Number of samples since a plan that began at a multiple of `longest` -> holds of a plan.
        self._holds_of_plans: dict[int, Holds] = {}
        #: Number of samples of a hold -> its linear model and cost.
        self._holds: dict[int, Hold] = {}

    def samples(self, age: int) -> np.ndarray:
        """Return the numbers of samples of the holds of a plan, (N,).

        age: number of samples since the first plan
        """
        lengths: list[int] = []
        first_sample = age
        for _ in range(self._count):
            # At most 2 / fine of the number of samples since the begin of the plan.
            allowed = max(1, 2 * (first_sample - age) // self._fine)
            power_of_two = 1 << (allowed.bit_length() - 1)  # the largest up to `allowed`
            length = min(power_of_two, self._longest)
            # A hold begins and ends at a multiple of its length, so that later plans have it, too.
            while first_sample % length:
                length //= 2
            lengths.append(length)
            first_sample += length
        return np.array(lengths)

    def at(self, age: int) -> Holds:
        """Return the holds of a plan. The argument is that of `samples`."""
        phase = age % self._longest
        if phase not in self._holds_of_plans:
            samples = self.samples(phase)
            linear = [self._hold(length) for length in samples.tolist()]
            weights = np.array([hold.W for hold in linear])
            self._holds_of_plans[phase] = Holds(samples, self.dt * samples, linear, weights)
        return self._holds_of_plans[phase]

    def _hold(self, length: int) -> Hold:
        """Return the linear model and cost of a hold of some samples, computed once."""
        if length not in self._holds:
            self._holds[length] = hold_of(*self.scaled.linear, length * self.dt)
        return self._holds[length]

    @property
    def most_samples(self) -> tuple[np.ndarray, int]:
        """Largest number of samples of each hold over all plans, (N,), and of a whole plan."""
        samples = np.array([self.samples(age) for age in range(self._longest)])
        return samples.max(axis=0), int(samples.sum(axis=1).max())

    @property
    def horizon(self) -> float:
        """Duration of the first plan, s."""
        return float(self.dt * self.samples(0).sum())

    def cut(self, longest: float) -> Grid:
        """Return the grid whose first plan lasts at most a given time, s."""
        ends = self.dt * np.cumsum(self.samples(0))
        count = max(1, int(np.count_nonzero(ends <= longest * (1.0 + 1e-9))))
        return Grid(self.scaled, self.dt, self._fine, count, self._longest, self.asked)


def gains_of(holds: Sequence[Hold], P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear optimal gains of the holds of a plan, (N, m, n), and P at its start.

    P: matrix of the cost z'Pz at the end of the plan, (n, n)
    """
    gains = []
    for hold in reversed(holds):
        K, P = hold.back(P)
        gains.append(K)
    return np.array(gains[::-1]), P


def grid_of(scaled: ScaledProblem, dt: float | None, horizon: float | None) -> Grid:
    """Return the holds of a plan, chosen from the linear model alone.

    - dt is the longest of 0.1, 0.2, 0.5, 1, ... ms for which the product with the aircraft's
      fastest pole is at most 0.7, and the linear optimum with held inputs costs at most 0.5 % more
      than the optimum, over the usual box.
    - The first 8 holds, or 16, are samples. Later ones last at most 0.4 time constants of the
      fastest pole, or 0.8 if dt is at least 20 ms. The linear optimum of a plan costs at most 1 %
      more than the optimum, or all holds are samples. There are 36 holds, or 72 if dt is at least
      20 ms.
    - The horizon is at most 4 time constants of the slowest pole of the linear loop and 10 of the
      fastest growing pole of the aircraft.

    dt: sample time, s, or None for the rule
    horizon: duration of a plan, s, or None for the rule. It is cut to 10 time constants of the
      fastest growing pole, and to the longest grid of the rule

    Raises BadInputError for a dt that is too long and for a horizon that is too short. Raises
    NoSolutionError if no sample time fits.
    """
    dt = sample_time_of_plans(scaled, dt)
    if horizon is not None and not dt <= horizon < math.inf:
        raise BadInputError(
            f"the horizon is {shown(horizon)} s; with samples of {dt:g} s, give at least {dt:g} s"
        )
    growing = float(scaled.poles.real.max(initial=0.0))
    longest_horizon = _UNSTABLE_HORIZON / growing if growing > 0.0 else math.inf
    slowest = float(np.abs(scaled.loop_poles.real).min())
    wanted_horizon = min(longest_horizon, _HORIZON / slowest if horizon is None else horizon)
    count = HOLDS * (2 if dt >= _SLOW_SAMPLE else 1)
    longest = _longest_hold(scaled, dt)
    # The coarsest grid comes first; all holds of the last one are samples.
    grids = [Grid(scaled, dt, fine, count, longest) for fine in (*_FINE, count)]
    if horizon is not None:
        # The finest grid that lasts long enough, or else the longest.
        long_enough = [grid for grid in grids if grid.horizon >= wanted_horizon * (1.0 - 1e-9)]
        grid = (long_enough[-1] if long_enough else grids[0]).cut(wanted_horizon)
        grid.asked = horizon if grid.horizon < horizon - dt else None
        return grid
    for grid in grids:
        fitting = grid.cut(wanted_horizon)
        if scaled.suboptimality_weight(gains_of(fitting.at(0).linear, scaled.P)[1]) <= _GRID_PRICE:
            break
    return fitting


def _longest_hold(scaled: ScaledProblem, dt: float) -> int:
    """Return the largest number of samples of a hold, a power of two."""
    time_constants = _LONGEST_HOLD * (_LONGER_HOLDS if dt >= _SLOW_SAMPLE else 1.0)
    # At most _MOST_SAMPLES, also of an aircraft without a fastest pole.
    samples = int(time_constants / max(scaled.fastest * dt, time_constants / _MOST_SAMPLES))
    return 1 << (max(1, samples).bit_length() - 1)  # the largest power of two up to it


def sample_time_of_plans(scaled: ScaledProblem, asked: float | None = None) -> float:
    """Return the sample time of plans, s: that of `_rule_of_samples`, or the asked one.

    Raises BadInputError if the asked one is more than _COARSEST times as long as that of the rule.
    """
    if asked is None:
        return _rule_of_samples(scaled)
    try:
        rule = _rule_of_samples(scaled)
    except NoSolutionError:
        # The longest that resolves the fastest pole, whatever it costs.
        rule = _RESOLVED / scaled.fastest if scaled.fastest else math.inf
    if asked > _COARSEST * rule:
        raise BadInputError(
            f"dt is {shown(asked)} s; give at most {_COARSEST * rule:.3g} s, "
            f"{_COARSEST:g} times the default of this aircraft"
        )
    return asked


def _rule_of_samples(scaled: ScaledProblem) -> float:
    """Return the longest listed sample time, s, that resolves the fastest pole and costs little.

    The cost is that of inputs held for a sample, above the least linear cost.
    """
    for dt in _SAMPLE_TIMES:
        if dt * scaled.fastest > _RESOLVED:
            continue
        try:
            _, P = hold_of(*scaled.linear_states, dt).infinite_horizon()
        except NoSolutionError:
            continue
        if scaled.suboptimality_weight(P) <= _HOLD_PRICE:
            return dt
    raise NoSolutionError(
        f"no sample time of at least {_SAMPLE_TIMES[-1]:g} s costs at most "
        f"{100 * _HOLD_PRICE:g} %; give dt"
    )


#: Fraction of the limits within which the linear loop stays.
_SHARE_OF_LIMITS = 0.9
#: Numbers of samples of the linear loop that are checked one by one, and of further steps of
#: _SAMPLES_OF_STEP samples each.
_CHECKED_SAMPLES = 150
_FURTHER_STEPS = 100
_SAMPLES_OF_STEP = 10


class EndPolicy:
    """Exact held gain v = -K z, where the linear loop keeps all limits.

    The set of these states is the maximal output admissible set of the linear loop.

    scaled: the problem in nominal units
    hold: linear model over a sample
    K: gain, (m, k)
    poles: eigenvalues of the held linear loop, (k,)

    Source: Gilbert and Tan, IEEE Transactions on Automatic Control 36 (1991) 1008.
    """

    def __init__(self, scaled: ScaledProblem, hold: Hold, K: np.ndarray) -> None:
        k = scaled.counts.linear
        self.K = K
        self._scaled = scaled
        loop = hold.A - hold.B @ K
        self.poles = np.asarray(np.linalg.eigvals(loop))
        of_step = np.linalg.matrix_power(loop, _SAMPLES_OF_STEP)
        transition = np.eye(k)  # from z to the states after some samples
        states_and_inputs = []
        # The first samples one by one, then the ends of steps of several samples.
        for number in range(_CHECKED_SAMPLES + _FURTHER_STEPS):
            states_and_inputs.append(np.vstack([transition, -K @ transition]))
            transition = (loop if number < _CHECKED_SAMPLES else of_step) @ transition
        #: Matrices from z to the states and inputs after the checked numbers of samples.
        self._states_and_inputs = np.array(states_and_inputs)

    def contains(self, z: np.ndarray) -> bool:
        """Return whether the linear loop from z stays within `_SHARE_OF_LIMITS` of all limits.

        z: followed states, (n,)
        """
        k = self._scaled.counts.linear
        lowest_z, highest_z = self._scaled.state_limits
        lowest_v, highest_v = self._scaled.input_limits
        lowest = _SHARE_OF_LIMITS * np.concatenate([lowest_z[:k], lowest_v])
        highest = _SHARE_OF_LIMITS * np.concatenate([highest_z[:k], highest_v])
        flown = self._states_and_inputs @ z[:k]  # a row for each of the checked samples
        return bool(((flown <= highest) & (flown >= lowest)).all())

    def inputs(self, z: np.ndarray) -> np.ndarray:
        """Return the inputs v, (m,), within their limits."""
        return np.clip(-self.K @ z[: self.K.shape[1]], *self._scaled.input_limits)
