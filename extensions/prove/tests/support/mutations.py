"""Random changes of certificates."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from hfa_prove.certificate import read_content
from hfa_prove.fields import NOT_PROVED
from hfa_prove.statements.plant import Subject
from hfa_support.errors import BadInputError


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


def accepted_claims(
    original: dict[str, Any],
    subject: Subject,
    check: Callable[[Any, Any], Any],
    is_true: Callable[[Any], bool],
    count: int,
) -> int:
    """Return the number of changed certificates that are accepted, and assert that each is true.

    The original certificate must be accepted and true.

    check: (statement, witness) -> anything, and an error if the statement is not proved
    is_true: statement -> whether samples agree with its claim
    count: number of changed certificates
    """
    rng = np.random.default_rng(0)
    statement, witness = read_content(copy.deepcopy(original), subject)
    check(statement, witness)
    assert is_true(statement)
    accepted = 0
    for _ in range(count):
        certificate = copy.deepcopy(original)
        mutate(certificate, rng)
        try:
            statement, witness = read_content(certificate, subject)
            check(statement, witness)
        except (BadInputError, *NOT_PROVED):
            continue
        accepted += 1
        assert is_true(statement), certificate
    return accepted
