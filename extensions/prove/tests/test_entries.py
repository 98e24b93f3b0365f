"""Entries of certificates: another type, shape or range is refused by its name."""

import copy
import json
import math
from pathlib import Path

import pytest
from proofs import put

import hfa
from hfa_prove.certificate import read_content
from hfa_prove.fields import Malformed
from hfa_support.errors import BadInputError

ROOT = Path(__file__).resolve().parents[3]
STORED = ROOT / "tests" / "nets" / "certificates" / "schedule.json"
#: Values that are no number, text, list or object of an entry, except for "1" where it has a text.
OTHERS = [None, True, "1", [], {}, math.nan, math.inf, 2**53 + 1, 1.1e300]


def leaves(value, path=()):
    """Yield the path of every entry of a certificate, also of lists and objects."""
    if path:
        yield path
    entries = value.items() if isinstance(value, dict) else ()
    for key, entry in enumerate(value) if isinstance(value, list) else entries:
        yield from leaves(entry, (*path, key))


def others(value):
    """Yield values of another type or shape than that of an entry."""
    yield from OTHERS
    if isinstance(value, list) and value:
        yield from ([*value, value[-1]], value[:-1])
    if isinstance(value, dict):
        yield from (value | {"stray": 1.0}, dict(list(value.items())[1:]))


def test_an_entry_of_another_type_or_shape_is_refused():
    """Each entry, and the first element of each list, is refused with a value of another type or shape
    (`others`); the message names the entry.
    """
    whole = json.loads(STORED.read_text())
    aircraft = hfa.aircraft()
    for path in leaves({part: whole[part] for part in ("statement", "witness")}):
        value = whole
        for key in path:
            value = value[key]
        if any(isinstance(key, int) and key > 0 for key in path):
            continue  # not the first element of a list
        for other in others(value):
            if other == value and type(other) is type(value):
                continue
            wrong = copy.deepcopy(whole)
            put(other, *path)(wrong)
            with pytest.raises((Malformed, BadInputError)) as refused:
                read_content(wrong, aircraft)
            names = [key for key in path if isinstance(key, str)][-2:]
            named = any(key in str(refused.value) for key in names)
            # Another name of the dynamics is refused as that of an aircraft file that is not given.
            assert named or path[-1] == "dynamics", (path, other)
