"""What a deployment would fly better with: one change of its card at a time, flown.

Right cards have changes that fly better too, a lower gain for one. So a change is named only where
the card flies badly without delay as well, where it brings clearly more starts back, where what the
training saw fits no worse with it, and where a lower gain alone does not do as well: a right policy
that is too strong cycles, and an exchange may weaken it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_policy.deployed import Deployed
from hfa_policy.deployment import Deployment
from hfa_policy.flights import SampledFlight, symbols_of_a_sample
from hfa_policy.mistakes import Mistake
from hfa_policy.outcomes import FlownRows, Place, seeded_starts
from hfa_policy.rest import RestSearch
from hfa_policy.sampled_loop import chain_of

if TYPE_CHECKING:
    from hfa_policy.assessment import AssessedPoint, Assessor

#: Part of the starts from which on a card flies well enough: right ones may be as narrow.
_WELL = 0.5
#: How many times more starts a repair must bring back, and which part of all at least.
_CLEARLY = 1.25
_MANY = 0.7
#: Flights of each repair at each of so many trims, and their seconds.
_STARTS = 24
_PLACES = 2
_SECONDS = 40.0
#: How many repairs are named that bring back as many as the best, less this part of the starts; the
#: quickest first.
_NAMED = 3
_AS_GOOD = 0.05
#: Part of the actions that shows whether a lower gain alone would do.
_LOWER = (0.5, 0.2, 0.1, 0.05, 0.02)
#: Sample times that are tried, as parts of that of the card.
_RATES = (0.25, 0.5, 2.0, 4.0)
_DEGREES = 180.0 / np.pi


class Repair(NamedTuple):
    """One change of a card: o' = P o + c, and an action times `sign`.

    kind: of the mistake that it undoes.
    text: what would have to be so.
    deployment: the changed card.
    P: (k, k); c follows from the changed card at a trim.
    sign: (m,).
    """

    kind: str
    text: str
    deployment: Deployment
    P: np.ndarray
    sign: np.ndarray


class Back(NamedTuple):
    """What a repair brings back.

    share: of the starts.
    seconds: mean time of the flights until they are back, or end.
    """

    share: float
    seconds: float


def better_repairs(assessor: Assessor, assessed: Sequence[AssessedPoint]) -> Iterator[Mistake]:
    """The repairs that bring clearly more starts back; nothing where the card flies well or every
    loop is stable at rest, or most would be without the delay."""
    flown = [point.flights for point in assessed if point.flights is not None]
    share = sum(each.returned for each in flown) / max(1, sum(each.starts for each in flown))
    is_stable = all(point.radius < 1.0 for point in assessed)  # right, and narrow or slow
    if not flown or is_stable or share >= _WELL or _delay_alone(assessor, assessed):
        return
    trial = _Trial(assessor, assessed)
    yield from trial.best()


def _delay_alone(assessor: Assessor, assessed: Sequence[AssessedPoint]) -> bool:
    """Whether most of the loops that are not stable would be without the delay."""
    deployment = assessor.deployed.deployment
    rests = [point.rest for point in assessed if point.rest is not None and point.radius >= 1.0]
    if not deployment.delay or not rests:
        return False
    stable = [chain_of(rest, deployment.dt, 0.0).radius < 1.0 for rest in rests]
    return 2 * sum(stable) > len(stable)


class _Trial:
    """Repairs flown side by side at the trims where the card flies worst."""

    def __init__(self, assessor: Assessor, assessed: Sequence[AssessedPoint]) -> None:
        self.assessor = assessor
        self.deployed = assessor.deployed
        self.card = assessor.deployed.deployment
        order = sorted(assessed, key=lambda point: point.flights.returned)  # type: ignore[union-attr]
        self.places = [point.place for point in order[:_PLACES]]
        self.holds_somewhere = any(point.holds for point in assessed)
        self.k = len(self.card.observation)
        self.m = len(self.card.action)

    def best(self) -> Iterator[Mistake]:
        """The repair that is named; nothing where none is."""
        as_it_is = Repair("", "", self.card, np.eye(self.k), np.ones(self.m))
        lower = [as_it_is._replace(sign=np.full(self.m, part)) for part in _LOWER]
        repairs = [repair for repair in self._repairs() if self._fits(repair)]
        tried = [as_it_is, *lower, *repairs]
        returned = self._returned(tried, self._flight())
        card, lowered = returned[0].share, max(each.share for each in returned[1 : 1 + len(lower)])
        better = []
        for repair, back in zip(repairs, returned[1 + len(lower) :], strict=True):
            if back.share >= max(_MANY, _CLEARLY * max(card, lowered)):
                better.append((back, repair))
        if not better and not self.holds_somewhere:
            better = self._better_rates(max(card, lowered))
        most = max((back.share for back, _ in better), default=0.0)
        as_good = [pair for pair in better if pair[0].share >= most - _AS_GOOD]
        as_good.sort(key=lambda pair: pair[0].seconds)
        for back, repair in as_good[:_NAMED]:
            text = (
                f"it would fly better if {repair.text}: {100 * back.share:.3g} % of the starts "
                f"come back, as it is {100 * card:.3g} %"
            )
            yield Mistake(repair.kind, False, text)

    def _flight(self) -> SampledFlight:
        """The flights of all repairs: P, c and sign are numbers of a row."""
        whole = self.assessor.flight()
        extra = self.k * self.k + self.k + self.m
        deployed = self.deployed
        arguments = symbols_of_a_sample(deployed, extra)
        P, c, sign = ca.vertsplit(arguments[3], [0, self.k**2, self.k**2 + self.k, extra])
        raw = ca.SX.sym("raw", self.m)
        o = ca.mtimes(ca.reshape(P, self.k, self.k), deployed.observe(*arguments[:3])) + c
        seen = deployed.normalized(o)[1]
        moved = deployed.inputs(sign * deployed.action(raw), *arguments[:3])
        steered = whole.steered._replace(
            enters=ca.Function("enters", arguments, [ca.densify(seen)]),
            moves=ca.Function("moves", [raw, *arguments], [ca.densify(moved)]),
        )
        return replace(whole, extra=extra, other=steered)

    def _returned(self, repairs: Sequence[Repair], flight: SampledFlight) -> list[Back]:
        """What each brings back; nothing where its loop is not stable."""
        places: list[Place] = []
        rows = []
        owners: list[int] = []
        for number, repair in enumerate(repairs):
            deployed = repair.deployment.on(self.deployed.model)
            for place in self.places:
                trim = self.deployed.trim_vector(place.point)
                rest = self._rest(repair, deployed, place)
                if rest is None or not rest.stable:
                    continue
                starts, pushes = seeded_starts(place, _STARTS, self.assessor.seed, False)
                numbers = self._numbers(repair, deployed, trim)
                extra = np.tile(numbers, (_STARTS, 1))
                rows.append(flight.rows(starts, np.tile(trim, (_STARTS, 1)), pushes, extra))
                places.append(rest)
                owners.append(number)
        shares = np.zeros(len(repairs))
        seconds = np.zeros(len(repairs))
        if not rows:
            return [Back(0.0, _SECONDS) for _ in repairs]
        flown = FlownRows(flight, places, np.vstack(rows), np.arange(len(places)).repeat(_STARTS))
        flown.fly(_SECONDS, flight.window(len(flown.rows), _SECONDS))
        for owner, number in enumerate(owners):
            back = flown.outcome(owner, places[owner]).returned
            shares[number] += back / (_STARTS * len(self.places))
            mine = flown.owners == owner
            seconds[number] += float(flown.times[mine].mean()) / len(self.places)
        return [Back(*pair) for pair in zip(shares.tolist(), seconds.tolist(), strict=True)]

    def _rest(self, repair: Repair, deployed: Deployed, place: Place) -> Place | None:
        """Where the repaired policy rests; of one whose actions are scaled alone the trim."""
        dt, delay = repair.deployment.dt, self.card.delay
        is_changed = repair.deployment is not self.card
        if is_changed:
            search = RestSearch(deployed, place.point)
            point = place.point
            rest = search.from_point(np.array(point.states), np.array(point.inputs))
        else:
            rest = place.rest
        if rest is None:
            return None
        if np.any(np.abs(repair.sign) != 1.0):
            sign = float(repair.sign[0])
            rest = replace(rest, K=sign * rest.K, K_inputs=sign * rest.K_inputs)
        stable = chain_of(rest, dt, delay).radius < 1.0
        return replace(place, rest=rest, stable=stable)

    def _numbers(self, repair: Repair, deployed: Deployed, trim: np.ndarray) -> np.ndarray:
        """P, c and sign of a repair at a trim, in the order of a row."""
        n, m = len(self.deployed.model.states), len(self.deployed.model.inputs)
        at_trim = (trim[:n], trim[n : n + m], trim)
        before = np.array(self.deployed.observe(*at_trim)).ravel()
        after = np.array(deployed.observe(*at_trim)).ravel()
        c = after - repair.P @ before
        return np.concatenate([repair.P.ravel(order="F"), c, repair.sign])

    # What the training saw.

    def _fits(self, repair: Repair) -> bool:
        """Whether what the normalizer has seen fits the changed observations no worse."""
        normalizer = self.card.normalizer
        if normalizer is None or repair.deployment.observation == self.card.observation:
            return True
        return self._misfit(repair.deployment) <= self._misfit(self.card) - np.log(1.5)

    def _misfit(self, deployment: Deployment) -> float:
        """Σ |log(spread of the observations of the starts / deviation of the training)|, and how
        far the trim is off the mean of the training, beyond one deviation of it."""
        normalizer = deployment.normalizer
        assert normalizer is not None
        deployed = deployment.on(self.deployed.model)
        place = self.places[0]
        starts, _ = seeded_starts(place, 64, 0, False)
        trim = deployed.trim_vector(place.point)
        inputs = np.array(place.point.inputs)
        seen = np.array(
            [np.array(deployed.observe(start, inputs, trim)).ravel() for start in starts]
        )
        at_trim = np.array(deployed.observe(np.array(place.point.states), inputs, trim)).ravel()
        deviation = np.maximum(normalizer.deviation, 1e-12)
        spread = np.maximum(seen.std(axis=0), 1e-12)
        off = np.maximum(np.abs(at_trim - normalizer.mean) / deviation - 1.0, 0.0)
        return float(np.abs(np.log(spread / deviation)).sum() + np.log1p(off).sum())

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
            sign = np.ones(self.m)
            sign[number] = -1.0
            text = f"the action of {name} had the other sign"
            deployment = self.card.changed(action=action)
            yield Repair("sign", text, deployment, np.eye(self.k), sign)

    def _abouts(self) -> Iterator[Repair]:
        for about, text in ((0.0, "absolute values"), ("trim", "deviations from trim")):
            observation = {
                name: {**entry, "about": about} for name, entry in self.card.observation.items()
            }
            if observation != self.card.observation:
                why = f"all observations were {text}"
                yield self._made("about", why, observation, np.eye(self.k))

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

    def _better_rates(self, baseline: float) -> list[tuple[Back, Repair]]:
        """The sample times that bring clearly more starts back than the card and a lower gain."""
        better = []
        for part in _RATES:
            timing = {**self.card.timing, "dt": part * self.card.dt}
            changed = self.card.changed(timing=timing)
            text = f"it were sampled every {1e3 * changed.dt:.4g} ms"
            repair = Repair("sample time", text, changed, np.eye(self.k), np.ones(self.m))
            flight = replace(
                self._flight(),
                dt=changed.dt,
                parts=max(1, round(part * self.assessor.flight().parts)),
            )
            (back,) = self._returned([repair], flight)
            if back.share >= max(_MANY, _CLEARLY * baseline):
                better.append((back, repair))
        return better
