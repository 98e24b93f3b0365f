"""Feed-forward networks in files, read without torch and without running anything: ONNX graphs and
state dicts.

Tensors are NumPy arrays whose entries are CasADi scalars: NumPy broadcasts, reshapes and multiplies
them, CasADi differentiates the result exactly. Weights keep the digits of the file; all arithmetic
is in doubles."""

from __future__ import annotations

import io
import json
import math
import pickle
import re
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.game.basis import Basis, basis
from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError, refuse_unknown, said_of, shortened
from hfa_support.files import regular_file
from verification.critic.candidate import Candidate, Nonlinear, from_weights, linearized

#: What a network may compute of the state: V, dV/dz, u, or V and u one behind the other.
OUTPUTS = ("V", "gradient", "policy", "V+policy")
#: Bytes of a file, and numbers in it: derivatives are symbolic.
LARGEST_FILE, LARGEST_NETWORK = 2**24, 200_000
#: The oldest ONNX operator set that is read.
OLDEST_OPSET = 9
Layers = list[tuple[np.ndarray, np.ndarray]]


class Network(NamedTuple):
    """functions: name of an output -> x -> its numbers, CasADi Functions (n,) -> (k,), in doubles;
    the name is one of `OUTPUTS` where it was asked for, "" of a state dict otherwise.

    precision: of the weights in the file, as "float32". layers: of a state dict, (weight (k, n),
    bias (k,)) each; a single one that acts on the basis has no function."""

    functions: dict[str, Any]
    precision: str
    layers: Layers


def network_in(
    path: str | Path,
    states: int,
    activation: str | None = None,
    parts: Mapping[str, str] | None = None,
    features: int = 0,
) -> Network:
    """The network in a file, of `states` inputs. activation: one of `ACTIVATIONS`, between the
    layers of a state dict, and behind a comma that of its output. parts: what is asked for -> which
    tensors, by a word in their names or more with + between them, or which output of an ONNX graph.

    A single layer of `features` inputs acts on the basis. Raises BadInputError, one line that names
    the file."""
    path, parts = Path(path), parts or {"": ""}
    with said_of(path):
        try:
            content = regular_file(path, LARGEST_FILE).read_bytes()
            if path.suffix.lower() == ".onnx":
                return _onnx_network(content, states, parts)
            tensors, precision = _checked(_tensors_in(content, path.suffix.lower()))
            found = {
                name: _layered(tensors, states, activation, part, features)
                for name, part in parts.items()
            }
            layers = next(iter(found.values()))[1]
            return Network(
                {name: each for name, (each, _) in found.items() if each is not None},
                precision,
                layers,
            )
        except OSError as error:
            raise BadInputError(f"cannot be read ({error.strerror})") from error
        except BadInputError:
            raise
        except Exception as error:  # a damaged file makes the readers raise nearly anything
            said = shortened(str(error).partition("\n")[0])
            raise BadInputError(f"it is damaged or no network ({said})") from error


def _each(function: Callable[..., Any]) -> Callable[..., np.ndarray]:
    """The function on every entry of an array, the same attributes of the operator for all."""
    return np.vectorize(function, otypes=[object])


def _gelu(x: Any, approximate: str = "none") -> Any:
    if approximate == "tanh":
        return 0.5 * x * (1.0 + ca.tanh(math.sqrt(2.0 / math.pi) * (x + 0.044715 * x**3)))
    return 0.5 * x * (1.0 + ca.erf(x / math.sqrt(2.0)))


#: What may stand between the layers of a state dict, by the names of `--set activation`.
ACTIVATIONS: Mapping[str, Callable[..., np.ndarray]] = {
    "tanh": _each(ca.tanh),
    "relu": _each(lambda x: ca.fmax(x, 0.0)),
    "leaky_relu": _each(lambda x, alpha=0.01: ca.fmax(x, 0.0) + alpha * ca.fmin(x, 0.0)),
    "sigmoid": _each(
        lambda x: 0.5 + 0.5 * ca.tanh(0.5 * x)
    ),  # exp(-x) overflows, and its derivative is then nan
    # log(1 + exp(x)), smooth at 0; beyond 40, x to the last digit.
    "softplus": _each(lambda x: ca.if_else(x > 40.0, x, ca.log1p(ca.exp(ca.fmin(x, 40.0))))),
    "elu": _each(lambda x, alpha=1.0: ca.fmax(x, 0.0) + alpha * ca.expm1(ca.fmin(x, 0.0))),
    "gelu": _each(_gelu),
    "silu": _each(lambda x: x * (0.5 + 0.5 * ca.tanh(0.5 * x))),
    "selu": _each(
        lambda x: (
            1.0507009873554805 * (ca.fmax(x, 0.0) + 1.6732632423543772 * ca.expm1(ca.fmin(x, 0.0)))
        )
    ),
    "sin": _each(ca.sin),
}
#: Which a network may have been trained with in place of the one that is said.
COMMON = ("tanh", "relu", "sigmoid", "softplus", "elu")


def _gemm(
    a: Any,
    b: Any,
    c: Any = 0.0,
    alpha: float = 1.0,
    beta: float = 1.0,
    transA: int = 0,
    transB: int = 0,
) -> Any:
    return alpha * ((a.T if transA else a) @ (b.T if transB else b)) + beta * c


def _reshape(x: np.ndarray, shape: np.ndarray, allowzero: int = 0) -> np.ndarray:
    return x.reshape(
        [
            x.shape[place] if size == 0 and not allowzero else int(size)
            for place, size in enumerate(shape)
        ]
    )


def _slice(
    x: np.ndarray, starts: Any, ends: Any, axes: Any = None, steps: Any = None
) -> np.ndarray:
    where = [slice(None)] * x.ndim
    steps = np.ones(len(starts)) if steps is None else steps
    for axis, *ends_and_step in zip(
        range(len(starts)) if axes is None else axes, starts, ends, steps, strict=True
    ):
        where[int(axis)] = slice(*map(int, ends_and_step))
    return x[tuple(where)]


def _reduced(reduce: Callable[..., Any], x: np.ndarray, axes: Any = None, keepdims: int = 1) -> Any:
    return reduce(
        x, axis=None if axes is None else tuple(map(int, np.ravel(axes))), keepdims=bool(keepdims)
    )


def _clip(x: np.ndarray, low: Any = None, high: Any = None, **ends: float) -> np.ndarray:
    low, high = ends.get("min", low), ends.get("max", high)
    x = x if low is None else _each(lambda each: ca.fmax(each, float(low)))(x)
    return x if high is None else _each(lambda each: ca.fmin(each, float(high)))(x)


def _cast(x: np.ndarray, to: int, **_: Any) -> np.ndarray:
    if to not in (1, 7, 11) or (to == 7) != (
        np.asarray(x).dtype.kind == "i"
    ):  # float, int64, double
        raise BadInputError(
            "a Cast goes to another type than float and double; export the network without it"
        )
    return x


#: ONNX operators: inputs, then attributes by name.
OPERATORS: Mapping[str, Callable[..., Any]] = {
    "Add": lambda a, b: a + b,
    "Sub": lambda a, b: a - b,
    "Mul": lambda a, b: a * b,
    "Div": lambda a, b: a / b,
    "Neg": lambda a: -a,
    "Sum": lambda *terms: sum(terms[1:], terms[0]),
    "MatMul": lambda a, b: a @ b,
    "Gemm": _gemm,
    **{
        name.title().replace("_", ""): each
        for name, each in ACTIVATIONS.items()
        if name not in ("silu", "selu")
    },
    **{each.title(): _each(getattr(ca, each)) for each in ("erf", "exp", "log", "sqrt", "cos")},
    "Abs": _each(ca.fabs),
    "Clip": _clip,
    "Reshape": _reshape,
    "Flatten": lambda x, axis=1: x.reshape(math.prod(x.shape[:axis]), -1),
    "Squeeze": lambda x, axes=None: np.squeeze(x, None if axes is None else tuple(map(int, axes))),
    "Unsqueeze": lambda x, axes: np.expand_dims(x, tuple(map(int, axes))),
    "Pow": lambda a, b: a**b,
    "Transpose": lambda a, perm=None: a.transpose(perm),
    "ReduceSum": partial(_reduced, np.sum),
    "ReduceMean": partial(_reduced, np.mean),
    "Concat": lambda *parts, axis: np.concatenate(parts, axis=axis),
    "Slice": _slice,
    "Gather": lambda x, places, axis=0: np.take(x, np.asarray(places, dtype=int), axis=axis),
    "Shape": lambda x: np.array(x.shape),
    "Identity": lambda a: a,
    "Dropout": lambda a, *_, **__: a,
    "Cast": _cast,
    "Constant": lambda **given: np.array(next(iter(given.values()))),
}


def _onnx_network(content: bytes, states: int, parts: Mapping[str, str]) -> Network:
    try:
        import onnx
    except ImportError as error:
        raise BadInputError(
            "ONNX files need the package onnx; install hfa with the extra [networks]"
        ) from error

    model = onnx.load_from_string(content)
    opset = max(
        (each.version for each in model.opset_import if each.domain in ("", "ai.onnx")), default=0
    )
    if opset < OLDEST_OPSET:
        raise BadInputError(
            f"it has the ONNX operator set {opset}; export it with {OLDEST_OPSET} or later"
        )
    graph = model.graph

    def constants(tensors: dict[str, Any]) -> tuple[dict[str, np.ndarray], str]:
        for name, tensor in tensors.items():
            if tensor.data_location == onnx.TensorProto.EXTERNAL:
                what = f"tensor {shortened(name)!r} is in another file"
                raise BadInputError(
                    f"{what}; export the weights inside (torch: external_data=False)"
                )
        return _checked(
            {name: onnx.numpy_helper.to_array(tensor) for name, tensor in tensors.items()}
        )

    known: dict[str, Any]
    known, precision = constants({each.name: each for each in graph.initializer})
    inputs = [each for each in graph.input if each.name not in known]
    if len(inputs) != 1 or not graph.output:
        said = f"it has {len(inputs)} inputs and {len(graph.output)} outputs"
        raise BadInputError(f"{said}; a critic takes the state alone")
    sizes = [
        each.dim_value for each in inputs[0].type.tensor_type.shape.dim
    ]  # 0 where it is left open
    if len(sizes) not in (1, 2) or (len(sizes) == 2 and sizes[0] > 1):
        raise BadInputError(f"its input has the shape {sizes}; it must be one row of states")
    _check_width(sizes[-1] or states, states)
    x = ca.SX.sym("x", states)
    known[inputs[0].name] = np.fromiter(ca.vertsplit(x), object).reshape((1, states)[-len(sizes) :])
    for node in graph.node:
        name = node.op_type if node.domain in ("", "ai.onnx") else f"{node.domain}.{node.op_type}"
        if name not in OPERATORS:
            raise BadInputError(
                f"operator {shortened(name)} is not known; use {', '.join(OPERATORS)}"
            )
        given = {each.name: onnx.helper.get_attribute_value(each) for each in node.attribute}
        if "approximate" in given:
            given["approximate"] = given["approximate"].decode()
        if name == "Constant" and "value" in given:
            given, single = constants(given)
            precision = min(precision, single)  # float32 before float64
        result = np.asarray(
            OPERATORS[name](*(known[each] if each else None for each in node.input), **given)
        )
        if sum(each.size for each in known.values()) + result.size > LARGEST_NETWORK:
            raise BadInputError(f"it has more than {LARGEST_NETWORK} numbers")
        known[node.output[0]] = result
    names = [each.name for each in graph.output]
    found = {}
    for kind, part in parts.items():
        for name in [part] if part else names:
            if name not in names:
                has = shortened(", ".join(names))
                raise BadInputError(f"it has no output {shortened(part)!r}; its outputs are {has}")
            found[kind if part or len(names) == 1 else name] = _function(x, known[name])
    return Network(found, precision, [])


def _check_width(found: int, states: int) -> None:
    if found != states:
        raise BadInputError(f"the network has {found} inputs and the plant {states} states")


def _checked(tensors: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], str]:
    """The tensors, floats in doubles, and the precision of the file. BadInputError where they are
    no finite numbers of at least 32 bits, or too many."""
    for name, value in tensors.items():
        if value.dtype.kind not in "fi" or (value.dtype.kind == "f" and value.dtype.itemsize < 4):
            raise BadInputError(
                f"tensor {shortened(name)!r} is {value.dtype}; give weights as float32 or float64"
            )
        if not np.all(np.isfinite(value)):
            raise BadInputError(f"tensor {shortened(name)!r} has numbers that are not finite")
    if sum(value.size for value in tensors.values()) > LARGEST_NETWORK:
        raise BadInputError(f"it has more than {LARGEST_NETWORK} numbers")
    single = any(value.dtype == np.float32 for value in tensors.values())
    doubles = {
        name: value.astype(float) if value.dtype.kind == "f" else value
        for name, value in tensors.items()
    }
    return doubles, "float32" if single else "float64"


def _function(x: Any, outputs: np.ndarray) -> Any:
    return ca.Function("network", [x], [ca.vertcat(*map(ca.SX, np.ravel(outputs).tolist()))])


def _layered(
    tensors: Mapping[str, np.ndarray], states: int, activation: str | None, part: str, features: int
) -> tuple[Any, Layers]:
    """The function of the layers in the order of the file, None of one that acts on the basis; each
    layer must take what the one before gives."""
    roots = shortened(
        ", ".join(dict.fromkeys(re.sub(r"\.?\d*\.?(weight|bias)$", "", name) for name in tensors)),
        200,
    )
    if part:
        words = [f".{each}." for each in part.split("+")]
        tensors = {
            name: value
            for name, value in tensors.items()
            if any(each in f".{name}." for each in words)
        }
    if not tensors:
        raise BadInputError(
            f"it holds no tensors called {shortened(part)!r}; its tensors are in {roots}"
        )
    layers: Layers = []
    for name, value in tensors.items():
        stem, kind = name.removesuffix("weight"), name.rpartition(".")[2]
        if kind == "bias" and name.removesuffix("bias") + "weight" in tensors:
            continue
        bias = tensors.get(f"{stem}bias", np.zeros(len(value)) if value.ndim else None)
        before, wrong = len(layers[-1][0]) if layers else None, ""
        if kind != "weight" or value.ndim != 2 or bias is None or bias.shape != (len(value),):
            wrong = "is no weight or bias of a linear layer"
        elif before not in (None, value.shape[1]):
            wrong = f"takes {value.shape[1]} numbers, the layer before gives {before}"
        if wrong:
            more = f"of several networks name one by --network: {roots}"
            raise BadInputError(f"tensor {shortened(name)!r} {value.shape} {wrong}; {more}")
        assert bias is not None
        layers.append((value, bias))
    width = layers[0][0].shape[1]
    if len(layers) == 1 and width == features:
        return None, layers
    _check_width(width, states)
    if len(layers) > 1 and activation is None:
        choices = "|".join(ACTIVATIONS)
        raise BadInputError(
            f"a state dict does not say what is between its layers; give --set activation={choices}"
        )
    between, _, last = (activation or "").partition(",")
    for name in filter(None, (between, last)):
        refuse_unknown("unknown activation", name, ACTIVATIONS)
    x = ca.SX.sym("x", states)
    h = np.fromiter(ca.vertsplit(x), object)
    for place, (weight, bias) in enumerate(layers):
        h = weight @ (ACTIVATIONS[between](h) if place and between else h) + bias
    return _function(x, ACTIVATIONS[last](h) if last else h), layers


def _tensors_in(content: bytes, suffix: str) -> dict[str, np.ndarray]:
    """Name -> array of a state dict, in the order of its layers: that of the file, or where the
    format sorts its names, that of the numbers in them."""
    if suffix == ".npz":
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    if suffix == ".safetensors":
        found = _safetensors(content)
        return {name: found[name] for name in sorted(found, key=_numbers_in_order)}
    if content[:2] != b"PK":
        raise BadInputError(
            "it is not what torch.save writes since torch 1.6; save state_dict() with it again"
        )
    return _torch_zip(content)


def _numbers_in_order(name: str) -> list[tuple[int, str]]:
    return [
        (int(part or 0), "") if part.isdecimal() else (-1, part)
        for part in re.split(r"(\d+)", name)
    ]


def _safetensors(content: bytes) -> dict[str, np.ndarray]:
    begin = 8 + int.from_bytes(content[:8], "little")
    found = {}
    for name, about in json.loads(content[8:begin]).items():
        if name != "__metadata__":
            start, stop = about["data_offsets"]
            values = np.frombuffer(content[begin + start : begin + stop], _dtype(about["dtype"]))
            found[name] = values.reshape(about["shape"])
    return found


#: Of safetensors and of torch; integers (counters of batches) are read, and refused where they
#: would be weights.
_DTYPES = {"F16": "<f2", "F32": "<f4", "F64": "<f8"}
_DTYPES |= {
    "HalfStorage": "<f2",
    "FloatStorage": "<f4",
    "DoubleStorage": "<f8",
    "LongStorage": "<i8",
}


def _dtype(kind: str) -> str:
    if kind not in _DTYPES:
        raise BadInputError(f"a tensor is {shortened(kind)}; save weights as float32 or float64")
    return _DTYPES[kind]


def _view(
    storage: np.ndarray, offset: int, size: tuple[int, ...], stride: tuple[int, ...], *_: Any
) -> np.ndarray:
    """torch._utils._rebuild_tensor_v2: the numbers of a storage at offset + Σ index stride;
    IndexError beyond it."""
    if math.prod(size) > storage.size:
        raise BadInputError(f"a tensor of shape {size} is larger than its storage")
    return storage[offset + sum(np.indices(size)[axis] * step for axis, step in enumerate(stride))]


#: All that a pickle may call.
_ALLOWED: Mapping[tuple[str, str], Callable[..., Any]] = {
    ("collections", "OrderedDict"): OrderedDict,
    ("torch._utils", "_rebuild_tensor_v2"): _view,
    ("torch._utils", "_rebuild_parameter"): lambda tensor, *_: tensor,
}


class _Restricted(pickle.Unpickler):
    """Builds dictionaries and arrays; every other class or function is refused by its name before
    it is made."""

    def __init__(self, content: bytes, storages: Mapping[str, bytes]) -> None:
        super().__init__(io.BytesIO(content))
        self.storages = storages

    def find_class(self, module: str, name: str) -> Any:
        if module == "torch" and name.endswith("Storage"):
            return _dtype(name)
        if (module, name) not in _ALLOWED:
            what = shortened(f"{module}.{name}")
            raise BadInputError(
                f"it wants to make {what}, which is not done: save state_dict() alone"
            )
        return _ALLOWED[module, name]

    def persistent_load(self, pid: Any) -> np.ndarray:
        return np.frombuffer(self.storages[f"data/{pid[2]}"], pid[1])


def _torch_zip(content: bytes) -> dict[str, np.ndarray]:
    """What torch.save or stable-baselines3 writes, whose policy.pth is such a file."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(each.file_size for each in archive.infolist()) > LARGEST_FILE:
            raise BadInputError(f"it unpacks to more than {LARGEST_FILE} bytes")
        names = archive.namelist()
        if "policy.pth" in names:
            return _torch_zip(archive.read("policy.pth"))
        if any(re.search(r"(^|/)(code/|constants\.pkl$)", each) for each in names):
            raise BadInputError(
                "it is TorchScript, a program; save state_dict() instead, or export to ONNX"
            )
        inside = {each.partition("/")[2]: archive.read(each) for each in names}
    return _named("", _Restricted(inside["data.pkl"], inside).load())


def _named(prefix: str, stored: Any, depth: int = 0) -> dict[str, np.ndarray]:
    """Arrays of dictionaries in dictionaries, as "model.0.weight"."""
    if isinstance(stored, np.ndarray):
        return {prefix.removesuffix("."): stored}
    found: dict[str, np.ndarray] = {}
    if isinstance(stored, dict) and depth < 4:
        for name, value in stored.items():
            found |= _named(f"{prefix}{name}.", value, depth + 1)
    return found


def from_network(
    game: Game,
    source: str | Path | ca.Function,
    *,
    network: str = "",
    activation: str | None = None,
    scale: np.ndarray | None = None,
    features: Basis | ca.Function | None = None,
) -> Candidate:
    """The critic that a network is: a file, as `network_in` reads it, or a CasADi Function of the
    state.

    network: which part of a file is what, as "value", "V=value" or "V=value,policy=actor"; without
    a name of `OUTPUTS` the number of outputs says it. scale: (n,), the network takes state i times
    scale[i]. A single layer on the features (default: the quadratic basis) is a polynomial in them.
    BadInputError, one line, names the file."""
    n, m = game.B.shape
    scale = np.ones(n) if scale is None else np.asarray(scale, dtype=float)
    if scale.shape != (n,) or not np.all(np.isfinite(scale) & (scale != 0.0)):
        raise BadInputError(f"scale needs {n} numbers other than 0, one for each state")
    functions = basis("quadratic", n) if features is None else features
    count = functions.size if isinstance(functions, Basis) else functions.numel_out(0)
    if isinstance(source, ca.Function):
        found = Network({network: source}, "float64", [])
    else:
        found = network_in(source, n, activation, _parts(network), count)
    with said_of("" if isinstance(source, ca.Function) else source):
        if not found.functions:
            (weight, bias), *_ = found.layers
            if len(weight) != 1 or not {*_parts(network)} <= {"", "V"}:
                raise BadInputError(
                    f"a layer on the basis has {len(weight)} outputs; only V, which has 1, is read of it"
                )
            if not isinstance(functions, Basis):
                return from_weights(game, weight[0], functions, float(bias[0]), found.precision)
            made = from_weights(game, weight[0] * functions.scaling(scale), functions)
            return replace(
                made,
                nonlinear=Nonlinear(None, None, None, None, "V", found.precision, float(bias[0])),
            )
        z = ca.SX.sym("z", n)
        kinds = _kinds({key: each.numel_out(0) for key, each in found.functions.items()}, n, m)
        outputs = {
            kinds[key]: ca.vec(each(ca.DM(scale) * z)) for key, each in found.functions.items()
        }
        if "V+policy" in outputs:
            both = outputs.pop("V+policy")
            outputs |= {"V": both[0], "policy": both[1:]}
        read = partial(from_network, game, source, network=network, scale=scale, features=features)
        others = [each for each in COMMON if activation and each != activation.partition(",")[0]]
        variants = {
            f"the activation is {each}, not {activation}": partial(read, activation=each)
            for each in others
        }
        return linearized(game, z, outputs, found.precision, variants)


def _parts(network: str) -> dict[str, str]:
    """Which of `OUTPUTS` ("": not said) -> the part of the file, of "value" or
    "V=value,policy=actor"."""
    found: dict[str, str] = {}
    for each in network.split(","):
        output, equals, part = each.strip().rpartition("=")
        if equals and output not in OUTPUTS:
            raise BadInputError(
                f"--network {shortened(each)!r}: before = stands one of {', '.join(OUTPUTS)}"
            )
        found[output] = part
    return found


def _kinds(sizes: Mapping[str, int], n: int, m: int) -> dict[str, str]:
    """What each output of a network is, by its name where that is one of `OUTPUTS`, else by its
    size."""
    counts, found = dict(zip(OUTPUTS, (1, n, m, 1 + m), strict=True)), dict[str, str]()
    for name, size in sizes.items():
        fitting = [kind for kind in ([name] if name in counts else counts) if counts[kind] == size]
        if "gradient" in fitting and m != n:
            fitting = [
                "gradient"
            ]  # V and a policy have as many where 1 + m = n; then they must be named
        if not fitting:
            said = ", ".join(f"{kind} has {count}" for kind, count in counts.items())
            raise BadInputError(f"the network has {size} outputs; on this plant {said}")
        if len(fitting) > 1:
            raise BadInputError(
                f"{size} outputs may be {' or '.join(fitting)}; say which, as --network {fitting[0]}="
            )
        found[name] = fitting[0]
    if sorted(found.values()) not in (*([each] for each in OUTPUTS), ["V", "policy"]):
        said = f"its outputs {shortened(', '.join(sizes))} are {', '.join(found.values())}"
        raise BadInputError(
            f"{said}; name one, or V and a policy, as in --network V=value,policy=actor"
        )
    return found
