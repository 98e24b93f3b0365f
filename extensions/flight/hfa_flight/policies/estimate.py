"""Estimate of a Kalman filter over one sample, as CasADi expressions.

The filter is extended: the nonlinear aircraft in the estimated winds predicts, with slopes at the
estimate. Flights, exported C and FMUs evaluate these expressions. Two covariances are carried
through the samples: that of the errors, for the gate, and one from which the gains follow. The
latter goes on as if values were used while there are none: a fast policy that learns at once what
has happened leaves its limits.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.held_step import parts_of_a_sample, rate_in_push, step_of_integration
from hfa_flight.policies.kalman import KalmanFilter

#: A value is impossible if its innovation is beyond this number of its standard deviations.
IMPOSSIBLE = 8.0
#: After this number of samples in a row with impossible values, the estimate begins anew if most
#: of them are impossible.
RESTARTS_AFTER = 10
#: Largest magnitude of a finite value: CasADi has no function of that name.
_FINITE = 1e300
#: Variance of a predicted state of the aircraft, in that of the stationary filter, above which the
#: prediction stands still: of the next estimate it is a millionth, and rounding of P another 1e-10.
_UNKNOWN = 1e6


class Estimate(NamedTuple):
    """Estimate of the states of a filter.

    x: deviations from the trim, (n,)
    P: covariance of their errors, (n, n)
    G: covariance from which the gains follow, (n, n): P without the samples that have no value
    missed: number of samples in a row with impossible values, (1,)
    begun: 0 before the first values, 1 after a sample at whose values it began first, 2 later, (1,)
    share: share of the policy's command that acts, (1,): an estimate that begins in flight fades
        commands in. Before the first values it is 0 in flight, and 1 if the states are known.
    last: last finite value of each sensor, (p,)
    """

    x: ca.SX
    P: ca.SX
    G: ca.SX
    missed: ca.SX
    begun: ca.SX
    share: ca.SX
    last: ca.SX

    def packed(self) -> ca.SX:
        """Return the memory of the filter, (memory_size,)."""
        pairs = _lower_triangle(self.x.numel())
        entries = [covariance[i, j] for covariance in (self.P, self.G) for i, j in pairs]
        return ca.vertcat(self.x, self.missed, self.begun, self.share, self.last, *entries)


def _lower_triangle(n: int) -> list[tuple[int, int]]:
    """Return the places of the lower triangle of an (n, n) matrix."""
    rows, columns = np.tril_indices(n)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def memory_size(known: KalmanFilter) -> int:
    """Return the number of entries of the memory: x, two counts, the share of the command, p
    values, lower triangles of P and G.
    """
    n = len(known.Phi)
    return n + 3 + len(known.sensors) + n * (n + 1)


def known_start(known: KalmanFilter) -> np.ndarray:
    """Return the memory before the first sample of a flight whose beginning is known: the commands
    act at once. Zero is that of a flight whose beginning is not.
    """
    return np.eye(1, memory_size(known), len(known.Phi) + 2).ravel()


def estimate_in(known: KalmanFilter, memory: ca.SX) -> Estimate:
    """Return the estimate in a memory, with the stationary P and G before the first sample."""
    n = len(known.Phi)
    ends = [0, n, n + 1, n + 2, n + 3, n + 3 + len(known.sensors), memory.numel()]
    x, missed, begun, share, last, entries = ca.vertsplit(memory, ends)
    P, G = (_symmetric(known.P, begun, half) for half in ca.vertsplit(entries, n * (n + 1) // 2))
    return Estimate(x, P, G, missed, begun, share, last)


def _symmetric(stationary: np.ndarray, begun: ca.SX, triangle: ca.SX) -> ca.SX:
    """Return the covariance of a lower triangle, or the stationary one before the first sample."""
    n = len(stationary)
    covariance = ca.SX(n, n)
    for place, (i, j) in enumerate(_lower_triangle(n)):
        entry = ca.if_else(begun, triangle[place], float(stationary[i, j]))
        covariance[i, j] = covariance[j, i] = entry
    return covariance


class Updated(NamedTuple):
    """Estimate at a sample, and 1 if a value of the sample was not used."""

    estimate: Estimate
    is_left_out: ca.SX


def updated(known: KalmanFilter, before: Estimate, y: ca.SX, fade: float) -> Updated:
    """Return the estimate with the measured deviations y, (p,).

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
    missed = ca.if_else(impossible > 0, before.missed + 1, ca.if_else(given > 0, 0, before.missed))
    is_wrong = ca.logic_and(missed >= RESTARTS_AFTER, 2 * impossible > given)
    is_first, is_settled = before.begun == 0, before.begun == 2
    in_flight = ca.logic_and(is_first, before.share == 0)
    begins = ca.logic_or(
        ca.logic_and(in_flight, given > 0),
        ca.logic_and(impossible > 0, ca.logic_or(ca.logic_not(is_settled), is_wrong)),
    )
    waits = ca.logic_and(in_flight, ca.logic_not(begins))
    new_x, new_P = _at_values(known, before, y, gate.is_given)
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
    return Updated(estimate, ca.if_else(begins, 0, sum(gate.is_used) < len(known.sensors)))


class _Gate(NamedTuple):
    """Of each measured value, 1 or 0: whether it is given, used, or given and impossible."""

    is_given: list[ca.SX]
    is_used: list[ca.SX]
    is_impossible: list[ca.SX]


def _gate(known: KalmanFilter, before: Estimate, y: ca.SX) -> _Gate:
    """Return which of the measured deviations y, (p,), are used."""
    gate = _Gate([], [], [])
    for place, (row, variance) in enumerate(_rows_and_variances(known)):
        deviation = ca.sqrt(before.P[row, row] + variance)
        innovation = ca.fabs(y[place] - before.x[row])
        is_new = ca.logic_or(before.begun == 0, y[place] != before.last[place])
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
    for place, (row, variance) in enumerate(_rows_and_variances(known)):
        used = is_used[place]
        gain = G[:, row] / (G[row, row] + variance)
        x = x + gain * ca.if_else(used, y[place] - x[row], 0.0)
        P = _corrected(P, used * gain, row, variance)
        G = _corrected(G, ca.logic_or(used, is_blind) * gain, row, variance)
    return x, P, G


def _corrected(P: ca.SX, gain: ca.SX, row: int, variance: float) -> ca.SX:
    """Return the covariance after the correction by a value of the state `row`, with any gain.

    variance: that of the value's noise
    """
    of_row = P[:, row]
    # covariance of the corrected states with the innovation, 0 for the optimal gain
    with_innovation = of_row - (P[row, row] + variance) * gain
    return _mirrored(P - ca.mtimes(gain, of_row.T) - ca.mtimes(with_innovation, gain.T))


def _mirrored(covariance: ca.SX) -> ca.SX:
    """Return the symmetric matrix of a lower triangle: the upper one is not computed."""
    return ca.tril2symm(ca.tril(covariance))


def _at_values(
    known: KalmanFilter, before: Estimate, y: ca.SX, is_given: list[ca.SX]
) -> tuple[ca.SX, ca.SX]:
    """Return x and P of an estimate that begins at the values that are given. Other states keep
    theirs, and in flight the air is that of the stationary turbulence.
    """
    air = slice(len(known.states), None)
    in_flight = ca.logic_or(before.begun == 2, before.share == 0)
    x, P = ca.SX(before.x), ca.SX(before.P)
    x[air] = 0.0
    P[:, air] = ca.if_else(in_flight, 0.0, P[:, air])
    P[air, :] = P[:, air].T
    P[air, air] = ca.if_else(in_flight, known.climate, before.P[air, air])
    for place, (row, variance) in enumerate(_rows_and_variances(known)):
        given = is_given[place]
        x[row] = ca.if_else(given, y[place], x[row])
        for other in range(x.numel()):
            P[row, other] = P[other, row] = ca.if_else(given, 0.0, P[row, other])
        P[row, row] = ca.if_else(given, variance, P[row, row])
    return x, P


def propagated(known: KalmanFilter, now: Estimate, x: ca.SX, Phi: ca.SX) -> Estimate:
    """Return the estimate that is predicted for the next sample, with Φ P Φ' + Q and Φ G Φ' + Q.

    If a predicted state is not finite or a variance of P too large, nothing is known: the states
    and P stay as they are. G stays if one of its own is too large.

    x: predicted states, (n,)
    Phi: their derivatives by the states of the estimate, (n, n)
    """
    is_finite = ca.sumsqr(x) <= _FINITE
    P, is_known = _predicted_covariance(known, now.P, Phi, is_finite)
    G, _ = _predicted_covariance(known, now.G, Phi, is_finite)
    return now._replace(x=ca.if_else(is_known, x, now.x), P=P, G=G)


def _predicted_covariance(
    known: KalmanFilter, P: ca.SX, Phi: ca.SX, is_finite: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return Φ P Φ' + Q and 1, or P and 0 if a variance is too large, or a state not finite."""
    later, is_known = _mirrored(ca.mtimes(ca.mtimes(Phi, P), Phi.T) + known.Q), is_finite
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
    rest = ca.vertcat(point.u + u, ca.SX(k, 1), known.winds_at(x), model.p)
    rate = rate_in_push(layout, model.linear, known.winds)
    rates = rate(ca.densify(ca.vertcat(X, rest)))[rows]
    parts = parts_of_a_sample([point], seconds)
    J = ca.jacobian(ca.vertcat(rates, ca.DM(known.A[k:, k:]) @ x[k:]), x) * (seconds / parts)
    step = step_of_integration(layout, model.linear, known.winds)
    Phi = part = _exponential(J)
    for _ in range(parts - 1):
        Phi = ca.mtimes(part, Phi)
    for _ in range(parts):
        X = step(ca.densify(ca.vertcat(X, rest, seconds / parts)))
    after = ca.vertcat((X - point.x)[rows], ca.mtimes(Phi[k:, k:], x[k:]))
    return ca.Function("extended", [x, u], [after, Phi])


def _exponential(A: ca.SX) -> ca.SX:
    """Return exp(A) to the fourth power of A."""
    exponential = term = ca.SX.eye(A.shape[0])
    for power in range(1, 5):
        term = ca.mtimes(term, A) / power
        exponential = exponential + term
    return exponential
