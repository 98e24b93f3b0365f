"""ONNX graphs: operators, external data and refused graphs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import hfa
from game_files import AT_15
from network_files import ONES, QUADRATIC, onnx_file, read, refusal, torch_file

RNG = np.random.default_rng(0)
X = RNG.normal(size=(7, 6)).astype("float32")
pytestmark = pytest.mark.usefixtures("folder")


def assert_as_onnx_runtime(path: str, **tolerance: float) -> None:
    runtime = pytest.importorskip("onnxruntime", reason="the package onnxruntime is not installed")
    session = runtime.InferenceSession(path, providers=["CPUExecutionProvider"])
    (states,), (outputs,) = session.get_inputs(), session.get_outputs()
    policy = read(path, inputs=outputs.shape[1], network="policy=").policy
    for x in 3.0 * X:
        theirs = session.run(None, {states.name: x[None]})[0].ravel()
        assert np.array(policy(x)).ravel() == pytest.approx(theirs, **tolerance)


def test_a_wide_graph_equals_onnxruntime() -> None:
    """Large products, of rows and of several vectors, are not expanded; branches meet again."""
    rng = np.random.default_rng(9)
    sizes = {"W": (6, 90), "V": (90, 90), "U": (45, 100), "B": (200, 3), "c": (1, 90)}
    constants = {
        name: (rng.normal(size=shape) / np.sqrt(shape[0])).astype("float32")
        for name, shape in sizes.items()
    }
    constants |= {"pairs": np.array([1, 2, 45]), "row": np.array([1, 200])}
    nodes: list[tuple[Any, ...]] = [
        ("MatMul", "x W", "a"),
        ("Tanh", "a", "h"),
        ("Gemm", "h V c", "g", {"transB": 1, "alpha": 0.5, "beta": 2.0}),
        ("Mul", "g h", "m"),
        ("Reshape", "m pairs", "p"),
        ("MatMul", "p U", "q"),
        ("Sin", "q", "s"),
        ("Reshape", "s row", "r"),
        ("MatMul", "r B", "y"),
    ]
    path = onnx_file("wide.onnx", nodes, constants, 3)
    assert_as_onnx_runtime(path, rel=1e-4, abs=1e-4)
    assert read(path, inputs=3).policy.is_a("MXFunction")


@pytest.mark.parametrize("opset", [9, 11, 13, 20])
def test_old_and_new_operator_sets_equal_onnxruntime(opset: int) -> None:
    """Graphs of old and of new operator sets give the results of onnxruntime."""
    axes = {"axes": [0]} if opset < 13 else {}
    nodes: list[tuple[Any, ...]] = [
        ("Flatten", "x", "f", {"axis": 1}),
        ("MatMul", "f W", "m"),
        ("Add", "m b", "a"),
        ("Tanh", "a", "t"),
        ("Squeeze", "t" if opset < 13 else "t zero", "s", axes),
        ("Unsqueeze", "s" if opset < 13 else "s zero", "w", axes),
        ("Cast", "w", "c", {"to": 1}),
        ("Gather", "c place", "g", {"axis": 1}),
        ("Clip", "g", "k", {"min": -0.5, "max": 0.5})
        if opset < 11
        else ("Clip", "g low high", "k"),
        ("Erf", "k", "e"),
        ("Identity", "e", "y"),
    ]
    constants = {
        key: RNG.normal(size=size).astype("float32")
        for key, size in {"W": (6, 4), "b": (4,)}.items()
    }
    constants |= {"place": np.array([0, 2]), "zero": np.array([0])}
    constants |= {"low": np.array(-0.5, "float32"), "high": np.array(0.5, "float32")}
    used = {word for _, inputs, *_ in nodes for word in inputs.split()}
    constants = {name: each for name, each in constants.items() if name in used}
    assert_as_onnx_runtime(onnx_file("a.onnx", nodes, constants, 2, opset=opset), abs=1e-6)


@pytest.mark.parametrize("seven", [7, -7])
def test_integer_division_in_a_graph_is_truncated(seven: int) -> None:
    """The quotient of integers in a graph is truncated: 7 / 2 = 3, and -7 / 2 = -3."""
    nodes = [
        ("Div", "seven two", "three"),
        ("Slice", "x begin three axis", "part"),
        ("ReduceSum", "part axis", "y"),
    ]
    constants = {
        "seven": np.array([seven]),
        "two": np.array([2]),
        "begin": np.array([0]),
        "axis": np.array([1]),
    }
    path = onnx_file("div.onnx", nodes, constants)
    assert float(read(path).value(np.arange(1.0, 7.0))) == 6.0


def test_external_weights_are_read_from_the_graphs_folder() -> None:
    """External weights are read from the graph's folder.

    A path or a symbolic link to another folder is refused.
    """
    onnx = pytest.importorskip("onnx", reason="the package onnx is not installed")
    constants = {"P": np.diag(np.arange(1.0, 7.0)), "ones": ONES}
    for folder in ("inside", "elsewhere"):
        Path(folder).mkdir()
    model = onnx.load(onnx_file("graph.onnx", QUADRATIC, constants))
    onnx.save(
        model, "inside/a.onnx", save_as_external_data=True, location="a.data", size_threshold=0
    )
    assert (Path("inside") / "a.data").exists()
    assert float(read("inside/a.onnx").value(np.ones(6))) == 21.0
    Path("inside/a.data").rename("elsewhere/a.data")
    assert "cannot be read (No such file" in refusal("inside/a.onnx")
    Path("inside/a.data").symlink_to("../elsewhere/a.data")
    assert "is stored outside the folder of the graph" in refusal("inside/a.onnx")
    model = onnx.load("inside/a.onnx", load_external_data=False)
    for tensor in model.graph.initializer:
        next(
            entry for entry in tensor.external_data if entry.key == "location"
        ).value = "../elsewhere/a.data"
    Path("inside/b.onnx").write_bytes(model.SerializeToString())
    assert (
        "is stored outside the folder of the graph; export the weights in the same file"
        in refusal("inside/b.onnx")
    )


def test_wrong_graphs_are_refused() -> None:
    """ONNX graphs with wrong sizes, types, operators or numbers are refused."""
    pytest.importorskip("onnx", reason="the package onnx is not installed")
    constants = {"P": np.eye(6, dtype="float32"), "ones": ONES.astype("float32")}
    half = {name: each.astype("float16") for name, each in constants.items()}
    ten = {"P": np.ones((10, 1), "float32")}
    not_a_number = {"P": np.full((6, 6), np.nan, "float32")}
    for said, nodes, numbers, states in (
        ("has 10 inputs", [("MatMul", "x P", "y")], ten, 10),
        ("Cast to the ONNX type number 10", [("Cast", "x", "y", {"to": 10})], constants, 6),
        (
            "BatchNormalization is in training mode",
            [("BatchNormalization", "x o o o o", "y", {"training_mode": 1})],
            {"o": np.ones(6, "float32")},
            6,
        ),
        ("operator Loop is not supported", [("Loop", "x", "y")], constants, 6),
        ("has the type float16; save the weights as float32", QUADRATIC, half, 6),
        ("not finite", QUADRATIC, constants | not_a_number, 6),
    ):
        assert said in refusal(onnx_file("wrong.onnx", nodes, numbers, states=states))
    onnx_file("good.onnx", QUADRATIC, constants)
    read("good.onnx")
    assert (
        "an ONNX file already contains the activations"
        in hfa("verify", *AT_15, "--weights", "good.onnx", "--set", "activation=tanh").err
    )
    Path("damaged.onnx").write_bytes(Path("good.onnx").read_bytes()[:-40])
    assert "is damaged or is not a network" in refusal("damaged.onnx")


def test_without_onnx_only_onnx_files_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without the package onnx, ONNX files are refused and torch files are read."""
    monkeypatch.setitem(sys.modules, "onnx", None)
    Path("a.onnx").write_bytes(b"")
    assert "ONNX files require the package onnx; type python -m pip install onnx" in refusal(
        "a.onnx"
    )
    read(torch_file("a.pt", {"weight": np.zeros((5, 6))}))


#: Operators of x alone, some with attributes.
_UNARY: list[tuple[str, dict[str, Any]]] = [
    *((name, {}) for name in ("Neg", "Tanh", "Relu", "LeakyRelu", "Sigmoid", "Softplus", "Elu")),
    *((name, {}) for name in ("Selu", "Gelu", "Sin", "Erf", "Exp", "Identity")),
    ("Elu", {"alpha": 0.7}),
    ("Selu", {"alpha": 1.5, "gamma": 1.1}),
    ("LeakyRelu", {"alpha": 0.2}),
    ("Gelu", {"approximate": "tanh"}),
    ("Transpose", {"perm": [0, 1]}),
]
#: The first state at which graphs are compared: equal to it, and above and below.
_FIRST = {"c": (3.0 * X)[:1]}
_FLAT = ("Reshape", "h flat", "y")
_WEIGHTS = RNG.normal(size=(6, 4)).astype("float32")
#: Graphs with one operator each, compared with ONNX Runtime: nodes, constants, outputs.
GRAPHS: dict[str, tuple[list[tuple[Any, ...]], dict[str, Any], int]] = {
    **{f"{name} {how or ''}": ([(name, "x", "y", how)], {}, 6) for name, how in _UNARY},
    **{name: ([(name, "x c", "y")], _FIRST, 6) for name in ("Add", "Sub", "Mul", "Div")},
    "Where": (
        [("Greater", "x c", "b"), ("Where", "b two x", "y")],
        _FIRST | {"two": np.float32(2)},
        6,
    ),
    **{
        f"{name} {keepdims}": (
            [(name, "x axes", "r", {"keepdims": keepdims}), ("Reshape", "r one_row", "y")],
            {"axes": np.array([1]), "one_row": np.array([1, 1])},
            1,
        )
        for name in ("ReduceSum", "ReduceMean")
        for keepdims in (0, 1)
    },
    "ReduceSum of all": ([("ReduceSum", "x", "y")], {}, 1),
    "Pow": ([("Pow", "x two", "y")], {"two": np.float32(2)}, 6),
    "Sqrt": ([("Relu", "x", "a"), ("Sqrt", "a", "y")], {}, 6),
    "Gemm": (
        [("Gemm", "x W c", "y", {"transB": 1, "alpha": 0.5, "beta": 2.0})],
        {"W": _WEIGHTS.T, "c": _WEIGHTS[0]},
        4,
    ),
    "Gemm of a transposed matrix": (
        [("Gemm", "W x", "h", {"transA": 1, "transB": 1}), _FLAT],
        {"W": _WEIGHTS, "flat": np.array([1, 4])},
        4,
    ),
    "Reshape": (
        [("Reshape", "x sizes", "h"), _FLAT],
        {"sizes": np.array([0, 2, -1]), "flat": np.array([1, 6])},
        6,
    ),
    "Slice backwards": (
        [("Slice", "x begin end axes steps", "y")],
        {
            "begin": np.array([4]),
            "end": np.array([0]),
            "axes": np.array([1]),
            "steps": np.array([-2]),
        },
        2,
    ),
    "Slice of all axes": (
        [("Slice", "x begin end", "y")],
        {"begin": np.array([0, 2]), "end": np.array([1, 5])},
        3,
    ),
    "Split in three": (
        [("Split", "x sizes", "a b c", {"axis": 1}), ("Concat", "c a b", "y", {"axis": 1})],
        {"sizes": np.array([1, 2, 3])},
        6,
    ),
    "Cast of integers": (
        [("Cast", "n", "f", {"to": 1}), ("Mul", "x f", "y")],
        {"n": np.array([7])},
        6,
    ),
    "Clip": ([("Clip", "x low high", "y")], {"low": np.float32(-0.5), "high": np.float32(1.5)}, 6),
    "LayerNormalization": (
        [("LayerNormalization", "x c two_c", "y", {"epsilon": 1e-4})],
        {"c": _FIRST["c"][0], "two_c": 2.0 * _FIRST["c"][0]},
        6,
    ),
    "BatchNormalization": (
        [("BatchNormalization", "x c c two_c spread", "y")],
        {"c": X[0], "two_c": 2.0 * X[1], "spread": X[2] ** 2 + np.float32(0.5)},
        6,
    ),
    "ReduceSum of none": (
        [("ReduceSum", "x none", "y", {"noop_with_empty_axes": 1})],
        {"none": np.zeros(0, "int64")},
        6,
    ),
    "Clip above": ([("Clip", "x low", "y")], {"low": np.float32(-0.5)}, 6),
    "Split": (
        [("Split", "x sizes", "a b", {"axis": 1}), ("Concat", "b a", "y", {"axis": 1})],
        {"sizes": np.array([2, 4])},
        6,
    ),
    "Split in equal parts": (
        [
            ("Split", "x", "a b c", {"axis": 1, "num_outputs": 3}),
            ("Mul", "a b", "m"),
            ("Sub", "m c", "y"),
        ],
        {},
        2,
    ),
    "Shape": (
        [
            ("Shape", "x", "s", {"start": 1, "end": 2}),
            ("Cast", "s", "f", {"to": 1}),
            ("Div", "x f", "y"),
        ],
        {},
        6,
    ),
    "Transpose": (
        [("Transpose", "x", "t"), ("Reshape", "t flat", "y")],
        {"flat": np.array([1, 6])},
        6,
    ),
}


@pytest.mark.parametrize("name", GRAPHS)
def test_each_operator_equals_onnxruntime(name: str) -> None:
    """Each supported operator gives the values of ONNX Runtime."""
    nodes, constants, outputs = GRAPHS[name]
    single = {"one": np.array(1.0, "float32")}  # says the type of the graph
    path = onnx_file("one.onnx", nodes, single | constants, outputs, opset=21)
    assert_as_onnx_runtime(path, rel=1e-5, abs=1e-6)


def test_unsupported_attributes_are_refused() -> None:
    """An operator with an unsupported attribute is refused, and the attribute is named."""
    said = refusal(onnx_file("odd.onnx", [("Tanh", "x", "y", {"odd": 1})], {"P": np.eye(6)}))
    assert "operator Tanh with 1 inputs and the attributes odd is not supported" in said
    assert "damaged" not in said


def test_a_graph_with_huge_results_is_refused() -> None:
    """A small graph whose results would need gigabytes is refused before it is evaluated."""
    tall = {"a": np.ones((2**12, 1), "float32"), "b": np.ones((1, 2**12), "float32")}
    for nodes, constants in (
        ([("Mul", "a b", "h")], tall),
        ([("MatMul", "a b", "h")], tall),
        ([("Gather", "x places", "h", {"axis": 1})], {"places": np.zeros(2**19, int)}),
    ):
        graph = [*nodes, ("ReduceSum", "h", "y")]
        said = refusal(onnx_file("large.onnx", graph, {"P": np.eye(6)} | constants))
        assert "array elements, but at most" in said


def test_metadata_of_a_file_are_named_as_not_applied() -> None:
    """A scale of actions in the metadata changes no gain, and a warning says so."""
    onnx = pytest.importorskip("onnx", reason="the package onnx is not installed")
    constants = {"P": np.diag(np.arange(1.0, 7.0)), "ones": ONES}
    model = onnx.load(onnx_file("plain.onnx", QUADRATIC, constants))
    entry = model.metadata_props.add()
    entry.key, entry.value = "action_scale", "0.25"
    onnx.save(model, "scaled.onnx")
    with pytest.warns(UserWarning, match="action_scale"):
        critic = read("scaled.onnx")
    assert float(critic.value(np.ones(6))) == 21.0
