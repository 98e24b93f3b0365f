"""Choice of the next maneuver: the one that narrows the widest band most.

Candidates are doublets, 3-2-1-1 maneuvers and multisines of a single input. Their bands are
predicted from the Fisher information of the model.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hfa_aircraft.model import Model
from hfa_identify.bands import BAND
from hfa_identify.fit import Fit, OutputError, inverse
from hfa_identify.records import Record
from hfa_identify.response import Responses
from hfa_identify.search import Search
from hfa_support.reporting.results import Result
from trim.point.solve import trim

#: Duration of a maneuver, s, and unit steps of doublet and 3-2-1-1, s.
_SECONDS = 15.0
_UNITS = (0.2, 0.4, 0.8, 1.6)
#: Time at which the maneuver begins, s.
_BEGIN = 0.5
#: Number of sines in the multisine, at multiples of 1 / duration.
_SINES = 24
#: Largest amplitude, as a fraction of the distance from the trim to the nearer limit, and number of
#: times that it is halved if a state leaves its limits.
_PART = 0.5
_HALVINGS = 6
#: Number of reported maneuvers.
_MOST = 10


@dataclass(frozen=True)
class Manoeuvre(Result):
    """A maneuver from the trim of the identified aircraft, with confidence bands of one parameter.

    kind: "doublet", "3-2-1-1" or "multisine".
    input: the input that moves.
    amplitude: amplitude of the input.
    unit: unit of the amplitude.
    seconds: shortest pulse width of a doublet or 3-2-1-1, or duration of a multisine, s.
    widest: parameter with the widest relative confidence band after the maneuver.
    before: half-width of the confidence band before the maneuver, percent of the estimate.
    after: half-width of the confidence band after the maneuver, percent of the estimate.
    """

    kind: str
    input: str
    amplitude: float
    unit: str
    seconds: float
    widest: str
    before: float
    after: float


def manoeuvres(search: Search, fit: Fit, model: Model, coloured: float) -> list[Manoeuvre]:
    """Return at most `_MOST` maneuvers, in the order of increasing `after`.

    The sensors and their noise are those of the records. The sampling interval is that of the first
    record. Initial states are unknown.

    model: the identified aircraft
    coloured: factor by which colored residuals widen the bands
    """
    known = fit.information / coloured**2
    before = _relative_bands(search, fit, known)
    found = []
    for kind, name, amplitude, seconds, information in _candidates(search, fit, model):
        after = _relative_bands(search, fit, known + information / coloured**2)
        worst = int(np.argmax(after))
        found.append(
            Manoeuvre(
                kind,
                name,
                amplitude,
                model.unit(name),
                seconds,
                search.responses.free[worst],
                100.0 * float(before[worst]),
                100.0 * float(after[worst]),
            )
        )
    return sorted(found, key=lambda each: each.after)[:_MOST]


def _relative_bands(search: Search, fit: Fit, information: np.ndarray) -> np.ndarray:
    """Return the half-widths of the bands relative to the estimates, (p,)."""
    # The result is 0 for an error of a column, and inf for a parameter without information.
    variances = np.diag(inverse(information)).copy()
    variances[np.diag(information) <= 0.0] = np.inf
    parameters = search.responses.model.parameters
    sizes = [
        max(abs(value), 1e-300) if name in parameters else np.inf
        for name, value in zip(search.responses.free, fit.theta, strict=True)
    ]
    return np.asarray(BAND * np.sqrt(np.maximum(variances, 0.0)) / sizes)


def _candidates(
    search: Search, fit: Fit, model: Model
) -> Iterator[tuple[str, str, float, float, np.ndarray]]:
    """Yield (kind, input, amplitude, duration, information) of each maneuver."""
    # The amplitude is halved until no state leaves its limits. Maneuvers that exceed the limits or
    # diverge at every amplitude are omitted.
    point = trim(model)
    start = np.array(point.states)
    inputs_at_trim = np.array(point.inputs)
    measured = search.responses.measured
    others = tuple(name for name in model.states if name not in measured)
    wider = Responses(model, search.responses.free, (*measured, *others))
    record = search.records[0]
    time = np.arange(0.0, _SECONDS, float(np.median(np.diff(record.time))))
    seen = {name: np.zeros(len(time)) for name in measured}
    for place, (name, signal) in enumerate(model.inputs.items()):
        room = _PART * min(signal.max - inputs_at_trim[place], inputs_at_trim[place] - signal.min)
        if not math.isfinite(room):
            room = signal.nominal
        for kind, seconds, shape in _shapes(time):
            for halving in range(_HALVINGS):
                amplitude = room / 2**halving
                inputs = np.tile(inputs_at_trim, (len(time), 1))
                inputs[:, place] += amplitude * shape
                flown = Record(kind, time, inputs, seen)
                try:
                    response = wider.of(flown, start, fit.theta)
                except FloatingPointError:
                    continue
                if not _within(model, wider, response.y):
                    continue
                searched = OutputError(search.responses, [flown], search.bounds, [start])
                information = searched.information(
                    response.slopes[:, : len(measured)], fit.noise, 0
                )
                yield kind, name, amplitude, seconds, information
                break


def _within(model: Model, responses: Responses, y: np.ndarray) -> bool:
    """Return whether every state stays within its limits."""
    # y (N, k)
    columns = [responses.measured.index(name) for name in model.states]
    states = y[:, columns]
    low = np.array([signal.min for signal in model.states.values()])
    high = np.array([signal.max for signal in model.states.values()])
    return bool(((states >= low) & (states <= high)).all())


def _shapes(time: np.ndarray) -> Iterator[tuple[str, float, np.ndarray]]:
    """Yield (kind, duration, shape) of each maneuver."""
    # The shape (N,) is between -1 and 1.
    # time (N,)
    for unit in _UNITS:
        yield "doublet", unit, _steps(time, unit, (1, 1))
        yield "3-2-1-1", unit, _steps(time, unit, (3, 2, 1, 1))
    # Schroeder's phases keep the peak of the sum small.
    numbers = np.arange(1, _SINES + 1)
    phases = np.pi * numbers * (numbers - 1) / _SINES
    sum_of_sines = np.sin(2.0 * np.pi * np.outer(time, numbers) / time[-1] + phases).sum(axis=1)
    yield "multisine", float(time[-1]), sum_of_sines / np.abs(sum_of_sines).max()


def _steps(time: np.ndarray, unit: float, lengths: tuple[int, ...]) -> np.ndarray:
    """Return pulses of 1, -1, 1, ..., with 0 before and after them, (N,)."""
    # time (N,)
    ends = _BEGIN + unit * np.concatenate([[0.0], np.cumsum(lengths)])
    place = np.searchsorted(ends, time, side="right")
    inside = (place > 0) & (place < len(ends))
    return np.where(inside, np.where(place % 2 == 1, 1.0, -1.0), 0.0)
