"""Pickles of Stable-Baselines3 and gymnasium, read without executing code.

Arrays are read as arrays. Objects of these packages become containers of their attributes. Other
classes and functions are refused.
"""

from __future__ import annotations

import io
import pickle
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hfa_support.errors import BadInputError, shortened

#: Packages whose objects are read as attributes. Their code is never imported.
_KEPT_PACKAGES = ("stable_baselines3", "sb3_contrib", "gymnasium", "gym", "torch")
_NUMPY_CORES = ("numpy", "numpy.core.multiarray", "numpy._core.multiarray")
_NUMERIC = ("numpy.core.numeric", "numpy._core.numeric")
_KINDS = ("b1", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f2", "f4", "f8")


class Inert:
    """Attributes of an object of another package, without its code.

    made_of: "module.Class" of the object.
    """

    made_of = ""

    def __new__(cls, *_: Any, **__: Any) -> Inert:
        """Create an empty object. The arguments in the pickle are ignored."""
        return super().__new__(cls)

    def __init__(self, *_: Any, **__: Any) -> None:
        pass

    def __setstate__(self, state: Any) -> None:
        """Store the attributes of a pickled object."""
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


def _inert(module: str, name: str) -> type[Inert]:
    return type("Inert", (Inert,), {"made_of": f"{module}.{name}"})


class _Kind:
    """Stand-in for numpy.dtype in a pickle: a kind of number and its byte order."""

    def __init__(self, kind: str, *_: Any) -> None:
        if not isinstance(kind, str) or kind not in _KINDS:
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


def _empty(*_: Any) -> _Array:
    return _Array(0)


def _array_of(content: bytes, kind: _Kind, shape: tuple[int, ...], order: str = "C") -> np.ndarray:
    """Return a NumPy array with the given bytes, number type, shape and order."""
    numbers = np.frombuffer(memoryview(content), dtype=kind.dtype)
    return numbers.reshape(shape, order="F" if order == "F" else "C")


def _scalar(kind: _Kind, content: bytes) -> Any:
    return np.frombuffer(content, dtype=kind.dtype)[0]


_NUMPY_CALLS: Mapping[str, Callable[..., Any]] = {
    "_reconstruct": _empty,
    "ndarray": _empty,
    "dtype": _Kind,
    "scalar": _scalar,
}


class _Restricted(pickle.Unpickler):
    """Unpickler that refuses classes and functions by name, before an object is created."""

    def find_class(self, module: str, name: str) -> Any:
        if module in _NUMPY_CORES and name in _NUMPY_CALLS:
            return _NUMPY_CALLS[name]
        if module in _NUMERIC and name == "_frombuffer":
            return _array_of
        if module == "collections" and name in ("OrderedDict", "deque"):
            return {"OrderedDict": OrderedDict, "deque": deque}[name]
        if module.split(".")[0] in _KEPT_PACKAGES or module.startswith("numpy.random."):
            return _inert(module, name)
        whose = " (a class or function that you defined)" if "cloudpickle" in module else ""
        raise BadInputError(
            f"reading the data would call {shortened(f'{module}.{name}')}{whose}, which is refused "
            "(no code was run); save the data without this object"
        )

    def persistent_load(self, pid: Any) -> Any:
        raise BadInputError("the pickle refers to data outside the file; save all data in one file")


def inert(content: bytes) -> Any:
    """Return the content of a pickle: dictionaries, lists, numbers, arrays and `Inert` objects.

    Raises BadInputError if the pickle contains another class or function, or is damaged.
    """
    try:
        return _Restricted(io.BytesIO(content)).load()
    except BadInputError:
        raise
    except Exception as error:  # a damaged pickle may cause any exception
        reason = shortened(str(error).partition("\n")[0]) or type(error).__name__
        raise BadInputError(
            f"the data are not a pickle, or are damaged ({reason}); save the file again"
        ) from error
