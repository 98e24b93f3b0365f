"""Tensors by name, from files of torch, safetensors, .npz and .json.

No code in a file is executed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from controller.critic.network.pickles import BFloat16, torch_stream, unpickled
from hfa_support.arrays.read import arrays_of_npz
from hfa_support.errors import BadInputError, missing_package, numbers_in, shortened
from hfa_support.files import unpacked

#: Largest number of entries in a file, about three layers of 1024 x 1024.
LARGEST_NETWORK = 2**22
#: Formats that store the order of the layers.
ORDERED = (".pt", ".pth", ".pkl", ".zip", ".cleanrl_model")
#: Type in a safetensors file -> NumPy type.
_SAFETENSORS = {"F16": "<f2", "BF16": "<u2", "F32": "<f4", "F64": "<f8", "I64": "<i8", "I32": "<i4"}
#: First bytes of a file of torch.save before torch 1.6, the number of its format.
_OLD_TORCH = b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19."
#: Levels of nested mappings and lists whose tensors are read.
_DEEPEST = 4
#: Precisions of weights, lowest first.
_PRECISIONS = ("bfloat16", "float16", "float32", "float64")


def stored_in(content: bytes, suffix: str) -> Any:
    """Return what a file of tensors contains: nested mappings and lists of arrays and other values.

    content: bytes of the file
    suffix: ".npz", ".msgpack", ".safetensors" or ".json"; of any other, a file is one of torch

    Raises BadInputError for a type of numbers that is not supported, for a TorchScript program, and
    for a damaged or too large zip file; any exception for another damaged file.
    """
    if suffix == ".npz":
        return arrays_of_npz(content)
    if suffix == ".msgpack":
        return _flax(content)
    if suffix == ".safetensors":
        return _safetensors(content)
    if suffix == ".json":
        return {name: numbers_in(name, rows) for name, rows in json.loads(content).items()}
    return torch_content(content)


def _flax(content: bytes) -> Any:
    """Return what `flax.serialization` wrote: an array is an extension (shape, type, bytes)."""
    try:
        import msgpack
    except ImportError as error:
        raise missing_package("files of flax require", "msgpack") from error

    def array(code: int, data: bytes) -> Any:
        """Return an array, or None for other extensions of flax."""
        if code != 1:
            return None
        shape, kind, numbers = msgpack.unpackb(data)
        if kind == "bfloat16":
            return BFloat16.of(np.frombuffer(numbers, "<u2")).reshape(shape)
        return np.frombuffer(numbers, kind).reshape(shape)

    return msgpack.unpackb(content, ext_hook=array, strict_map_key=False)


def torch_content(content: bytes) -> Any:
    """Return what torch.save, of any version, or pickle wrote.

    Raises BadInputError for another file, and for a TorchScript program.
    """
    if content[: len(_OLD_TORCH)] == _OLD_TORCH:
        return torch_stream(content)
    if content[:1] == b"\x80":
        return unpickled(content)
    if content[:2] != b"PK":
        raise _not_torch()
    of_zip = unpacked(content)
    if any(re.search(r"(^|/)(code/|constants\.pkl$)", name) for name in of_zip):
        raise BadInputError(
            "the file is a TorchScript program, which is not supported; save state_dict() "
            "instead, or export the network to ONNX"
        )
    members = {name.partition("/")[2]: member for name, member in of_zip.items()}
    if "data.pkl" not in members:
        raise _not_torch()
    return unpickled(members["data.pkl"], members)


def flattened(stored: Any, prefix: str = "", depth: int = 0) -> dict[str, np.ndarray]:
    """Return the arrays in nested mappings and lists, by names such as "model.0.weight"."""
    if hasattr(stored, "detach"):
        stored = _of_torch(stored)
    if isinstance(stored, np.ndarray):
        return {prefix.removesuffix("."): stored}
    tensors: dict[str, np.ndarray] = {}
    if isinstance(stored, (list, tuple)):
        stored = dict(enumerate(stored))
    if isinstance(stored, Mapping) and depth < _DEEPEST:
        for name, value in stored.items():
            tensors |= flattened(value, f"{prefix}{name}.", depth + 1)
    return tensors


def _of_torch(tensor: Any) -> np.ndarray:
    """Return a tensor of torch as an array. NumPy has no bfloat16."""
    numbers = tensor.detach().cpu()
    is_bfloat16 = str(numbers.dtype) == "torch.bfloat16"
    array = np.asarray((numbers.float() if is_bfloat16 else numbers).numpy())
    return array.view(BFloat16) if is_bfloat16 else array


def checked_tensors(tensors: Mapping[str, np.ndarray]) -> tuple[dict[str, np.ndarray], str]:
    """Return the tensors with floats in double precision, and the lowest precision of the floats.

    Raises BadInputError if the tensors have too many entries in total, or if an entry is not a
    finite number.
    """
    precisions = {"float64"}
    for name, array in tensors.items():
        if array.dtype.kind not in "fibu":
            raise BadInputError(
                f"tensor {shortened(name)!r} has the type {array.dtype}; save the weights as "
                "float32 or float64"
            )
        if not np.all(np.isfinite(array)):
            raise BadInputError(
                f"tensor {shortened(name)!r} contains entries that are not finite; save a "
                "network with finite weights"
            )
        if array.dtype.kind == "f":
            precisions.add("bfloat16" if isinstance(array, BFloat16) else str(array.dtype))
    if sum(array.size for array in tensors.values()) > LARGEST_NETWORK:
        raise BadInputError(
            f"the tensors have more than {LARGEST_NETWORK} entries in total, the maximum; give a "
            "smaller network"
        )
    doubles = {
        name: np.asarray(array).astype(float) if array.dtype.kind == "f" else array
        for name, array in tensors.items()
    }
    return doubles, lowest(precisions)


def lowest(precisions: set[str]) -> str:
    """Return the lowest of several precisions, such as "float32"."""
    return next((each for each in _PRECISIONS if each in precisions), "float64")


def _not_torch() -> BadInputError:
    """Return the error that torch.save did not write a file."""
    return BadInputError(
        "the file was not written by torch.save; save state_dict() with torch.save, or export the "
        "network to ONNX"
    )


def _safetensors(content: bytes) -> dict[str, np.ndarray]:
    """Return the tensors of a safetensors file by name."""
    # The first eight bytes contain the length of a JSON object. Its entries give the position of
    # each tensor in the data that follow.
    begin = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:begin])
    data = memoryview(content)[begin:]
    tensors = {}
    for name, entry in header.items():
        if name == "__metadata__":
            continue
        kind = entry["dtype"]
        if kind not in _SAFETENSORS:
            raise BadInputError(
                f"a tensor has the unsupported type {shortened(kind)}; save the weights as "
                "float32 or float64"
            )
        start, stop = entry["data_offsets"]
        values = np.frombuffer(data[start:stop], _SAFETENSORS[kind])
        values = BFloat16.of(values) if kind == "BF16" else values
        tensors[name] = values.reshape(entry["shape"])
    return tensors
