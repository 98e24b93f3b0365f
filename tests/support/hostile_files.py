"""Corrupted input files: replaced tokens, arrays, archive members and bytes.

Certificates with false claims and correct digests are included.
"""

from __future__ import annotations

import hashlib
import io
import json
import random
import re
import struct
import zipfile
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

NUMBERS = (
    *(
        "0",
        "-1",
        "1",
        "2",
        "3.5",
        "1e-320",
        "1e308",
        "-1e308",
        "1e99",
        "1e400",
        "nan",
        "inf",
        "-inf",
        "1e-9",
        "90",
    ),
    *(
        "9" * 5000,
        "0x" + "f" * 5000,
        "1_000",
        "0.1.2",
        "٣",
        "1,2",
        "--",
        "",
        "true",
        "1e",
        "1d3",
        "-89.999",
    ),
)
VALUES = (
    *(
        '""',
        '"text"',
        '"\\u0000"',
        '"\\u001b[31m"',
        '"\\ud800"',
        "null",
        "false",
        "[]",
        "{}",
        "[[]]",
        "[1]",
        "[1,2]",
    ),
    *(
        "[[1,2],[3]]",
        "[[1,2],[3,4]]",
        "[[[1]]]",
        '["a","b"]',
        "[null]",
        "1979-05-27",
        "'",
        "[" * 3000,
        "{",
        "=",
    ),
    *(
        '"' + "x" * 5000 + '"',
        '"nan"',
        '{"a": 1}',
        "[nan]",
        "[1e999]",
        ",",
        "\n",
        '"speed"',
        '"dihedral"',
        "\x00",
    ),
)
WORDS = (
    *(
        "--",
        "-",
        "=",
        "--json",
        "-o",
        "\x1b[31m",
        "\n",
        "é",
        "\ud800",
        "%s",
        "a=b",
        "/dev/null",
        "..",
        "",
    ),
    "x" * 5000,
)
_TOKENS = re.compile(r'"[^"\n]*"|[-+.\w]+|\s+|.', re.DOTALL)
#: Values that replace the entries of an array.
_FILLED = (np.nan, np.inf, 1j, 1e308, 1e-320, 0.0, True, "1.5", "\x1b[31m" * 300)
_TYPES: tuple[Any, ...] = ("M8[D]", [("x", "f8")], ">f8", "f2", "S1")
_ARRAYS: tuple[Callable[[np.ndarray], Any], ...] = (
    *(partial(lambda value, a: np.full(a.shape, value), value) for value in _FILLED),
    *(
        lambda a: np.empty(0),
        lambda a: np.empty((0, 3)),
        lambda a: np.array("text"),
        lambda a: np.array(["a", "b"]),
    ),
    *(
        lambda a: np.ones((2, *a.shape)),
        lambda a: np.ones((400, 400)),
        lambda a: np.ones((1,) * 9),
        lambda a: a.T,
    ),
    *(
        lambda a: a.ravel(),
        lambda a: a[None],
        lambda a: a[:-1] if a.ndim else a,
        lambda a: a[::-1] if a.ndim else a,
    ),
    *(partial(lambda kind, a: np.zeros(a.shape, dtype=kind), kind) for kind in _TYPES),
)
_NAMES = (
    "A",
    "B",
    "E",
    "Q",
    "R",
    "W",
    "P",
    "K",
    "delta",
    "time",
    "basis",
    "states",
    "schema",
    "x" * 300,
    "\x1b[31m",
)


def damaged(content: bytes, chance: random.Random) -> bytes:
    """Return the content after one to four random changes.

    A change flips a bit, replaces a byte, removes or repeats bytes, or cuts off the end.
    """
    result = bytearray(content)
    for _ in range(chance.randint(1, 4)):
        if not result:
            break
        at = chance.randrange(len(result))
        length = chance.randint(1, 32)
        match chance.randrange(5):
            case 0:
                result[at] ^= 1 << chance.randrange(8)
            case 1:
                result[at] = chance.choice(b'\x00\x1b\xff"[]{}=,.:-+#9eE\n')
            case 2:
                del result[at : at + length]
            case 3:
                result[at:at] = result[at : at + length]
            case _:
                del result[at:]
    return bytes(result)


def _hostile_text(content: bytes, chance: random.Random) -> bytes:
    tokens = _TOKENS.findall(content.decode("utf-8"))
    for _ in range(chance.randint(1, 3)):
        places = [number for number, token in enumerate(tokens) if not token.isspace()] or [0]
        at = chance.choice(places)
        place_from = chance.choice(places)
        match chance.randrange(5):
            case 0 | 1:
                tokens[at] = chance.choice((*NUMBERS, *VALUES))
            case 2:
                tokens[at] = ""
            case 3:
                tokens[at] *= chance.choice((2, 3, 1000))
            case _:
                tokens[at], tokens[place_from] = tokens[place_from], tokens[at]
    return "".join(tokens).encode("utf-8", "replace")


def _hostile_arrays(arrays: Mapping[str, Any], chance: random.Random) -> dict[str, Any]:
    result = {name: np.asarray(array) for name, array in arrays.items() if not name.startswith("_")}
    for _ in range(chance.randint(1, 3)):
        name = chance.choice(list(result) or ["A"])
        array = result.get(name, np.zeros(1))
        match chance.randrange(5):
            case 0:
                result.pop(name, None)
            case 1:
                result[chance.choice(_NAMES)] = result.pop(name, array)
            case _:
                result[name] = np.asarray(chance.choice(_ARRAYS)(array))
    return result


def _hostile_npz(content: bytes, chance: random.Random) -> bytes:
    with np.load(io.BytesIO(content)) as loaded:
        arrays = _hostile_arrays(dict(loaded), chance)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, array, allow_pickle=True)
            data = member.getvalue()
            match chance.randrange(8):
                case 6:
                    data = damaged(data, chance)
                case 7:
                    data = re.sub(
                        rb"'shape': \([^)]*\)",
                        b"'shape': (%d, 1000000)" % 10 ** chance.randrange(19),
                        data,
                    )
            archive.writestr(f"{name}.npy", data)
    return stream.getvalue()


def hostile_file(name: str, content: bytes, chance: random.Random) -> bytes:
    if name.endswith(".mat") or chance.random() < 0.3:
        return damaged(content, chance)
    for suffix, make in _OF_SUFFIX.items():
        if name.endswith(suffix):
            return make(content, chance)
    return _hostile_text(content, chance)


def _hostile_zip(content: bytes, chance: random.Random) -> bytes:
    """Return a valid zip archive with one or two members damaged, omitted or doubled in length."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    for _ in range(chance.randint(1, 2)):
        name = chance.choice(list(members))
        match chance.randrange(5):
            case 0:
                members[name] *= 2
            case 1 if len(members) > 1:
                members.pop(name)
            case _:
                members[name] = damaged(members[name], chance)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return stream.getvalue()


def _hostile_safetensors(content: bytes, chance: random.Random) -> bytes:
    """Return the content of a safetensors file with a corrupted header or a wrong header length."""
    length = struct.unpack("<Q", content[:8])[0]
    header = _hostile_text(content[8 : 8 + length], chance)
    said = len(header)
    if chance.random() < 0.2:
        said = chance.choice([0, 1, said - 1, said + 1, 2**20, 2**40, 2**63, 2**64 - 1])
    return struct.pack("<Q", said) + header + content[8 + length :]


def _hostile_onnx(content: bytes, chance: random.Random) -> bytes:
    """Return an ONNX file with one to three random changes of its graph or numbers."""
    import onnx

    model = onnx.load_from_string(content)
    nodes = model.graph.node
    for _ in range(chance.randint(1, 3)):
        node = nodes[chance.randrange(len(nodes))]
        constants = model.graph.initializer
        constant = constants[chance.randrange(len(constants))]
        match chance.randrange(7):
            case 0:
                node.op_type = chance.choice(_OPERATORS)
            case 1:
                node.input[chance.randrange(len(node.input))] = chance.choice(["", "x", "y", "no"])
            case 2:
                node.output[0] = chance.choice(["x", "h", "y", ""])
            case 3:
                sizes = (0, -1, 1, 3, 2**31, 2**62)
                constant.dims[chance.randrange(len(constant.dims))] = chance.choice(sizes)
            case 4:
                name = chance.choice(["axis", "axes", "to", "perm", "alpha", "value", "shape"])
                values = (2**62, -9, [1, 1, 1], 1.5, "x", [])
                node.attribute.append(onnx.helper.make_attribute(name, chance.choice(values[:5])))
            case 5:
                constant.raw_data = damaged(constant.raw_data, chance)
            case _:
                constant.data_type = chance.randrange(24)
    return bytes(model.SerializeToString())


_OPERATORS = (
    *("Gemm", "Concat", "Reshape", "ConstantOfShape", "Expand", "Tile", "Range", "Resize", "Loop"),
    *("Pad", "OneHot", "Gather", "Cast", "Split", "Einsum", "Pow", "Div", "Log", "Exp", "NoSuch"),
)
_OF_SUFFIX: dict[str, Callable[[bytes, random.Random], bytes]] = {
    ".npz": _hostile_npz,
    ".onnx": _hostile_onnx,
    ".pt": _hostile_zip,
    ".safetensors": _hostile_safetensors,
}


def hostile_claims(content: bytes, chance: random.Random) -> bytes:
    """Return the content of a certificate with changed entries and correct digests, like a
    forgery.
    """
    certificate = json.loads(content)
    for _ in range(chance.randint(1, 3)):
        holder: Any = certificate
        key: Any = chance.choice(["kind", *["statement", "witness"] * 8])
        while isinstance(holder[key], (dict, list)) and holder[key] and chance.random() < 0.9:
            holder = holder[key]
            keys = list(holder) if isinstance(holder, dict) else range(len(holder))
            key = chance.choice(keys)
        holder[key] = chance.choice(_CLAIMS)
    body = {
        name: value
        for name, value in certificate.items()
        if name not in ("digest", "provenance", "checksum")
    }
    head = json.dumps(body)[:-1]
    digest = hashlib.sha256(head.encode()).hexdigest()
    whole = f'{head}, "digest": "{digest}", "provenance": {json.dumps(certificate["provenance"])}'
    checksum = hashlib.sha256(whole.encode()).hexdigest()
    return f'{whole}, "checksum": "{checksum}"}}\n'.encode()


_CLAIMS: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 1e308, -1e308, 1e-320, 10**400, float("nan"), float("inf")),
    *("", "1e9999", "inf", "nan", "x" * 5000, "\x1b[31m", "\ud800", [], {}, [[]], [{}], [1.0, 1.0]),
    *([2.0, 1.0], [[1.0]], {"a": 1}, [[[[[[[[[[1]]]]]]]]]], [1.0] * 5000),
)


def hostile_store(files: Mapping[str, bytes], chance: random.Random) -> dict[str, bytes]:
    """Return the files of a store, one or two of them removed, replaced, damaged or added.

    files: path in the store -> content
    """
    made = dict(files)
    for _ in range(chance.randint(1, 2)):
        name = chance.choice(sorted(made))
        match chance.randrange(6):
            case 0:
                made.pop(name)
            case 1:
                made[name] = made[chance.choice(sorted(made))]
            case 2:
                folder = name.rpartition("/")[0]
                made[f"{folder}/{chance.choice(['.zarray', '.zgroup', '.zattrs', 'x'])}"] = b"{}"
            case _:
                content = made[name]
                is_text = name.endswith(".json")
                make = _hostile_text if is_text and chance.random() < 0.7 else damaged
                made[name] = make(content, chance)
        if not made:
            break
    return made
