"""Conversion of ONNX graphs to CasADi functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.network.activations import ACTIVATIONS, on_entries
from controller.critic.network.products import Products
from controller.critic.network.row_network import RowNetwork
from controller.critic.network.tensors import LARGEST_NETWORK, checked_tensors
from hfa_support.errors import BadInputError, missing_package, prefix_errors, shortened, warn
from hfa_support.files import regular_file

#: Oldest supported ONNX operator set.
OLDEST_OPSET = 9
#: Largest number of scalars in a graph that depend on the state.
_MOST_SCALARS = 200_000


def _divided(a: Any, b: Any) -> Any:
    """Return a / b as defined by ONNX, with the quotient of integers truncated."""
    quotient = a / b
    if np.asarray(a).dtype.kind == "i" and np.asarray(b).dtype.kind == "i":
        return np.trunc(quotient).astype(int)
    return quotient


def _gemm(
    times: Callable[[np.ndarray, np.ndarray], np.ndarray],
    a: np.ndarray,
    b: np.ndarray,
    c: Any = 0.0,
    **how: float,
) -> Any:
    first = a.T if how.get("transA") else a
    second = b.T if how.get("transB") else b
    return how.get("alpha", 1.0) * times(first, second) + how.get("beta", 1.0) * c


def _reshape(x: np.ndarray, shape: np.ndarray, allowzero: int = 0) -> np.ndarray:
    sizes = [int(size) for size in shape]
    if not allowzero:
        sizes = [size or x.shape[axis] for axis, size in enumerate(sizes)]
    return x.reshape(sizes)


def _slice(
    x: np.ndarray, starts: Any, ends: Any, axes: Any = None, steps: Any = None
) -> np.ndarray:
    axes = range(len(starts)) if axes is None else axes
    steps = np.ones(len(starts)) if steps is None else steps
    slices = [slice(None)] * x.ndim
    for axis, start, end, step in zip(axes, starts, ends, steps, strict=True):
        slices[int(axis)] = slice(int(start), int(end), int(step))
    return x[tuple(slices)]


def _reduced(
    combine: Callable[..., Any],
    x: np.ndarray,
    axes: Any = None,
    keepdims: int = 1,
    noop_with_empty_axes: int = 0,
) -> Any:
    if axes is None or not np.size(axes):
        if noop_with_empty_axes:
            return x
        return combine(x, axis=None, keepdims=bool(keepdims))
    return combine(x, axis=tuple(map(int, np.ravel(axes))), keepdims=bool(keepdims))


def _clip(x: np.ndarray, low: Any = None, high: Any = None, **ends: float) -> np.ndarray:
    low = ends.get("min", low)
    high = ends.get("max", high)
    if low is not None:
        x = on_entries(partial(ca.fmax, float(low)))(x)
    if high is not None:
        x = on_entries(partial(ca.fmin, float(high)))(x)
    return x


def _cast(x: np.ndarray, to: int, **_: Any) -> np.ndarray:
    if to not in (_FLOAT, _DOUBLE, _INT64) or (to == _INT64 and np.asarray(x).dtype.kind != "i"):
        raise BadInputError(
            f"Cast to the ONNX type number {to} is not supported (only to float and double); "
            "export the network without this Cast"
        )
    return x if to == _INT64 or x.dtype.kind == "O" else x.astype(float)


def _split(
    x: np.ndarray, sizes: Any = None, axis: int = 0, num_outputs: int = 1, split: Any = None
) -> tuple[np.ndarray, ...]:
    """Return consecutive parts of x along an axis, as the ONNX operator Split does."""
    # The parts have the lengths `sizes` or `split`. Without lengths, there are `num_outputs` parts
    # of equal length, of which the last may be shorter.
    sizes = split if sizes is None else sizes
    if sizes is None:
        length = -(-x.shape[axis] // num_outputs)
        sizes = np.full(num_outputs, length)
    ends = np.cumsum(np.asarray(sizes, dtype=int))[:-1]
    return tuple(np.split(x, ends, axis=axis))


def _shape(x: np.ndarray, start: int = 0, end: int | None = None) -> np.ndarray:
    return np.array(x.shape[start:end], dtype=int)


def normalized(x: np.ndarray, axes: tuple[int, ...], epsilon: float) -> np.ndarray:
    """Return (x - mean) / sqrt(variance + epsilon), with mean and variance over the given axes."""
    centred = x - np.mean(x, axis=axes, keepdims=True)
    variance = np.mean(centred**2, axis=axes, keepdims=True)
    return centred / on_entries(ca.sqrt)(variance + epsilon)


def _layer_norm(
    x: np.ndarray,
    scale: Any,
    bias: Any = 0.0,
    axis: int = -1,
    epsilon: float = 1e-5,
    stash_type: int = 1,
) -> np.ndarray:
    axes = tuple(range(axis % x.ndim, x.ndim))
    return normalized(x, axes, epsilon) * scale + bias


def _batch_norm(
    x: np.ndarray, scale: Any, bias: Any, mean: Any, variance: Any, **how: float
) -> np.ndarray:
    if how.get("training_mode"):
        raise BadInputError(
            "BatchNormalization is in training mode; call eval() on the network before the export"
        )
    if x.ndim != 2:
        raise BadInputError(
            f"BatchNormalization acts on an array with {x.ndim} axes; export the network with 2 "
            "axes (samples x entries)"
        )
    return (x - mean) / np.sqrt(variance + how.get("epsilon", 1e-5)) * scale + bias


def _chosen(condition: Any, value: Any, otherwise: Any) -> Any:
    if isinstance(condition, ca.SX):
        return ca.if_else(condition, value, otherwise)
    return value if condition else otherwise


#: ONNX operators of exported MLPs with normalizers, except products, as functions of inputs, with
#: attributes as keywords.
_OPERATORS: Mapping[str, Callable[..., Any]] = {
    "Add": lambda a, b: a + b,
    "Sub": lambda a, b: a - b,
    "Mul": lambda a, b: a * b,
    "Div": _divided,
    "Neg": lambda a: -a,
    "Tanh": ACTIVATIONS["tanh"],
    "Relu": ACTIVATIONS["relu"],
    "LeakyRelu": ACTIVATIONS["leaky_relu"],
    "Sigmoid": ACTIVATIONS["sigmoid"],
    "Softplus": ACTIVATIONS["softplus"],
    "Elu": ACTIVATIONS["elu"],
    "Selu": ACTIVATIONS["selu"],
    "Gelu": ACTIVATIONS["gelu"],
    "Sin": ACTIVATIONS["sin"],
    "Erf": on_entries(ca.erf),
    "Exp": on_entries(ca.exp),
    "Sqrt": on_entries(ca.sqrt),
    "Clip": _clip,
    "Greater": np.frompyfunc(lambda a, b: a > b, 2, 1),  # these two are in torch's Softplus
    "Where": np.frompyfunc(_chosen, 3, 1),
    "LayerNormalization": _layer_norm,
    "BatchNormalization": _batch_norm,
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
    "Shape": _shape,
    "Split": _split,
    "Identity": lambda a: a,
    "Cast": _cast,
    "Constant": lambda **values: np.array(next(iter(values.values()))),
}
#: Operators that only arrange numbers. The chain of a network omits them.
_ARRANGING = {"Identity", "Reshape", "Flatten", "Squeeze", "Unsqueeze", "Constant", "Shape"}
_ARRANGING |= {"Cast", "Transpose", "Split"}
#: Type numbers of ONNX.
_FLOAT = 1
_INT64 = 7
_DOUBLE = 11
_PRODUCTS = ("MatMul", "Gemm")
_ELEMENTWISE = ("Add", "Sub", "Mul", "Div", "Pow", "Greater", "Where")


class GraphFunctions(NamedTuple):
    """Functions of an ONNX graph.

    functions: requested kind, or name of the output -> function of x (states,), or of (x, u)
        (states + inputs,) for a Q.
    rows: name -> function of x (N, states), or empty if no product in the graph is large.
    precision: precision of the weights, "float32" or "float64".
    operators: operators that depend on x with the sizes of their results, in one line.
    """

    functions: dict[str, ca.Function]
    rows: dict[str, RowNetwork]
    precision: str
    operators: str


def _graph_in(onnx: Any, path: Path) -> Any:
    """Return the ONNX graph in a file. Metadata, which are not applied, are named in a warning.

    Raises BadInputError if the operator set is too old.
    """
    model = onnx.load_from_string(regular_file(path).read_bytes())
    versions = [item.version for item in model.opset_import if item.domain in ("", "ai.onnx")]
    opset = max(versions, default=0)
    if opset < OLDEST_OPSET:
        raise BadInputError(
            f"the graph uses ONNX operator set {opset}; export the network with operator set "
            f"{OLDEST_OPSET} or later"
        )
    if named := [each.key for each in model.metadata_props]:
        warn(
            f"{path.name}: the metadata {shortened(', '.join(named))} are not applied; scales and "
            "the order of states and inputs are those of the graph"
        )
    return model.graph


def graph_functions(
    path: Path, states: int, inputs: int, outputs: Mapping[str, str]
) -> GraphFunctions:
    """Convert the ONNX graph in a file to functions of one state, and of many states.

    path: path of the file. External weights are read from files in its folder
    states: number of states of the plant
    inputs: number of inputs of the plant
    outputs: requested kind -> name of an output of the graph, or "" for all

    Raises BadInputError if the package onnx is missing or the graph is not supported.
    """
    try:
        import onnx
    except ImportError as error:
        raise missing_package("ONNX files require", "onnx") from error
    graph = _graph_in(onnx, path)
    arrays: dict[str, Any]
    initializers = {tensor.name: tensor for tensor in graph.initializer}
    arrays, precision = _constants(onnx, initializers, path.parent)
    shapes = _inputs_of(graph, set(arrays), states, inputs)
    widths = [shape[-1] for shape in shapes.values()]
    x = ca.SX.sym("x", sum(widths))
    parts = np.split(np.fromiter(ca.vertsplit(x), object), np.cumsum(widths)[:-1])
    for (name, shape), part in zip(shapes.items(), parts, strict=True):
        arrays[name] = part.reshape(shape)
    products = Products(x)  # of large matrices, which NumPy computes for many states at once
    operators: dict[str, Callable[..., Any]] = {
        "MatMul": products.times,
        "Gemm": partial(_gemm, products.times),
        **_OPERATORS,
    }
    steps = [" and ".join(map(str, widths))]
    steps_of_nodes, precision_of_nodes = _evaluate(onnx, graph.node, operators, arrays)
    steps += steps_of_nodes
    functions = {}
    rows = {}
    for key, name in _outputs_of(graph, outputs).items():
        functions[key] = products.function(arrays[name])
        for_many_states = products.rows(arrays[name])
        if for_many_states is not None:
            rows[key] = for_many_states
    lowest_precision = min(precision, precision_of_nodes)  # float32 before float64
    return GraphFunctions(functions, rows, lowest_precision, " -> ".join(steps))


def _evaluate(
    onnx: Any,
    nodes: Iterable[Any],
    operators: Mapping[str, Callable[..., Any]],
    arrays: dict[str, Any],
) -> tuple[list[str], str]:
    """Evaluate the nodes of a graph in order, and add their results to `arrays`."""
    steps = []
    precision = "float64"
    scalars = 0
    constants = 0
    for node in nodes:
        results, node_precision = _evaluated(onnx, operators, node, arrays)
        size = sum(result.size for result in results)
        is_symbolic = any(result.dtype == object for result in results)
        if is_symbolic:
            scalars += size
        else:
            constants += size
        if scalars > _MOST_SCALARS or constants > LARGEST_NETWORK:
            raise BadInputError(
                f"the graph has at least {scalars} entries that depend on the state (at most "
                f"{_MOST_SCALARS} are supported) and {constants} constant entries (at most "
                f"{LARGEST_NETWORK}); give a smaller network"
            )
        arrays |= dict(zip(node.output, results, strict=False))
        precision = min(precision, node_precision)  # float32 before float64
        if node.op_type not in _ARRANGING and is_symbolic:
            steps.append(f"{node.op_type} {size}")
    return steps, precision


def _inputs_of(
    graph: Any, constants: set[str], state_count: int, input_count: int
) -> dict[str, tuple[int, ...]]:
    """Return the shape of each input of a graph for one row, by name.

    A single input is z, or [z u] of a Q function. Two inputs are z and u of a Q function. Raises
    BadInputError for other inputs.
    """
    shapes = _shapes_in(graph, constants)
    if len(shapes) not in (1, 2) or not graph.output:
        raise BadInputError(
            f"the graph has {len(shapes)} inputs and {len(graph.output)} outputs; give a graph "
            "with at least one output and the state as input (for a Q function, also the plant "
            "input)"
        )
    one_row_shapes: dict[str, tuple[int, ...]] = {}
    for (name, shape), width in zip(shapes.items(), (state_count, input_count), strict=False):
        _refuse_rows(name, shape)
        columns = shape[-1] or width  # an open dimension has the width of the plant
        if len(shapes) == 1:
            check_width(columns, state_count, input_count)
        elif columns != width:
            raise BadInputError(
                f"input {shortened(name)!r} of the graph has {columns} entries instead of "
                f"{width}; give a Q function with two inputs: the state ({state_count} entries), "
                f"then the plant input ({input_count} entries)"
            )
        one_row_shapes[name] = (columns,) if len(shape) == 1 else (1, columns)
    return one_row_shapes


def _shapes_in(graph: Any, constants: set[str]) -> dict[str, list[int]]:
    """Return the shape of each input of a graph as stored, by name, with 0 for open dimensions."""
    return {
        item.name: [axis.dim_value for axis in item.type.tensor_type.shape.dim]
        for item in graph.input
        if item.name not in constants
    }


def _refuse_rows(name: str, shape: list[int]) -> None:
    """Raise BadInputError unless an input of a graph is a vector or accepts one row."""
    if len(shape) not in (1, 2) or (len(shape) == 2 and shape[0] > 1):
        raise BadInputError(
            f"input {shortened(name)!r} of the graph has the shape {shape}; export the network "
            "for one row per input"
        )


def check_width(width: int, states: int, inputs: int) -> None:
    """Raise BadInputError unless a network has one input for each state.

    A Q must have one input for each state and input of the plant.

    width: number of inputs of the network
    states, inputs: number of states and of inputs of the plant. inputs = 0 excludes a Q
    """
    if width == states:
        return
    if inputs == 0:
        raise BadInputError(
            f"the network has {width} inputs, but {states} observations are given; list the "
            "observations of the training"
        )
    if width != states + inputs:
        raise BadInputError(
            f"the network has {width} inputs; give {states} (the states of the plant) or, for a "
            f"Q function, {states + inputs} (states and inputs of the plant)"
        )


def _constants(
    onnx: Any, tensors: Mapping[str, Any], folder: Path | None = None
) -> tuple[dict[str, np.ndarray], str]:
    """Return the arrays of ONNX tensors by name, and the precision of their weights."""
    arrays = {}
    for name, tensor in tensors.items():
        if tensor.data_location == onnx.TensorProto.EXTERNAL:
            with prefix_errors(f"tensor {shortened(name)!r}"):
                arrays[name] = _external(onnx, tensor, folder)
        else:
            arrays[name] = onnx.numpy_helper.to_array(tensor)
    return checked_tensors(arrays)


def _external(onnx: Any, tensor: Any, folder: Path | None) -> np.ndarray:
    """Return the array of a tensor stored in a separate file."""
    entries = {entry.key: entry.value for entry in tensor.external_data}
    location = entries.get("location", "")
    beside = folder is not None and (folder / location).resolve().parent == folder.resolve()
    if folder is None or not beside:
        raise BadInputError(
            f"tensor {shortened(tensor.name)!r} is stored outside the folder of the graph; export "
            "the weights in the same file (torch: external_data=False)"
        )
    path = regular_file(folder / location)
    dtype = np.dtype(onnx.helper.tensor_dtype_to_np_dtype(tensor.data_type))
    count = math.prod(tensor.dims)
    values = np.fromfile(path, dtype, count, offset=int(entries.get("offset", 0)))
    return values.reshape(tuple(tensor.dims))


def _evaluated(
    onnx: Any,
    operators: Mapping[str, Callable[..., Any]],
    node: Any,
    arrays: Mapping[str, Any],
) -> tuple[list[np.ndarray], str]:
    """Return the outputs of a node and the precision of its constant."""
    name = node.op_type
    if node.domain not in ("", "ai.onnx"):
        name = f"{node.domain}.{name}"
    if name not in operators:
        raise BadInputError(
            f"operator {shortened(name)} is not supported; export a network that uses only "
            f"{', '.join(operators)}"
        )
    attributes = {item.name: onnx.helper.get_attribute_value(item) for item in node.attribute}
    attributes = {
        key: value.decode() if isinstance(value, bytes) else value
        for key, value in attributes.items()
    }
    if name == "Split":
        attributes.setdefault("num_outputs", len(node.output))
    precision = "float64"
    if name == "Constant" and "value" in attributes:
        attributes, precision = _constants(onnx, attributes)
    inputs = [arrays[item] if item else None for item in node.input]
    _refuse_unread(name, operators[name], inputs, attributes)
    _refuse_more(name, _size_of(name, inputs, attributes), inputs)
    outputs = operators[name](*inputs, **attributes)
    results = [np.asarray(part) for part in (outputs if isinstance(outputs, tuple) else [outputs])]
    for index, result in enumerate(results):
        if result.dtype == object and not any(isinstance(entry, ca.SX) for entry in result.flat):
            results[index] = np.array(result.tolist())
    return results, precision


def _refuse_unread(
    name: str, operator: Callable[..., Any], inputs: list[Any], attributes: Mapping[str, Any]
) -> None:
    """Raise BadInputError unless the function of an operator accepts its inputs and attributes."""
    try:
        rule = signature(getattr(operator, "pyfunc", operator))
    except ValueError:  # functions of NumPy, which accept only arrays
        return
    try:
        rule.bind(*inputs, **attributes)
    except TypeError as error:
        how = ", ".join(attributes) or "none"
        raise BadInputError(
            f"operator {name} with {len(inputs)} inputs and the attributes {shortened(how)} is not "
            f"supported ({error}); export the network without this operator"
        ) from error


def _size_of(name: str, inputs: list[Any], attributes: Mapping[str, Any]) -> int:
    """Return the number of entries of an operator's result, before the result is computed."""
    if name == "Gather":
        x, places = inputs
        return x.size // max(x.shape[attributes.get("axis", 0)], 1) * np.size(places)
    shapes = [np.shape(array) for array in inputs if array is not None]
    if name in _PRODUCTS:
        first, second = shapes[:2]
        summed = max(first[0] if attributes.get("transA") else first[-1], 1)
        return (math.prod(first) // summed) * (math.prod(second) // summed)
    if name in _ELEMENTWISE:
        return math.prod(np.broadcast_shapes(*shapes))
    return 0


def _refuse_more(name: str, size: int, inputs: Any) -> None:
    """Raise BadInputError if the result of an operator would be too large."""
    is_symbolic = any(np.asarray(array).dtype == object for array in inputs if array is not None)
    most = _MOST_SCALARS if is_symbolic else LARGEST_NETWORK
    if size > most:
        raise BadInputError(
            f"operator {name} requires {size:.3g} array elements, but at most {most} are "
            "supported; give a smaller network"
        )


def _outputs_of(graph: Any, outputs: Mapping[str, str]) -> dict[str, str]:
    """Return the requested outputs of a graph, as key -> name of the output."""
    names = [item.name for item in graph.output]
    found = {}
    for kind, output in outputs.items():
        if output and output not in names:
            raise BadInputError(
                f"the graph has no output {shortened(output)!r}; choose from "
                f"{shortened(', '.join(names))}"
            )
        if output:
            found[kind] = output
        elif len(names) == 1:
            found[kind] = names[0]
        else:
            found |= {name: name for name in names}
    return found
