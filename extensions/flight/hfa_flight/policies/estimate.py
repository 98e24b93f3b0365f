"""Estimate of a Kalman filter over one sample, as CasADi expressions.

The filter is extended: the nonlinear aircraft in the estimated winds predicts, with slopes at the
estimate. Flights, exported C and FMUs evaluate these expressions. Two covariances are carried
through the samples: P of the errors, for the gate, and one from which the gains follow. In samples
without any value, the latter changes as if all values were used, so that the gains do not grow: a
fast policy leaves its limits if the estimate then jumps to the next values.
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
_LARGEST_FINITE = 1e300
#: Ratio of the variance of a predicted state to that of the stationary filter above which the
#: prediction is not used. It would then weigh a millionth in the next estimate, and the rounding
#: errors of a larger P, 1e-16 of its variances, would exceed 1e-10 of the stationary variance.
_LARGEST_GROWTH = 1e6
#: Option of a Jacobian in reverse mode, which of these equations has two thirds of the code.
_REVERSE_MODE = {"helper_options": {"ad_weight": 1.0}}
#: Options of a function whose code is exported once, however often it is called.
_EXPORTED_ONCE = {"cse": True, "never_inline": True}


class Estimate(NamedTuple):
    """Estimate of the states of a filter, in the order of the memory.

    x: deviations from the trim, (n,)
    missed: number of samples in a row with impossible values, (1,)
    begun: 0 before the first values, 1 after the first sample if the filter was switched on at its
        values, else 2, (1,)
    share: share of the policy's command that acts, (1,): an estimate that begins in flight fades
        commands in. Before the first values it is 0 in flight, and 1 if the states are known.
    last: last finite value of each sensor, (p,)
    P: covariance of the errors of x, (n, n), of which the memory has the lower triangle
    P_of_gain: covariance from which the gains follow, (n, n): P, but in a sample without any value
        it changes as if all values were used
    """

    x: Any
    missed: Any
    begun: Any
    share: Any
    last: Any
    P: Any
    P_of_gain: Any

    def packed(self) -> ca.SX:
        """Return the memory of the filter, (memory_size,)."""
        return ca.vertcat(*self._replace(P=_triangle(self.P), P_of_gain=_triangle(self.P_of_gain)))


def memory_slices(kalman: KalmanFilter) -> Estimate:
    """Return the slice of each part of an estimate in the memory."""
    n = len(kalman.Phi)
    triangle = n * (n + 1) // 2
    # x, missed, begun, share, last, P and P_of_gain
    return Estimate(*slices_of([n, 1, 1, 1, len(kalman.sensors), triangle, triangle]))


def _triangle(P: ca.SX) -> ca.SX:
    """Return the entries of the lower triangle of a symmetric matrix, (n, n), column by column."""
    return ca.project(P, ca.Sparsity.lower(P.shape[0])).nz[:]


def _symmetric(triangle: ca.SX, n: int) -> ca.SX:
    """Return the symmetric matrix, (n, n), of the entries of its lower triangle."""
    return ca.tril2symm(ca.SX(ca.Sparsity.lower(n), triangle))


def memory_size(kalman: KalmanFilter) -> int:
    """Return the number of entries of the memory."""
    return int(memory_slices(kalman).P_of_gain.stop)


def known_start(kalman: KalmanFilter, x: np.ndarray | None = None) -> np.ndarray:
    """Return the memory before a flight from known states, in which commands act at once.

    The memory of a filter that is switched on in flight is zero.

    x: deviations of all states from the trim, (n,), or None for 0
    """
    memory, places = np.zeros(memory_size(kalman)), memory_slices(kalman)
    memory[places.share] = 1.0
    if x is not None:
        memory[places.x][: len(kalman.states)] = x[kalman.point.model.state_places(kalman.states)]
    return memory


def estimate_in(kalman: KalmanFilter, memory: ca.SX) -> Estimate:
    """Return the estimate in a memory. Before the first sample both covariances are the filter's
    stationary P, with unknown biases.
    """
    parts = Estimate(*(memory[part] for part in memory_slices(kalman)))
    at_begin = _triangle(ca.SX(ca.DM(kalman.P_at_begin)))
    P, P_of_gain = (
        _symmetric(ca.if_else(parts.begun, triangle, at_begin), len(kalman.Phi))
        for triangle in (parts.P, parts.P_of_gain)
    )
    return parts._replace(P=P, P_of_gain=P_of_gain)


def updated(
    kalman: KalmanFilter, before: Estimate, y: ca.SX, fade: float
) -> tuple[Estimate, ca.SX]:
    """Return the estimate with the measured deviations y, (p,), and 1 if a value was not used.

    A missing or impossible value is left out. A value is missing if it is not finite, or if it
    equals the last one to the bit: it is frozen. The estimate begins anew at the values
    - of the first sample with values, if the filter is switched on in flight;
    - of the sample after it, if a value is impossible;
    - of the last of RESTARTS_AFTER samples in a row with impossible values, if most are impossible.
    From known states commands act at once; after any other begin they are faded in.

    fade: time in which commands are faded in, s
    """
    values = _values(kalman, before.x, y)
    gate = _gate(before, values)
    x, P, P_of_gain = _corrected_by_values(before, values, gate.is_used)
    given, used = ca.sum1(gate.is_given), ca.sum1(gate.is_used)
    impossible = given - used

    # Samples in a row with impossible values. One without any value does not change the number.
    missed = ca.if_else(impossible > 0, before.missed + 1, ca.if_else(given > 0, 0, before.missed))
    is_wrong = ca.logic_and(missed >= RESTARTS_AFTER, 2 * impossible > given)

    # Does the estimate begin at these values, or wait for the first ones?
    # in flight, without a value yet
    is_switched_on = ca.logic_and(before.begun == 0, before.share == 0)
    begins = ca.logic_or(
        ca.logic_and(is_switched_on, given > 0),
        ca.logic_and(impossible > 0, ca.logic_or(before.begun == 1, is_wrong)),
    )
    waits = ca.logic_and(is_switched_on, ca.logic_not(begins))
    begun = ca.if_else(waits, 0, ca.if_else(ca.logic_and(is_switched_on, begins), 1, 2))
    x_at_values, P_at_values = _at_values(kalman, before, y, gate.is_given)

    # Share of the command: 0 at a begin, but that of the memory in the sample after one.
    share_at_begin = ca.if_else(before.begun == 2, 0.0, before.share) if fade else 1.0
    share_later = ca.fmin(before.share + kalman.dt / fade, 1.0) if fade else 1.0

    estimate = Estimate(
        x=ca.if_else(begins, x_at_values, x),
        P=ca.if_else(begins, P_at_values, P),
        P_of_gain=ca.if_else(begins, P_at_values, P_of_gain),
        missed=ca.if_else(begins, 0, missed),
        begun=begun,
        share=ca.if_else(ca.logic_or(begins, waits), share_at_begin, share_later),
        last=ca.if_else(ca.fabs(y) <= _LARGEST_FINITE, y, before.last),
    )
    return estimate, ca.if_else(begins, 0, used < len(kalman.sensors))


class _Gate(NamedTuple):
    """Of each measured value, 1 or 0, (p,): whether it is given, and whether it is used."""

    is_given: ca.SX
    is_used: ca.SX


class _Values(NamedTuple):
    """Measured values, those expected at the prediction, (p,), with their slopes (p, n), and the
    variances of the noise.
    """

    y: ca.SX
    expected: ca.SX
    slopes: ca.SX
    variances: ca.SX


def _values(kalman: KalmanFilter, x: ca.SX, y: ca.SX) -> _Values:
    """Return the measured deviations y, (p,), with what is expected at predicted states x."""
    at = ca.SX.sym("at", x.numel())
    sensed = kalman.sensed(at)
    both = [sensed, ca.densify(ca.jacobian(sensed, at))]
    expected, slopes = ca.substitute(both, [at], [x])
    return _Values(y, expected, slopes, ca.SX(ca.DM(np.diag(kalman.R))))


def _gate(before: Estimate, values: _Values) -> _Gate:
    """Return which of the measured values are used."""
    predicted = ca.diag(ca.mtimes([values.slopes, before.P, values.slopes.T]))
    innovation = ca.fabs(values.y - values.expected)
    is_new = ca.logic_or(before.begun == 0, values.y != before.last)  # not frozen
    is_given = ca.logic_and(is_new, innovation <= _LARGEST_FINITE)  # false for NaN
    is_possible = innovation <= IMPOSSIBLE * ca.sqrt(predicted + values.variances)
    return _Gate(is_given, ca.logic_and(is_given, is_possible))


def _corrected_by_values(
    before: Estimate, values: _Values, is_used: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return x, P and P_of_gain after the measured values that are used, one after the other.

    Without any value, P_of_gain is corrected as if all were used.
    """
    x, P, P_of_gain = before.x, before.P, before.P_of_gain
    is_blind = ca.sum1(is_used) == 0
    correction = _correction(x.numel())

    def corrected(P: ca.SX, gain: ca.SX) -> ca.SX:
        """Return the covariance after the correction by a value, with any gain."""
        PC = ca.mtimes(P, slopes.T)
        given = ca.vertcat(_triangle(P), PC, ca.mtimes(slopes, PC) + variance, gain)
        return _symmetric(correction(given), P.shape[0])

    for place in range(is_used.numel()):
        slopes, variance, used = values.slopes[place, :], values.variances[place], is_used[place]
        PC = ca.mtimes(P_of_gain, slopes.T)
        gain = PC / (ca.mtimes(slopes, PC) + variance)
        expected = values.expected[place] + ca.mtimes(slopes, x - before.x)
        x = x + gain * ca.if_else(used, values.y[place] - expected, 0.0)
        P = corrected(P, used * gain)
        P_of_gain = corrected(P_of_gain, ca.logic_or(used, is_blind) * gain)
    return x, P, P_of_gain


def _correction(n: int) -> ca.Function:
    """Return the function [triangle of P; its row; variance of the innovation; gain] -> triangle
    after the correction.
    """
    sizes = (n * (n + 1) // 2, n, 1, n)
    given = [ca.SX.sym("given", size) for size in sizes]
    triangle, PC, variance, gain = given
    # For any gain P⁺ = P - gain (P C')' - with_innovation gain', with the covariance of corrected
    # states and innovation, which is 0 for the optimal gain.
    with_innovation = PC - variance * gain
    P = _symmetric(triangle, n) - ca.mtimes(gain, PC.T) - ca.mtimes(with_innovation, gain.T)
    return ca.Function("correction", [ca.vertcat(*given)], [_triangle(P)], _EXPORTED_ONCE)


def _at_values(
    kalman: KalmanFilter, before: Estimate, y: ca.SX, is_given: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return x and P of an estimate that begins in flight at the values that are given.

    A state has the value of its sensor, if that has no bias. The others are corrected from their
    estimates, by values of which they are a part, as if their errors were of nominal size.

    The air is the most likely one in which the flow angles are those of the trim: with slopes at
    other flow angles, the next values would give wrong winds.
    """
    k, states = len(kalman.states), kalman.point.model.states
    air, flow = slice(k, None), kalman.sight[:, k:]
    # The most likely air of flow angles a in stationary turbulence: cov(air, a) cov(a, a)⁻¹ a.
    of_flow = kalman.climate @ flow.T @ np.linalg.pinv(flow @ kalman.climate @ flow.T)
    x, P = ca.SX(before.x), ca.SX(before.P)
    P[:, air] = 0.0
    P[air, :] = 0.0
    P[air, air] = ca.DM(kalman.climate)
    places = {name: place for place, name in enumerate(kalman.sensors)}
    direct = [name for name in places if name in states and not kalman.sensors[name].bias]
    for name in direct:
        row, given = kalman.states.index(name), is_given[places[name]]
        x[row] = ca.if_else(given, y[places[name]], x[row])
        P[row, :] = ca.if_else(given, 0.0, P[row, :])
        P[:, row] = P[row, :].T
        P[row, row] = ca.if_else(given, kalman.sensors[name].noise ** 2, P[row, row])
    x[air] = -ca.mtimes(ca.DM(of_flow), x[:k])
    indirect = [place for name, place in places.items() if name not in direct]
    if not indirect:
        return x, P
    for row, name in enumerate(kalman.states):
        if name not in direct and kalman.C[indirect, row].any():
            P[row, :] = 0.0
            P[:, row] = 0.0
            P[row, row] = states[name].nominal ** 2
    wide = before._replace(x=x, P=P, P_of_gain=P)
    values = _Values(*(part[indirect, :] for part in _values(kalman, x, y)))
    x, P, _ = _corrected_by_values(wide, values, is_given[indirect])
    return x, P


def propagated(kalman: KalmanFilter, now: Estimate, x: ca.SX, Phi: ca.SX) -> Estimate:
    """Return the estimate that is predicted for the next sample, with Φ P Φ' + Q.

    If a predicted state is not finite or a variance of P too large, the states and P stay as they
    are. P_of_gain is predicted like P, and stays if one of its own variances is too large.

    x: predicted states, (n,)
    Phi: their derivatives by the states of the estimate, (n, n)
    """
    is_finite = ca.sumsqr(x) <= _LARGEST_FINITE
    n = Phi.shape[0]
    triangle, slopes = ca.SX.sym("P", n * (n + 1) // 2), ca.SX.sym("Phi", Phi.sparsity())
    after = ca.mtimes(ca.mtimes(slopes, _symmetric(triangle, n)), slopes.T) + kalman.Q
    given = ca.vertcat(triangle, slopes.nz[:])
    prediction = ca.Function("prediction", [given], [_triangle(after)], _EXPORTED_ONCE)
    P, is_usable = _predicted_covariance(kalman, prediction, now.P, Phi, is_finite)
    P_of_gain, _ = _predicted_covariance(kalman, prediction, now.P_of_gain, Phi, is_finite)
    return now._replace(x=ca.if_else(is_usable, x, now.x), P=P, P_of_gain=P_of_gain)


def _predicted_covariance(
    kalman: KalmanFilter, prediction: ca.Function, P: ca.SX, Phi: ca.SX, is_finite: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return Φ P Φ' + Q and 1, or P and 0 if a variance is too large, or a state not finite.

    prediction: [triangle of P; entries of Φ] -> triangle of Φ P Φ' + Q
    """
    after = prediction(ca.vertcat(_triangle(P), Phi.nz[:]))
    later, is_usable = _symmetric(after, P.shape[0]), is_finite
    for place in range(len(kalman.states)):
        limit = _LARGEST_GROWTH * float(kalman.P[place, place])
        is_usable = ca.logic_and(is_usable, later[place, place] <= limit)
    return ca.if_else(is_usable, later, P), is_usable


def extended_step(kalman: KalmanFilter, seconds: float) -> ca.Function:
    """Return (x, u) -> (x after some seconds, slopes by x (n, n)) of the nonlinear aircraft in the
    winds of x, with held inputs.

    The slopes are those of the linearization at x: exp(J h) in each integration step of h seconds,
    with the derivatives J of the rates, up to the fourth power of J h.
    """
    point, model, k = kalman.point, kalman.point.model, len(kalman.states)
    layout = (in_gusts(model) if kalman.winds else model).layout
    rows = model.state_places(kalman.states)
    x, u = ca.SX.sym("x", len(kalman.Phi)), ca.SX.sym("u", len(model.inputs))
    X = ca.SX(ca.DM(point.x))
    X[rows] += x[:k]
    no_push = ca.SX(k, 1)
    held = ca.vertcat(point.u + u, no_push, kalman.winds_at(x), model.p)
    steps = parts_of_a_sample([point], seconds)

    # Slopes: Jh = J h, and exp(Jh) = I + Jh + Jh² (I/2 + Jh/6 + Jh²/24) + ...
    rate = rate_in_push(layout, model.linear, kalman.winds)
    rates = rate(ca.densify(ca.vertcat(X, held)))[rows]
    derivatives = ca.vertcat(rates, ca.DM(kalman.A[k:, k:]) @ x[k:])
    Jh = ca.jacobian(derivatives, x, _REVERSE_MODE) * (seconds / steps)
    identity, square = ca.SX.eye(len(kalman.Phi)), ca.mtimes(Jh, Jh)
    Phi = Phi_of_step = identity + Jh + ca.mtimes(square, identity / 2 + Jh / 6 + square / 24)
    for _ in range(steps - 1):
        Phi = ca.mtimes(Phi_of_step, Phi)

    # States: the aircraft is integrated; the air is linear, and the aircraft has no effect on it.
    step = step_of_integration(layout, model.linear, kalman.winds)
    for _ in range(steps):
        X = step(ca.densify(ca.vertcat(X, held, seconds / steps)))
    after = ca.vertcat((X - point.x)[rows], ca.mtimes(Phi[k:, k:], x[k:]))
    return ca.Function("extended", [x, u], [after, Phi])
