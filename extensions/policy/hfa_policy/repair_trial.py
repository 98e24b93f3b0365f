"""What a deployment would fly better with: changes of its card, flown side by side.

Right policies too fly better with another card: one that is too strong or too late with whatever
makes it weaker, a narrow one at its few worst starts, one that was trained badly with much. So a
change is named only where the policy flies well with it and clearly better than with the card as it
is, and where no other gain does about the same. A gain is such a cause only where it helps: a weak
policy of a wrong sign flies as well as none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.envelope import flight_envelope
from hfa_policy.deployed import Deployed
from hfa_policy.deployment import Deployment
from hfa_policy.episodes import cost_weights
from hfa_policy.flights import SampledFlight, symbols_of_a_sample
from hfa_policy.held_step import parts_of_a_sample
from hfa_policy.mistake import Mistake
from hfa_policy.observation_evidence import observations_of_training
from hfa_policy.outcomes import seeded_starts
from hfa_policy.repairs import Repair, card_with_gain, repairs_of

if TYPE_CHECKING:
    from hfa_policy.assessment import AssessedPoint, Assessor

#: Part of the starts that a change brings back: the policy flies well with it. One that was trained
#: badly flies better with some changes, well with none.
_WELL = 0.8
#: So many times as many starts, or as much cost, are clearly more; and so many starts of all: fewer
#: are chance.
_CLEARLY = 1.25
_MORE_STARTS = 1.0 / 6.0
#: How many times as much a policy costs as it is, at half of the starts, where a change brings no
#: more of them back: right ones that were trained badly reach 2.3.
_AS_IT_IS = 3.0
#: Who is farther from the trim than so many half-widths of the box of starts, or swings by more in
#: the last second, did not come back. Some policies rest off trim; of the many exchanges some fly
#: as near as that by chance, and must come back into the box.
_NEAR = 3.0
_AT_REST = 0.1
#: A card that keeps fewer of the starts within the limits harms: that no control does about as well
#: as a change is then no argument against it.
_KEEPS = 0.7
#: Of the actions: the card as it is, no control, and the gains that a right policy may lack. One
#: that was trained for dear control is up to fifty times too weak, none is ten times too strong.
_GAINS = (1.0, 0.0, 0.2, 0.5, 2.0, 5.0, 0.1, 0.35, 0.7, 10.0, 20.0, 50.0)
#: How many of them, the first, are flown at another sample time.
_AT_RATES = 6
#: A policy may be a little too strong for its sample time: its loop does not grow by so much from
#: one sample to the next.
_TOO_SLOW = 2.0
#: The sizes of observations ask for a change, or speak against it, where they are as a sum of
#: logarithms so much nearer to what the training saw, or farther: a factor of 20, a third of the
#: degrees of a radian.
_NEARER = 3.0
#: Trims where changes are flown: those where the fewest starts come back.
_PLACES = 2
#: Changes of a kind that are left after a few short flights of all, and that are named at most.
_LEFT = 3
#: Sample times that are tried, as parts of that of the card; the slowest first.
_RATES = (0.5, 0.25, 0.125)
#: A size of cost beyond which flights are not told apart.
_MOST = 1e9


class _Sample(NamedTuple):
    """Starts of each change, and the seconds that each is flown."""

    starts: int
    seconds: float


_SHORT = _Sample(4, 8.0)
_WHOLE = _Sample(24, 40.0)


class _Flown(NamedTuple):
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

    def strictly(self) -> _Flown:
        """The same where only those in the box of starts are back."""
        return self._replace(back=self.into_box)

    def times(self, other: _Flown) -> float:
        """How many times the costs of another these are: the median over the starts."""
        return float(np.median(self.costs / other.costs))

    @property
    def flies_well(self) -> bool:
        """Whether most starts come back."""
        return self.back >= _WELL * len(self.costs)

    @property
    def harms(self) -> bool:
        """Whether it loses many of the starts."""
        return self.kept <= _KEEPS * len(self.costs)

    def is_better_than(self, card: _Flown) -> bool:
        """Whether it loses no more starts than the card as it is, and brings clearly more of them
        back at clearly less cost, or no fewer at a third."""
        if self.kept < card.kept or self.back < card.back:
            return False
        least = max(_CLEARLY * card.back, card.back + _MORE_STARTS * len(self.costs))
        if self.back >= least and card.times(self) >= _CLEARLY:
            return True
        return card.times(self) >= _AS_IT_IS

    def is_a_gain(self, none: _Flown, other_gains: Sequence[_Flown]) -> bool:
        """Whether another gain, one that helps, brings about as many back at about the cost."""
        return any(
            none.times(other) >= _CLEARLY
            and _CLEARLY * other.back >= self.back
            and other.times(self) < _CLEARLY
            for other in other_gains
        )


class _Found(NamedTuple):
    """A change that is clearly better, its kind and what would have to be so."""

    flown: _Flown
    kind: str
    why: str


def better_repairs(assessor: Assessor, assessed: Sequence[AssessedPoint]) -> Iterator[Mistake]:
    """The changes of the card with which the policy flies clearly better, the best first; nothing
    where it flies well."""
    if not all(_flies_well(point) for point in assessed):
        yield from _Trial(assessor, assessed).named()


def _flies_well(point: AssessedPoint) -> bool:
    """Whether it holds at a trim, and most starts come back to within the box of starts."""
    if not point.holds or point.flights is None:
        return False
    near_trim = bool(np.all(np.abs(point.rest_offset) <= point.place.box))
    return near_trim and point.flights.returned >= _WELL * point.flights.starts


class _Trial:
    """Changes flown side by side at the trims where the card flies worst."""

    def __init__(self, assessor: Assessor, assessed: Sequence[AssessedPoint]) -> None:
        self.assessor = assessor
        self.deployed = assessor.deployed
        self.card = assessor.deployed.deployment
        order = sorted(assessed, key=lambda point: point.flights.returned)  # type: ignore[union-attr]
        self.places = [point.place for point in order[:_PLACES]]
        self.points = [place.point for place in self.places]
        self.holds_everywhere = all(point.holds for point in assessed)
        self.is_far_too_slow = any(not point.radius < _TOO_SLOW for point in assessed)
        self.k = len(self.card.observation)
        self.m = len(self.card.action)
        self.gains = [card_with_gain(self.card, gain) for gain in _GAINS]

    def named(self) -> Iterator[Mistake]:
        """The changes that are named, the best first."""
        repairs = self._left(repairs_of(self.deployed))
        flown = self._fly([*self.gains, *repairs], self.card.dt, _WHOLE)
        of_gains = flown[: len(self.gains)]
        found = []
        for repair, of_repair in zip(repairs, flown[len(self.gains) :], strict=True):
            if self._is_clear(repair, of_repair, of_gains):
                found.append(_Found(of_repair, repair.kind, repair.text))
        if not found and self.is_far_too_slow and not self.holds_everywhere:
            found = self._faster(of_gains)
        found.sort(key=lambda each: float(np.log(each.flown.costs).sum()))
        for each in found[:_LEFT]:
            if each.flown.times(found[0].flown) < _CLEARLY:
                yield Mistake(each.kind, False, _said(each, of_gains[0]))

    def _left(self, repairs: Sequence[Repair]) -> list[Repair]:
        """The changes of each kind that cost least in a few short flights."""
        flown = self._fly(repairs, self.card.dt, _SHORT)
        costs = [float(np.log(of_repair.costs).sum()) for of_repair in flown]
        left: dict[str, list[Repair]] = {}
        for number in np.argsort(costs).tolist():
            of_kind = left.setdefault(repairs[number].kind, [])
            if len(of_kind) < _LEFT:
                of_kind.append(repairs[number])
        return [repair for of_kind in left.values() for repair in of_kind]

    def _is_clear(self, repair: Repair, flown: _Flown, of_gains: Sequence[_Flown]) -> bool:
        """Whether a change is clearly better than the card and no gain, nor no control, does the
        same; where what the training saw asks for it, than the card."""
        if repair.kind == "order":
            flown = flown.strictly()
            of_gains = [of_gain.strictly() for of_gain in of_gains]
        card, none, *others = of_gains
        nearer = self._nearer(repair)
        if nearer <= -_NEARER or not flown.flies_well or not flown.is_better_than(card):
            return False
        if nearer >= _NEARER:
            return True
        is_none = none.times(flown) < _CLEARLY and not card.harms
        return not is_none and not flown.is_a_gain(none, others)

    def _faster(self, of_gains: Sequence[_Flown]) -> list[_Found]:
        """The slowest sample time at which the policy flies well and is far cheaper than as it is,
        and no gain, at that sample time or that of the card, is clearly cheaper: that policy would
        be too strong."""
        card = of_gains[0]
        for part in _RATES:
            dt = part * self.card.dt
            own, *others = self._fly(self.gains[:_AT_RATES], dt, _WHOLE)
            is_better = own.is_better_than(card) and card.times(own) >= _AS_IT_IS
            is_too_strong = any(own.times(gain) >= _CLEARLY for gain in (*others, *of_gains))
            if own.flies_well and is_better and not is_too_strong:
                why = f"it were sampled every {1e3 * dt:.4g} ms or faster"
                return [_Found(own, "sample time", why)]
        return []

    # Flights.

    def _flight(self, dt: float) -> SampledFlight:
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
        return replace(whole, dt=dt, parts=parts, extra=extra, other=steered)

    def _fly(self, repairs: Sequence[Repair], dt: float, sample: _Sample) -> list[_Flown]:
        """The flights of each change, whose starts are shared out to the trims."""
        flight = self._flight(dt)
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
        at_rest = kept & (swing <= _AT_REST)
        ends = (kept, at_rest & (away <= _NEAR), at_rest & (away <= 1.0))
        shape = (len(repairs), -1)
        counts = [end.reshape(shape).sum(axis=1).tolist() for end in ends]
        return [*map(_Flown, costs.reshape(shape), *counts)]

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

    # What the training saw.

    def _nearer(self, repair: Repair) -> float:
        """How much nearer to what the training saw the observations of the changed card are; 0
        where nothing is known of that."""
        if observations_of_training(self.card) is None:
            return 0.0
        return self._misfit(self.card) - self._misfit(repair.deployment)

    def _misfit(self, deployment: Deployment) -> float:
        """Σ |log(size of the observations of the starts / of the training)|, sizes as root mean
        squares about the mean of the training."""
        seen = observations_of_training(deployment)
        assert seen is not None
        mean, size = seen
        deployed = deployment.on(self.deployed.model)
        place = self.places[0]
        starts, _ = seeded_starts(place, 64, 0, False)
        trim = deployed.trim_vector(place.point)
        inputs = np.array(place.point.inputs)
        rows = [np.array(deployed.observe(start, inputs, trim)).ravel() for start in starts]
        size_here = np.sqrt(((np.array(rows) - mean) ** 2).mean(axis=0))
        least = 1.0 / _MOST
        return float(np.abs(np.log((size_here + least) / (size + least))).sum())


def _said(found: _Found, of_card: _Flown) -> str:
    """What would have to be so, and how many times as much the card costs as it is."""
    times = of_card.times(found.flown)
    said = f"{times:.3g}" if times < 1000.0 else "over 1000"
    return f"it would fly better if {found.why}: as it is its flights cost {said} times as much"
