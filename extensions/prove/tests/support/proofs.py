"""Certificates as content of a file, changes of their entries, and what is decided about them."""

import copy
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest

from hfa import Model, NoSolutionError, Signal
from hfa_aircraft.about import Source
from hfa_prove import Gains
from hfa_prove.certificate import KIND, SCHEMA

Content = dict[str, Any]


def float_equations(x, u, p, w):
    """Return depth' = heave and heave' = lift - pull depth - drag heave, and the load of a float."""
    return {"depth": x.heave, "heave": u.lift - p.pull * x.depth - p.drag * x.heave}, {
        "load": u.lift - 0.5 * p.pull
    }


#: At depth 1 the lift of the trim is the pull, and the load half of it. With K = (k, c) the
#: eigenvalues of A - B K are those of s² + (drag + c) s + pull + k.
FLOAT = Model(
    "float",
    {"depth": Signal("m"), "heave": Signal("m/s")},
    {"lift": Signal("N", 1.0, -9.0, 4.0)},
    float_equations,
    outputs={"load": Signal("N", 1.0, -9.0)},
    parameters={"pull": Signal("N/m", start=1.0), "drag": Signal("N s/m", start=0.1, min=-9.0)},
    schedule="pull",
    trim={"depth": 1.0, "heave": 0.0},
    source=Source("float.py:FLOAT", "3" * 64),
)
CONSTANT = Gains(np.array([1.0]), np.array([[[1.0, 2.9]]]))


def certificate(statement, witness):
    """Return the content of the file of a certificate."""
    closing = dict.fromkeys(("toolchain", "digest", "provenance", "checksum"), "")
    claims = {"statement": statement.content(), "witness": witness}
    return {**closing, "schema": SCHEMA, "kind": KIND, **claims}


def put(value, *path):
    """Return a change that replaces an entry by a value, or by a function of the old value."""

    def change(content):
        holder = content
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = value(holder[path[-1]]) if callable(value) else value

    return change


def changed(content, **changes):
    """Return a copy of a certificate with other entries.

    changes: keys of an entry, joined by two underscores -> its value, or a function of the old value
    """
    made = copy.deepcopy(content)
    for name, value in changes.items():
        keys = (int(key) if key.isdigit() else key for key in name.split("__"))
        put(value, *keys)(made)
    return made


def decided(is_proved, words="", error=NoSolutionError):
    """Return a context in which a claim is proved, or refused with these words."""
    return nullcontext() if is_proved else pytest.raises(error, match=words or None)
