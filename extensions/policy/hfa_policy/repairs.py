"""What a deployment would fly better with: one change of its card at a time, flown.

A policy flies its training's cost J = Σ x'Qx + u'Ru best with the card that it was trained with.
Three kinds of right policies fly better with another card, and are told from mistakes:

- one that is too strong flies better with whatever weakens it: a change is named only where a lower
  gain, down to none at all, does clearly worse;
- one that is too strong or too weak flies better with other scales: such a change is named only
  where what the training saw asks for it, or, where that is not known, where no gain from a fifth
  of the card's on comes near it and none at all is better;
- one that cycles flies better at a higher rate: a rate is named only where the gain is right for
  it, as training makes it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.envelope import flight_envelope
from hfa_policy.deployed import Deployed
from hfa_policy.deployment import Deployment
from hfa_policy.episodes import cost_weights
from hfa_policy.flights import SampledFlight, symbols_of_a_sample
from hfa_policy.held_step import parts_of_a_sample
from hfa_policy.mistakes import Mistake, observations_of_training
from hfa_policy.outcomes import seeded_starts

if TYPE_CHECKING:
    from hfa_policy.assessment import AssessedPoint, Assessor

#: A policy that holds with every start back and costs less than this more than the optimum, mean
#: percent, flies well enough.
_WELL = 200.0
#: Trims where repairs are flown.
_PLACES = 2
#: Repairs of a kind that are left after a few short flights of all.
_LEFT = 3
#: A size of cost that no flight is distinguished beyond.
_MOST = 1e9
#: How many times the cost of a repair the card must cost, no control at all, and the card with any
#: lower gain.
_CARD = 3.0
_NO_CONTROL = 2.5
_LOWER = 1.25
#: Parts of the actions that show whether a lower gain would do.
_GAINS = (0.5, 0.2, 0.1, 0.05, 0.0)
#: A right policy is not so strong that less than this part of its gain is the best.
_TOO_STRONG = 0.2
#: Of a change of scales where it is known what the training saw: how many times its cost the card
#: must cost, and no control at all, and how much nearer to that it must be, as a sum of logarithms.
_CARD_OF_SCALES = 1.5
_NO_CONTROL_OF_SCALES = 2.0
_NEARER = 3.0
#: How much farther from what the training saw another change may be.
_FARTHER = 1.0
#: Of a sample time: how many times its cost a lower gain must cost there, and with the card.
_OWN_GAIN = 0.9
_LOWER_AT_RATE = 1.0
#: Sample times that are tried, as parts of that of the card; the slowest first.
_RATES = (0.5, 0.25, 0.125)
#: How many repairs are named that cost up to so many times the best.
_NAMED = 3
_AS_GOOD = 1.25
_DEGREES = 180.0 / np.pi
#: The kinds that change the size of observations.
_OF_SIZE = ("degrees", "scale")


class _Sample(NamedTuple):
    """Starts of each repair at each trim, and the seconds that each is flown."""

    starts: int
    seconds: float


_SHORT = _Sample(4, 8.0)
_WHOLE = _Sample(12, 20.0)


class Repair(NamedTuple):
    """One change of a card: o' = P o + c, and an action times `gain`.

    kind: of the mistake that it undoes.
    text: what would have to be so.
    deployment: the changed card.
    P: (k, k); c follows from the changed card at a trim.
    gain: (m,).
    """

    kind: str
    text: str
    deployment: Deployment
    P: np.ndarray
    gain: np.ndarray


class _Found(NamedTuple):
    """A repair that is better by far: its cost, how much nearer to what the training saw, its kind
    and what would have to be so."""

    cost: float
    nearer: float
    kind: str
    why: str


def better_repairs(assessor: Assessor, assessed: Sequence[AssessedPoint]) -> Iterator[Mistake]:
    """The repairs with which the policy costs clearly less; nothing where it flies well."""
    if all(_flies_well(point) for point in assessed):
        return
    yield from _Trial(assessor, assessed).named()


def _flies_well(point: AssessedPoint) -> bool:
    """Whether every start comes back at a trim, at a moderate cost where it is stable there."""
    if point.flights is None or point.flights.returned < point.flights.starts:
        return False
    if point.buzzes:
        return True
    return point.holds and point.cost is not None and point.cost.sampled_mean <= _WELL


class _Trial:
    """Repairs flown side by side at the trims where the card flies worst."""

    def __init__(self, assessor: Assessor, assessed: Sequence[AssessedPoint]) -> None:
        self.assessor = assessor
        self.deployed = assessor.deployed
        self.card = assessor.deployed.deployment
        order = sorted(assessed, key=lambda point: point.flights.returned)  # type: ignore[union-attr]
        self.places = [point.place for point in order[:_PLACES]]
        self.points = [place.point for place in self.places]
        self.holds_everywhere = all(point.holds for point in assessed)
        self.k = len(self.card.observation)
        self.m = len(self.card.action)
        as_it_is = Repair("", "", self.card, np.eye(self.k), np.ones(self.m))
        #: The card as it is, and with every lower gain.
        self.gains = [as_it_is._replace(gain=np.full(self.m, gain)) for gain in (1.0, *_GAINS)]

    def named(self) -> Iterator[Mistake]:
        """The repairs that are named, the best first."""
        repairs = self._left(self._repairs())
        costs = self._costs([*self.gains, *repairs], self.card.dt, _WHOLE)
        lower = costs[: len(self.gains)]
        found = []
        for repair, cost in zip(repairs, costs[len(self.gains) :], strict=True):
            if self._is_clear(repair, cost, lower):
                found.append(_Found(cost, self._nearer(repair) or 0.0, repair.kind, repair.text))
        if not found and not self.holds_everywhere:
            found = self._rates(lower)
        least = min((each.cost for each in found), default=0.0)
        as_good = [each for each in found if each.cost <= _AS_GOOD * least]
        as_good.sort(key=lambda each: (-round(each.nearer), each.cost))
        for each in as_good[:_NAMED]:
            times = min(lower[0] / each.cost, 1000.0)
            text = (
                f"it would fly better if {each.why}: as it is its flights cost "
                f"{'over ' if times == 1000.0 else ''}{times:.3g} times as much"
            )
            yield Mistake(each.kind, False, text)

    def _left(self, repairs: Sequence[Repair]) -> list[Repair]:
        """The repairs of each kind that cost least in a few short flights."""
        costs = self._costs(repairs, self.card.dt, _SHORT)
        left: dict[str, list[Repair]] = {}
        for number in np.argsort(costs).tolist():
            of_kind = left.setdefault(repairs[number].kind, [])
            if len(of_kind) < _LEFT:
                of_kind.append(repairs[number])
        return [repair for of_kind in left.values() for repair in of_kind]

    def _is_clear(self, repair: Repair, cost: float, lower: Sequence[float]) -> bool:
        """Whether a repair is better by far than the card, whose costs with lower gains, down to
        none, these are."""
        card, none = lower[0], lower[-1]
        nearer = self._nearer(repair)
        if repair.kind in _OF_SIZE and nearer is not None:
            is_better = card >= _CARD_OF_SCALES * cost and none >= _NO_CONTROL_OF_SCALES * cost
            return is_better and nearer >= _NEARER
        is_better = card >= _CARD * cost and none >= _NO_CONTROL * cost
        if repair.kind in _OF_SIZE:
            plausible = [
                of_gain
                for of_gain, gain in zip(lower[1:], _GAINS, strict=True)
                if gain >= _TOO_STRONG
            ]
            return is_better and min(plausible) >= _LOWER * cost and min(lower) >= cost
        is_far = nearer is not None and nearer < -_FARTHER
        return is_better and min(lower) >= _LOWER * cost and not is_far

    def _rates(self, lower: Sequence[float]) -> list[_Found]:
        """The slowest sample time with which it costs clearly less, the gain of the policy being
        right for it."""
        for part in _RATES:
            dt = part * self.card.dt
            cost, *lower_there = self._costs(self.gains, dt, _WHOLE)
            is_better = lower[0] >= _CARD * cost and lower_there[-1] >= _NO_CONTROL * cost
            is_own = min(lower_there) >= _OWN_GAIN * cost
            if is_better and is_own and min(lower) >= _LOWER_AT_RATE * cost:
                why = f"it were sampled every {1e3 * dt:.4g} ms or faster"
                return [_Found(cost, 0.0, "sample time", why)]
        return []

    # Flights.

    def _flight(self, dt: float) -> SampledFlight:
        """The flights of all repairs: P, c and gain are numbers of a row."""
        whole = self.assessor.flight()
        extra = self.k * self.k + self.k + self.m
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

    def _costs(self, repairs: Sequence[Repair], dt: float, sample: _Sample) -> list[float]:
        """The cost of each repair, the geometric mean over its flights: one in ten that is lost is
        no more than ten that cost a quarter more."""
        flight = self._flight(dt)
        rows = []
        for repair in repairs:
            changed = repair.deployment.on(self.deployed.model)
            for place in self.places:
                trim = self.deployed.trim_vector(place.point)
                starts, pushes = seeded_starts(place, sample.starts, self.assessor.seed, False)
                extra = np.tile(self._numbers(repair, changed, trim), (sample.starts, 1))
                trims = np.tile(trim, (sample.starts, 1))
                rows.append(flight.rows(starts, trims, pushes, extra))
        envelopes = [flight_envelope(self.deployed.model, point) for point in self.points]
        least = np.repeat([envelope.least for envelope in envelopes], sample.starts, axis=0)
        most = np.repeat([envelope.most for envelope in envelopes], sample.starts, axis=0)
        limits = np.tile(least, (len(repairs), 1)), np.tile(most, (len(repairs), 1))
        costs = self._costs_of_rows(flight, np.vstack(rows), limits, sample.seconds)
        by_repair = np.log(costs).reshape(len(repairs), -1).mean(axis=1)
        return [float(cost) for cost in np.exp(by_repair)]

    def _costs_of_rows(
        self,
        flight: SampledFlight,
        rows: np.ndarray,
        limits: tuple[np.ndarray, np.ndarray],
        seconds: float,
    ) -> np.ndarray:
        """Of each flight Σ x'Qx + u'Ru over its windows, with the largest deviations from trim in a
        window; who leaves the limits pays that window for all that are left."""
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
        return np.clip(costs, 1.0 / _MOST, _MOST)

    def _numbers(self, repair: Repair, changed: Deployed, trim: np.ndarray) -> np.ndarray:
        """P, c and gain of a repair at a trim, in the order of a row."""
        n, m = len(self.deployed.model.states), len(self.deployed.model.inputs)
        at_trim = (trim[:n], trim[n : n + m], trim)
        before = np.array(self.deployed.observe(*at_trim)).ravel()
        after = np.array(changed.observe(*at_trim)).ravel()
        c = after - repair.P @ before
        return np.concatenate([repair.P.ravel(order="F"), c, repair.gain])

    # What the training saw.

    def _nearer(self, repair: Repair) -> float | None:
        """How much nearer to what the training saw the observations of the changed card are; None
        where nothing is known of that."""
        if observations_of_training(self.card) is None:
            return None
        if repair.deployment.observation == self.card.observation:
            return 0.0
        return self._misfit(self.card) - self._misfit(repair.deployment)

    def _misfit(self, deployment: Deployment) -> float:
        """Σ |log(size of the observations of the starts / of the training)|, sizes as root mean
        squares about the mean of the training."""
        seen_then = observations_of_training(deployment)
        assert seen_then is not None
        mean, size = seen_then
        deployed = deployment.on(self.deployed.model)
        place = self.places[0]
        starts, _ = seeded_starts(place, 64, 0, False)
        trim = deployed.trim_vector(place.point)
        inputs = np.array(place.point.inputs)
        seen = np.array(
            [np.array(deployed.observe(start, inputs, trim)).ravel() for start in starts]
        )
        seen_now = np.sqrt(((seen - mean) ** 2).mean(axis=0))
        least = 1.0 / _MOST
        return float(np.abs(np.log((seen_now + least) / (size + least))).sum())

    # The repairs.

    def _repairs(self) -> list[Repair]:
        """Every single change of the card that is tried."""
        return [*self._exchanges(), *self._signs(), *self._abouts(), *self._scales()]

    def _made(self, kind: str, text: str, observation: Mapping[str, Any], P: Any) -> Repair:
        changed = self.card.changed(observation=dict(observation))
        return Repair(kind, text, changed, np.asarray(P, dtype=float), np.ones(self.m))

    def _exchanges(self) -> Iterator[Repair]:
        names = list(self.card.observation)
        for one, other in combinations(range(self.k), 2):
            order = list(range(self.k))
            order[one], order[other] = other, one
            observation = {names[i]: self.card.observation[names[i]] for i in order}
            text = f"{names[one]} and {names[other]} were exchanged in the observation"
            yield self._made("order", text, observation, np.eye(self.k)[order])

    def _signs(self) -> Iterator[Repair]:
        for number, (name, entry) in enumerate(self.card.action.items()):
            turned = re.sub(r"\ba\b", "(-a)", entry.get("map", "trim + a"))
            action = {**self.card.action, name: {**entry, "map": turned}}
            gain = np.ones(self.m)
            gain[number] = -1.0
            text = f"the action of {name} had the other sign"
            deployment = self.card.changed(action=action)
            yield Repair("sign", text, deployment, np.eye(self.k), gain)

    def _abouts(self) -> Iterator[Repair]:
        for about, text in ((0.0, "absolute values"), ("trim", "deviations from trim")):
            observation = {
                name: {**entry, "about": about} for name, entry in self.card.observation.items()
            }
            if observation != self.card.observation:
                why = f"all observations were {text}"
                yield self._made("about", why, observation, np.eye(self.k))

    def _sizes(self) -> np.ndarray:
        """(k,), the size of each observation: the deviation that the card's Q prices with 1, else
        the nominal one of the model, else 1."""
        Q, _ = cost_weights(self.deployed)
        signals = self.deployed.model.signals
        sizes = []
        for name, entry in self.card.observation.items():
            observed = entry.get("formula", name)
            size = 1.0
            if Q.get(observed, 0.0) > 0.0:
                size = Q[observed] ** -0.5
            elif observed in signals:
                size = signals[observed].nominal
            sizes.append(size)
        return np.array(sizes)

    def _scales(self) -> Iterator[Repair]:
        angles = []
        for formula in self.deployed.observed:
            units = {self.deployed.model.unit(name) for name in formula.names}
            angles.append(any(unit.startswith("rad") for unit in units))
        factors = np.where(angles, _DEGREES, 1.0)
        scales = np.array([entry.get("scale", 1.0) for entry in self.card.observation.values()])
        trials = [
            ("degrees", "its angles were observed in degrees", factors),
            ("degrees", "its angles were observed in radians", 1.0 / factors),
            ("scale", "its observations had no scale", scales),
            ("scale", "its observations were scaled twice", 1.0 / scales),
            ("scale", "its scales were taken once, not twice", np.sqrt(np.abs(scales))),
        ]
        if np.allclose(scales, 1.0):
            sizes = self._sizes()
            names = self.card.observation
            given = ", ".join(f"{name} {size:.3g}" for name, size in zip(names, sizes, strict=True))
            trials.append(("scale", f"its observations had scales, as {given}", 1.0 / sizes))
        for kind, text, multiplied in trials:
            if np.allclose(multiplied, 1.0):
                continue
            observation = {
                name: {**entry, "scale": float(scale / factor)}
                for (name, entry), scale, factor in zip(
                    self.card.observation.items(), scales, multiplied, strict=True
                )
            }
            yield self._made(kind, text, observation, np.diag(multiplied))
