"""Forged certificates of regions, which claim too much or prove too little."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

Content = dict[str, Any]
Forgery = Callable[[Content, np.random.Generator], None]


def forgeries(content: Content, count: int, seed: int = 0) -> Iterator[tuple[str, Content]]:
    """Yield the name and the content of forgeries of a certificate, each kind in turn.

    count: number of attempts. Attempts that change nothing are left out.
    """
    generator = np.random.default_rng(seed)
    disturbed = bool(content["statement"]["loop"]["disturbances"])
    kinds = list((KINDS | DISTURBED_KINDS if disturbed else KINDS).items())
    for number in range(count):
        name, forge = kinds[number % len(kinds)]
        forged = copy.deepcopy(content)
        forge(forged, generator)
        if forged != content:
            yield name, forged


def _level_beyond(content: Content, generator: np.random.Generator) -> None:
    content["statement"]["piece"]["c"] *= generator.uniform(1.03, 5.0)


def _scaled(content: Content, generator: np.random.Generator) -> None:
    factor = generator.uniform(0.2, 0.97)
    for term in content["statement"]["piece"]["W"]:
        term[0] *= factor


def _shifted(content: Content, generator: np.random.Generator) -> None:
    terms = content["statement"]["piece"]["W"]
    term = terms[generator.integers(len(terms))]
    term[0] -= generator.uniform(0.1, 1.0) * max(abs(other[0]) for other in terms)


def _exchanged(content: Content, generator: np.random.Generator) -> None:
    terms = content["statement"]["piece"]["W"]
    order = generator.permutation(len(terms))
    coefficients = [terms[index][0] for index in order]
    for term, coefficient in zip(terms, coefficients, strict=True):
        term[0] = coefficient


def _gain(content: Content, generator: np.random.Generator) -> None:
    K = content["statement"]["loop"]["policy"]["K"]
    if not K:
        content["statement"]["piece"]["c"] *= 2.0
        return
    row = generator.integers(len(K))
    K[row] = [-entry * generator.uniform(0.3, 2.0) for entry in K[row]]


def _widened(content: Content, generator: np.random.Generator) -> None:
    limits = content["statement"]["loop"]["limits"]
    if not limits:
        content["statement"]["piece"]["c"] *= 2.0
        return
    name = sorted(limits)[generator.integers(len(limits))]
    limits[name] = [
        None if end is None else end * generator.uniform(1.01, 3.0) for end in limits[name]
    ]
    if all(end in (None, 0.0) for end in limits[name]):
        del limits[name]


def _limit_left_out(content: Content, generator: np.random.Generator) -> None:
    limits = content["statement"]["loop"]["limits"]
    if limits:
        del limits[sorted(limits)[generator.integers(len(limits))]]
    else:
        content["statement"]["piece"]["c"] *= 3.0


def _trim_moved(content: Content, generator: np.random.Generator) -> None:
    trim = content["statement"]["loop"]["trim"]
    name = sorted(trim)[generator.integers(len(trim))]
    trim[name] += generator.choice([-1.0, 1.0]) * 10.0 ** generator.uniform(-4.0, 0.0)


def _extent(content: Content, generator: np.random.Generator) -> None:
    extents = content["statement"]["extents"]
    name = sorted(extents)[generator.integers(len(extents))]
    factor = generator.uniform(0.3, 0.95)
    extents[name] = [end * factor for end in extents[name]]


def _gram_negated(content: Content, generator: np.random.Generator) -> None:
    """Negate the Gram matrix of a random multiplier in a certificate.

    The main Gram matrix is not stored, because the checker computes it from the identity.
    """
    parts = content["witness"]["parts"]
    part = parts[generator.integers(len(parts))]
    multipliers = list(part["evidence"]["multipliers"].values())
    square = multipliers[generator.integers(len(multipliers))]
    square["gram"] = (-np.array(square["gram"])).tolist()


def _gram_permuted(content: Content, generator: np.random.Generator) -> None:
    part = content["witness"]["parts"][generator.integers(len(content["witness"]["parts"]))]
    square = part["evidence"]
    values = np.array(square["gram"])
    order = generator.permutation(len(values))
    if (order == np.arange(len(values))).all():
        order = order[::-1]
    square["gram"] = values[np.ix_(order, order)].tolist()


def _gram_scaled(content: Content, generator: np.random.Generator) -> None:
    part = content["witness"]["parts"][generator.integers(len(content["witness"]["parts"]))]
    for square in part["evidence"]["multipliers"].values():
        square["gram"] = (np.array(square["gram"]) * generator.uniform(10.0, 100.0)).tolist()


def _multipliers_gone(content: Content, generator: np.random.Generator) -> None:
    for part in content["witness"]["parts"]:
        part["evidence"]["multipliers"] = {}


def _part_left_out(content: Content, generator: np.random.Generator) -> None:
    parts = content["witness"]["parts"]
    parts.pop(generator.integers(len(parts)))


def _no_parts(content: Content, generator: np.random.Generator) -> None:
    content["witness"]["parts"] = []


def _part_declared_empty(content: Content, generator: np.random.Generator) -> None:
    parts = content["witness"]["parts"]
    content["witness"]["empty"].append(parts.pop(generator.integers(len(parts))))


def _small_ball(content: Content, generator: np.random.Generator) -> None:
    factor = generator.uniform(0.1, 0.99)
    content["witness"]["T"] = (np.array(content["witness"]["T"]) * factor).tolist()


def _flat_ball(content: Content, generator: np.random.Generator) -> None:
    content["witness"]["T"][0] = list(content["witness"]["T"][-1])


def _low_order(content: Content, generator: np.random.Generator) -> None:
    content["witness"]["order"] = int(generator.integers(0, 3))


def _disturbance_larger(content: Content, generator: np.random.Generator) -> None:
    sizes = content["statement"]["loop"]["disturbances"]
    for name in sizes:
        sizes[name] *= generator.uniform(1.5, 10.0)


def _disturbance_negative(content: Content, generator: np.random.Generator) -> None:
    sizes = content["statement"]["loop"]["disturbances"]
    for name in sizes:
        sizes[name] *= -generator.uniform(0.0, 10.0)


def _disturbance_left_out(content: Content, generator: np.random.Generator) -> None:
    """Remove the disturbances from a certificate.

    The certificate then claims convergence of a loop that is disturbed.
    """
    disturbances = content["statement"]["loop"]["disturbances"]
    count = len(disturbances)
    disturbances.clear()
    for part in (*content["witness"]["parts"], *content["witness"]["empty"]):
        part["inputs"] = part["inputs"][:-count]
        if generator.uniform() < 0.5:
            part["evidence"]["multipliers"].pop("edge", None)


def _end_left_out(content: Content, generator: np.random.Generator) -> None:
    end = ["low", "high"][generator.integers(2)]
    parts = content["witness"]["parts"]
    content["witness"]["parts"] = [part for part in parts if part["inputs"][-1] != end]


def _end_twice(content: Content, generator: np.random.Generator) -> None:
    end = ["low", "high", "free", "any"][generator.integers(4)]
    for part in content["witness"]["parts"]:
        part["inputs"][-1] = end


def _ends_exchanged(content: Content, generator: np.random.Generator) -> None:
    parts = content["witness"]["parts"]
    for part in parts[:: generator.integers(1, 3)]:
        part["inputs"][-1] = {"low": "high", "high": "low"}[part["inputs"][-1]]


def _edge_everywhere(content: Content, generator: np.random.Generator) -> None:
    """Exchange the multipliers of V <= rho and V >= rho in a certificate."""
    for part in content["witness"]["parts"]:
        multipliers = part["evidence"]["multipliers"]
        multipliers["level"], multipliers["edge"] = multipliers["edge"], multipliers["level"]


#: Further forgeries, of a set that is invariant under a disturbance.
DISTURBED_KINDS: dict[str, Forgery] = {
    "disturbance larger": _disturbance_larger,
    "disturbance negative": _disturbance_negative,
    "disturbance left out": _disturbance_left_out,
    "an end left out": _end_left_out,
    "one end twice": _end_twice,
    "ends exchanged": _ends_exchanged,
    "level and edge exchanged": _edge_everywhere,
}
KINDS: dict[str, Forgery] = {
    "rho beyond": _level_beyond,
    "V scaled": _scaled,
    "V shifted": _shifted,
    "V exchanged": _exchanged,
    "another gain": _gain,
    "limits widened": _widened,
    "a limit left out": _limit_left_out,
    "trim moved": _trim_moved,
    "extents smaller": _extent,
    "Gram matrix negated": _gram_negated,
    "Gram matrix permuted": _gram_permuted,
    "multipliers larger": _gram_scaled,
    "multipliers gone": _multipliers_gone,
    "part left out": _part_left_out,
    "no parts": _no_parts,
    "part said to be empty": _part_declared_empty,
    "ball too small": _small_ball,
    "ball flat": _flat_ball,
    "order too low": _low_order,
}
