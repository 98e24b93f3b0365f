"""Comparison of a certificate's statement with the user's data.

An entry that is not a claim is compared if the user gave a value. The first line of the report
names the entries that were not given.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from hfa_prove.fields import Stated, stored
from hfa_support.errors import NoSolutionError


class Given(NamedTuple):
    """A value from the user's data that is compared with an entry of a statement.

    value: the value
    same: (value in the certificate, user's value), both in the form of a file -> whether they
        agree, exact equality by default
    """

    value: Any
    same: Callable[[Any, Any], bool] = operator.eq


def close_to(relative: float, sizes: Any) -> Callable[[Any, Any], bool]:
    """Return a comparison of matrices.

    The comparison has the arguments (value in the certificate, user's value). Two matrices agree if
    their shapes are equal and no difference exceeds `relative` times the largest absolute entry of
    the user's matrix, all in units of `sizes`.

    sizes: typical sizes of the entries
    """

    def same(stated: Any, own: Any) -> bool:
        claimed, values = np.array(stated), np.array(own)
        if claimed.shape != values.shape:
            return False
        size = np.max(np.abs(values / sizes), initial=0.0)
        return bool(np.all(np.abs((claimed - values) / sizes) <= relative * size))

    return same


def within(widths: Mapping[str, float]) -> Callable[[Any, Any], bool]:
    """Return a comparison of objects with numbers.

    The comparison has the arguments (value in the certificate, user's value). Two objects agree if
    their names are equal and no difference exceeds the permitted difference.

    widths: name -> largest permitted difference
    """

    def same(stated: Any, own: Any) -> bool:
        return set(stated) == set(own) and all(
            abs(stated[name] - value) <= widths[name] for name, value in own.items()
        )

    return same


def compare(statement: Stated, given: Mapping[str, Given]) -> list[str]:
    """Return the subjects (`Entry.subject`) that the user did not give, in the statement's order.

    given: path of an entry -> the user's value

    Raises NoSolutionError if an entry differs from the user's value.
    """
    entries = list(statement.entries())
    stated = {path: value for path, _, value in entries}
    for path, own in given.items():
        name = path.rpartition(".")[2]
        in_file = own._replace(value=stored(own.value))
        if not own.same(stated[path], in_file.value):
            different = _first_difference(name, stated[path], in_file)
            what = f"limit of {different}" if name == "limits" else different
            raise NoSolutionError(
                f"{what} in the certificate differs from the value of the options; give the "
                "options of the proof"
            )
    not_given = [declared.subject for path, declared, _ in entries if path not in given]
    return [subject for subject in dict.fromkeys(not_given) if subject]


def _first_difference(name: str, stated: Any, own: Given) -> str:
    """Return the first name in an object whose values differ, or the name of another entry."""
    if isinstance(stated, Mapping) and isinstance(own.value, Mapping):
        for key in (*own.value, *stated):
            # The comparison is one of whole objects: of all names, only this one is as stated.
            with_stated = {other: value for other, value in own.value.items() if other != key}
            if key in stated:
                with_stated[key] = stated[key]
            if not own.same(with_stated, own.value):
                return str(key)
    return name
