"""Tensors by name, from files of torch, safetensors, .npz and .json.

No code in a file is executed.
"""

from __future__ import annotations

import io
import json
import pickle
import re
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hfa_support.arrays.read import arrays_of_npz
from hfa_support.errors import BadInputError, numbers_in, shortened
from hfa_support.files import unpacked

#: Packages whose objects are read as attributes (`Inert`). Their code is never imported.
_INERT_PACKAGES = ("stable_baselines3", "sb3_contrib", "gymnasium", "gym", "torch")
#: Kinds of numbers in pickled NumPy arrays.
_NUMBER_TYPES = ("b1", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8")
#: Class of a torch storage -> NumPy type. bfloat16 are the upper halves of float32.
_STORAGE_TYPES = {
    "HalfStorage": "<f2",
    "BFloat16Storage": "<u2",
    "FloatStorage": "<f4",
    "DoubleStorage": "<f8",
    "LongStorage": "<i8",
    "IntStorage": "<i4",
    "ByteStorage": "<u1",
    "BoolStorage": "?",
}


class Inert:
    """Attributes of an object of another package, without its code.

    made_of: "module.Class" of the object
    """

    made_of = ""

    def __new__(cls, *_: Any, **__: Any) -> Inert:
        """Create an empty object. The arguments in the pickle are ignored."""
        return super().__new__(cls)

    def __init__(self, *_: Any, **__: Any) -> None:
        pass

    def __setstate__(self, state: Any) -> None:
        """Store the attributes of a pickled object."""
        # (attributes or None, slots) of a class with __slots__
        if isinstance(state, tuple) and len(state) == 2 and isinstance(state[1], dict):
            state = {**(state[0] or {}), **state[1]}
        if isinstance(state, dict):
            self.__dict__.update(state)
            self.__dict__.pop("made_of", None)  # belongs to the class, not to the file

    def __setitem__(self, key: Any, value: Any) -> None:
        """Ignore an entry of a pickled container."""

    def append(self, item: Any) -> None:
        """Ignore an item of a pickled container."""

    def extend(self, items: Any) -> None:
        """Ignore the items of a pickled container."""


class BFloat16(np.ndarray):
    """Array of float32 that was stored as bfloat16."""

    @staticmethod
    def of(halves: np.ndarray) -> np.ndarray:
        """Return float32 of bfloat16, which are their upper halves.

        halves: unsigned integers of 2 bytes
        """
        return (halves.astype("<u4") << 16).view("<f4").view(BFloat16)


class _Kind:
    """Stand-in for numpy.dtype in a pickle: a kind of number and its byte order."""

    def __init__(self, kind: str, *_: Any) -> None:  # *_: align and copy of numpy.dtype
        if not isinstance(kind, str) or kind not in _NUMBER_TYPES:
            named = shortened(kind) if isinstance(kind, str) else type(kind).__name__
            raise BadInputError(
                f"the data contain an array of {named}, which is not a numeric type; save "
                "numbers only"
            )
        self.kind = kind
        self.order = "="

    def __setstate__(self, state: Any) -> None:
        """Set the byte order from the pickled state (version, byte order, ...)."""
        if state[1] in ("<", ">"):
            self.order = state[1]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Return the NumPy data type."""
        return np.dtype(self.order + self.kind)


class _Array(np.ndarray):
    """Stand-in for numpy.ndarray in a pickle, empty until its pickled state is set."""

    def __setstate__(self, state: Any) -> None:
        """Set the pickled state (version, shape, kind, is in Fortran order, bytes)."""
        version, shape, kind, in_columns, content = state
        super().__setstate__((version, shape, kind.dtype, in_columns, content))


def _array_of(
    content: bytes,
    kind: _Kind,
    shape: tuple[int, ...],
    order: str = "C",
    axes: tuple[int, ...] = (),
) -> np.ndarray:
    """Return a NumPy array with the given bytes, number type, shape, order and order of axes."""
    numbers = np.frombuffer(content, kind.dtype)
    array = numbers.reshape(shape, order="F" if order == "F" else "C")
    return array.transpose(axes or range(array.ndim))


def _tensor(storage: Any, offset: Any, size: Any, stride: Any, *_: Any) -> np.ndarray:
    """Return a tensor of torch: the entries storage[offset + Σ index_i stride_i]."""
    strides = [step * storage.itemsize for step in stride]  # in bytes, as the offset below
    array_type = type(storage)  # ndarray or BFloat16; refuses an entry outside the storage
    return array_type(size, storage.dtype, storage, offset * storage.itemsize, strides)


#: What a pickle may call -> what is called instead.
_STAND_INS: dict[tuple[str, str], Callable[..., Any]] = {
    ("collections", "OrderedDict"): OrderedDict,
    ("collections", "deque"): deque,
    ("_codecs", "encode"): lambda text, *_: text.encode("latin1"),
    ("torch._utils", "_rebuild_tensor_v2"): _tensor,
    ("torch._utils", "_rebuild_parameter"): lambda tensor, *_: tensor,
    ("torch.storage", "_load_from_bytes"): lambda content: torch_stream(content),
    ("numpy", "ndarray"): lambda *_: _Array(0),
    ("numpy", "dtype"): _Kind,
}
for _module in ("builtins", "__builtin__"):
    _STAND_INS[_module, "set"] = set
for _core in ("numpy.core", "numpy._core"):
    _STAND_INS[f"{_core}.multiarray", "_reconstruct"] = lambda *_: _Array(0)
    _STAND_INS[f"{_core}.multiarray", "scalar"] = lambda kind, content: _array_of(
        content, kind, ()
    )[()]
    _STAND_INS[f"{_core}.numeric", "_frombuffer"] = _array_of


class _Restricted(pickle.Unpickler):
    """Unpickler that refuses classes and functions by name, before an object is created."""

    def __init__(self, stream: io.BytesIO, numbers_of: Callable[..., np.ndarray]) -> None:
        super().__init__(stream)
        self.numbers_of = numbers_of  # function (key, number type, count) of a storage

    def find_class(self, module: str, name: str) -> Any:
        """Return what stands for a class or function of the pickle, or refuse it."""
        if (module, name) in _STAND_INS:
            return _STAND_INS[module, name]
        if module == "torch" and name in _STORAGE_TYPES:
            return name  # `persistent_load` receives it as the class of a storage
        if module.split(".")[0] in _INERT_PACKAGES or module.startswith("numpy.random."):
            return type("Inert", (Inert,), {"made_of": f"{module}.{name}"})
        whose = " (a class or function that you defined)" if "cloudpickle" in module else ""
        raise BadInputError(
            f"reading the data would call {shortened(f'{module}.{name}')}{whose}, which is refused "
            "(no code was run); save state_dict() alone, or the data without this object"
        )

    def persistent_load(self, pid: Any) -> np.ndarray:
        """Return the numbers of the torch storage ("storage", class, key, device, count, ...)."""
        if not (isinstance(pid, tuple) and len(pid) >= 5 and isinstance(pid[2], str)):
            raise BadInputError(
                "the file is damaged (a storage has no name); save the network again"
            )
        _, of_class, key, _, count, *_ = pid
        kind = getattr(of_class, "made_of", of_class)  # `find_class` returned an Inert, or a name
        if not isinstance(kind, str) or kind not in _STORAGE_TYPES:
            raise BadInputError(
                f"a tensor has the unsupported type {shortened(str(kind))}; save the weights as "
                "float32 or float64"
            )
        numbers = self.numbers_of(key, _STORAGE_TYPES[kind], count)
        return BFloat16.of(numbers) if kind == "BFloat16Storage" else numbers


def unpickled(content: bytes, storages: Mapping[str, bytes] | None = None) -> Any:
    """Return the content of a pickle: containers, numbers, arrays and `Inert` objects.

    storages: "data/KEY" -> bytes of a torch storage, of a file of torch.save

    Raises BadInputError if the pickle contains another class or function, or is damaged.
    """

    def numbers(key: str, kind: str, _: Any) -> np.ndarray:
        """Return the numbers of a storage by its key."""
        if storages is None or f"data/{key}" not in storages:
            raise BadInputError(
                "the pickle refers to data outside the file; save all data in one file"
            )
        return np.frombuffer(storages[f"data/{key}"], kind)

    return parsed(lambda: _Restricted(io.BytesIO(content), numbers).load())


def torch_stream(content: bytes) -> Any:
    """Return the content of a file of torch.save before torch 1.6: pickles, then the storages.

    Raises BadInputError as `unpickled` does.
    """
    # The file consists of five pickles (number of the format, version, system; the content; keys of
    # the storages) and the storages. The content is read twice: the first time its storages are
    # zeros, whose types say how many bytes to read, and the second time they have their numbers.
    stream = io.BytesIO(content)
    storages: dict[str, np.ndarray] = {}

    def storage_or_zeros(key: str, kind: str, count: Any) -> np.ndarray:
        """Return the numbers of a storage, or zeros before they are read."""
        if key not in storages:
            bytes_left = len(content) - sum(storage.nbytes for storage in storages.values())
            size = count * np.dtype(kind).itemsize if isinstance(count, int) else -1
            if not 0 <= size <= bytes_left:
                raise BadInputError(
                    "the file is damaged (a storage is larger than the file); save it again"
                )
            storages[key] = np.zeros(count, kind)
        return storages[key]

    def next_pickle() -> Any:
        """Return the content of the pickle at the position of the stream."""
        return _Restricted(stream, storage_or_zeros).load()

    def load() -> Any:
        """Return the content, after its storages were read."""
        for _ in ("number of the format", "version", "system"):
            next_pickle()
        begin_of_content = stream.tell()
        next_pickle()
        keys = next_pickle()
        for key in keys:
            count = int.from_bytes(stream.read(8), "little")
            kind = storages[key].dtype
            storages[key] = np.frombuffer(stream.read(count * kind.itemsize), kind)
        stream.seek(begin_of_content)
        return next_pickle()

    return parsed(load)


def parsed(parse: Callable[[], Any]) -> Any:
    """Return what a parser of bytes returns; what it raises is damage of the bytes."""
    try:
        return parse()
    except BadInputError:
        raise
    except Exception as error:  # each parser raises others
        reason = shortened(str(error).partition("\n")[0]) or type(error).__name__
        raise BadInputError(
            f"the file is damaged or has another format ({reason}); save it again"
        ) from error


#: Largest number of entries in a file, about three layers of 1024 x 1024.
LARGEST_NETWORK = 2**22
#: Formats that store the order of the layers.
ORDERED_FILES = (".pt", ".pth", ".pkl", ".zip", ".cleanrl_model")
#: Type in a safetensors file -> NumPy type.
_SAFETENSORS = {"F16": "<f2", "BF16": "<u2", "F32": "<f4", "F64": "<f8", "I64": "<i8", "I32": "<i4"}
#: First bytes of a file of torch.save before torch 1.6, the number of its format.
_OLD_TORCH = b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19."
#: Levels of nested mappings and lists whose tensors are read.
_DEEPEST_LEVEL = 4
#: Precisions of weights, lowest first.
_PRECISIONS = ("bfloat16", "float16", "float32", "float64")


def stored_in(content: bytes, suffix: str) -> Any:
    """Return what a file of tensors contains: nested mappings and lists of arrays and other values.

    content: bytes of the file
    suffix: ".npz", ".safetensors" or ".json"; of any other, a file is one of torch

    Raises BadInputError for a type of numbers that is not supported, for a TorchScript program, and
    for a damaged or too large file.
    """
    if suffix == ".npz":
        return arrays_of_npz(content)
    if suffix == ".safetensors":
        return _safetensors(content)
    if suffix == ".json":
        return {name: numbers_in(name, rows) for name, rows in json.loads(content).items()}
    return torch_content(content)


def torch_content(content: bytes) -> Any:
    """Return what torch.save, of any version, or pickle wrote.

    Raises BadInputError for another file, and for a TorchScript program.
    """
    if content[: len(_OLD_TORCH)] == _OLD_TORCH:
        return torch_stream(content)
    if content[:1] == b"\x80":  # of a pickle
        return unpickled(content)
    if content[:2] != b"PK":  # of a zip
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
    if isinstance(stored, Mapping) and depth < _DEEPEST_LEVEL:
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
    return {
        name: np.asarray(array).astype(float) if array.dtype.kind == "f" else array
        for name, array in tensors.items()
    }, lowest(precisions)


def lowest(precisions: set[str]) -> str:
    """Return the lowest of several precisions, such as "float32" of "float64" and "float32"."""
    return next((name for name in _PRECISIONS if name in precisions), "float64")


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
