"""Estimate of a Kalman filter over one sample, as CasADi expressions.

Flights, exported C and FMUs evaluate these expressions. Two covariances are carried through the
samples: that of the errors, for the gate, and one from which the gains follow. A fast policy that
learns a large error within one sample leaves its limits, even if what it learns is true. Therefore
an estimate returns after missing values as fast as the stationary filter, and no faster.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.air.held_step import held_step, parts_of_a_sample
from hfa_flight.policies.kalman import KalmanFilter

#: A value is impossible if its innovation is beyond this number of its standard deviations.
IMPOSSIBLE = 8.0
#: After this number of samples in a row with impossible values, the estimate begins anew if most
#: of them are impossible.
LOST = 10
#: Largest magnitude of a finite value: CasADi has no function of that name.
_FINITE = 1e300
#: Variance of a predicted state, in that of the stationary filter, above which the prediction
#: stands still: of the next estimate it is a millionth, and rounding of P another 1e-10.
_UNKNOWN = 1e6


class Estimate(NamedTuple):
    """Estimate of the states of a filter.

    x: deviations from the trim, (n,)
    P: covariance of their errors, (n, n)
    G: covariance from which the gains follow, (n, n): P without the samples that have no value
    missed: number of samples in a row with impossible values, (1,)
    begun: 0 before the first sample, 1 after a first one with an impossible value, 2 later, (1,)
    last: last finite value of each sensor, (p,)
    """

    x: ca.SX
    P: ca.SX
    G: ca.SX
    missed: ca.SX
    begun: ca.SX
    last: ca.SX

    def packed(self) -> ca.SX:
        """Return the memory of the filter, (memory_size,)."""
        pairs = _lower_triangle(self.x.numel())
        entries = [covariance[i, j] for covariance in (self.P, self.G) for i, j in pairs]
        return ca.vertcat(self.x, self.missed, self.begun, self.last, *entries)


def _lower_triangle(n: int) -> list[tuple[int, int]]:
    """Return the places of the lower triangle of an (n, n) matrix."""
    rows, columns = np.tril_indices(n)
    return list(zip(rows.tolist(), columns.tolist(), strict=True))


def memory_size(known: KalmanFilter) -> int:
    """Return the number of entries of the memory: x, two counts, p values, triangles of P and G."""
    n = len(known.Phi)
    return n + 2 + len(known.sensors) + n * (n + 1)


def unpacked(known: KalmanFilter, memory: ca.SX) -> Estimate:
    """Return the estimate in a memory, with the stationary P and G before the first sample."""
    n = len(known.Phi)
    ends = [0, n, n + 1, n + 2, n + 2 + len(known.sensors), memory.numel()]
    x, missed, begun, last, entries = ca.vertsplit(memory, ends)
    P, G = (_symmetric(known.P, begun, each) for each in ca.vertsplit(entries, n * (n + 1) // 2))
    return Estimate(x, P, G, missed, begun, last)


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


def updated(
    known: KalmanFilter, before: Estimate, y: ca.SX, *, is_extended: bool = False
) -> Updated:
    """Return the estimate with the measured deviations y, (p,).

    A value that is not finite is missing, and so is one that equals the last one to the bit: it is
    frozen. A missing or impossible value is left out. The estimate begins at the values that are
    given if one is impossible at the first sample, or then at the second, because the first was, or
    most are at the end of LOST such samples in a row.
    With the linear model, a value corrects its own state at most as in the stationary filter, and
    a measured speed is taken without what the predicted wind across the path adds to it, if all
    values on which this depends are used.

    is_extended: whether the nonlinear model predicts the states
    """
    gate = _gate(known, before, y)
    seen = y
    if not is_extended:
        seen = y - _added_speed(known, y, winds_in(known, before.x), gate.is_used)
    x, P, G = _corrected_by_values(known, before, seen, gate.is_used, is_extended=is_extended)
    impossible, given = sum(gate.is_impossible, ca.SX(0)), sum(gate.is_given, ca.SX(0))
    missed = ca.if_else(impossible > 0, before.missed + 1, ca.if_else(given > 0, 0, before.missed))
    is_lost = ca.logic_and(missed >= LOST, 2 * impossible > given)
    begins = ca.logic_and(impossible > 0, ca.logic_or(before.begun < 2, is_lost))
    new_x, new_P = _at_values(known, before, seen, gate.is_given)
    x, P = ca.if_else(begins, new_x, x), ca.if_else(begins, new_P, P)
    begun = ca.if_else(ca.logic_and(before.begun == 0, impossible > 0), 1, 2)
    last = ca.if_else(ca.fabs(y) <= _FINITE, y, before.last)
    G = P if is_extended else G
    estimate = Estimate(x, P, G, ca.if_else(begins, 0, missed), begun, last)
    left_out = ca.if_else(begins, 0, sum(gate.is_used) < len(known.sensors))
    return Updated(estimate, left_out)


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
    known: KalmanFilter, before: Estimate, y: ca.SX, is_used: list[ca.SX], *, is_extended: bool
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return x, P and G after the measured values that are used, one after the other.

    Without any, G follows as if all were used, so that gains do not grow; that of an extended
    filter is P.
    """
    x, P, G = before.x, before.P, before.P if is_extended else before.G
    is_blind = ca.logic_not(ca.logic_or(sum(is_used, ca.SX(0)) > 0, is_extended))
    rows_and_variances = _rows_and_variances(known)
    largest = [np.inf] * len(rows_and_variances) if is_extended else _own_gains(known)
    for place, (row, variance) in enumerate(rows_and_variances):
        used = is_used[place]
        own_gain = G[row, row] / (G[row, row] + variance)
        gain = ca.fmin(1.0, largest[place] / own_gain) / (G[row, row] + variance) * G[:, row]
        x = x + gain * ca.if_else(used, y[place] - x[row], 0.0)
        P = _corrected(P, used * gain, row, variance)
        G = _corrected(G, ca.logic_or(used, is_blind) * gain, row, variance)
    return x, P, G


def _own_gains(known: KalmanFilter) -> list[float]:
    """Return by how much each value corrects its own state in the stationary filter, in turn."""
    P, gains = ca.SX(ca.DM(known.P)), []
    for row, variance in _rows_and_variances(known):
        gain = P[:, row] / (P[row, row] + variance)
        gains.append(float(gain[row]))
        P = _corrected(P, gain, row, variance)
    return gains


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
    """Return x and P of an estimate that begins at the values that are given."""
    x, P = ca.SX(before.x), ca.SX(before.P)
    for place, (row, variance) in enumerate(_rows_and_variances(known)):
        given = is_given[place]
        x[row] = ca.if_else(given, y[place], x[row])
        for other in range(x.numel()):
            P[row, other] = P[other, row] = ca.if_else(given, 0.0, P[row, other])
        P[row, row] = ca.if_else(given, variance, P[row, row])
    return x, P


def winds_in(known: KalmanFilter, x: ca.SX) -> ca.SX:
    """Return the winds of some states (n,), within 4 standard deviations, (w,)."""
    winds = ca.mtimes(ca.DM(known.W), x[len(known.states) :])
    return ca.fmin(ca.fmax(winds, -ca.DM(known.strongest)), ca.DM(known.strongest))


def _added_speed(known: KalmanFilter, y: ca.SX, winds: ca.SX, is_used: list[ca.SX]) -> ca.SX:
    """Return what winds across the path add to the measured values, of the speed alone, (p,), or
    zero if a value on which it depends is not used.
    """
    added, of_sensors = known.added_speed(), ca.SX(y.numel(), 1)
    if added is None:
        return of_sensors
    z, is_complete = ca.SX(len(known.states), 1), ca.SX(1)
    for row in added.needed:
        sensor = known.sensors.index(known.states[row])
        z[row] = y[sensor]
        is_complete = ca.logic_and(is_complete, is_used[sensor])
    speed = known.sensors.index(known.states[added.row])
    of_sensors[speed] = ca.if_else(is_complete, added.of(z, winds), 0.0)
    return of_sensors


def propagated(known: KalmanFilter, now: Estimate, x: ca.SX, Phi: ca.SX | ca.DM) -> Estimate:
    """Return the estimate that is predicted for the next sample.

    If a variance of the predicted P is too large, nothing is known: the states and P stay as they
    are. G stays if one of its own is.

    x: predicted states, (n,)
    Phi: their derivatives by the states of the estimate, (n, n)
    """
    P, is_known = _predicted_covariance(known, now.P, Phi)
    G, _ = _predicted_covariance(known, now.G, Phi)
    return now._replace(x=ca.if_else(is_known, x, now.x), P=P, G=G)


def _predicted_covariance(known: KalmanFilter, P: ca.SX, Phi: ca.SX | ca.DM) -> tuple[ca.SX, ca.SX]:
    """Return Φ P Φ' + Q and 1, or P and 0 if a variance of the former is too large."""
    later = _mirrored(ca.mtimes(ca.mtimes(Phi, P), Phi.T) + known.Q)
    is_known = ca.SX(1)
    for place, variance in enumerate(np.diag(known.P).tolist()):
        is_known = ca.logic_and(is_known, later[place, place] <= _UNKNOWN * variance)
    return ca.if_else(is_known, later, P), is_known


def extended_step(known: KalmanFilter, Phi: np.ndarray, seconds: float) -> ca.Function:
    """Return (x, u) -> (x after some seconds, slopes by x (n, n)) of the nonlinear aircraft in the
    winds of x, with held inputs.

    Phi: linear model of these seconds, which moves the states of the air
    """
    point, n, k = known.point, len(known.Phi), len(known.states)
    model = point.model
    steps = parts_of_a_sample([point], seconds)
    moved = held_step(model, seconds, steps, known.winds)
    x, u = ca.MX.sym("x", n), ca.MX.sym("u", len(model.inputs))
    chosen = ca.DM(np.eye(len(point.x))[:, model.state_places(known.states)])
    z, of_air = ca.vertsplit(x, [0, k, n]) if n > k else (x, ca.MX(0, 1))
    limit = ca.DM(known.strongest)
    winds = ca.fmin(ca.fmax(ca.mtimes(ca.DM(known.W), of_air), -limit), limit)
    push = ca.vertcat(ca.DM.zeros(k), winds)
    X, _ = moved(point.x + ca.mtimes(chosen, z), point.u + u, push, model.p)
    after = ca.vertcat(ca.mtimes(chosen.T, X - point.x), ca.mtimes(ca.DM(Phi[k:, k:]), of_air))
    return ca.Function("extended", [x, u], [after, ca.densify(ca.jacobian(after, x))])
