"""Flights of changed cards, side by side: what each costs, and which starts come back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.envelope import flight_envelope
from hfa_policy.deployed import Deployed
from hfa_policy.episodes import cost_weights
from hfa_policy.flights import SampledFlight, symbols_of_a_sample
from hfa_policy.held_step import parts_of_a_sample
from hfa_policy.outcomes import BALL, Place, seeded_starts
from hfa_policy.repairs import Repair

if TYPE_CHECKING:
    from hfa_policy.assessment import Assessor

#: Who is farther from the trim than so many half-widths of the box of starts, or swings by more
#: than the ball in the last second, did not come back. Some policies rest off trim; of the many
#: exchanges some fly as near as that by chance, and must come back into the box.
NEAR = 3.0
#: A size of cost beyond which flights are not told apart.
_MOST = 1e9


class Sample(NamedTuple):
    """Starts of each change, and the seconds that each is flown."""

    starts: int
    seconds: float


class Flown(NamedTuple):
    """The flights of one change.

    costs: (N,).
    kept: how many stay within the limits.
    back: how many of them are nearly at rest near the trim at the end.
    into_box: how many of those are in the box of starts.
    """

    costs: np.ndarray
    kept: int
    back: int
    into_box: int

    def strictly(self) -> Flown:
        """The same where only those in the box of starts are back."""
        return self._replace(back=self.into_box)

    def times(self, other: Flown) -> float:
        """How many times the costs of another these are: the median over the starts."""
        return float(np.median(self.costs / other.costs))


class ChangeFlights:
    """Flights of changed cards from the same starts about some trims.

    assessor: of the card as it is.
    places: the trims.
    """

    def __init__(self, assessor: Assessor, places: Sequence[Place]) -> None:
        self.assessor = assessor
        self.deployed = assessor.deployed
        self.places = places
        self.points = [place.point for place in places]
        self.k = len(self.deployed.deployment.observation)
        self.m = len(self.deployed.deployment.action)

    def _flight(self, dt: float, delay: float) -> SampledFlight:
        """The flights of all changes: P, c and gain are numbers of a row."""
        whole = self.assessor.flight()
        extra = self.k**2 + self.k + self.m
        deployed = self.deployed
        arguments = symbols_of_a_sample(deployed, extra)
        P, c, gain = ca.vertsplit(arguments[3], [0, self.k**2, self.k**2 + self.k, extra])
        raw = ca.SX.sym("raw", self.m)
        o = ca.mtimes(ca.reshape(P, self.k, self.k), deployed.observe(*arguments[:3])) + c
        seen = deployed.normalized(o)[1]
        moved = deployed.inputs(gain * deployed.action(raw), *arguments[:3])
        steered = whole.steered._replace(
            enters=ca.Function("enters", arguments, [ca.densify(seen)]),
            moves=ca.Function("moves", [raw, *arguments], [ca.densify(moved)]),
        )
        parts = parts_of_a_sample(self.points, dt)
        return replace(whole, dt=dt, delay=delay, parts=parts, extra=extra, other=steered)

    def flown(
        self,
        repairs: Sequence[Repair],
        sample: Sample,
        dt: float | None = None,
        delay: float | None = None,
    ) -> list[Flown]:
        """The flights of each change, whose starts are shared out to the trims; with the sample
        time and the delay of the card unless given."""
        card = self.deployed.deployment
        flight = self._flight(card.dt if dt is None else dt, card.delay if delay is None else delay)
        starts_here = sample.starts // len(self.places)
        rows = []
        for repair in repairs:
            changed = repair.deployment.on(self.deployed.model)
            for place in self.places:
                trim = self.deployed.trim_vector(place.point)
                starts, pushes = seeded_starts(place, starts_here, self.assessor.seed, False)
                extra = np.tile(self._numbers(repair, changed, trim), (starts_here, 1))
                trims = np.tile(trim, (starts_here, 1))
                rows.append(flight.rows(starts, trims, pushes, extra))
        envelopes = [flight_envelope(self.deployed.model, point) for point in self.points]
        least = np.repeat([envelope.least for envelope in envelopes], starts_here, axis=0)
        most = np.repeat([envelope.most for envelope in envelopes], starts_here, axis=0)
        limits = np.tile(least, (len(repairs), 1)), np.tile(most, (len(repairs), 1))
        flown = np.vstack(rows)
        costs, kept = self._costs_of_rows(flight, flown, limits, sample.seconds)
        away, swing = self._at_the_end(flight, flown, starts_here)
        at_rest = kept & (swing <= BALL)
        ends = (kept, at_rest & (away <= NEAR), at_rest & (away <= 1.0))
        shape = (len(repairs), -1)
        counts = [end.reshape(shape).sum(axis=1).tolist() for end in ends]
        return [*map(Flown, costs.reshape(shape), *counts)]

    def _at_the_end(
        self, flight: SampledFlight, rows: np.ndarray, starts: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """How far flights are from the trim in their last window, and by how much they swing: the
        most of the linear states, in half-widths of the box of starts, (N,) each."""
        _, _, low_X, high_X, *_ = flight.slices
        model = self.deployed.model
        linear = [list(model.states).index(name) for name in model.linear]
        centres = np.array([np.array(place.point.states)[linear] for place in self.places])
        boxes = np.maximum([place.box for place in self.places], 1.0 / _MOST)
        places_of_a_change = np.repeat(np.arange(len(self.places)), starts)
        owners = np.resize(places_of_a_change, len(rows))  # the same of each change
        highest = rows[:, high_X][:, linear]
        lowest = rows[:, low_X][:, linear]
        away = np.maximum(highest - centres[owners], centres[owners] - lowest) / boxes[owners]
        swing = (highest - lowest) / 2.0 / boxes[owners]
        return away.max(axis=1), swing.max(axis=1)

    def _costs_of_rows(
        self,
        flight: SampledFlight,
        rows: np.ndarray,
        limits: tuple[np.ndarray, np.ndarray],
        seconds: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Of each flight Σ x'Qx + u'Ru over its windows, with the largest deviations from trim in a
        window, and whether it stays within the limits; who leaves them pays that window for all
        that are left."""
        model = self.deployed.model
        X, _, low_X, high_X, low_U, high_U, trim, _, _ = flight.slices
        n, m = len(model.states), len(model.inputs)
        Q, R = cost_weights(self.deployed)
        of_states = [Q.get(name, 0.0) for name in model.states]
        of_inputs = [R.get(name, 0.0) for name in model.inputs]
        weights = np.array([*of_states, *of_inputs])
        windows = max(1, round(seconds / (flight.samples_in_window * flight.dt)))
        window = flight.window(len(rows), seconds)
        costs = np.zeros(len(rows))
        flying = np.arange(len(rows))
        for number in range(windows):
            moved = rows[flying]
            moved[:, low_X] = moved[:, high_X] = moved[:, X]
            moved[:, low_U] = np.inf
            moved[:, high_U] = -np.inf
            moved = window(moved)
            rows[flying] = moved
            lowest = np.hstack([moved[:, low_X], moved[:, low_U]])
            highest = np.hstack([moved[:, high_X], moved[:, high_U]])
            base = moved[:, trim][:, : n + m]
            with np.errstate(all="ignore"):
                largest = np.maximum(highest - base, base - lowest)
                rate = np.nan_to_num(largest**2 @ weights, nan=_MOST).clip(max=_MOST)
            least, most = (limit[flying] for limit in limits)
            inside = (moved[:, low_X] >= least) & (moved[:, high_X] <= most)
            is_lost = ~(inside.all(axis=1) & np.isfinite(moved[:, X]).all(axis=1))
            costs[flying] += rate * np.where(is_lost, windows - number, 1)
            flying = flying[~is_lost]
            if not flying.size:
                break
        kept = np.zeros(len(rows), dtype=bool)
        kept[flying] = True
        return np.clip(costs, 1.0 / _MOST, _MOST), kept

    def _numbers(self, repair: Repair, changed: Deployed, trim: np.ndarray) -> np.ndarray:
        """P, c and gain of a change at a trim, in the order of a row."""
        n, m = len(self.deployed.model.states), len(self.deployed.model.inputs)
        at_trim = (trim[:n], trim[n : n + m], trim)
        before = np.array(self.deployed.observe(*at_trim)).ravel()
        after = np.array(changed.observe(*at_trim)).ravel()
        c = after - repair.P @ before
        return np.concatenate([repair.P.ravel(order="F"), c, repair.gain])
