"""Tensors of state dicts in files of torch, safetensors, .npz and .json.

No code in a file is executed.
"""

from __future__ import annotations

import io
import json
import pickle
import re
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hfa_support.errors import BadInputError, numbers_in, shortened
from hfa_support.files import LARGEST

#: Largest number of entries in a file, about three layers of 1024 x 1024.
LARGEST_NETWORK = 2**22
#: Types of safetensors and of torch. Integers (counters of batches) are read, but refused as
#: weights.
_TYPES = {
    "F16": "<f2",
    "F32": "<f4",
    "F64": "<f8",
    "HalfStorage": "<f2",
    "FloatStorage": "<f4",
    "DoubleStorage": "<f8",
    "LongStorage": "<i8",
}


def tensors_in(content: bytes, suffix: str) -> dict[str, np.ndarray]:
    """Return the tensors of a state dict by name, in the order of the file.

    content: bytes of the file
    suffix: suffix of the file, such as ".npz"

    Raises BadInputError for a damaged file, for an unsupported type, for a torch file that contains
    TorchScript or was written by a version before torch 1.6, and for an archive that unpacks to
    more than `LARGEST` bytes.
    """
    if suffix == ".npz":
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            _refuse_large(archive)
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    if suffix == ".safetensors":
        return _safetensors(content)
    if suffix == ".json":
        return {name: numbers_in(name, rows) for name, rows in json.loads(content).items()}
    return _torch_zip(content)


def checked_tensors(tensors: Mapping[str, np.ndarray]) -> tuple[dict[str, np.ndarray], str]:
    """Return the tensors with floats in double precision, and the precision of the file.

    The precision is "float32" if a tensor has this precision, otherwise "float64". Raises
    BadInputError if the tensors have too many entries in total, if an entry is not finite, or if a
    type is neither integer, bool nor a float of at least 32 bits.
    """
    for name, array in tensors.items():
        is_float = array.dtype.kind == "f"
        if not (array.dtype.kind in "ib" or (is_float and array.dtype.itemsize >= 4)):
            raise BadInputError(
                f"tensor {shortened(name)!r} has the type {array.dtype}; save the weights as "
                "float32 or float64"
            )
        if not np.all(np.isfinite(array)):
            raise BadInputError(
                f"tensor {shortened(name)!r} contains entries that are not finite; save a "
                "network with finite weights"
            )
    if sum(array.size for array in tensors.values()) > LARGEST_NETWORK:
        raise BadInputError(
            f"the tensors have more than {LARGEST_NETWORK} entries in total, the maximum; give a "
            "smaller network"
        )
    is_single = any(array.dtype == np.float32 for array in tensors.values())
    doubles = {
        name: array.astype(float) if array.dtype.kind == "f" else array
        for name, array in tensors.items()
    }
    return doubles, "float32" if is_single else "float64"


def _safetensors(content: bytes) -> dict[str, np.ndarray]:
    """Return the tensors of a safetensors file by name."""
    # The first eight bytes contain the length of a JSON object. Its entries give the position of
    # each tensor in the data that follow.
    begin = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:begin])
    data = memoryview(content)[begin:]
    tensors = {}
    for name, entry in header.items():
        if name != "__metadata__":
            start, stop = entry["data_offsets"]
            values = np.frombuffer(data[start:stop], _dtype(entry["dtype"]))
            tensors[name] = values.reshape(entry["shape"])
    return tensors


def _dtype(kind: str) -> str:
    if kind not in _TYPES:
        raise BadInputError(
            f"a tensor has the unsupported type {shortened(kind)}; save the weights as float32 or "
            "float64"
        )
    return _TYPES[kind]


def _view(storage: Any, offset: Any, size: Any, stride: Any, *_: Any) -> np.ndarray:
    """Return a tensor of a torch file: the entries storage[offset + Σ index_i stride_i]."""
    # Replaces torch._utils._rebuild_tensor_v2. NumPy refuses an entry outside the storage.
    strides = [step * storage.itemsize for step in stride]
    return np.ndarray(size, storage.dtype, storage, offset * storage.itemsize, strides)


#: Classes and functions that a pickle may call.
_ALLOWED: Mapping[tuple[str, str], Callable[..., Any]] = {
    ("collections", "OrderedDict"): OrderedDict,
    ("torch._utils", "_rebuild_tensor_v2"): _view,
    ("torch._utils", "_rebuild_parameter"): lambda tensor, *_: tensor,
}


class _Restricted(pickle.Unpickler):
    """Unpickler for dictionaries and arrays that refuses any other class or function by name."""

    def __init__(self, content: bytes, storages: Mapping[str, bytes]) -> None:
        super().__init__(io.BytesIO(content))
        self.storages = storages

    def find_class(self, module: str, name: str) -> Any:
        if module == "torch" and name.endswith("Storage"):
            return _dtype(name)  # persistent_load receives this type as pid[1]
        if (module, name) not in _ALLOWED:
            raise BadInputError(
                f"the file would load {shortened(f'{module}.{name}')}, but only tensors may be "
                "loaded; save state_dict() alone"
            )
        return _ALLOWED[module, name]

    def persistent_load(self, pid: Any) -> np.ndarray:
        if not (isinstance(pid, tuple) and len(pid) == 5 and isinstance(pid[2], str)):
            raise BadInputError(
                "the file is damaged (a storage has no name); save the network again"
            )
        if not isinstance(pid[1], str):
            raise BadInputError(
                "the file is damaged (a storage has no data type); save the network again"
            )
        if f"data/{pid[2]}" not in self.storages:
            raise _not_torch()
        return np.frombuffer(self.storages[f"data/{pid[2]}"], pid[1])


def _refuse_large(archive: zipfile.ZipFile) -> None:
    """Raise BadInputError if a zip file unpacks to more than `LARGEST` bytes in total."""
    if sum(member.file_size for member in archive.infolist()) > LARGEST:
        raise BadInputError(
            f"the file unpacks to more than {LARGEST >> 20} MiB, the maximum; save a "
            "smaller network"
        )


def unpacked(archive: zipfile.ZipFile, name: str) -> bytes:
    """Return a member of a zip file as bytes, at most as many as its stated size.

    Raises BadInputError if this size exceeds `LARGEST`, or if the member is encrypted or has a
    compression that neither torch nor NumPy uses.
    """
    entry = archive.getinfo(name)
    is_encrypted = entry.flag_bits & 1
    if is_encrypted or entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise BadInputError(
            f"member {shortened(name)} is encrypted or compressed in an unsupported way; save "
            "the file again with torch.save"
        )
    if entry.file_size > LARGEST:
        raise BadInputError(
            f"member {shortened(name)} of the file unpacks to more than {LARGEST >> 20} "
            "MiB, the maximum; save a smaller network"
        )
    with archive.open(entry) as stream:
        return stream.read(entry.file_size)


def _not_torch() -> BadInputError:
    """Return the error for a file of an older torch, or of another program."""
    return BadInputError(
        "the file was not written by torch.save of torch 1.6 or later; save state_dict() with such "
        "a version, or export the network to ONNX"
    )


def _torch_zip(content: bytes) -> dict[str, np.ndarray]:
    """Return the tensors of torch.save, or of policy.pth in a Stable-Baselines3 zip."""
    if content[:2] != b"PK":
        raise _not_torch()
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        _refuse_large(archive)
        names = archive.namelist()
        if "policy.pth" in names:
            return _torch_zip(unpacked(archive, "policy.pth"))
        if any(re.search(r"(^|/)(code/|constants\.pkl$)", name) for name in names):
            raise BadInputError(
                "the file is a TorchScript program, which is not supported; save state_dict() "
                "instead, or export the network to ONNX"
            )
        members = {name.partition("/")[2]: unpacked(archive, name) for name in names}
    if "data.pkl" not in members:
        raise _not_torch()
    stored = _Restricted(members["data.pkl"], members).load()
    return _flattened("", stored)


def _flattened(prefix: str, stored: Any, depth: int = 0) -> dict[str, np.ndarray]:
    """Return the arrays of nested containers by names such as "model.0.weight"."""
    if isinstance(stored, np.ndarray):
        return {prefix.removesuffix("."): stored}
    tensors: dict[str, np.ndarray] = {}
    if isinstance(stored, (list, tuple)):
        stored = dict(enumerate(stored))
    if isinstance(stored, dict) and depth < 4:
        for name, value in stored.items():
            tensors |= _flattened(f"{prefix}{name}.", value, depth + 1)
    return tensors
