"""Hostile values, words, texts and arrays: what they are a string of bytes decides."""

from __future__ import annotations

import io
import re
import warnings
import zipfile
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any, TypeVar

import numpy as np
from damage import damaged

Item = TypeVar("Item")

#: What numbers are replaced with, in words and in texts.
NUMBERS = (
    *("0", "-1", "1", "2", "3.5", "-0", "1e-320", "1e308", "-1e308", "1e99", "1e400", "nan", "inf", "-inf", "1e-9"),
    *("90", "9" * 5000, "0x" + "f" * 5000, "1_000", "1e9", "0.1.2", "٣", "1,2", "--", "", "true", "1e", "1d3"),
    *("18", "-89.999"),
)
#: What values of texts are replaced with.
VALUES = (
    *('""', '"text"', '"\\u0000"', '"\\u001b[31m"', '"\\ud800"', "null", "false", "[]", "{}", "[[]]", "[1]", "[1,2]"),
    *("[[1,2],[3]]", "[[1,2],[3,4]]", "[[[1]]]", '["a","b"]', '[["a"]]', "[null]", "1979-05-27", "'", "[" * 3000),
    *("{", "=", '"' + "x" * 5000 + '"', '"nan"', '"--"', '{"a": 1}', "[nan]", "[1e999]", ",", "\n", '"speed"'),
    *('"dihedral"', "#", "\x00"),
)
#: Words of a command line.
WORDS = (
    *("--", "-", "", "=", "--json", "-o", "\x1b[31m", "x" * 5000, "\n", "é", "\ud800", "%s", "a=b", "/dev/null"),
    *(".", ".."),
)
_TOKENS = re.compile(r'"[^"\n]*"|[-+.\w]+|\s+|.', re.DOTALL)
_MOST_EDITS = 3


class Choices:
    """Choices that a string of bytes makes, two bytes each; after its end always the first."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0

    def below(self, count: int) -> int:
        """A whole number from 0 to count - 1."""
        part = self._content[self._at : self._at + 2]
        self._at += 2
        return int.from_bytes(part, "little") % count

    def of(self, items: Sequence[Item]) -> Item:
        """One of the items."""
        return items[self.below(len(items))]


def hostile_bytes(content: bytes, choices: Choices) -> bytes:
    """The content damaged, in three of four cases."""
    if not choices.below(4):
        return content
    return damaged(content, np.random.default_rng(choices.below(2**16)))


def hostile_text(content: bytes, choices: Choices) -> bytes:
    """A text with one to three of its tokens replaced, removed, doubled, repeated or swapped; rarely damaged, too."""
    tokens = _TOKENS.findall(content.decode("utf-8"))
    for _ in range(1 + choices.below(_MOST_EDITS)):
        telling = [number for number, token in enumerate(tokens) if not token.isspace()]
        if not telling:
            break
        at, other = choices.of(telling), choices.of(telling)
        match choices.below(6):
            case 0 | 1:
                tokens[at] = choices.of(NUMBERS)
            case 2:
                tokens[at] = choices.of(VALUES)
            case 3:
                tokens[at] = ""
            case 4:
                tokens[at] *= choices.of((2, 3, 1000))
            case _:
                tokens[at], tokens[other] = tokens[other], tokens[at]
    changed = "".join(tokens).encode("utf-8", "replace")
    return changed if choices.below(8) else hostile_bytes(changed, choices)


def hostile_words(words: Sequence[str], more: Sequence[str], choices: Choices) -> list[str]:
    """A command line with one to three words replaced, put in, removed, doubled or swapped; more: words to put in."""
    result = list(words)
    for _ in range(1 + choices.below(_MOST_EDITS)):
        at = choices.below(len(result) + 1)
        match choices.below(5):
            case 0:
                result[at:at] = [choices.of(more), choices.of(NUMBERS)]
            case 1:
                result[at : at + 1] = [choices.of(NUMBERS)]
            case 2:
                result[at : at + 1] = [choices.of((*WORDS, *more))]
            case 3:
                result[at : at + 1] = []
            case _:
                name = choices.of(more)
                value = choices.of((*NUMBERS, *WORDS))
                result[at:at] = [f"{name}={value}"]
    return result


_ARRAYS: tuple[Callable[[np.ndarray], Any], ...] = (
    lambda a: np.empty(0),
    lambda a: np.empty((0, 3)),
    lambda a: np.empty((3, 0)),
    lambda a: a.astype(float) * np.nan if a.dtype.kind in "fiu" else a,
    lambda a: np.array(np.nan),
    lambda a: np.array("text"),
    lambda a: np.array(["a", "b"]),
    lambda a: np.full(a.shape, "1.5"),
    lambda a: np.full(a.shape, "\x1b[31m" * 300),
    lambda a: np.full(a.shape, True),
    lambda a: np.full(a.shape, 1j),
    lambda a: np.full(a.shape, 1e308),
    lambda a: np.full(a.shape, -1e308),
    lambda a: np.full(a.shape, 1e-320),
    lambda a: np.full(a.shape, np.iinfo(np.int64).min),
    lambda a: np.full(a.shape, 255, dtype=np.uint8),
    lambda a: np.full(a.shape, np.inf),
    lambda a: np.zeros(a.shape),
    lambda a: np.ones((2, *a.shape)),
    lambda a: np.ones((1,) * 9),
    lambda a: a.T,
    lambda a: a.ravel(),
    lambda a: a[None],
    lambda a: a[:-1] if a.ndim else a,
    lambda a: np.repeat(a, 2, axis=-1) if a.ndim else a,
    lambda a: np.ones((400, 400)),
    lambda a: np.ones(20000),
    lambda a: a[::-1] if a.ndim else a,
)
#: Of .npz files alone: MATLAB has no such types.
_TYPED: tuple[Callable[[np.ndarray], Any], ...] = (
    lambda a: np.full(a.shape, "2000-01-01", dtype="M8[D]"),
    lambda a: np.zeros(a.shape, dtype=[("x", "f8"), ("y", "i4")]),
    lambda a: np.zeros(a.shape, dtype="V8"),
    lambda a: np.ones(a.shape, dtype=">f8"),
    lambda a: np.ones(a.shape, dtype="f2"),
    lambda a: np.ones(a.shape, dtype=np.longdouble),
    lambda a: np.full(a.shape, b"bytes"),
)
_NAMES = ("A", "B", "E", "Q", "R", "W", "P", "K", "delta", "time", "basis", "states", "schema", "x" * 300, "\x1b[31m")


def _hostile_arrays(arrays: Mapping[str, np.ndarray], choices: Choices, also: tuple = ()) -> dict[str, Any]:
    result: dict[str, Any] = {name: np.asarray(array) for name, array in arrays.items()}
    for _ in range(1 + choices.below(_MOST_EDITS)):
        names = list(result) or ["A"]
        name = choices.of(names)
        match choices.below(6):
            case 0:
                result.pop(name, None)
            case 1:
                result[choices.of(_NAMES)] = result.pop(name, np.zeros(1))
            case 2:
                result[choices.of(_NAMES)] = choices.of(_ARRAYS)(np.asarray(result.get(name, np.zeros(1))))
            case _:
                result[name] = choices.of((*_ARRAYS, *also))(np.asarray(result.get(name, np.zeros(1))))
    return result


@cache
def _of_npz(content: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(content)) as loaded:
        return dict(loaded)


@cache
def _of_mat(content: bytes) -> dict[str, np.ndarray]:
    from scipy.io import loadmat

    return {name: value for name, value in loadmat(io.BytesIO(content)).items() if not name.startswith("_")}


def _few(arrays: dict[str, np.ndarray], choices: Choices) -> dict[str, np.ndarray]:
    """In three of four cases without what is nested: nine tenths of some files, read by few and slow to write."""
    if not choices.below(4):
        return arrays
    return {name: array for name, array in arrays.items() if "." not in name and array.dtype.names is None}


def hostile_npz(content: bytes, choices: Choices) -> bytes:
    """An archive with other arrays, or damaged headers of arrays, or damaged as a file."""
    if not choices.below(4):
        return hostile_bytes(content, choices)
    arrays = _hostile_arrays(_few(_of_npz(content), choices), choices, _TYPED)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", choices.of((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, array, allow_pickle=True)
            data = member.getvalue()
            match choices.below(12):
                case 9:
                    data = hostile_bytes(data, choices)
                case 10:
                    shape = b"'shape': (%d, %d)" % (10 ** choices.below(19), 10**6)
                    data = re.sub(rb"'shape': \([^)]*\)", shape, data)
                case 11:
                    name = choices.of(("../A", "A.npy.npy", "/A", "A/B", ""))
            with warnings.catch_warnings(action="ignore", category=UserWarning):  # a name may come twice
                archive.writestr(f"{name}.npy", data)
    return stream.getvalue()


def hostile_mat(content: bytes, choices: Choices) -> bytes:
    """A .mat file of version 4 or 5 with other matrices, structures and cells in it, or damaged as a file."""
    from scipy.io import savemat

    if not choices.below(3):
        return hostile_bytes(content, choices)
    arrays = _hostile_arrays(_few(_of_mat(content), choices), choices)
    named = {re.sub(r"\W", "x", name)[:31]: array for name, array in arrays.items()}
    match choices.below(5):
        case 3:
            named = {"model": named}
        case 4:
            named = {name: {"a": array} for name, array in named.items()}
    stream = io.BytesIO()
    try:
        savemat(stream, named, format=choices.of(("5", "5", "4")), do_compression=bool(choices.below(2)))
    except (TypeError, ValueError):  # what MATLAB has no type for
        return hostile_bytes(content, choices)
    return stream.getvalue()
