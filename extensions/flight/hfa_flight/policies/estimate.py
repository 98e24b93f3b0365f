"""Estimate of a Kalman filter over one sample, as CasADi expressions.

The filter is extended: the nonlinear aircraft in the estimated winds predicts, with slopes at the
estimate. Flights, exported C and FMUs evaluate these expressions. Two covariances are carried
through the samples: that of the errors, for the gate, and one from which the gains follow. The
latter goes on as if values were used while there are none: a fast policy that learns at once what
has happened leaves its limits.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.held_step import parts_of_a_sample, rate_in_push, slices_of, step_of_integration
from hfa_flight.policies.kalman import KalmanFilter

#: A value is impossible if its innovation is beyond this number of its standard deviations.
IMPOSSIBLE = 8.0
#: After this number of samples in a row with impossible values, the estimate begins anew if most
#: of them are impossible.
RESTARTS_AFTER = 10
#: Largest magnitude that counts as finite: CasADi has no `isfinite`.
_FINITE = 1e300
#: Ratio of the variance of a predicted state to that of the stationary filter above which the
#: prediction stands still. It then weighs a millionth in the next estimate, and with larger ones
#: the rounding errors of P, 1e-16 of them, would exceed 1e-10 of the stationary variance.
_UNKNOWN = 1e6
#: Option of a Jacobian in reverse mode, which of these equations has two thirds of the code.
_BACKWARD = {"helper_options": {"ad_weight": 1.0}}
#: Options of a function whose code is exported once, however often it is called.
_CALLED = {"cse": True, "never_inline": True}


class Estimate(NamedTuple):
    """Estimate of the states of a filter, in the order of the memory.

    x: deviations from the trim, (n,)
    missed: number of samples in a row with impossible values, (1,)
    begun: 0 before the first values, 1 after a sample at whose values it began first, 2 later, (1,)
    share: share of the policy's command that acts, (1,): an estimate that begins in flight fades
        commands in. Before the first values it is 0 in flight, and 1 if the states are known.
    last: last finite value of each sensor, (p,)
    P: covariance of the errors of x, (n, n), of which the memory has the lower triangle
    G: covariance from which the gains follow, (n, n): P without the samples that have no value
    """

    x: Any
    missed: Any
    begun: Any
    share: Any
    last: Any
    P: Any
    G: Any

    def packed(self) -> ca.SX:
        """Return the memory of the filter, (memory_size,)."""
        return ca.vertcat(*self._replace(P=_triangle(self.P), G=_triangle(self.G)))


def memory_slices(known: KalmanFilter) -> Estimate:
    """Return the slice of each part of an estimate in the memory."""
    n = len(known.Phi)
    triangle = n * (n + 1) // 2
    return Estimate(*slices_of([n, 1, 1, 1, len(known.sensors), triangle, triangle]))


def _triangle(P: ca.SX) -> ca.SX:
    """Return the entries of the lower triangle of a symmetric matrix, (n, n), column by column."""
    return ca.project(P, ca.Sparsity.lower(P.shape[0])).nz[:]


def _symmetric(triangle: ca.SX, n: int) -> ca.SX:
    """Return the symmetric matrix, (n, n), of the entries of its lower triangle."""
    return ca.tril2symm(ca.SX(ca.Sparsity.lower(n), triangle))


def memory_size(known: KalmanFilter) -> int:
    """Return the number of entries of the memory."""
    return int(memory_slices(known).G.stop)


def known_start(known: KalmanFilter) -> np.ndarray:
    """Return the memory before a flight from known states, in which commands act at once.

    A memory of zeros is that of a filter that is switched on in flight.
    """
    memory = np.zeros(memory_size(known))
    memory[memory_slices(known).share] = 1.0
    return memory


def estimate_in(known: KalmanFilter, memory: ca.SX) -> Estimate:
    """Return the estimate in a memory. Before the first sample P and G are both the filter's
    stationary P.
    """
    parts = Estimate(*(memory[part] for part in memory_slices(known)))
    at_begin = _triangle(ca.SX(ca.DM(known.P)))
    P, G = (
        _symmetric(ca.if_else(parts.begun, triangle, at_begin), len(known.Phi))
        for triangle in (parts.P, parts.G)
    )
    return parts._replace(P=P, G=G)


def updated(known: KalmanFilter, before: Estimate, y: ca.SX, fade: float) -> tuple[Estimate, ca.SX]:
    """Return the estimate with the measured deviations y, (p,), and 1 if a value was not used.

    A value that is not finite is missing, and so is one that equals the last one to the bit: it is
    frozen. A missing or impossible value is left out. In flight, the estimate begins at the first
    values that are given, in air of which only the turbulence is known, and commands are faded in;
    so it does where most values are impossible at the end of RESTARTS_AFTER such samples. From
    known states it begins at the values if one is impossible at the first sample, and commands act
    at once. It begins again at the second sample if a value is impossible then.

    fade: time in which commands are faded in, s
    """
    gate = _gate(known, before, y)
    x, P, G = _corrected_by_values(known, before, y, gate.is_used)
    impossible, given = sum(gate.is_impossible, ca.SX(0)), sum(gate.is_given, ca.SX(0))
    # Samples in a row with impossible values. One without any value is not counted.
    missed = ca.if_else(impossible > 0, before.missed + 1, ca.if_else(given > 0, 0, before.missed))
    is_wrong = ca.logic_and(missed >= RESTARTS_AFTER, 2 * impossible > given)
    # The first sample with values, and those after the second one.
    is_first, is_settled = before.begun == 0, before.begun == 2
    in_flight = ca.logic_and(is_first, before.share == 0)  # switched on, and without a value yet
    begins = ca.logic_or(
        ca.logic_and(in_flight, given > 0),
        ca.logic_and(impossible > 0, ca.logic_or(ca.logic_not(is_settled), is_wrong)),
    )
    waits = ca.logic_and(in_flight, ca.logic_not(begins))
    new_x, new_P = _at_values(known, before, y, gate.is_given)
    # The share at the begin: that of the memory (0 in flight, 1 of known states), or 0 again.
    fading = ca.if_else(is_settled, 0.0, before.share) if fade else 1.0
    faded = ca.fmin(before.share + known.dt / fade, 1.0) if fade else 1.0
    begun = ca.if_else(waits, 0, ca.if_else(ca.logic_and(is_first, begins), 1, 2))
    estimate = Estimate(
        x=ca.if_else(begins, new_x, x),
        P=ca.if_else(begins, new_P, P),
        G=ca.if_else(begins, new_P, G),
        missed=ca.if_else(begins, 0, missed),
        begun=begun,
        share=ca.if_else(ca.logic_or(begins, waits), fading, faded),
        last=ca.if_else(ca.fabs(y) <= _FINITE, y, before.last),
    )
    return estimate, ca.if_else(begins, 0, sum(gate.is_used) < len(known.sensors))


class _Gate(NamedTuple):
    """Of each measured value, 1 or 0: whether it is given, used, or given and impossible."""

    is_given: list[ca.SX]
    is_used: list[ca.SX]
    is_impossible: list[ca.SX]


def _gate(known: KalmanFilter, before: Estimate, y: ca.SX) -> _Gate:
    """Return which of the measured deviations y, (p,), are used."""
    gate = _Gate(is_given=[], is_used=[], is_impossible=[])
    for place, (row, variance) in enumerate(_rows_and_variances(known)):
        deviation = ca.sqrt(before.P[row, row] + variance)
        innovation = ca.fabs(y[place] - before.x[row])
        is_new = ca.logic_or(before.begun == 0, y[place] != before.last[place])  # not frozen
        is_given = ca.logic_and(is_new, innovation <= _FINITE)  # false for NaN
        is_used = ca.logic_and(is_given, innovation <= IMPOSSIBLE * deviation)
        gate.is_given.append(is_given)
        gate.is_used.append(is_used)
        gate.is_impossible.append(ca.logic_and(is_given, ca.logic_not(is_used)))
    return gate


def _rows_and_variances(known: KalmanFilter) -> list[tuple[int, float]]:
    """Return the row of the state that each sensor measures, and the variance of its noise."""
    rows = [known.states.index(name) for name in known.sensors]
    return list(zip(rows, np.diag(known.R).tolist(), strict=True))


def _corrected_by_values(
    known: KalmanFilter, before: Estimate, y: ca.SX, is_used: list[ca.SX]
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return x, P and G after the measured values that are used, one after the other.

    Without any, G follows as if all were used.
    """
    x, P, G = before.x, before.P, before.G
    is_blind = sum(is_used, ca.SX(0)) == 0
    correction = _correction(x.numel())
    for place, (row, variance) in enumerate(_rows_and_variances(known)):
        used = is_used[place]
        gain = G[:, row] / (G[row, row] + variance)
        x = x + gain * ca.if_else(used, y[place] - x[row], 0.0)
        P = _corrected(correction, P, row, variance, used * gain)
        G = _corrected(correction, G, row, variance, ca.logic_or(used, is_blind) * gain)
    return x, P, G


def _corrected(correction: ca.Function, P: ca.SX, row: int, variance: float, gain: ca.SX) -> ca.SX:
    """Return the covariance after the correction by a value of the state `row`, with any gain.

    variance: that of the value's noise
    """
    given = ca.vertcat(_triangle(P), P[:, row], P[row, row] + variance, gain)
    return _symmetric(correction(given), P.shape[0])


def _correction(n: int) -> ca.Function:
    """Return the function [triangle of P; its row; variance of the innovation; gain] -> triangle
    after the correction.
    """
    sizes = (n * (n + 1) // 2, n, 1, n)
    given = [ca.SX.sym("given", size) for size in sizes]
    triangle, of_row, variance, gain = given
    # P C' - gain variance: covariance of the corrected states and the innovation, 0 for the optimal
    # gain. Then P⁺ = P - gain (P C')' - (this) gain' for any gain.
    with_innovation = of_row - variance * gain
    P = _symmetric(triangle, n) - ca.mtimes(gain, of_row.T) - ca.mtimes(with_innovation, gain.T)
    return ca.Function("correction", [ca.vertcat(*given)], [_triangle(P)], _CALLED)


def _at_values(
    known: KalmanFilter, before: Estimate, y: ca.SX, is_given: list[ca.SX]
) -> tuple[ca.SX, ca.SX]:
    """Return x and P of an estimate that begins at the values that are given. Other states keep
    theirs. In flight the air is that of the stationary turbulence in which the flow angles are
    those of the trim: with slopes far from these, the next values would give wrong winds.
    """
    k = len(known.states)
    air, flow = slice(k, None), known.sight[:, k:]
    # The most likely air of given flow angles: their covariance with the air times their inverse.
    of_flow = known.climate @ flow.T @ np.linalg.pinv(flow @ known.climate @ flow.T)
    in_flight = ca.logic_or(before.begun == 2, before.share == 0)
    x, P = ca.SX(before.x), ca.SX(before.P)
    P[:, air] = ca.if_else(in_flight, 0.0, P[:, air])
    P[air, :] = P[:, air].T
    P[air, air] = ca.if_else(in_flight, known.climate, before.P[air, air])
    for place, (row, variance) in enumerate(_rows_and_variances(known)):
        given = is_given[place]
        x[row] = ca.if_else(given, y[place], x[row])
        P[row, :] = ca.if_else(given, 0.0, P[row, :])
        P[:, row] = P[row, :].T
        P[row, row] = ca.if_else(given, variance, P[row, row])
    x[air] = ca.if_else(in_flight, -ca.mtimes(ca.DM(of_flow), x[:k]), 0.0)
    return x, P


def propagated(known: KalmanFilter, now: Estimate, x: ca.SX, Phi: ca.SX) -> Estimate:
    """Return the estimate that is predicted for the next sample, with Φ P Φ' + Q and Φ G Φ' + Q.

    If a predicted state is not finite or a variance of P too large, nothing is known: the states
    and P stay as they are. G stays if one of its own is too large.

    x: predicted states, (n,)
    Phi: their derivatives by the states of the estimate, (n, n)
    """
    is_finite = ca.sumsqr(x) <= _FINITE
    n = Phi.shape[0]
    triangle, slopes = ca.SX.sym("P", n * (n + 1) // 2), ca.SX.sym("Phi", Phi.sparsity())
    after = ca.mtimes(ca.mtimes(slopes, _symmetric(triangle, n)), slopes.T) + known.Q
    given = ca.vertcat(triangle, slopes.nz[:])
    prediction = ca.Function("prediction", [given], [_triangle(after)], _CALLED)
    P, is_known = _predicted_covariance(known, prediction, now.P, Phi, is_finite)
    G, _ = _predicted_covariance(known, prediction, now.G, Phi, is_finite)
    return now._replace(x=ca.if_else(is_known, x, now.x), P=P, G=G)


def _predicted_covariance(
    known: KalmanFilter, prediction: ca.Function, P: ca.SX, Phi: ca.SX, is_finite: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return Φ P Φ' + Q and 1, or P and 0 if a variance is too large, or a state not finite.

    prediction: [triangle of P; entries of Φ] -> triangle of Φ P Φ' + Q
    """
    after = prediction(ca.vertcat(_triangle(P), Phi.nz[:]))
    later, is_known = _symmetric(after, P.shape[0]), is_finite
    for place in range(len(known.states)):
        limit = _UNKNOWN * float(known.P[place, place])
        is_known = ca.logic_and(is_known, later[place, place] <= limit)
    return ca.if_else(is_known, later, P), is_known


def extended_step(known: KalmanFilter, seconds: float) -> ca.Function:
    """Return (x, u) -> (x after some seconds, slopes by x (n, n)) of the nonlinear aircraft in the
    winds of x, with held inputs.

    The slopes are exp(J seconds) to the fourth power in each step, J those of the rates at x.
    """
    point, model, k = known.point, known.point.model, len(known.states)
    layout = (in_gusts(model) if known.winds else model).layout
    rows = model.state_places(known.states)
    x, u = ca.SX.sym("x", len(known.Phi)), ca.SX.sym("u", len(model.inputs))
    X = ca.SX(ca.DM(point.x))
    X[rows] += x[:k]
    no_push = ca.SX(k, 1)
    rest = ca.vertcat(point.u + u, no_push, known.winds_at(x), model.p)
    rate = rate_in_push(layout, model.linear, known.winds)
    rates = rate(ca.densify(ca.vertcat(X, rest)))[rows]
    parts = parts_of_a_sample([point], seconds)
    derivatives = ca.vertcat(rates, ca.DM(known.A[k:, k:]) @ x[k:])
    J = ca.jacobian(derivatives, x, _BACKWARD) * (seconds / parts)
    step = step_of_integration(layout, model.linear, known.winds)
    identity, square = ca.SX.eye(len(known.Phi)), ca.mtimes(J, J)
    # exp(J) = I + J + J² (I/2 + J/6 + J²/24) + ...
    Phi = part = identity + J + ca.mtimes(square, identity / 2 + J / 6 + square / 24)
    for _ in range(parts - 1):
        Phi = ca.mtimes(part, Phi)
    for _ in range(parts):
        X = step(ca.densify(ca.vertcat(X, rest, seconds / parts)))
    # The air is linear, and the aircraft has no effect on it.
    after = ca.vertcat((X - point.x)[rows], ca.mtimes(Phi[k:, k:], x[k:]))
    return ca.Function("extended", [x, u], [after, Phi])
