"""How far a gain behind a Kalman filter tolerates changes of the aircraft: its linear loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_flight.air.held_step import in_samples
from hfa_flight.policies.deployment.sampled_loop import Chain, chain_margins, late_hold
from hfa_flight.policies.kalman import KalmanFilter
from hfa_support.reporting.results import Result

#: Longest unknown delay that is searched, in samples, and parts of a sample of the search.
_MOST_SAMPLES = 30
_PARTS = 4


@dataclass(frozen=True, eq=False)
class FilterMargins(Result):
    """Margins of the linear loop of a gain behind a filter, at the commands of the inputs.

    compensator_radius: spectral radius of filter and gain alone, from the measured values to the
        commands. Above 1 they are unstable without the aircraft.
    radius: spectral radius of the loop.
    gain_low, gain_high: factors on one input between which the loop is stable, the closest to 1 of
        all inputs; the other inputs are unchanged.
    phase: smallest phase margin of an input, deg.
    delay: smallest delay margin of an input, s.
    unknown_delay: smallest delay of all inputs, unknown to the filter, with which the loop is
        unstable, s; None if there is none among those that are searched.
    """

    compensator_radius: float
    radius: float
    gain_low: float
    gain_high: float
    phase: float
    delay: float
    unknown_delay: float | None

    def text(self) -> str:
        """Return the margins as a sentence."""
        if not self.radius < 1.0:
            return (
                "The linear loop of the gain behind the filter is unstable (spectral radius "
                f"{self.radius:.4g})."
            )
        alone = "unstable" if self.compensator_radius >= 1.0 else "stable"
        late = (
            f"No delay of all inputs up to {_MOST_SAMPLES} samples that the filter does not know "
            "makes it unstable."
        )
        if self.unknown_delay is not None:
            late = (
                "A delay of all inputs that the filter does not know makes it unstable from "
                f"{1e3 * self.unknown_delay:.3g} ms on."
            )
        return (
            f"Linear loop of the gain behind the filter: gain margin {self.gain_low:.3g} to "
            f"{self.gain_high:.3g}, phase {self.phase:.3g} deg, delay "
            f"{1e3 * self.delay:.3g} ms, the smallest of all inputs. {late} Filter and gain "
            f"alone are {alone} (spectral radius {self.compensator_radius:.4g})."
        )


def margins_of(kalman: KalmanFilter, K: np.ndarray) -> FilterMargins:
    """Return the margins of the linear loop of a gain behind a filter.

    The margins of an unstable loop are gains of 1, a phase of 0 and delays of 0.

    K: (m, k)
    """
    gain = K @ kalman.sight
    loop = _late_loop(kalman, gain, 0.0)
    alone = kalman.compensator_radius(K)
    if not loop.radius < 1.0:
        return FilterMargins(
            alone, loop.radius, gain_low=1.0, gain_high=1.0, phase=0.0, delay=0.0, unknown_delay=0.0
        )
    inputs = chain_margins(loop).inputs
    return FilterMargins(
        compensator_radius=alone,
        radius=loop.radius,
        gain_low=max(margin.gain_low for margin in inputs),
        gain_high=min(margin.gain_high for margin in inputs),
        phase=min(margin.phase for margin in inputs),
        delay=min(margin.delay for margin in inputs),
        unknown_delay=_unknown_delay(kalman, gain),
    )


def _late_loop(kalman: KalmanFilter, gain: np.ndarray, delay: float) -> Chain:
    """Return the loop whose commands act after a delay that the filter does not predict.

    The states of the loop are those of aircraft and air, the commands under way, the latest first,
    and the predicted states of the filter.

    gain: (m, n), of the command -gain x̂ of the estimate
    delay: s
    """
    Phi, Gamma, L, C = kalman.Phi, kalman.Gamma, kalman.L, kalman.C
    (n, m), (whole, rest) = Gamma.shape, in_samples(delay, kalman.dt)
    plant = late_hold(kalman.A, kalman.B, kalman.dt, rest)
    count = (whole + (rest > 0.0)) * m  # entries of the commands under way
    size = n + count + n
    F, G, command = np.zeros((size, size)), np.zeros((size, m)), np.zeros((m, size))
    filtered = slice(n + count, size)

    # Command -gain x̂, with the estimate x̂ = (I - L C) x⁻ + L C x from the prediction x⁻.
    command[:, :n] = -gain @ L @ C
    command[:, filtered] = -gain @ (np.eye(n) - L @ C)

    # Aircraft and air: the oldest command acts for `rest` (`early`), then the next one (`late`).
    F[:n, :n] = Phi
    if whole:
        begin = n + (whole - 1) * m
        F[:n, begin : begin + m] = plant.late
    else:
        G[:n] = plant.late
    if rest:
        F[:n, n + count - m : n + count] = plant.early

    # Commands under way, a sample older.
    if count:
        G[n : n + m] = np.eye(m)
        F[n + m : n + count, n : n + count - m] = np.eye(count - m)

    # The filter predicts with its own command, without delay.
    predicting = Phi - Gamma @ gain
    F[filtered, :n] = predicting @ L @ C
    F[filtered, filtered] = predicting @ (np.eye(n) - L @ C)
    return Chain(F, G, command, n, kalman.dt, np.eye(size, n))


def _unknown_delay(kalman: KalmanFilter, gain: np.ndarray) -> float | None:
    """Return the smallest delay, s, with which the loop of `_late_loop` is unstable, or None."""
    from scipy.optimize import brentq

    def excess(delay: float) -> Any:
        """Return the spectral radius of the loop with a delay, minus 1."""
        return _late_loop(kalman, gain, delay).radius - 1.0

    before = 0.0
    for part in range(1, _MOST_SAMPLES * _PARTS + 1):
        delay = part * kalman.dt / _PARTS
        if excess(delay) >= 0.0:
            return float(brentq(excess, before, delay, xtol=1e-6 * kalman.dt))
        before = delay
    return None
