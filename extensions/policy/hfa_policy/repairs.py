"""Trial changes of a deployment file, each of which corrects one possible mistake."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from hfa_policy.deployed import Deployed
from hfa_policy.deployment import Deployment
from hfa_policy.episodes import cost_weights

_DEGREES = 180.0 / np.pi


class Repair(NamedTuple):
    """Change of a deployment: o' = P o + c and a' = gain S a.

    kind: type of the corrected mistake.
    text: assumption of the change, for the message.
    deployment: the changed deployment, from which c follows at a trim.
    P: (k, k).
    gain: (m,).
    S: (m, m).
    """

    kind: str
    text: str
    deployment: Deployment
    P: np.ndarray
    gain: np.ndarray
    S: np.ndarray


def deployment_with_gain(card: Deployment, gain: float) -> Repair:
    """Return the trial change of a deployment that multiplies all actions by a gain."""
    return _with_gains(card, "", "", card, np.full(len(card.action), gain))


def repairs_of(deployed: Deployed) -> list[Repair]:
    """Return the trial changes of a deployment, each of which corrects one possible mistake."""
    card = deployed.deployment
    of_observations = [*_exchanges(card), *_abouts(card), *_scales(deployed)]
    return [*of_observations, *_signs(card), *_exchanged_actions(card), *_units(deployed)]


def _with_observation(
    card: Deployment, kind: str, text: str, observation: Mapping[str, Any], P: np.ndarray
) -> Repair:
    changed = card.changed(observation=dict(observation))
    count = len(card.action)
    return Repair(kind, text, changed, P, np.ones(count), np.eye(count))


def _with_gains(
    card: Deployment, kind: str, text: str, changed: Deployment, gain: np.ndarray
) -> Repair:
    """Return the change of a deployment that multiplies each action by a gain.

    kind: type of the corrected mistake
    text: assumption of the change, for the message
    changed: the changed deployment
    gain: (m,)
    """
    return Repair(kind, text, changed, np.eye(len(card.observation)), gain, np.eye(gain.size))


def _exchanges(card: Deployment) -> Iterator[Repair]:
    """Yield the trial changes of a deployment that exchange two observations."""
    names = list(card.observation)
    for one, other in combinations(range(len(names)), 2):
        order = list(range(len(names)))
        order[one], order[other] = other, one
        observation = {names[i]: card.observation[names[i]] for i in order}
        text = f"{names[one]} and {names[other]} were exchanged in the observation"
        yield _with_observation(card, "order", text, observation, np.eye(len(names))[order])


def _signs(card: Deployment) -> Iterator[Repair]:
    """Yield the trial changes of sign: of each action, and of all actions together."""
    turned = {name: _times(entry, -1.0) for name, entry in card.action.items()}
    for number, name in enumerate(card.action):
        changed = card.changed(action={**card.action, name: turned[name]})
        gain = np.ones(len(card.action))
        gain[number] = -1.0
        yield _with_gains(card, "sign", f"the action of {name} had the other sign", changed, gain)
    if len(card.action) > 1:
        changed = card.changed(action=turned)
        gain = -np.ones(len(card.action))
        yield _with_gains(card, "sign", "all actions had the other sign", changed, gain)


def _times(entry: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """Return the entry of an action in the deployment file with the action scaled.

    In the map of the result, factor * a replaces a.
    """
    map_of_action = entry.get("map", "trim + a")
    return {**entry, "map": re.sub(r"\ba\b", f"({factor!r} * a)", map_of_action)}


def _exchanged_actions(card: Deployment) -> Iterator[Repair]:
    """Yield the trial changes of a deployment that exchange two actions.

    The boxes of the actions keep their order, because they belong to the outputs of the network.
    """
    names = list(card.action)
    for one, other in combinations(range(len(names)), 2):
        order = list(range(len(names)))
        order[one], order[other] = other, one
        placed = zip(card.action.values(), (names[i] for i in order), strict=True)
        changed = card.changed(action={name: _moving(card.action[name], at) for at, name in placed})
        text = f"the actions of {names[one]} and {names[other]} were exchanged"
        same = np.eye(len(card.observation))
        swap = np.eye(len(names))[order]
        yield Repair("actions", text, changed, same, np.ones(len(names)), swap)


def _moving(entry: Mapping[str, Any], place: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entry of an action in the deployment file with the box of another action.

    place: entry of the other action. If it has no box, the result has none
    """
    return {key: part for key, part in {**entry, "box": place.get("box")}.items() if part}


def _units(deployed: Deployed) -> Iterator[Repair]:
    """Yield the trial change that assumes that actions on angles are in degrees, not in radians.

    Nothing is yielded without such actions.
    """
    card = deployed.deployment
    angles = [name for name in card.action if deployed.model.unit(name) in ("rad", "deg")]
    if angles:
        changed = card.changed(
            action={
                name: _times(entry, 1.0 / _DEGREES) if name in angles else entry
                for name, entry in card.action.items()
            }
        )
        gain = np.where([name in angles for name in card.action], 1.0 / _DEGREES, 1.0)
        text = f"the actions of {', '.join(angles)} were in degrees, which the map takes in radians"
        yield _with_gains(card, "map", text, changed, gain)


def _abouts(card: Deployment) -> Iterator[Repair]:
    """Yield the trial changes that make all observations absolute values, or all deviations.

    A change that changes nothing is omitted.
    """
    for about, text in ((0.0, "absolute values"), ("trim", "deviations from trim")):
        observation = {name: {**entry, "about": about} for name, entry in card.observation.items()}
        if observation != card.observation:
            why = f"all observations were {text}"
            yield _with_observation(card, "about", why, observation, np.eye(len(observation)))


def _scales(deployed: Deployed) -> Iterator[Repair]:
    """Yield the trial changes of the scales of the observations, and of the units of angles.

    A change that changes nothing is omitted.
    """
    card = deployed.deployment
    scales = np.array([entry.get("scale", 1.0) for entry in card.observation.values()])
    in_degrees = np.where(_angles(deployed), _DEGREES, 1.0)
    trials = [
        ("degrees", "its angles were observed in degrees", in_degrees),
        ("degrees", "its angles were observed in radians", 1.0 / in_degrees),
        ("scale", "its observations had no scale", scales),
        ("scale", "its observations were scaled twice", 1.0 / scales),
        ("scale", "its scales were taken once, not twice", np.sqrt(np.abs(scales))),
    ]
    if np.allclose(scales, 1.0):
        sizes = _sizes(deployed)
        named = zip(card.observation, sizes, strict=True)
        given = ", ".join(f"{name} {size:.3g}" for name, size in named)
        trials.append(("scale", f"its observations had scales, as {given}", 1.0 / sizes))
    for kind, text, factors in trials:
        if not np.allclose(factors, 1.0):
            observation = _divided(card, scales / factors)
            yield _with_observation(card, kind, text, observation, np.diag(factors))


def _divided(card: Deployment, scales: np.ndarray) -> dict[str, Any]:
    """Return the table `observation` of a deployment with other scales.

    scales: scale of each observation, (k,)
    """
    entries = zip(card.observation.items(), scales.tolist(), strict=True)
    return {name: {**entry, "scale": scale} for (name, entry), scale in entries}


def _angles(deployed: Deployed) -> list[bool]:
    """Return, for each observation, whether it depends on angles or angular rates."""
    found = []
    for formula in deployed.observed:
        units = {deployed.model.unit(name) for name in formula.names}
        found.append(any(unit.startswith("rad") for unit in units))
    return found


def _sizes(deployed: Deployed) -> np.ndarray:
    """Return the typical size of each observation, (k,).

    - With a positive weight q in the deployment's Q: 1 / sqrt(q), the deviation with cost 1.
    - Other signals: the nominal value.
    - Other formulas: 1.
    """
    Q, _ = cost_weights(deployed)
    signals = deployed.model.signals
    sizes = []
    for name, entry in deployed.deployment.observation.items():
        observed = entry.get("formula", name)
        size = 1.0
        if Q.get(observed, 0.0) > 0.0:
            size = Q[observed] ** -0.5
        elif observed in signals:
            size = signals[observed].nominal
        sizes.append(size)
    return np.array(sizes)
