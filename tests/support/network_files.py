"""Writers of network files in the formats of ONNX, torch and safetensors, without torch."""

import json
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from cli import refused

from hfa import Game, from_network

#: Nodes of z'Pz: x P, multiplied by x, summed.
QUADRATIC = [("MatMul", "x P", "h"), ("Mul", "x h", "terms"), ("MatMul", "terms ones", "y")]
ONES = np.ones((6, 1))
_STORAGE = {
    "float16": b"HalfStorage",
    "float32": b"FloatStorage",
    "float64": b"DoubleStorage",
    "int64": b"LongStorage",
}


def onnx_file(path, nodes, constants, outputs=1, states=6, inputs=0, opset=20):
    """Write an ONNX graph and return its path.

    The graph maps "x" (1, states), and "u" (1, inputs) if `inputs` is not 0, to "y" (1, outputs).

    nodes: (operator, inputs, output, attributes if any); names of inputs are separated by blanks
    constants: name -> array
    """
    onnx = pytest.importorskip("onnx", reason="the package onnx is not installed")
    kinds = {
        "float32": onnx.TensorProto.FLOAT,
        "float64": onnx.TensorProto.DOUBLE,
        "float16": onnx.TensorProto.FLOAT16,
    }
    found = {name: np.asarray(value) for name, value in constants.items()}
    kind = next(
        (kinds[str(each.dtype)] for each in found.values() if each.dtype.kind == "f"),
        kinds["float32"],
    )
    graph = onnx.helper.make_graph(
        [
            onnx.helper.make_node(
                operator, inputs.split(), output.split(), **(more[0] if more else {})
            )
            for operator, inputs, output, *more in nodes
        ],
        "critic",
        [
            onnx.helper.make_tensor_value_info(name, kind, [1, width])
            for name, width in {"x": states, "u": inputs}.items()
            if width
        ],
        [onnx.helper.make_tensor_value_info("y", kind, [1, outputs])],
        [onnx.numpy_helper.from_array(each, name) for name, each in found.items()],
    )
    model = onnx.helper.make_model(
        graph, opset_imports=[onnx.helper.make_opsetid("", opset)], ir_version=9
    )
    onnx.save(model, str(path))
    return str(path)


def torch_file(path, tensors):
    """Write a state dict in the format of torch.save, opcode by opcode, and return its path."""

    def text(value):
        return b"X" + struct.pack("<I", len(value)) + value.encode()

    def whole(*values):
        return b"(" + b"".join(b"J" + struct.pack("<i", each) for each in values) + b"t"

    parts = [b"\x80\x02ccollections\nOrderedDict\n)R"]
    arrays = {name: np.asarray(value) for name, value in tensors.items()}
    for key, (name, each) in enumerate(arrays.items()):
        storage = b"ctorch\n" + _STORAGE[str(each.dtype)] + b"\n"
        size = struct.pack("<i", each.size)
        pid = b"(" + text("storage") + storage + text(str(key)) + text("cpu") + b"J" + size + b"tQ"
        strides = [step // each.itemsize for step in each.copy(order="C").strides]
        view = (
            pid
            + b"J\0\0\0\0"
            + whole(*each.shape)
            + whole(*strides)
            + b"\x89ccollections\nOrderedDict\n)R"
        )
        parts.append(text(name) + b"ctorch._utils\n_rebuild_tensor_v2\n(" + view + b"tRs")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("critic/data.pkl", b"".join(parts) + b".")
        for key, each in enumerate(arrays.values()):
            archive.writestr(f"critic/data/{key}", each.tobytes())
    return str(path)


def safetensors_file(path, tensors):
    """Write a safetensors file, a JSON header followed by the numbers, and return its path."""
    header = {}
    body = b""
    for name, value in tensors.items():
        each = np.asarray(value)
        kind = {"float32": "F32", "float64": "F64", "float16": "F16", "uint16": "BF16"}[
            str(each.dtype)
        ]
        header[name] = {
            "dtype": kind,
            "shape": list(each.shape),
            "data_offsets": [len(body), len(body) + each.nbytes],
        }
        body += each.tobytes()
    said = json.dumps(header).encode()
    Path(path).write_bytes(struct.pack("<Q", len(said)) + said + body)
    return str(path)


def chain(names, widths, rng):
    """Return random weights and biases of linear layers.

    names: names of the layers, such as "actor.0"
    widths: numbers of inputs and outputs of the layers, one more than names
    """
    tensors = {}
    for name, takes, gives in zip(names, widths[:-1], widths[1:], strict=True):
        tensors[f"{name}.weight"] = rng.normal(size=(gives, takes))
        tensors[f"{name}.bias"] = rng.normal(size=gives)
    return tensors


def output_of(tensors, names, activation, x):
    """Return the output of the layers with these names for states x, (n,) or (N, n)."""
    h = np.asarray(x)
    for name in names:
        h = h @ tensors[f"{name}.weight"].T + tensors[f"{name}.bias"]
        h = activation(h) if name != names[-1] else h
    return h


def square_layers(*names):
    """Return the weights of a network 6-6-...-1 whose layers have these names, so that any order of
    the layers before the last is possible.
    """
    rng = np.random.default_rng(4)
    layers = {f"{name}.weight": rng.normal(size=(6, 6)) for name in names[:-1]}
    return layers | {f"{names[-1]}.weight": np.ones((1, 6))}


def read(path, *, states=6, inputs=5, **how):
    """Return the network in a file as a critic of a plant with these numbers of states and inputs.

    how: keyword arguments of `from_network`
    """
    B = np.ones((states, inputs))
    game = Game(-np.eye(states), B, Q=np.ones(states), R=np.ones(inputs))
    return from_network(game, path, **how)


def refusal(path, **how):
    """Return the message with which a file is refused: one line that begins with the path.

    how: keyword arguments of `read`
    """
    said = refused(read, path, **how)
    assert said.startswith(str(path))
    return said
