"""Random changes of certificates."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import numpy as np


def leaves(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of every entry of a certificate, including entries that are lists or
    objects.
    """
    if path:
        yield path
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from leaves(entry, (*path, key))
    if isinstance(value, list):
        for index, entry in enumerate(value):
            yield from leaves(entry, (*path, index))


def mutate(certificate: dict[str, Any], rng: np.random.Generator) -> None:
    """Change, remove or repeat one random entry in the statement or the witness of a
    certificate.
    """
    claims = {name: certificate[name] for name in ("statement", "witness")}
    paths = list(leaves(claims))
    *parents, last = paths[rng.integers(len(paths))]
    holder: Any = claims
    for key in parents:
        holder = holder[key]
    value = holder[last]
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        near = [value + 1e-6, value * (1 + 1e-12), value * (1 - 1e-12), value * 1.01, value * 0.99]
        far = [0, -value, 0.5 * value, 2.0 * value, value + 1, value - 1, 1e300, None, "1"]
        choices = [*near, *far]
        holder[last] = choices[rng.integers(len(choices))]
    elif rng.uniform() < 0.5 or not isinstance(holder, list):
        del holder[last]
    else:
        holder.append(copy.deepcopy(value))
