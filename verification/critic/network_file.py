"""Feed-forward networks in files, read without torch and without running anything: ONNX graphs and state dicts.

Tensors are NumPy arrays whose entries are CasADi scalars: NumPy broadcasts, reshapes and multiplies them, CasADi
differentiates the result exactly. Weights keep the digits of the file; all arithmetic is in doubles.
"""

from __future__ import annotations

import io
import json
import math
import pickle
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError, refuse_unknown, said_of, shortened
from hfa_support.files import regular_file

#: Suffixes of the files that `network_in` reads.
NETWORK_FILES = (".onnx", ".pt", ".pth", ".pkl", ".safetensors")
#: Bytes of a file, and numbers in it: derivatives are symbolic.
LARGEST_FILE, LARGEST_NETWORK = 2**24, 200_000
#: The oldest ONNX operator set whose operators all have their present form.
OLDEST_OPSET = 13
Layers = list[tuple[np.ndarray, np.ndarray]]


class Network(NamedTuple):
    """x -> network(x), a CasADi Function (n,) -> (k,), in doubles.

    precision: of the weights in the file, as "float32". layers: of a state dict, (weight (k, n), bias (k,)) each; () of
    a graph.
    """

    function: Any
    precision: str
    layers: Layers


def network_in(
    path: str | Path, states: int, activation: str | None = None, part: str | None = None, features: int = 0
) -> Network:
    """The network in a file, of `states` inputs. activation: one of `ACTIVATIONS`, between the layers of a state dict;
    part: of which network, where names of a state dict begin with it.

    A single layer of `features` inputs acts on the basis: its function is None. Raises BadInputError, one line that
    names the file.
    """
    path = Path(path)
    with said_of(path):
        try:
            content = regular_file(path, LARGEST_FILE).read_bytes()
            if path.suffix.lower() == ".onnx":
                if activation is not None or part is not None:
                    raise BadInputError("--activation and --network belong to a state dict; an ONNX file says them")
                return _onnx_network(content, states)
            return _layered(_tensors_in(content, path.suffix.lower()), states, activation, part, features)
        except OSError as error:
            raise BadInputError(f"cannot be read ({error.strerror})") from error
        except BadInputError:
            raise
        except Exception as error:  # a damaged file makes the readers raise nearly anything
            raise BadInputError(
                f"it is damaged or no network ({shortened(str(error).partition(chr(10))[0])})"
            ) from error


def _each(function: Callable[[Any], Any]) -> Callable[..., np.ndarray]:
    return np.vectorize(function, otypes=[object])


def _positive(x: np.ndarray) -> np.ndarray:
    return _each(lambda each: ca.fmax(each, 0.0))(x)


def _negative(x: np.ndarray) -> np.ndarray:
    return _each(lambda each: ca.fmin(each, 0.0))(x)


def _tanh(x: np.ndarray) -> np.ndarray:
    return _each(ca.tanh)(x)


def _sigmoid(x: np.ndarray) -> np.ndarray:
    return 0.5 + 0.5 * _tanh(0.5 * x)  # exp(-x) overflows, and its derivative is then nan


def _softplus(x: np.ndarray) -> np.ndarray:
    """log(1 + exp(x)), smooth at 0; beyond 40, x to the last digit."""
    return _each(lambda each: ca.if_else(each > 40.0, each, ca.log1p(ca.exp(ca.fmin(each, 40.0)))))(x)


def _elu(x: np.ndarray, alpha: float = 1.0) -> np.ndarray:
    return _positive(x) + alpha * _each(ca.expm1)(_negative(x))


def _leaky(x: np.ndarray, alpha: float = 0.01) -> np.ndarray:
    return _positive(x) + alpha * _negative(x)


def _gelu(x: np.ndarray, approximate: str = "none") -> np.ndarray:
    if approximate == "tanh":
        return 0.5 * x * (1.0 + _tanh(math.sqrt(2.0 / math.pi) * (x + 0.044715 * x * x * x)))
    return 0.5 * x * (1.0 + _each(ca.erf)(x / math.sqrt(2.0)))


#: What may stand between the layers of a state dict, by the names of --activation.
ACTIVATIONS: Mapping[str, Callable[..., np.ndarray]] = {
    "tanh": _tanh,
    "relu": _positive,
    "leaky_relu": _leaky,
    "sigmoid": _sigmoid,
    "softplus": _softplus,
    "elu": _elu,
    "gelu": _gelu,
}


def _gemm(a: Any, b: Any, c: Any = 0.0, alpha: float = 1.0, beta: float = 1.0, transA: int = 0, transB: int = 0) -> Any:
    return alpha * ((a.T if transA else a) @ (b.T if transB else b)) + beta * c


def _reshape(x: np.ndarray, shape: np.ndarray, allowzero: int = 0) -> np.ndarray:
    sizes = [x.shape[place] if size == 0 and not allowzero else int(size) for place, size in enumerate(shape)]
    return x.reshape(sizes)


def _slice(x: np.ndarray, starts: Any, ends: Any, axes: Any = None, steps: Any = None) -> np.ndarray:
    where = [slice(None)] * x.ndim
    axes = range(len(starts)) if axes is None else axes
    for axis, start, end, step in zip(axes, starts, ends, [1] * len(starts) if steps is None else steps, strict=True):
        # ONNX clips, and an end far below 0 with a negative step means "to the first"
        stop = None if step < 0 and end < -x.shape[axis] else int(end)
        where[int(axis)] = slice(int(start), stop, int(step))
    return x[tuple(where)]


def _reduce_sum(x: np.ndarray, axes: Any = None, keepdims: int = 1, noop_with_empty_axes: int = 0) -> np.ndarray:
    if axes is None and noop_with_empty_axes:
        return x
    return np.sum(x, axis=None if axes is None else tuple(map(int, axes)), keepdims=bool(keepdims))


#: ONNX operators: inputs, then attributes by name.
OPERATORS: Mapping[str, Callable[..., Any]] = {
    "Add": lambda a, b: a + b,
    "Sub": lambda a, b: a - b,
    "Mul": lambda a, b: a * b,
    "Div": lambda a, b: a / b,
    "Neg": lambda a: -a,
    "MatMul": lambda a, b: a @ b,
    "Gemm": _gemm,
    "Tanh": _tanh,
    "Relu": _positive,
    "LeakyRelu": _leaky,
    "Sigmoid": _sigmoid,
    "Softplus": _softplus,
    "Elu": _elu,
    "Gelu": _gelu,
    "Reshape": _reshape,
    "Pow": lambda a, b: a**b,
    "Transpose": lambda a, perm=None: a.transpose(perm),
    "ReduceSum": _reduce_sum,
    "Concat": lambda *parts, axis: np.concatenate(parts, axis=axis),
    "Slice": _slice,
    "Identity": lambda a: a,
    "Constant": lambda **given: next(iter(given.values())),
}


def _onnx_network(content: bytes, states: int) -> Network:
    try:
        import onnx
    except ImportError as error:
        raise BadInputError("ONNX files need the package onnx; install hfa with the extra [networks]") from error

    model = onnx.load_from_string(content)
    opset = max((each.version for each in model.opset_import if each.domain in ("", "ai.onnx")), default=0)
    if opset < OLDEST_OPSET:
        raise BadInputError(f"it has the ONNX operator set {opset}; export it with {OLDEST_OPSET} or later")
    graph, precisions = model.graph, set[str]()

    def constant(name: str, tensor: Any) -> np.ndarray:
        if tensor.data_location == onnx.TensorProto.EXTERNAL:
            raise BadInputError(
                f"tensor {shortened(name)!r} is in another file; export the weights inside (torch: external_data=False)"
            )
        kind = onnx.TensorProto.DataType.Name(tensor.data_type).lower()
        if kind not in ("float", "double", "int32", "int64"):
            raise BadInputError(f"tensor {shortened(name)!r} is {kind}; export weights as float32 or float64")
        if kind in ("float", "double"):
            precisions.add({"float": "float32", "double": "float64"}[kind])
        return _finite(name, onnx.numpy_helper.to_array(tensor))

    known: dict[str, Any] = {each.name: constant(each.name, each) for each in graph.initializer}
    inputs = [each for each in graph.input if each.name not in known]
    if len(inputs) != 1 or len(graph.output) != 1:
        raise BadInputError(f"it has {len(inputs)} inputs and {len(graph.output)} outputs; a critic has 1 and 1")
    sizes = [each.dim_value for each in inputs[0].type.tensor_type.shape.dim]  # 0 where it is left open
    if len(sizes) not in (1, 2) or (len(sizes) == 2 and sizes[0] > 1):
        raise BadInputError(f"its input has the shape {sizes}; it must be one row of states")
    if sizes[-1] not in (0, states):
        raise _wrong_width(sizes[-1], states)
    x, known[inputs[0].name] = _symbols(states, (states,) if len(sizes) == 1 else (1, states))
    for node in graph.node:
        name = node.op_type if node.domain in ("", "ai.onnx") else f"{node.domain}.{node.op_type}"
        if name not in OPERATORS:
            raise BadInputError(f"operator {shortened(name)} is not known; use {', '.join(OPERATORS)}")
        given = {each.name: onnx.helper.get_attribute_value(each) for each in node.attribute}
        if name == "Constant":
            given = {
                key: constant(node.output[0], value) if key == "value" else np.array(value)
                for key, value in given.items()
            }
        given = {key: value.decode() if isinstance(value, bytes) else value for key, value in given.items()}
        result = OPERATORS[name](*(known[each] if each else None for each in node.input), **given)
        if sum(each.size for each in known.values()) + result.size > LARGEST_NETWORK:
            raise BadInputError(f"it has more than {LARGEST_NETWORK} numbers")
        known[node.output[0]] = result
    return Network(_function(x, known[graph.output[0].name]), "float32" if "float32" in precisions else "float64", [])


def _wrong_width(found: int, states: int) -> BadInputError:
    return BadInputError(f"the network has {found} inputs and the plant {states} states")


def _finite(name: str, values: np.ndarray) -> np.ndarray:
    if values.size > LARGEST_NETWORK:
        raise BadInputError(
            f"tensor {shortened(name)!r} has {values.size} numbers; networks may have {LARGEST_NETWORK}"
        )
    if not np.all(np.isfinite(values)):
        raise BadInputError(f"tensor {shortened(name)!r} has numbers that are not finite")
    return values.astype(float) if values.dtype.kind == "f" else values


def _symbols(states: int, shape: tuple[int, ...]) -> tuple[Any, np.ndarray]:
    """The vector of CasADi symbols, and an array of them."""
    x, entries = ca.SX.sym("x", states), np.empty(states, dtype=object)
    for place in range(states):
        entries[place] = x[place]
    return x, entries.reshape(shape)


def _function(x: Any, outputs: np.ndarray) -> Any:
    return ca.Function("network", [x], [ca.vertcat(*map(ca.SX, np.ravel(outputs).tolist()))])


def _layered(
    tensors: Mapping[str, np.ndarray], states: int, activation: str | None, part: str | None, features: int
) -> Network:
    """The layers in the order of the file; each must take what the one before gives."""
    first = sorted({name.partition(".")[0] for name in tensors})
    if part is not None:
        tensors = {name: value for name, value in tensors.items() if f"{name}.".startswith(f"{part}.")}
    if not tensors:
        raise BadInputError(f"it holds no tensors under {part!r}; its names begin with {shortened(', '.join(first))}")
    layers: Layers = []
    for name, value in tensors.items():
        stem, kind = name.removesuffix("weight"), name.rpartition(".")[2]
        if kind == "bias" and name.removesuffix("bias") + "weight" in tensors:
            continue
        bias = tensors.get(f"{stem}bias", np.zeros(len(value)) if value.ndim else None)
        if kind != "weight" or value.ndim != 2 or bias is None or bias.shape != (len(value),):
            raise BadInputError(f"tensor {shortened(name)!r} {value.shape} is no weight or bias of a linear layer")
        if layers and len(layers[-1][0]) != value.shape[1]:
            raise BadInputError(
                f"{shortened(name)!r} takes {value.shape[1]} numbers, the layer before gives {len(layers[-1][0])}; "
                f"of several networks name one by --network: {shortened(', '.join(first))}"
            )
        layers.append((value.astype(float), bias.astype(float)))
    precision = "float32" if any(each.dtype == np.float32 for each in tensors.values()) else "float64"
    width = layers[0][0].shape[1]
    if len(layers) == 1 and width == features:
        return Network(None, precision, layers)
    if width != states:
        raise _wrong_width(width, states)
    if len(layers) > 1 and activation is None:
        raise BadInputError(
            f"a state dict does not say what is between its layers; give --activation {'|'.join(ACTIVATIONS)}"
        )
    if activation is not None:
        refuse_unknown("unknown activation", activation, ACTIVATIONS)
    x, h = _symbols(states, (states,))
    for place, (weight, bias) in enumerate(layers):
        h = weight @ (ACTIVATIONS[activation](h) if place and activation else h) + bias
    return Network(_function(x, h), precision, layers)


def _tensors_in(content: bytes, suffix: str) -> dict[str, np.ndarray]:
    """Name -> array of a state dict, float32 or float64, finite."""
    read = _safetensors if suffix == ".safetensors" else _torch_zip if content[:2] == b"PK" else _torch_legacy
    found = {name: _checked(name, value) for name, value in read(content).items()}
    if sum(value.size for value in found.values()) > LARGEST_NETWORK:
        raise BadInputError(f"it has more than {LARGEST_NETWORK} numbers")
    return found


def _checked(name: str, value: np.ndarray) -> np.ndarray:
    _finite(name, value)
    return value


def _safetensors(content: bytes) -> dict[str, np.ndarray]:
    begin = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:begin])
    found = {}
    for name, about in header.items():
        if name != "__metadata__":
            start, stop = about["data_offsets"]
            values = np.frombuffer(content[begin + start : begin + stop], _dtype(name, about["dtype"], _SAFETENSORS))
            found[name] = values.reshape(about["shape"])
    return found


_SAFETENSORS = {"F32": "<f4", "F64": "<f8"}
#: Storages of torch; integers (counters of batches) are read, and refused where they would be weights.
_STORAGES = {"FloatStorage": "<f4", "DoubleStorage": "<f8", "LongStorage": "<i8", "IntStorage": "<i4"}


def _dtype(name: str, kind: str, known: Mapping[str, str]) -> str:
    if kind not in known:
        raise BadInputError(f"tensor {shortened(name)!r} is {shortened(kind)}; save weights as float32 or float64")
    return known[kind]


class _Tensor(NamedTuple):
    """A view of a storage that is not read yet."""

    storage: tuple[str, str]
    offset: int
    size: tuple[int, ...]
    stride: tuple[int, ...]

    def values(self, storages: Mapping[str, bytes]) -> np.ndarray:
        kind, key = self.storage
        flat = np.frombuffer(storages[key], kind)
        if math.prod(self.size) > flat.size:
            raise BadInputError(f"a tensor of shape {self.size} is larger than its storage")
        places = np.full(self.size, self.offset)
        for axis, (count, step) in enumerate(zip(self.size, self.stride, strict=True)):
            places += (np.arange(count) * step).reshape([-1 if each == axis else 1 for each in range(len(self.size))])
        return flat[places]


class _Restricted(pickle.Unpickler):
    """Builds dictionaries and `_Tensor`s; every other class or function is refused by its name before it is made."""

    def find_class(self, module: str, name: str) -> Any:
        allowed: dict[tuple[str, str], Any] = {
            ("collections", "OrderedDict"): OrderedDict,
            ("torch._utils", "_rebuild_tensor_v2"): lambda storage, offset, size, stride, *_: _Tensor(
                storage, offset, tuple(size), tuple(stride)
            ),
            ("torch._utils", "_rebuild_parameter"): lambda tensor, *_: tensor,
        }
        if module == "torch" and name.endswith("Storage"):
            return _dtype("of the file", name, _STORAGES)
        if (module, name) not in allowed:
            raise BadInputError(
                f"it wants to make {shortened(f'{module}.{name}')}, which is not done: save state_dict() alone"
            )
        return allowed[module, name]

    def persistent_load(self, pid: Any) -> Any:
        _, kind, key, *_ = pid
        return kind, str(key)


def _torch_zip(content: bytes) -> dict[str, np.ndarray]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(each.file_size for each in archive.infolist()) > LARGEST_FILE:
            raise BadInputError(f"it unpacks to more than {LARGEST_FILE} bytes")
        inside = {each.partition("/")[2]: archive.read(each) for each in archive.namelist()}
    if inside.get("byteorder", b"little") != b"little":
        raise BadInputError("its numbers are big-endian; save it on another machine")
    storages = {name.removeprefix("data/"): value for name, value in inside.items() if name.startswith("data/")}
    return _flat(_Restricted(io.BytesIO(inside["data.pkl"])).load(), storages)


def _torch_legacy(content: bytes) -> dict[str, np.ndarray]:
    """Before torch 1.6: a magic number, the protocol, the machine, the dictionary, the keys, then each storage."""
    stream = io.BytesIO(content)
    *_, stored, keys = (_Restricted(stream).load() for _ in range(5))
    kinds = {tensor.storage[1]: tensor.storage[0] for tensor in _named("", stored).values()}
    storages = {}
    for key in keys:
        count = int.from_bytes(stream.read(8), "little")
        storages[key] = stream.read(count * np.dtype(kinds[key]).itemsize)
    return _flat(stored, storages)


def _named(prefix: str, stored: Any, depth: int = 0) -> dict[str, _Tensor]:
    """Tensors of dictionaries in dictionaries, as "model.0.weight"."""
    if isinstance(stored, _Tensor):
        return {prefix.removesuffix("."): stored}
    found: dict[str, _Tensor] = {}
    if isinstance(stored, dict) and depth < 4:
        for name, value in stored.items():
            found |= _named(f"{prefix}{name}.", value, depth + 1)
    return found


def _flat(stored: Any, storages: Mapping[str, bytes]) -> dict[str, np.ndarray]:
    return {name: tensor.values(storages) for name, tensor in _named("", stored).items()}
