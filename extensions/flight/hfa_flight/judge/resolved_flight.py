"""The integration step of assessed flights, halved until a few of them hardly change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hfa_aircraft.batch_simulation import Figures, IntegrationError, ReportedFigure, resolved
from hfa_flight.judge.outcomes import TrimCase, seeded_starts
from hfa_flight.simulate.envelope import flight_envelope
from hfa_flight.simulate.sampled_flights import SampledFlight

#: Largest duration (s) and number of samples of a flight.
_SECONDS = 10.0
_SAMPLES = 1000
#: Number of flights from each trim whose integration error is computed.
_CHECKED = 2
#: Nominal values of the states to which changes of smaller deviations are relative.
_SMALL = 1e-3


class _Flown(NamedTuple):
    """An aircraft over a sample, and the largest deviation of each of its states, (n,)."""

    flight: SampledFlight
    largest: np.ndarray


def resolved_flight(
    flight: SampledFlight, cases: Sequence[TrimCase], seed: int
) -> tuple[SampledFlight, IntegrationError]:
    """Return the aircraft with so many integration steps in a sample that flights are resolved.

    `_CHECKED` flights from each trim are compared with the same flights with half the step.

    seed: seed of the initial conditions
    """
    model = flight.deployed.model

    def flown(refinement: int) -> _Flown:
        """Return the flights with so many times the integration steps in a sample."""
        finer = replace(flight, steps_per_sample=refinement * flight.steps_per_sample)
        return _Flown(finer, _largest_deviations(finer, cases, seed))

    def figures(flown: _Flown) -> Figures:
        """Return the figures that must hardly change: the largest deviations of linear states."""
        largest = dict(zip(model.states, flown.largest.tolist(), strict=True))
        return {
            f"the largest deviation of {name}": ReportedFigure(
                largest[name], _SMALL * model.states[name].nominal
            )
            for name in model.linear
        }

    checked, error = resolved(flown, figures, flight.dt / flight.steps_per_sample)
    return checked.flight, error


def _largest_deviations(flight: SampledFlight, cases: Sequence[TrimCase], seed: int) -> np.ndarray:
    """Return the largest deviation of each state from the trim, within the envelope, (n,)."""
    deployed = flight.deployed
    owners = np.repeat(np.arange(len(cases)), _CHECKED)
    starts = np.vstack([seeded_starts(case, _CHECKED, seed, with_pulse=False)[0] for case in cases])
    trims = np.array([deployed.trim_vector(case.point) for case in cases])[owners]
    seconds = min(_SECONDS, _SAMPLES * flight.dt)
    ticks = flight.samples_in_window * flight.windows(seconds)
    samples = flight.compiled(len(owners), seconds)
    flown, _ = samples.fly(flight.start(starts, trims), trims, ticks)
    lowest, highest = flight.extremes(flown.states)
    envelopes = [flight_envelope(deployed.model, case.point) for case in cases]
    least = np.array([envelope.least for envelope in envelopes])[owners, None]
    most = np.array([envelope.most for envelope in envelopes])[owners, None]
    # Of each flight, the samples before its first one outside; the initial condition counts.
    inside = np.logical_and.accumulate(flight.stays(flown.states, least, most), axis=1)
    inside[:, 0] = True
    trim = trims[:, None, : lowest.shape[2]]
    farthest = np.maximum(highest - trim, trim - lowest)
    deviations: np.ndarray = np.where(inside[:, :, None], farthest, 0.0)
    return np.asarray(deviations.max(axis=(0, 1)))
