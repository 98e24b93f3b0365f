"""How far a gain behind a Kalman filter tolerates changes of the aircraft: its linear loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_flight.air.held_step import acting_commands, in_samples
from hfa_flight.policies.deployment.sampled_loop import Chain, chain_margins, zero_order_hold
from hfa_flight.policies.kalman import KalmanFilter, near_one
from hfa_support.matrices import spectral_radius
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
                f"{near_one(self.radius)})."
            )
        alone = "unstable" if self.compensator_radius >= 1.0 else "stable"
        late = (
            f"No delay of all inputs up to {_MOST_SAMPLES} samples that the filter does not know "
            "makes it unstable."
        )
        if self.unknown_delay is not None:
            late = (
                "A further delay of all inputs, unknown to the filter, makes it unstable from "
                f"{1e3 * self.unknown_delay:.3g} ms on."
            )
        return (
            f"Linear loop of the gain behind the filter: gain margin {self.gain_low:.3g} to "
            f"{self.gain_high:.3g}, phase {self.phase:.3g} deg, delay "
            f"{1e3 * self.delay:.3g} ms, the smallest of all inputs. {late} Filter and gain "
            f"alone are {alone} (spectral radius {near_one(self.compensator_radius)})."
        )


def margins_of(kalman: KalmanFilter, K: np.ndarray, delay: float) -> FilterMargins:
    """Return the margins of the linear loop of a gain behind a filter.

    The margins of an unstable loop are gains of 1, a phase of 0 and delays of 0.

    K: (m, k)
    delay: time after which commands act, which the filter knows, s
    """
    gain = K @ kalman.sight
    loop, alone = late_loop(kalman, gain, delay), compensator_radius(kalman, K, delay)
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
        unknown_delay=_unknown_delay(kalman, gain, delay),
    )


def compensator_radius(kalman: KalmanFilter, K: np.ndarray, delay: float = 0.0) -> float:
    """Return the spectral radius of filter and gain alone, from measured values to commands."""
    loop = late_loop(kalman, K @ kalman.sight, delay)
    alone = slice(len(kalman.Phi) + _under_way(delay, kalman.dt) * len(K), None)
    return spectral_radius(loop.F[alone, alone])


def _under_way(delay: float, dt: float) -> int:
    """Return the number of earlier commands that act after a sample."""
    whole, rest = in_samples(delay, dt)
    return whole + (rest > 0.0)


def late_loop(kalman: KalmanFilter, gain: np.ndarray, known: float, further: float = 0.0) -> Chain:
    """Return the loop whose commands act after a delay of which the filter predicts a part.

    The states of the loop are those of aircraft and air, the commands on their way to these, the
    latest first, the predicted states of the filter, and the commands that it takes as under way.

    gain: (m, n), of the command -gain x̂ of the estimate when the command acts, as is known
    known, further: s
    """
    (n, m), dt, delay = kalman.Gamma.shape, kalman.dt, known + further
    count, own_count = _under_way(delay, dt), _under_way(known, dt)
    size = 2 * n + (count + own_count) * m
    # Each row is a linear form of the states of the loop, and of the commands u that act.
    sizes = [n, *[m] * count, n, *[m] * own_count, m]
    x, *parts = np.split(np.eye(size + m), np.cumsum(sizes)[:-1])
    queue, (predicted, *own_queue, u) = parts[:count], parts[count:]

    def later(of: np.ndarray, commands: list[np.ndarray], late: float, time: float) -> np.ndarray:
        """Return states some time after a sample, by the commands that act, the latest first."""
        for samples_ago, seconds in acting_commands(late, dt, time):
            Phi, Gamma = zero_order_hold(kalman.A, kalman.B, seconds)
            of = Phi @ of + Gamma @ commands[samples_ago]
        return of

    estimate = predicted + kalman.L @ kalman.C @ (x - predicted)
    own = -gain @ later(estimate, [u, *own_queue], known, known)
    of_plant, of_filter = [u, *queue], [own, *own_queue]
    after = [
        later(x, of_plant, delay, dt),
        *of_plant[:count],
        later(estimate, of_filter, known, dt),
        *of_filter[:own_count],
    ]
    F, G = np.split(np.vstack(after), [size], axis=1)
    return Chain(F, G, own[:, :size], n, dt)


def _unknown_delay(kalman: KalmanFilter, gain: np.ndarray, known: float) -> float | None:
    """Return the smallest further delay, s, with which `late_loop` is unstable, or None."""
    from scipy.optimize import brentq

    def excess(delay: float) -> Any:
        """Return the spectral radius of the loop with a further delay, minus 1."""
        return late_loop(kalman, gain, known, delay).radius - 1.0

    before = 0.0
    for part in range(1, _MOST_SAMPLES * _PARTS + 1):
        delay = part * kalman.dt / _PARTS
        if excess(delay) >= 0.0:
            return float(brentq(excess, before, delay, xtol=1e-6 * kalman.dt))
        before = delay
    return None
