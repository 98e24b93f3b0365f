"""The changes of a card that are tried, each of which undoes one mistake of a deployment."""

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
    """One change of a card: o' = P o + c and a' = gain a.

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


def card_with_gain(card: Deployment, gain: float) -> Repair:
    """The card as it is, all its actions times a gain."""
    return Repair("", "", card, np.eye(len(card.observation)), np.full(len(card.action), gain))


def repairs_of(deployed: Deployed) -> list[Repair]:
    """Every single change of the card that is tried."""
    card = deployed.deployment
    return [*_exchanges(card), *_signs(card), *_abouts(card), *_scales(deployed)]


def _with_observation(
    card: Deployment, kind: str, text: str, observation: Mapping[str, Any], P: np.ndarray
) -> Repair:
    changed = card.changed(observation=dict(observation))
    return Repair(kind, text, changed, P, np.ones(len(card.action)))


def _exchanges(card: Deployment) -> Iterator[Repair]:
    """Two observations in each other's place."""
    names = list(card.observation)
    for one, other in combinations(range(len(names)), 2):
        order = list(range(len(names)))
        order[one], order[other] = other, one
        observation = {names[i]: card.observation[names[i]] for i in order}
        text = f"{names[one]} and {names[other]} were exchanged in the observation"
        yield _with_observation(card, "order", text, observation, np.eye(len(names))[order])


def _signs(card: Deployment) -> Iterator[Repair]:
    """One action of the other sign, and all of them."""
    turned = {
        name: {**entry, "map": re.sub(r"\ba\b", "(-a)", entry.get("map", "trim + a"))}
        for name, entry in card.action.items()
    }
    same = np.eye(len(card.observation))
    for number, name in enumerate(card.action):
        changed = card.changed(action={**card.action, name: turned[name]})
        gain = np.ones(len(card.action))
        gain[number] = -1.0
        yield Repair("sign", f"the action of {name} had the other sign", changed, same, gain)
    if len(card.action) > 1:
        changed = card.changed(action=turned)
        gain = -np.ones(len(card.action))
        yield Repair("sign", "all actions had the other sign", changed, same, gain)


def _abouts(card: Deployment) -> Iterator[Repair]:
    """Absolute values for deviations from trim, and the reverse."""
    for about, text in ((0.0, "absolute values"), ("trim", "deviations from trim")):
        observation = {name: {**entry, "about": about} for name, entry in card.observation.items()}
        if observation != card.observation:
            why = f"all observations were {text}"
            yield _with_observation(card, "about", why, observation, np.eye(len(observation)))


def _scales(deployed: Deployed) -> Iterator[Repair]:
    """Other units of the angles, and scales left out or taken twice."""
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
    """The observations of a card with these scales."""
    entries = zip(card.observation.items(), scales.tolist(), strict=True)
    return {name: {**entry, "scale": scale} for (name, entry), scale in entries}


def _angles(deployed: Deployed) -> list[bool]:
    """Of each observation, whether it takes angles or their rates."""
    found = []
    for formula in deployed.observed:
        units = {deployed.model.unit(name) for name in formula.names}
        found.append(any(unit.startswith("rad") for unit in units))
    return found


def _sizes(deployed: Deployed) -> np.ndarray:
    """(k,), the size of each observation: the deviation that the card's Q prices with 1, else the
    nominal one of the model, else 1."""
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
