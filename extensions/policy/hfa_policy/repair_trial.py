"""Search for changes of a deployment file that improve its policy's flights.

Some changes of correct files also improve the flights. A policy with a gain that is too high, or
with too much delay, improves with any change that weakens it. A badly trained policy improves
with many changes. A change is therefore reported only under these conditions:

- The flights with the change are good and clearly better than with the file as written.
- No change of gain alone is about as good and clearly better than no control.
- If the file contains the cost of the training, the cost with the change is near its optimum.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hfa_policy.assessment import AssessedPoint, Assessor
from hfa_policy.change_flights import NEAR, ChangeFlights, FlightResults, Sample
from hfa_policy.deployed import Deployed
from hfa_policy.deployment import Deployment
from hfa_policy.mistake import Mistake
from hfa_policy.observation_evidence import observations_of_training
from hfa_policy.outcomes import seeded_starts
from hfa_policy.repairs import Repair, deployment_with_gain, repairs_of
from hfa_support.native.bound import RowFunction

#: Fraction of the flights that converge with a good policy. A badly trained policy improves with
#: some changes, but is good with none.
_WELL = 0.8
#: Factor by which the number of converged flights, or the cost, clearly differs. The number must
#: also differ by the second value, as a fraction of all flights. Smaller differences are chance.
_CLEARLY = 1.25
_MORE_STARTS = 1.0 / 6.0
#: Cost ratio at half of the initial conditions by which a change must improve the file as written
#: if no more flights converge, or if the change is an exchange. For right but badly trained
#: policies, it reaches 2.3.
_AS_IT_IS = 3.0
#: Least cost without control, relative to the cost with a change. If it is lower, flights hardly
#: depend on the policy, and corrections of different mistakes look alike. For a 737 with alpha and
#: pitch exchanged, the cost with the opposite elevator sign is 1.02 times the optimum, and 1.4
#: times without control.
_NEEDED = 2.0
#: A file with a smaller fraction of flights within the limits is harmful. That the absence of
#: control is about as good is then no argument against a change, unless the change weakens the
#: control.
_KEEPS = 0.7
#: Factors on the actions: the file as written, no control, and gains that may be missing in a right
#: policy. A policy trained for expensive control is up to fifty times too weak. No policy is ten
#: times too strong.
_GAINS = (1.0, 0.0, 0.2, 0.5, 2.0, 5.0, 0.1, 0.35, 0.7, 10.0, 20.0, 50.0)
#: Factors on the actions that a change makes smaller.
_WEAKER = (0.0, 0.1, 0.3)
#: Number of the first gains that are also tried at another sample time.
_AT_RATES = 6
#: Difference of the misfit to the training's record that supports or excludes a change, as a sum of
#: logarithms. It corresponds to a factor of 20, a third of the factor between degrees and radians.
_NEARER = 3.0
#: Largest cost of a policy with a right file, relative to the optimum. Good trained policies reach
#: 1.1, exact policies with one mistake corrected 1.4. Wrong changes have at least 2.7.
_OF_OPTIMUM = 2.0
#: The same limit for scales, which are estimated from the weights of the cost.
_OF_OPTIMUM_GUESSED = 2.5
#: Added to sizes before their logarithms.
_LEAST = 1e-9
#: Number of trims with simulated changes: those where the fewest flights converge.
_PLACES = 2
#: Number of changes of a kind that remain after short flights, and number of kinds that are named.
_LEFT = 3
_MOST_NAMED = 3
#: A change with a higher cost, relative to the best change, is not named.
_AS_GOOD = 2.0
#: Flights with all changes, and with the remaining changes.
_SHORT = Sample(4, 8.0)
_WHOLE = Sample(24, 40.0)
#: Trial sample times relative to that of the file, the slowest first.
_RATES = (0.5, 0.25, 0.125)


class _Found(NamedTuple):
    """Change that is clearly better.

    flown: results of the flights with the change.
    kind: type of the corrected mistake.
    why: assumption of the change, for the message.
    """

    flown: FlightResults
    kind: str
    why: str


def better_repairs(assessor: Assessor, assessed: Sequence[AssessedPoint]) -> Iterator[Mistake]:
    """Yield the changes of the deployment that clearly improve the flights, the best first.

    Nothing is yielded if the flights at all trims are already good.
    """
    if not all(_flies_well(point) for point in assessed):
        yield from _Trial(assessor, assessed).named()


def _flies_well(point: AssessedPoint) -> bool:
    """Return whether the policy performs well at a trim.

    The policy holds, most flights converge, and the equilibrium is near the trim.
    """
    if not point.holds or point.flights is None:
        return False
    near_trim = bool(np.all(np.abs(point.offset) <= NEAR * point.place.box))
    return near_trim and point.flights.returned >= _WELL * point.flights.starts


def _most_converge(flown: FlightResults) -> bool:
    """Return whether most flights converge."""
    return flown.back >= _WELL * len(flown.costs)


def _many_leave(flown: FlightResults) -> bool:
    """Return whether many flights leave the envelope.

    At most the fraction `_KEEPS` of the flights then stays inside.
    """
    return flown.kept <= _KEEPS * len(flown.costs)


def _is_better(flown: FlightResults, card: FlightResults) -> bool:
    """Return whether a change is clearly better than the file as written.

    With the change, no more flights may leave the envelope and no fewer may converge. In addition,
    either clearly more flights converge at clearly less cost, or the cost is at most a third.

    flown: results with the change
    card: results with the file as written
    """
    if flown.kept < card.kept or flown.back < card.back:
        return False
    least = max(_CLEARLY * card.back, card.back + _MORE_STARTS * len(flown.costs))
    if flown.back >= least and card.times(flown) >= _CLEARLY:
        return True
    return card.times(flown) >= _AS_IT_IS


def _weakens(repair: Repair) -> bool:
    """Return whether a change reduces the magnitude of an observation or of an action."""
    largest = np.abs(repair.P).max(axis=1)
    return bool(np.any(largest < 1.0) or np.any(np.abs(repair.gain) < 1.0))


def _is_a_gain(
    flown: FlightResults, none: FlightResults, other_gains: Sequence[FlightResults]
) -> bool:
    """Return whether a change of gain alone improves the flights about as much as another change.

    With such a gain, about as many flights converge at about the same cost, or the cost is clearly
    lower. In both cases, the cost must be clearly lower than without control.

    flown: results with the other change
    none: results without control
    other_gains: results with other gains
    """
    for other in other_gains:
        is_as_good = _CLEARLY * other.back >= flown.back and other.times(flown) < _CLEARLY
        is_cheaper = flown.times(other) >= _CLEARLY
        if none.times(other) >= _CLEARLY and (is_as_good or is_cheaper):
            return True
    return False


class _Trial:
    """Trials of changes, simulated together at the trims where the fewest flights converge."""

    def __init__(self, assessor: Assessor, assessed: Sequence[AssessedPoint]) -> None:
        self.deployed = assessor.deployed
        self.card = assessor.deployed.deployment
        order = sorted(assessed, key=lambda point: point.flights.returned)  # type: ignore[union-attr]
        self.places = [point.place for point in order[:_PLACES]]
        self.flights = ChangeFlights(assessor, self.places)
        # The radius is nan without an equilibrium.
        self.is_unstable = any(not point.radius < 1.0 for point in assessed)
        self.gains = [deployment_with_gain(self.card, gain) for gain in _GAINS]

    def named(self) -> Iterator[Mistake]:
        """Yield the best change of each kind, the best first, at most `_MOST_NAMED`.

        A change is omitted if its median cost is at least `_AS_GOOD` times that of the best change.
        Nothing is yielded if the delay alone explains the flights.
        """
        if self._is_only_late():
            return
        repairs = self._left(repairs_of(self.deployed))
        card, *flown = self.flights.simulate([self.gains[0], *repairs], _WHOLE)
        found = []
        for repair, of_repair in zip(repairs, flown, strict=True):
            if self._is_clear(repair, of_repair, card):
                found.append(_Found(of_repair, repair.kind, repair.text))
        if self.is_unstable:
            found += self._faster(card)
        found = self._near_optimal(found)
        found.sort(key=lambda each: float(np.log(each.flown.costs).sum()))
        best_of_kinds: dict[str, _Found] = {}
        for each in found:
            best_of_kinds.setdefault(each.kind, each)
        for each in list(best_of_kinds.values())[:_MOST_NAMED]:
            if each.flown.times(found[0].flown) < _AS_GOOD:
                yield Mistake(each.kind, False, _recommendation(each, card))

    @cached_property
    def _of_gains(self) -> list[FlightResults]:
        """Results of the flights with each change of gain alone.

        The first gains are those of the file as written and of no control.
        """
        return self.flights.simulate(self.gains, _WHOLE)

    def _near_optimal(self, found: list[_Found]) -> list[_Found]:
        """Return the found changes whose flights cost about as much as the flights of the optimum.

        All are returned if the deployment file contains no cost or no optimum exists.
        """
        if self.card.cost is None or not found:
            return found
        optimum = self.flights.simulate_optimum(_WHOLE)
        if optimum is None:
            return found
        limits = {"scale": _OF_OPTIMUM_GUESSED}
        return [
            each
            for each in found
            if each.flown.times(optimum) <= limits.get(each.kind, _OF_OPTIMUM)
        ]

    def _is_only_late(self) -> bool:
        """Return whether most flights converge without the delay.

        The result is False if the file has no delay.
        """
        if self.card.delay == 0.0:
            return False
        (on_time,) = self.flights.simulate(self.gains[:1], _WHOLE, delay=0.0)
        return _most_converge(on_time)

    def _left(self, repairs: Sequence[Repair]) -> list[Repair]:
        """Return the changes that remain after a few short flights with each: `_LEFT` of each kind.

        These changes have the lowest costs of their kind.
        """
        flown = self.flights.simulate(repairs, _SHORT)
        costs = [float(np.log(of_repair.costs).sum()) for of_repair in flown]
        left: dict[str, list[Repair]] = {}
        for number in np.argsort(costs).tolist():
            of_kind = left.setdefault(repairs[number].kind, [])
            if len(of_kind) < _LEFT:
                of_kind.append(repairs[number])
        return [repair for of_kind in left.values() for repair in of_kind]

    def _is_clear(self, repair: Repair, flown: FlightResults, card: FlightResults) -> bool:
        """Return whether a change is to be reported. All these conditions must be fulfilled:

        - Most flights converge with the change, and it is clearly better than the file as written.
        - The observations in the training do not contradict the change.
        - Unless these observations support the change, neither a change of gain nor the absence of
          control is about as good. The absence of control is disregarded if many flights leave the
          envelope with the file as written and the change weakens no observation or action.
        - A change of order reduces the cost to at most a third. Its flights converge if they end in
          the box (`FlightResults.into_box`).
        - A change of a map is clearly better than weaker actions.

        flown: results with the change
        card: results of the file as written
        """
        if repair.kind == "order":
            if card.times(flown) < _AS_IT_IS:
                return False
            flown = flown.counted_in_box()
            card = card.counted_in_box()
        if not _most_converge(flown) or not _is_better(flown, card):
            return False
        if repair.kind == "map" and self._is_weaker_action(repair, flown):
            return False
        nearer = self._nearer(repair)
        if abs(nearer) >= _NEARER:
            return nearer > 0.0
        _, none, *others = self._of_gains
        if repair.kind == "order":
            none, *others = (of_gain.counted_in_box() for of_gain in (none, *others))
        is_none = none.times(flown) < _NEEDED and (_weakens(repair) or not _many_leave(card))
        return not is_none and not _is_a_gain(flown, none, others)

    def _is_weaker_action(self, repair: Repair, flown: FlightResults) -> bool:
        """Return whether a change that weakens actions is about as good with still weaker actions.

        Weaker actions include zero.
        """
        smaller = repair.gain < 1.0
        gains = [np.where(smaller, part, 1.0) for part in _WEAKER]
        weaker = self.flights.simulate([repair._replace(gain=gain) for gain in gains], _WHOLE)
        return any(
            _CLEARLY * other.back >= flown.back and other.times(flown) < _CLEARLY
            for other in weaker
        )

    def _faster(self, card: FlightResults) -> list[_Found]:
        """Return a list with the longest shorter sample time at which the policy is clearly better.

        At this sample time, most flights converge, and their cost is at most a third. The list is
        empty if no sample time qualifies. A sample time does not qualify if a change of gain, at
        either sample time, has clearly lower cost, because the gain of the policy is then too high.

        card: results of the file as written
        """
        (short,) = self.flights.simulate(self.gains[:1], _SHORT)
        for part in _RATES:
            dt = part * self.card.dt
            (short_faster,) = self.flights.simulate(self.gains[:1], _SHORT, dt)
            if short.times(short_faster) < _CLEARLY:
                continue
            (faster,) = self.flights.simulate(self.gains[:1], _WHOLE, dt)
            is_third = _is_better(faster, card) and card.times(faster) >= _AS_IT_IS
            if not _most_converge(faster) or not is_third:
                continue
            faster_gains = self.flights.simulate(self.gains[1:_AT_RATES], _WHOLE, dt)
            gains = (*faster_gains, *self._of_gains)
            if not any(faster.times(gain) >= _CLEARLY for gain in gains):
                why = f"the policy were sampled every {1e3 * dt:.4g} ms or faster"
                return [_Found(faster, "sample time", why)]
        return []

    # Comparison with the training's record.

    def _nearer(self, repair: Repair) -> float:
        """Return the misfit of the file as written minus the misfit of a change (`_misfit`).

        The result is 0 if the observations of the training are unknown.
        """
        if observations_of_training(self.card) is None:
            return 0.0
        return self._misfit_as_written - self._misfit(repair.deployment)

    @cached_property
    def _misfit_as_written(self) -> float:
        """Misfit of the file as written to the observations in training (`_misfit`)."""
        return self._misfit(self.card)

    def _misfit(self, deployment: Deployment) -> float:
        """Return how much the observations differ in size from those in the training.

        The misfit is Σ |log(size of the initial observations / size in training)| over the
        observations, at the trim with the worst flights. A size is the root mean square about the
        training's mean.
        """
        seen = observations_of_training(deployment)
        assert seen is not None
        mean, size = seen
        deployed = Deployed(deployment, self.deployed.model)
        place = self.places[0]
        starts, _ = seeded_starts(place, 64, 0, False)
        trims = np.tile(deployed.trim_vector(place.point), (len(starts), 1))
        inputs = np.tile(place.point.inputs, (len(starts), 1))
        (commands,) = RowFunction(deployed.command)(starts, inputs, trims)
        (observed,) = RowFunction(deployed.observe)(starts, commands, trims)
        size_here = np.sqrt(((observed - mean) ** 2).mean(axis=0))
        return float(np.abs(np.log((size_here + _LEAST) / (size + _LEAST))).sum())


def _recommendation(found: _Found, of_card: FlightResults) -> str:
    """Return a sentence that recommends a change, with the ratio of the costs without and with it.

    of_card: results of the file as written
    """
    times = of_card.times(found.flown)
    said = f"{times:.3g}" if times < 1000.0 else "over 1000"
    return f"flights would improve if {found.why}: now they cost {said} times as much"
