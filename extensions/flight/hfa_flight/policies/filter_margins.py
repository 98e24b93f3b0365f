"""How far a gain behind a Kalman filter tolerates changes of the aircraft: its linear loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import casadi as ca
import numpy as np

from hfa_flight.air.gusts import state_of
from hfa_flight.policies.deployment.sampled_loop import chain_margins
from hfa_flight.policies.kalman import KalmanFilter, near_one
from hfa_support.matrices import spectral_radius
from hfa_support.reporting.results import Result
from trim.linear.delays import (
    Chain,
    Plant,
    samples_under_way,
    searched_delays,
    text_of_further_delay,
)


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
        unstable, s; None if there is none up to `searched`.
    searched: longest such delay that was examined, s.
    """

    compensator_radius: float
    radius: float
    gain_low: float
    gain_high: float
    phase: float
    delay: float
    unknown_delay: float | None
    searched: float = 0.0

    def text(self) -> str:
        """Return the margins as a sentence."""
        if not self.radius < 1.0:
            return (
                "The linear loop of the gain behind the filter is unstable (spectral radius "
                f"{near_one(self.radius)})."
            )
        alone = "unstable" if self.compensator_radius >= 1.0 else "stable"
        return (
            f"Linear loop of the gain behind the filter: gain margin {self.gain_low:.3g} to "
            f"{self.gain_high:.3g}, phase {self.phase:.3g} deg, delay "
            f"{1e3 * self.delay:.3g} ms, the smallest of all inputs. "
            f"{text_of_further_delay(self.unknown_delay, self.searched)} "
            f"Filter and gain alone are {alone} (spectral radius "
            f"{near_one(self.compensator_radius)})."
        )


@dataclass(frozen=True, eq=False)
class FilterLoop(Chain):
    """Loop of a gain behind a filter, whose commands act after a delay that it knows in part.

    s are the n states of aircraft and air, the commands on their way to these, the latest first,
    the predicted states of the filter, and the commands that it takes as under way.

    kalman: the filter.
    alone: rows of s that are the filter's.
    N: covariance that turbulence and sensors add to s in a sample.
    feed: covariance of the commands by the sensors of the same sample.
    """

    kalman: KalmanFilter
    alone: slice
    N: np.ndarray
    feed: np.ndarray

    @classmethod
    def of(cls, kalman: KalmanFilter, K: np.ndarray, known: float, further: float = 0.0) -> Self:
        """Return the loop of -K (what is seen at x̂, when the command acts, as is known).

        K: (m, k)
        known, further: delay, s
        """
        gain, (n, m), p, dt = K @ kalman.sight, kalman.Gamma.shape, len(kalman.C), kalman.dt
        count, own_count = (samples_under_way(late, dt) for late in (known + further, known))
        size = 2 * n + (count + own_count) * m
        # Each row is a linear form of s, the commands u that act, the noise of the sensors, and
        # what the turbulence adds to the states of the air.
        sizes = [n, *[m] * count, n, *[m] * own_count, m, p, n]
        x, *parts = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
        queue, (predicted, *own_queue, u, noise, gust) = parts[:count], parts[count:]
        plant = Plant(kalman.A, kalman.B, dt)
        estimate = predicted + kalman.L @ (kalman.C @ (x - predicted) + noise)
        own = -gain @ plant.later(estimate, [u, *own_queue], known, known)
        of_plant, of_filter = [u, *queue], [own, *own_queue]
        after = [
            plant.later(x, of_plant, known + further, dt) + gust,
            *of_plant[:count],
            plant.later(estimate, of_filter, known, dt),
            *of_filter[:own_count],
        ]
        F, G, by_noise, by_gust = np.split(np.vstack(after), np.cumsum([size, m, p]), axis=1)
        C, feed = own[:, :size], own[:, size + m : size + m + p]
        by_noise = by_noise + G @ feed
        return cls(
            F,
            G,
            C,
            n,
            dt,
            kalman,
            alone=slice(n + count * m, None),
            N=by_noise @ kalman.R @ by_noise.T + by_gust @ kalman.air @ by_gust.T,
            feed=feed @ kalman.R @ feed.T,
        )

    @property
    def compensator_radius(self) -> float:
        """Spectral radius of filter and gain alone, from measured values to commands."""
        return spectral_radius(self.F[self.alone, self.alone])

    def rms(self, samples: int) -> np.ndarray:
        """Return the root mean square of linear states and commands, (k + m,), over the second half
        of a flight that begins in calm at the trim.

        The speed is that of the linear loop plus x'Hx/2, which the gain does not see. Its mean
        square is tr(HS)²/4 + tr(HSHS)/2 for a normal x of covariance S.
        """
        kalman, n, k = self.kalman, self.states, len(self.kalman.states)
        speed = state_of(kalman.point.model, "speed")
        H, row = np.zeros((n, n)), 0
        if speed in kalman.states:
            x, row = ca.SX.sym("x", n), kalman.states.index(speed)
            hessian = ca.hessian((x[:k] - kalman.seen(x))[row], x)[0]
            H = ca.Function("hessian", [x], [ca.densify(hessian)])(0.0).full()
        outputs = np.vstack([np.eye(k, len(self.F)), self.C])
        covariance, total = np.zeros_like(self.F), np.zeros(len(outputs))
        first_counted = samples // 2
        for sample in range(samples):
            if sample >= first_counted:
                total += np.diag(outputs @ covariance @ outputs.T)
                total[k:] += np.diag(self.feed)
                HS = H @ covariance[:n, :n]
                total[row] += 0.25 * np.trace(HS) ** 2 + 0.5 * np.trace(HS @ HS)
            covariance = self.closed @ covariance @ self.closed.T + self.N
        return np.asarray(np.sqrt(total / max(samples - first_counted, 1)))


def margins_of(loop_with: Callable[[float], FilterLoop]) -> FilterMargins:
    """Return the margins of a loop.

    The margins of an unstable loop are gains of 1, a phase of 0 and delays of 0.

    loop_with: function of a further delay, s -> loop
    """
    loop = loop_with(0.0)
    alone = loop.compensator_radius
    if not loop.radius < 1.0:
        return FilterMargins(
            alone, loop.radius, gain_low=1.0, gain_high=1.0, phase=0.0, delay=0.0, unknown_delay=0.0
        )
    inputs, unknown = chain_margins(loop).inputs, searched_delays(loop_with, loop.dt, 0.0)
    return FilterMargins(
        compensator_radius=alone,
        radius=loop.radius,
        gain_low=max(margin.gain_low for margin in inputs),
        gain_high=min(margin.gain_high for margin in inputs),
        phase=min(margin.phase for margin in inputs),
        delay=min(margin.delay for margin in inputs),
        unknown_delay=unknown.limit,
        searched=unknown.searched,
    )
