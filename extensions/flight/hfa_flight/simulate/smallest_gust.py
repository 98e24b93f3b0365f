"""The smallest 1-cosine gusts with which a policy leaves its limits: `hfa fly --gust smallest`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.gusts import (
    UPDRAFT,
    OneMinusCosine,
    foot_in_length_unit,
    gust_speed,
    length_unit_of,
)
from hfa_flight.air.scenario import Scenario, Uncertainty
from hfa_flight.policies.given import policy_and_scenario
from hfa_flight.simulate.closed_loop import FlightLoop, NonlinearPlant
from hfa_flight.simulate.envelope import flight_envelope, is_limited, outside
from hfa_flight.simulate.flight import Flight, fly_within
from hfa_flight.simulate.simulation import CompiledLoop
from hfa_support.errors import BadInputError, numbers_in, shown
from hfa_support.progress import Progress
from hfa_support.reporting.parts import Part
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table, short_number
from hfa_support.units import conversion_factor
from trim.point.operating_point import OperatingPoint

#: Default lengths of complete gusts, ft. FAR 25.341 has 60 to 700 ft, twice the gradient distance.
LENGTHS = (25.0, 50.0, 100.0, 200.0, 400.0, 800.0)
#: The search for the smallest peak begins at this share of the airspeed, and ends at all of it.
_FIRST_PEAK = 0.01
#: Ratio of a peak to the one flown before, until one leaves the limits: the relative width of a
#: window of peaks that may be missed. The coarse ratio follows a flight within half of the limits.
_FINE_RATIO, _COARSE_RATIO = 1.01, 1.05
#: Largest ratio of the two peaks between which a threshold lies.
ACCURACY = 1.005
#: Usual number of flights for a length, for the decision on machine code.
_FLIGHTS_OF_A_LENGTH = 200
#: Time after a gust in which a flight must stay inside, s.
AFTER = 5.0


class GustThreshold(NamedTuple):
    """Smallest gust of a length and a direction with which a flight leaves the limits.

    length: of the complete gust, in the unit of length of the aircraft
    inside: largest flown peak below the threshold that stays inside, in the unit of the updraft,
        negative for a downdraft
    peak: smallest flown peak that leaves, within .5 % of `inside`; None if none up to the airspeed
    by: variable that leaves first, or ""
    time: time of the departure, s, or None
    """

    length: float
    inside: float
    peak: float | None
    by: str
    time: float | None


@dataclass(frozen=True, eq=False, repr=False)
class SmallestGusts(Result, Reported):
    """Smallest 1-cosine gusts with which a policy leaves its limits, by length and direction.

    point: the trim at which each flight begins.
    policy: name of the policy.
    thresholds: two of each length, updraft and downdraft.
    flights: number of gusts that were flown.
    about_policy: notes on the policy, such as the air that its filter assumes.
    """

    schema = "hfa.smallest-gusts/1"

    point: OperatingPoint
    policy: str
    thresholds: Sequence[GustThreshold]
    flights: int
    about_policy: Sequence[str] = ()

    @property
    def smallest(self) -> GustThreshold | None:
        """The smallest gust of all lengths, or None if no flight leaves."""
        known = [threshold for threshold in self.thresholds if threshold.peak is not None]
        return min(known, key=lambda threshold: abs(threshold.peak or 0.0), default=None)

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "operating_point": self.point,
            "policy": self.policy,
            "thresholds": [threshold._asdict() for threshold in self.thresholds],
            "smallest": None if self.smallest is None else self.smallest._asdict(),
            "flights": self.flights,
        }

    def report(self) -> Report:
        """Return the report: a row for each length, with both directions."""
        length, speed = length_unit_of(self.point.model), _unit_of_peak(self.point.model)
        rows = []
        for up, down in zip(self.thresholds[::2], self.thresholds[1::2], strict=True):
            cells = [*_cells(up, speed), *_cells(down, speed)]
            rows.append((f"{up.length:g}", *cells))
        header = (f"length [{length}]", f"updraft [{speed}]", "by", f"downdraft [{speed}]", "by")
        flown = (
            f"{self.point.model.title} {self.point.at_scheduled}".strip()
            + f", policy {self.policy}, from the trim, without noise"
        )
        accuracy, fine, coarse = (
            f"{100.0 * (ratio - 1.0):.2g} %" for ratio in (ACCURACY, _FINE_RATIO, _COARSE_RATIO)
        )
        how = (
            f"Each peak leaves the limits within {AFTER:g} s after the gust, and the flown peak "
            f"inside is at most {accuracy} smaller. {self.flights} gusts were flown, with peaks "
            f"from {100.0 * _FIRST_PEAK:g} % of the airspeed on in steps of {fine}, or {coarse} "
            "after a flight within half of the limits: windows of smaller peaks that leave, "
            "narrower than a step, are not seen."
        )
        title = f"{self._headline()}\n{flown}"
        parts: list[Part] = [Table(header, rows), how, *self.about_policy]
        return Report(title, parts, data=self.to_dict())

    def _headline(self) -> str:
        """Return the first line of the report, on the smallest gust of all lengths."""
        least = self.smallest
        if least is None or least.peak is None:
            return "Smallest gust: none up to the airspeed leaves the limits"
        kind = "updraft" if least.peak > 0.0 else "downdraft"
        length, speed = length_unit_of(self.point.model), _unit_of_peak(self.point.model)
        return (
            f"Smallest gust: {kind} of {short_number(abs(least.peak), '')} {speed}, "
            f"{least.length:g} {length} long, leaves by {least.by}"
        )


def _unit_of_peak(model: Model) -> str:
    """Return the unit of the updraft, such as "ft/s"."""
    return in_gusts(model).unit(UPDRAFT)


def _cells(threshold: GustThreshold, unit: str) -> tuple[str, str]:
    """Return the cells of a threshold: peak, and the variable that leaves."""
    if threshold.peak is None:
        return f"none to {abs(threshold.inside):.3g}", ""
    return short_number(abs(threshold.peak), unit), threshold.by


def smallest_gusts(
    model: Model,
    point: OperatingPoint,
    policy: Any = None,
    lengths: Sequence[float] | None = None,
    *,
    scenario: Scenario | None = None,
    envelope: Limits | Mapping[str, tuple[float, float]] | None = None,
    progress: Progress | None = None,
) -> SmallestGusts:
    """Return the smallest 1-cosine updrafts and downdrafts with which a policy leaves its limits.

    The gust begins with the flight, at the trim. Its peak grows by 1 % (5 % after a flight within
    half of the limits) until a flight leaves the envelope up to 5 s after the gust; then the
    interval is halved to .5 %. Both ends are flown. A window of smaller peaks that leave, narrower
    than these steps, is not seen.

    policy: any form that `hfa.fly` accepts, also behind a filter
    lengths: lengths of complete gusts, in the unit of length of the aircraft; default 25 to 800 ft
    scenario: delay, timing and errors; noise and turbulence are left out
    envelope: limits of the states, or only those that differ from `flight_envelope(model, point)`
    progress: called after each threshold

    Raises BadInputError for a wrong length, or an envelope without a limit.

    Source: FAR 25.341(a); the search is by flights, and finds no gust that it did not fly.
    """
    speed = gust_speed(point)
    if lengths is None:
        gust_lengths = foot_in_length_unit(model) * np.array(LENGTHS)
    else:
        gust_lengths = np.atleast_1d(numbers_in("lengths", lengths)).astype(float)
    is_positive = np.isfinite(gust_lengths) & (gust_lengths > 0.0)
    if not (gust_lengths.size and is_positive.all()):
        raise BadInputError(f"lengths is {shown(lengths)}; give lengths above 0")
    within = envelope if isinstance(envelope, Limits) else flight_envelope(model, point, envelope)
    if not is_limited(within):
        raise BadInputError("the envelope has no limit that a gust could leave; give a limit")
    first_gust = OneMinusCosine(float(gust_lengths[0]), 0.0, speed)
    own_scenario = replace(
        scenario or Scenario(sample=0.01),
        gust=first_gust,
        uncertainty=Uncertainty(),
        samples=None,
    ).on(model)
    flown_policy, own_scenario = policy_and_scenario(policy, point, own_scenario)
    loop = FlightLoop(NonlinearPlant(model, point), flown_policy, own_scenario)
    # Factor from the unit of the airspeed to that of the peak; 1 if the latter is not known.
    of_peak = conversion_factor(f"{length_unit_of(model)}/s", _unit_of_peak(model)) or 1.0
    # Before the flights, so that no note counts the samples of one of them.
    notes = flown_policy.notes()
    compiled = CompiledLoop(loop, flights=_FLIGHTS_OF_A_LENGTH * len(gust_lengths))
    thresholds: list[GustThreshold] = []
    flights = 0
    for length in gust_lengths.tolist():
        for sign in (1.0, -1.0):
            gust = OneMinusCosine(length, 0.0, speed)
            search = _Search(compiled, within, gust, speed * of_peak)
            thresholds.append(search.threshold(sign))
            flights += search.flights
            if progress is not None:
                progress(len(thresholds), 2 * len(gust_lengths))
    return SmallestGusts(point, flown_policy.name, tuple(thresholds), flights, notes)


@dataclass
class _Search:
    """Search for the threshold of gusts of one length.

    loop: the loop, whose flights begin at the trim
    envelope: limits that a flight leaves
    gust: gust of the length, whose peak is replaced
    airspeed: largest peak of the search, in the unit of the peak
    flights: number of gusts flown
    """

    loop: CompiledLoop
    envelope: Limits
    gust: OneMinusCosine
    airspeed: float
    flights: int = 0

    def threshold(self, sign: float) -> GustThreshold:
        """Return the threshold of updrafts (1) or downdrafts (-1)."""
        staying, leaving = 0.0, _FIRST_PEAK * self.airspeed  # peaks of the flights
        flight = self._flight(sign * leaving)
        while flight.departure is None:
            staying = leaving
            if staying >= self.airspeed:
                return GustThreshold(self.gust.length, sign * staying, None, "", None)
            ratio = _COARSE_RATIO if self._is_within_half(flight) else _FINE_RATIO
            leaving = min(ratio * leaving, self.airspeed)
            flight = self._flight(sign * leaving)
        departure = flight.departure
        while leaving > ACCURACY * staying:
            middle = 0.5 * (staying + leaving)
            in_middle = self._flight(sign * middle).departure
            if in_middle is None:
                staying = middle
            else:
                leaving, departure = middle, in_middle
        by, time = departure.state, departure.time
        return GustThreshold(self.gust.length, sign * staying, sign * leaving, by, time)

    def _is_within_half(self, flight: Flight) -> bool:
        """Return whether a flight stays within half of the distance to each limit."""
        # It does if the states with twice their deviations from the trim are within the limits.
        doubled = 2.0 * flight.deviations.limited + flight.point.x
        return not outside(self.envelope, doubled).any()

    def _flight(self, peak: float) -> Flight:
        """Return the flight in a gust with this peak."""
        self.flights += 1
        gust = replace(self.gust, peak=peak)
        scenario = self.loop.loop.scenario
        ticks = np.ceil((gust.until + AFTER) / scenario.tick)
        in_gust = replace(scenario, gust=gust, duration=float(ticks) * scenario.tick)
        return fly_within(self.loop, self.envelope, in_gust)
