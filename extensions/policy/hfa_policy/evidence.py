"""Effects of the actions beside the exact gain's, and observations in flight and in training.

A reversed action has the opposite sign of the exact gain. An observation with a wrong unit, scale,
place or reference has another range in flight than in training.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from controller.riccati.gare import unconfirmed_solution
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.deployment.equilibrium import EquilibriumSearch
from hfa_policy.cost_above_optimum import lqr_at
from hfa_policy.flights import SampledFlight
from hfa_policy.outcomes import Place
from hfa_policy.reach import reach_of
from hfa_policy.recorded_flights import recorded_flights
from hfa_support.errors import NoSolutionError
from hfa_support.native.bound import RowFunction

#: Number of flights from each trim in which the observations are recorded.
_FLIGHTS = 8
#: Least number of observations of a normalizer's statistics.
_MANY = 1000.0


class ActionEffect(NamedTuple):
    """Effect of an action in the linear loop, beside that of the exact gain.

    The effect K_i b_i is the amount by which the action lowers the sum of the eigenvalues of the
    loop, 1/s, with K_i the action's row of the gain and b_i its column of B. For the exact gain
    K = R⁻¹ B'P it is b_i'P b_i / R_ii for a diagonal R, and thus never negative.

    action: name of the input.
    effect: of the policy, negative for a reversed action.
    exact_effect: of the exact gain.
    """

    action: str
    effect: float
    exact_effect: float


class ObservationRange(NamedTuple):
    """Range of an observation in flight, and its values in training, as the policy receives them.

    The values are those before a normalizer.

    observation: name in the deployment file.
    lowest, highest: in the flights, within the envelope.
    mean, spread: mean and standard deviation in training, or nan if the policy's files do not
        contain them.
    farthest: largest distance in flight from the mean in training, in standard deviations, or nan.
    """

    observation: str
    lowest: float
    highest: float
    mean: float
    spread: float
    farthest: float


def action_effects(
    deployed: Deployed, place: Place, search: EquilibriumSearch
) -> list[ActionEffect]:
    """Return the effect of each action at an equilibrium, or at the trim if it is saturated.

    The exact gain is that of the linear problem with the weights of `weights_at`. The result is []
    if this problem has no solution.

    search: search for the equilibrium at this trim
    """
    loop = place.equilibrium
    if loop is None or loop.clips:
        loop = search.at_trim()
    inside = reach_of(deployed, loop, place.box).loop
    try:
        exact = unconfirmed_solution(lqr_at(deployed, inside)).K
    except NoSolutionError:
        return []
    gain = inside.K if inside.gain is None else inside.gain
    damping = np.diag(gain @ inside.B)
    exact_damping = np.diag(exact @ inside.B)
    columns = (deployed.commanded, damping.tolist(), exact_damping.tolist())
    return [ActionEffect(*row) for row in zip(*columns, strict=True)]


def observation_ranges(
    flight: SampledFlight, places: Sequence[Place], seed: int
) -> list[list[ObservationRange]]:
    """Return the range of each observation in a few flights from each trim, beside the training's.

    seed: seed of the initial conditions
    """
    deployed = flight.deployed
    lowest, highest = _extremes(flight, places, seed)
    names = list(deployed.deployment.observation)
    mean, spread = _in_training(deployed.deployment)
    ranges = []
    for number in range(len(places)):
        mine = slice(number * _FLIGHTS, (number + 1) * _FLIGHTS)
        low, high = lowest[mine].min(axis=0), highest[mine].max(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            farthest = np.maximum(high - mean, mean - low) / spread
        columns = (low, high, mean, spread, farthest)
        table = zip(names, *(column.tolist() for column in columns), strict=True)
        ranges.append([ObservationRange(*row) for row in table])
    return ranges


def _extremes(
    flight: SampledFlight, places: Sequence[Place], seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest observations (N, k) of flights within their envelopes."""
    flown = recorded_flights(flight, places, seed, _FLIGHTS)
    count, samples = flown.inside.shape
    rows = (flown.states, flown.before, np.repeat(flown.trims[:, None], samples, axis=1))
    observe = RowFunction(flight.deployed.observe)
    (observed,) = observe(*(each.reshape(count * samples, -1) for each in rows))
    observed = observed.reshape(count, samples, -1)
    observed[~flown.inside] = np.nan
    return np.fmin.reduce(observed, axis=1), np.fmax.reduce(observed, axis=1)


def _in_training(deployment: Deployment) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation of the observations in training, (k,) each, or nan."""
    count = len(deployment.observation)
    normalizer = deployment.normalizer
    if normalizer is not None:
        is_of_many = not math.isfinite(normalizer.count) or normalizer.count > _MANY
        spread = np.sqrt(normalizer.variance[-count:])
        return normalizer.mean[-count:], spread if is_of_many else np.full(count, math.nan)
    stored = deployment.actor.stored
    if stored is not None and stored.timesteps > 0 and stored.last is not None:
        last = stored.last if stored.last_original is None else stored.last_original
        return last.mean(axis=0)[-count:], last.std(axis=0)[-count:]
    return np.full(count, math.nan), np.full(count, math.nan)
