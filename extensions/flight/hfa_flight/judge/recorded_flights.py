"""A few flights from each trim, stored at each sample, and their integration error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hfa_aircraft.march.ending import is_within
from hfa_aircraft.march.march import march
from hfa_aircraft.march.refinement import Figures, IntegrationError, ReportedFigure, resolved
from hfa_flight.judge.outcomes import Place, seeded_starts
from hfa_flight.simulate.envelope import flight_envelope
from hfa_flight.simulate.sampled_flights import SampledFlight, SampledRows

#: Largest duration (s) and number of samples of a recorded flight.
_SECONDS = 10.0
_SAMPLES = 1000
#: Number of flights from each trim whose integration error is computed.
_CHECKED = 2
#: Nominal values of the states to which changes of smaller deviations are relative.
_SMALL = 1e-3


@dataclass(frozen=True, eq=False)
class RecordedFlights:
    """Flights at each sample.

    flight: the aircraft over a sample.
    states: X, (N, T, n).
    lowest, highest: extremes of X in the sample before, (N, T, n).
    before: inputs just before each sample, (N, T, m).
    trims: (X0; U0; p) of each flight, (N, t).
    inside: True until the flight leaves its envelope, (N, T).
    """

    flight: SampledFlight
    states: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    before: np.ndarray
    trims: np.ndarray
    inside: np.ndarray


def recorded_flights(
    flight: SampledFlight, places: Sequence[Place], seed: int, count: int
) -> RecordedFlights:
    """Return flights from each trim, without a disturbance pulse.

    seed: seed of the initial conditions
    count: number of flights from each trim
    """
    deployed = flight.deployed
    owners = np.repeat(np.arange(len(places)), count)
    starts = np.vstack([seeded_starts(place, count, seed, pushed=False)[0] for place in places])
    trims = np.array([deployed.trim_vector(place.point) for place in places])[owners]
    seconds = min(_SECONDS, _SAMPLES * flight.dt)
    window = flight.samples_in_window
    ticks = window * max(1, round(seconds / (window * flight.dt)))
    loop = SampledRows(flight.compiled(len(owners), seconds), flight.start(starts, trims), trims)
    with np.errstate(all="ignore"):
        flown, _ = march(loop, ticks)
    X, memory, *_ = flight.slices
    states = flown.states[:, :, X]
    lowest, highest = flight.extremes(flown.states)
    before = flown.states[:, :, memory][:, :, -len(deployed.model.inputs) :]
    envelopes = [flight_envelope(deployed.model, place.point) for place in places]
    least = np.array([each.least for each in envelopes])[owners, None]
    most = np.array([each.most for each in envelopes])[owners, None]
    within = is_within(lowest, least, most) & is_within(highest, least, most)
    inside = np.logical_and.accumulate(within, axis=1)
    inside[:, 0] = True
    return RecordedFlights(flight, states, lowest, highest, before, trims, inside)


def resolved_flight(
    flight: SampledFlight, places: Sequence[Place], seed: int
) -> tuple[SampledFlight, IntegrationError]:
    """Return the aircraft with so many integration steps in a sample that flights are resolved.

    `_CHECKED` flights from each trim are compared with the same flights with half the step.

    seed: seed of the initial conditions
    """

    def recorded(parts: int) -> RecordedFlights:
        finer = replace(flight, parts=parts * flight.parts)
        return recorded_flights(finer, places, seed, _CHECKED)

    flown, error = resolved(recorded, _figures, flight.dt / flight.parts)
    return flown.flight, error


def _figures(flown: RecordedFlights) -> Figures:
    """Return the largest deviation of each linear state from the trim, within the envelope."""
    model = flown.flight.deployed.model
    trim = flown.trims[:, None, : flown.states.shape[2]]
    farthest = np.maximum(flown.highest - trim, trim - flown.lowest)
    deviations = np.where(flown.inside[:, :, None], farthest, 0.0)
    largest = dict(zip(model.states, deviations.max(axis=(0, 1)).tolist(), strict=True))
    return {
        f"the largest deviation of {name}": ReportedFigure(
            largest[name], _SMALL * model.states[name].nominal
        )
        for name in model.linear
    }
