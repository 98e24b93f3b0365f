"""Strategies of hypothesis: inputs whose smallest failing example is shown.

`make fuzz` tries many examples of each property, `make test` a few that are the same in every run.
"""

import functools
import io
import json
import math
import os
import re

import numpy as np
from hypothesis import HealthCheck, settings, strategies as st
from hypothesis.extra import numpy as arrays
from json_places import places, replaced

#: Number of random examples of each property; without it, few that are the same in every run.
EXAMPLES = os.environ.get("EXAMPLES")
settings.register_profile(
    "properties",
    max_examples=int(EXAMPLES or 3),
    derandomize=EXAMPLES is None,
    database=None,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
settings.load_profile("properties")

#: Texts of numbers and other words, as typed or as they stand in files.
TEXTS = st.sampled_from(
    [
        *("0", "-1", "2", "3.5", "1e-320", "1e308", "1e400", "nan", "-inf", "1_000", "1,2", "--"),
        *("", "true", "null", "[]", "{}", "[[1,2],[3]]", '"text"', '"\\ud800"', "1979-05-27", "=b"),
        *(
            "\x1b[31m",
            "\n",
            "é",
            "\ud800",
            "%s",
            "/dev/null",
            "..",
            "--json",
            "-o",
            "'",
            "{",
            "\x00",
        ),
        *("x" * 5000, "9" * 5000, "[" * 3000, "speed", "dihedral"),
    ]
)
#: Values of an entry of JSON.
VALUES = st.one_of(
    st.sampled_from(
        [None, True, 0, -1, 1e308, -1e308, 1e-320, 10**400, math.nan, math.inf, [1.0] * 5000]
    ),
    st.sampled_from(["", "1e9999", "nan", "x" * 5000, "\x1b[31m", [], {}, [[]], [{}], {"a": 1}]),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9),
        lambda inner: (
            st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
        ),
        max_leaves=6,
    ),
)
#: Arrays in place of an array of a file.
ARRAYS = arrays.arrays(
    st.sampled_from(["f8", ">f8", "f2", "c16", "?", "i8", "U3", "S1", "M8[D]"]),
    arrays.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=7),
)
_TOKENS = re.compile(r'"[^"\n]*"|[-+.\w]+|\s+|.', re.DOTALL)


def changed_bytes(content):
    """Return a strategy of content in which some bytes are replaced by others."""

    def changed(at, length, new):
        return content[:at] + new + content[at + length :]

    place = st.integers(0, len(content))
    return st.builds(changed, place, st.integers(0, 32) | place, st.binary(max_size=8))


def changed_text(content):
    """Return a strategy of text in which one to three words or numbers are replaced."""
    tokens = _TOKENS.findall(content.decode("latin-1"))
    places = [number for number, token in enumerate(tokens) if not token.isspace()] or [0]

    def changed(new):
        words = [new.get(number, token) for number, token in enumerate(tokens)]
        return "".join(words).encode("utf-8", "replace")

    return st.dictionaries(st.sampled_from(places), TEXTS, min_size=1, max_size=3).map(changed)


def changed_arrays(content):
    """Return a strategy of .npz files in which one to three arrays are replaced, removed or added."""
    with np.load(io.BytesIO(content)) as loaded:
        given = dict(loaded)

    def changed(new):
        stream = io.BytesIO()
        kept = {name: array for name, array in (given | new).items() if array is not None}
        np.savez(stream, **kept)
        return stream.getvalue()

    names = st.sampled_from([*given, *"ABEQRWPK", "delta", "time", "basis", "states", "x" * 300])
    return st.dictionaries(names, st.none() | ARRAYS, min_size=1, max_size=3).map(changed)


def changed_entry(data):
    """Return a strategy of JSON data in which one entry has another value."""
    paths = st.sampled_from([path for path, _ in places(data)])
    return st.builds(functools.partial(replaced, data), paths, VALUES)


def changed_file(name, content):
    """Return a strategy of files that are damaged in a way that their suffix suggests, or anywhere."""
    ways = [changed_bytes(content)]
    if name.endswith(".npz"):
        ways.append(changed_arrays(content))
    if name.endswith((".json", ".toml", ".csv", ".xml", ".safetensors")):
        ways.append(changed_text(content))
    if name.endswith(".json"):
        ways.append(changed_entry(json.loads(content)).map(lambda data: json.dumps(data).encode()))
    return st.one_of(*reversed(ways))
