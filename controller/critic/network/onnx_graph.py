"""ONNX graphs of feed-forward networks as CasADi functions of one state.

Each value of the graph is a row: only its last axis has more than one entry.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import reduce
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.network.layers import ACTIVATIONS, hard_sigmoid
from controller.critic.network.tensors import (
    LARGEST_NETWORK,
    BFloat16,
    checked_tensors,
    lowest,
    parsed,
)
from hfa_support.errors import BadInputError, missing_package, shortened
from hfa_support.files import regular_file

#: Oldest supported ONNX operator set.
OLDEST_OPSET = 9
#: Type numbers of ONNX: float, float16, double and bfloat16.
_FLOAT_TYPES = (1, 10, 11, 16)
#: Kind of output -> names of outputs of this kind.
_NAMES_OF_OUTPUTS = {
    "policy": ("policy", "action", "actions", "u", "mu", "mean"),
    "V": ("V", "value", "values", "v"),
    "gradient": ("gradient",),
}


def _product(a: Any, b: Any) -> Any:
    """Return the product of a row and a matrix, or of two matrices."""
    if a.shape[1] != b.shape[0]:
        raise BadInputError(f"multiplies {a.shape} and {b.shape}")  # the caller names the operator
    return a @ b


def _gemm(
    a: Any,
    b: Any,
    c: Any = 0.0,
    alpha: float = 1.0,
    beta: float = 1.0,
    transA: int = 0,
    transB: int = 0,
) -> Any:
    """Return alpha A B + beta c, with A or B transposed on request."""
    return alpha * _product(a.T if transA else a, b.T if transB else b) + beta * c


def _clip(x: Any, low: Any = None, high: Any = None, **ends: float) -> Any:
    """Return x limited to low and high, which old operator sets have as attributes min and max."""
    low = ends.pop("min", low)
    high = ends.pop("max", high)
    if ends:
        raise BadInputError(f"has the attributes {', '.join(ends)}")
    x = x if low is None else ca.fmax(x, low)
    return x if high is None else ca.fmin(x, high)


def _sum(x: Any, axes: Any = None, keepdims: int = 1, noop_with_empty_axes: int = 0) -> Any:
    """Return the sum of a row's entries; without axes, the row if `noop_with_empty_axes` is set."""
    is_unchanged = noop_with_empty_axes and not np.size(() if axes is None else axes)
    return x if is_unchanged else ca.sum2(x)


def _mean(x: Any, *axes: Any, **how: int) -> Any:
    """Return the mean of the entries of a row, or the row itself, where `_sum` returns it.

    `_sum` returns one entry, to divide by the number of entries, or the row, to divide by 1.
    """
    total = _sum(x, *axes, **how)
    return total * (total.numel() / x.numel())


def _layer_norm(
    x: Any, scale: Any, bias: Any = 0.0, axis: int = -1, epsilon: float = 1e-5, stash_type: int = 1
) -> Any:
    """Return a row with the mean 0 and the variance 1 of its entries, times scale, plus bias."""
    # A row has one axis of entries, and arithmetic is in doubles: axis and stash_type, the
    # precision of ONNX, are not read.
    centred = x - ca.sum2(x) / x.numel()
    variance = ca.sum2(centred**2) / x.numel()
    return centred / ca.sqrt(variance + epsilon) * scale + bias


def _batch_norm(
    x: Any,
    scale: Any,
    bias: Any,
    mean: Any,
    variance: Any,
    epsilon: float = 1e-5,
    momentum: float = 0.9,
    training_mode: int = 0,
) -> Any:
    """Return a row normalized by the mean and the variance of the training, scaled and shifted."""
    if training_mode:
        raise BadInputError("is in training mode; call eval() on the network before the export")
    return (x - mean) / ca.sqrt(variance + epsilon) * scale + bias


def _slice(x: Any, starts: Any, ends: Any, axes: Any = None, steps: Any = None) -> Any:
    """Return the entries of a row from start to end. Of several axes, the last is that of a row."""
    step = 1 if steps is None else np.ravel(steps)[-1]
    # Negative and too large places mean the same as in a list of Python.
    columns = slice(int(np.ravel(starts)[-1]), int(np.ravel(ends)[-1]), int(step))
    return x[:, list(range(x.numel()))[columns]]


def _gather(x: Any, places: Any, axis: int = 0) -> Any:
    """Return the entries of a row at some places. `_refuse_shape` refuses another axis."""
    return x[:, [int(place) for place in np.ravel(places)]]


def _cast(x: Any, to: int, saturate: int = 1) -> Any:
    """Return a row unchanged, whatever float it is converted to: arithmetic is in doubles."""
    if to not in _FLOAT_TYPES:
        raise BadInputError(f"converts to the ONNX type number {to}, not to a float")
    return x


def _same(x: Any, *_: Any, **__: Any) -> Any:
    """Return a row unchanged, of an operator that only arranges its entries."""
    return x


#: Operators that only arrange numbers. The chain of a network omits them. The row of Split is cut
#: into the widths of its results.
_ARRANGING = (
    *("Identity", "Flatten", "Reshape", "Squeeze", "Unsqueeze", "Transpose", "Split", "Expand"),
)
#: Operator of a graph that is no function u(x) of one row -> what such a graph does.
_NO_FUNCTION = {
    **dict.fromkeys(("Loop", "Scan", "If"), "has a loop or a branch"),
    **dict.fromkeys(("LSTM", "GRU", "RNN"), "is recurrent"),
    **dict.fromkeys(("ArgMax", "TopK", "Multinomial"), "chooses one of several discrete actions"),
}
#: Operator -> function of rows (1, k) and constants, with attributes as keywords. Axes are not
#: examined: a result must have the shape that the ONNX package computes, and be a row.
_OPERATORS: Mapping[str, Callable[..., Any]] = {
    "MatMul": _product,
    "Gemm": _gemm,
    "Add": operator.add,
    "Sub": operator.sub,
    "Mul": operator.mul,
    "Div": operator.truediv,
    "Pow": operator.pow,
    "Neg": operator.neg,
    **{name: ACTIVATIONS[name.lower()] for name in ("Tanh", "Relu", "Sigmoid", "Softplus", "Elu")},
    **{name: ACTIVATIONS[name.lower()] for name in ("Selu", "Gelu", "Sin", "HardSwish", "Mish")},
    "Softsign": ACTIVATIONS["softsign"],
    "LeakyRelu": ACTIVATIONS["leaky_relu"],
    **{name: getattr(ca, name.lower()) for name in ("Erf", "Exp", "Sqrt", "Log", "Cos")},
    "Abs": ca.fabs,
    "Reciprocal": lambda a: 1.0 / a,
    "HardSigmoid": lambda a, alpha=0.2, beta=0.5: hard_sigmoid(a, alpha, beta),
    "Min": lambda *parts: reduce(ca.fmin, parts),
    "Max": lambda *parts: reduce(ca.fmax, parts),
    "Clip": _clip,
    "Greater": operator.gt,  # Greater and Where are in torch's Softplus
    "Where": ca.if_else,
    "ReduceSum": _sum,
    "ReduceMean": _mean,
    "LayerNormalization": _layer_norm,
    "BatchNormalization": _batch_norm,
    "Concat": lambda *parts, axis: ca.horzcat(*parts),
    "Slice": _slice,
    "Gather": _gather,
    "Cast": _cast,
    **dict.fromkeys(_ARRANGING, _same),
}
#: Operators whose results are constants: also the shape of a row.
_CONSTANT_OPERATORS = ("Constant", "Shape", "ConstantOfShape", "Equal")
#: Operators with places or axes among their arguments, which stay arrays of integers.
_WITH_INTEGERS = ("ReduceSum", "ReduceMean", "Slice", "Gather", *_ARRANGING)
_ELEMENTWISE = ("Add", "Sub", "Mul", "Div", "Pow", "Greater", "Where", "Min", "Max")


class GraphFunctions(NamedTuple):
    """Functions of an ONNX graph.

    functions: requested kind, or name of the output -> function of x (states,)
    precision: lowest precision of the weights, such as "float32"
    operators: operators that depend on x with the sizes of their results, in one line
    notes: sentences on what the file contains and the functions do not use
    """

    functions: dict[str, ca.Function]
    precision: str
    operators: str
    notes: tuple[str, ...]


def graph_functions(path: Path, states: int, outputs: Mapping[str, str]) -> GraphFunctions:
    """Return the ONNX graph in a file as functions of one state.

    path: path of the file
    states: number of states of the plant
    outputs: kind -> name of an output, "" for the usual name of that kind; the kind "" takes all
        outputs by their names

    Raises BadInputError if the package onnx is missing or the graph is not supported.
    """
    try:
        import onnx
    except ImportError as error:
        raise missing_package("ONNX files require", "onnx") from error
    content = regular_file(path).read_bytes()
    model = parsed(lambda: onnx.load_from_string(content))
    _refuse_model(onnx, model)
    traced = _traced(onnx, model, states)
    x = ca.MX.sym("x", states)  # a column; the values of the graph are rows
    functions = {}
    chosen = _outputs_of(model.graph, outputs)
    for kind, name in chosen.items():
        row = traced.rows.get(name)
        if row is None:  # a constant output
            row = ca.MX(ca.DM(np.atleast_2d(traced.arrays[name])))
        value = ca.substitute(ca.densify(row.T), traced.input, x.T)
        functions[kind] = ca.Function("network", [x], [value])
    others = [item.name for item in model.graph.output if item.name not in chosen.values()]
    metadata = [f"metadata {entry.key}" for entry in model.metadata_props]
    unused = shortened(", ".join(others + metadata), 200)
    notes = (f"not used: {unused}",) if unused else ()
    return GraphFunctions(functions, traced.precision, traced.operators, notes)


class _Traced(NamedTuple):
    """Values of a graph, by name."""

    arrays: dict[str, np.ndarray]  # at the state 0
    rows: dict[str, ca.MX]  # those that depend on the input, (1, k)
    input: ca.MX  # symbols, (1, k)
    precision: str  # the lowest of the weights
    operators: str  # that depend on the input, with the sizes of their results


def _traced(onnx: Any, model: Any, states: int) -> _Traced:
    """Return the values of a graph for a plant, operator by operator."""
    graph = model.graph
    weights = {tensor.name: _array(onnx, tensor) for tensor in graph.initializer}
    arrays, precision = checked_tensors(weights)
    size = sum(array.size for array in arrays.values())
    given, shape = _input_of(graph, set(arrays), states)
    arrays[given] = np.zeros(shape)
    x = ca.MX.sym("x", 1, states)
    rows, operators = {given: x}, [str(states)]
    for node in graph.node:
        step = _Operator(onnx, model.opset_import, node)

        # Every value is an array at the state 0, which has its shape.
        results, precision_of_node = step.on_arrays(
            [arrays[name] if name else None for name in node.input]
        )
        arrays |= dict(zip(node.output, results, strict=True))
        precision = lowest({precision, precision_of_node})

        # A value that depends on the state is also a row of expressions.
        if step.name != "Shape" and any(name in rows for name in node.input):
            row = step.on_rows([rows.get(name, arrays.get(name)) for name in node.input])
            widths = [arrays[name].size for name in node.output]
            parts = (
                ca.horzsplit(row, np.cumsum([0, *widths]).tolist()) if len(widths) > 1 else [row]
            )
            for output, part in zip(node.output, parts, strict=True):
                _refuse_shape(step.name, arrays[output].shape, part)
                rows[output] = part
            if step.name not in (*_ARRANGING, "Cast"):
                operators.append(f"{step.name} {row.numel()}")

        size += sum(result.size for result in results)
        if size > LARGEST_NETWORK:
            raise BadInputError(
                f"the graph has more than {LARGEST_NETWORK} entries, the maximum; give a smaller "
                "network"
            )
    return _Traced(arrays, rows, x, precision, " -> ".join(operators))


def _array(onnx: Any, tensor: Any) -> np.ndarray:
    """Return a tensor of a graph as an array. NumPy has no bfloat16."""
    array = onnx.numpy_helper.to_array(tensor)
    if tensor.data_type == onnx.TensorProto.BFLOAT16:
        return np.asarray(array, dtype=np.float32).view(BFloat16)
    return np.asarray(array)


class _Operator:
    """Node of a graph: evaluated on arrays by the ONNX package, and on rows by `_OPERATORS`.

    name: type of the operator, such as "Gemm", with its domain unless it is one of ONNX
    """

    def __init__(self, onnx: Any, opsets: Any, node: Any) -> None:
        self._onnx = onnx
        self._opsets = opsets
        self._node = node
        is_of_onnx = node.domain in ("", "ai.onnx")
        self.name = node.op_type if is_of_onnx else f"{node.domain}.{node.op_type}"
        if self.name in _NO_FUNCTION:
            raise BadInputError(
                f"the graph {_NO_FUNCTION[self.name]} (operator {self.name}); export a "
                "feed-forward policy with continuous actions"
            )
        if self.name not in (*_OPERATORS, *_CONSTANT_OPERATORS):
            raise BadInputError(
                f"operator {shortened(self.name)} is not supported; export a network that uses "
                f"only {', '.join([*_OPERATORS, *_CONSTANT_OPERATORS])}"
            )

    def on_arrays(self, arguments: list[np.ndarray | None]) -> tuple[list[np.ndarray], str]:
        """Return the results for arrays, which the ONNX package computes, and their precision.

        The precision is "float64", except for the weights in an operator Constant.
        """
        from onnx.reference import ReferenceEvaluator

        self._refuse_size([array for array in arguments if array is not None])
        helper = self._onnx.helper
        inputs = {  # an argument without a name is optional and left out
            name: array for name, array in zip(self._node.input, arguments, strict=True) if name
        }
        of_inputs = [helper.make_empty_tensor_value_info(name) for name in inputs]
        of_outputs = [helper.make_empty_tensor_value_info(name) for name in self._node.output]
        graph = helper.make_graph([self._node], "node", of_inputs, of_outputs)
        single = helper.make_model(graph, opset_imports=self._opsets)
        with self._naming_operator(), np.errstate(all="ignore"):
            results = ReferenceEvaluator(single).run(None, inputs)
        arrays = dict(zip(self._node.output, map(np.asarray, results), strict=True))
        if inputs:
            doubles = [a.astype(float) if a.dtype.kind == "f" else a for a in arrays.values()]
            return doubles, "float64"
        checked, precision = checked_tensors(arrays)  # weights in the operator Constant
        return list(checked.values()), precision

    def on_rows(self, arguments: list[Any]) -> ca.MX:
        """Return the result for rows, which depend on the input, and for constant arrays."""
        if self.name not in _WITH_INTEGERS:
            arguments = [
                ca.DM(np.atleast_2d(value).astype(float))
                if isinstance(value, np.ndarray)
                else value
                for value in arguments
            ]
        values = self._onnx.helper.get_attribute_value
        attributes = {item.name: values(item) for item in self._node.attribute}
        keywords = {
            name: value.decode() if isinstance(value, bytes) else value
            for name, value in attributes.items()
        }
        with self._naming_operator():
            result: ca.MX = _OPERATORS[self.name](*arguments, **keywords)
            return result

    def _refuse_size(self, arrays: list[np.ndarray]) -> None:
        """Raise BadInputError if the result of arrays would be too large, before it is computed."""
        shapes = [array.shape for array in arrays]
        size = sum(math.prod(shape) for shape in shapes)  # bounds the result of most operators
        with self._naming_operator():
            if self.name == "Gather":
                size = math.prod(shapes[0]) * math.prod(shapes[1])
            elif self.name in ("ConstantOfShape", "Expand"):
                size *= math.prod(int(length) for length in np.ravel(arrays[-1]))
            elif self.name in ("MatMul", "Gemm"):
                size = max(shapes[0]) * max(shapes[1])  # in any order of the axes
            elif self.name in _ELEMENTWISE:
                size = math.prod(np.broadcast_shapes(*shapes))
        if size > LARGEST_NETWORK:
            raise BadInputError(
                f"operator {self.name} requires {size:.3g} array elements, but at most "
                f"{LARGEST_NETWORK} are supported; give a smaller network"
            )

    @contextmanager
    def _naming_operator(self) -> Iterator[None]:
        """Name the operator in the error of an operator that cannot be evaluated."""
        try:
            yield
        except Exception as error:  # CasADi, NumPy and the ONNX package raise any exception
            reason = shortened(" ".join(str(error).split()))
            raise BadInputError(
                f"operator {self.name} is not supported as it is used here ({reason}); export the "
                "network without it"
            ) from error


def _refuse_shape(name: str, shape: tuple[int, ...], row: ca.MX) -> None:
    """Raise BadInputError unless the result of an operator is a row with this shape.

    shape: shape of the result that the ONNX package computes
    row: the result as a row, computed along the last axis
    """
    if math.prod(shape[:-1]) != 1:
        raise BadInputError(
            f"operator {name} has a result of the shape {shape}, but only rows (1, k) are "
            "supported; export the network without it"
        )
    if row.shape != (1, math.prod(shape)):
        raise BadInputError(
            f"operator {name} acts on an axis other than the last, which is not supported; export "
            "the network without it"
        )


def _refuse_model(onnx: Any, model: Any) -> None:
    """Raise BadInputError for an old operator set and for weights in another file."""
    versions = [item.version for item in model.opset_import if item.domain in ("", "ai.onnx")]
    opset = max(versions, default=0)
    if opset < OLDEST_OPSET:
        raise BadInputError(
            f"the graph uses ONNX operator set {opset}; export the network with operator set "
            f"{OLDEST_OPSET} or later"
        )
    for tensor in model.graph.initializer:
        if tensor.data_location == onnx.TensorProto.EXTERNAL:
            raise BadInputError(
                f"tensor {shortened(tensor.name)!r} is stored in another file; export the weights "
                "in the same file (torch: external_data=False)"
            )


def _input_of(graph: Any, constants: set[str], states: int) -> tuple[str, tuple[int, ...]]:
    """Return the name of the input of a graph, and its shape for one row."""
    shapes = {
        item.name: [axis.dim_value for axis in item.type.tensor_type.shape.dim]  # 0 if it is open
        for item in graph.input
        if item.name not in constants
    }
    if len(shapes) != 1 or not graph.output:
        raise BadInputError(
            f"the graph has {len(shapes)} inputs and {len(graph.output)} outputs; give a graph "
            "with at least one output and the state as its input"
        )
    ((name, shape),) = shapes.items()
    if len(shape) not in (1, 2) or (len(shape) == 2 and shape[0] > 1):
        raise BadInputError(
            f"input {shortened(name)!r} of the graph has the shape {shape}; export the network "
            "for one row per input"
        )
    check_width(shape[-1] or states, states)  # an open dimension has the width of the plant
    return name, (states,) if len(shape) == 1 else (1, states)


def check_width(width: int, states: int) -> None:
    """Raise BadInputError unless a network has one input for each state or observation."""
    if width != states:
        raise BadInputError(
            f"the network has {width} inputs, but {states} are given: the states of the plant, or "
            "the observations of a deployment file (docs/policy.md)"
        )


def _outputs_of(graph: Any, outputs: Mapping[str, str]) -> dict[str, str]:
    """Return the requested outputs of a graph, kind -> name of the output.

    The kind "", of no request, stands for all outputs whose names tell their kinds, or for all.
    """
    names = [item.name for item in graph.output]
    by_kind = {  # the first output of each kind, as the last item of a dictionary counts
        kind: name
        for kind, known in _NAMES_OF_OUTPUTS.items()
        for name in names[::-1]
        if name in known
    }
    chosen = {}
    for kind, output in outputs.items():
        if output and output not in names:
            raise BadInputError(
                f"the graph has no output {shortened(output)!r}; choose from "
                f"{shortened(', '.join(names))}"
            )
        if output or len(names) == 1:
            chosen[kind] = output or names[0]
        elif not kind:
            chosen |= by_kind or {name: name for name in names}
        elif kind in by_kind:
            chosen[kind] = by_kind[kind]
        else:
            words = f"{kind}={names[0]}"
            raise BadInputError(
                f"the graph has the outputs {shortened(', '.join(names))}; select one, for example "
                f'by network="{shortened(words)}"',
                ("--network", words),
            )
    return chosen
