"""ONNX graphs against onnxruntime, and refused graphs."""

import sys
from pathlib import Path

import numpy as np
import pytest
from network_files import ONES, QUADRATIC, onnx_file, read, refusal, torch_file

from hfa import BadInputError, Game, read_critic

RNG = np.random.default_rng(0)
X = RNG.normal(size=(7, 6)).astype("float32")
pytestmark = pytest.mark.usefixtures("folder")


def assert_as_onnx_runtime(path, **tolerance):
    """Assert that the policy of a graph equals ONNX Runtime at the states 3 X."""
    runtime = pytest.importorskip("onnxruntime", reason="the package onnxruntime is not installed")
    session = runtime.InferenceSession(path, providers=["CPUExecutionProvider"])
    (states,), (outputs,) = session.get_inputs(), session.get_outputs()
    policy = read(path, inputs=outputs.shape[1], network="policy=").policy
    for x in 3.0 * X:
        theirs = session.run(None, {states.name: x[None]})[0].ravel()
        assert np.array(policy(x)).ravel() == pytest.approx(theirs, **tolerance)


@pytest.mark.parametrize("opset", [9, 13])
def test_old_and_new_operator_sets_equal_onnxruntime(opset):
    """A graph of each operator set gives the results of ONNX Runtime.

    Axes are attributes before set 13, and limits of Clip before set 11; later, they are inputs.
    """
    axes = {"axes": [0]} if opset < 13 else {}
    nodes = [
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
    assert_as_onnx_runtime(onnx_file("a.onnx", nodes, constants, outputs=2, opset=opset), abs=1e-6)


def external(path):
    """Write a graph whose weights are in another file, and return its path."""
    onnx = pytest.importorskip("onnx", reason="the package onnx is not installed")
    constants = {"P": np.eye(6), "ones": ONES}
    model = onnx.load(onnx_file(path, QUADRATIC, constants))
    how = {"save_as_external_data": True, "location": "a.data", "size_threshold": 0}
    onnx.save(model, path, **how)
    return path


_SINGLES = {"P": np.eye(6, dtype="float32"), "ones": ONES.astype("float32")}
_TALL = {"a": np.ones((2**12, 1), "float32"), "b": np.ones((1, 2**12), "float32")}
_SUM = ("ReduceSum", "h", "y")
_LARGE = [("ConstantOfShape", "size", "h"), _SUM]
#: Graphs that are refused: what is said, nodes, constants, number of states.
REFUSED = {
    "inputs": ("has 10 inputs", [("MatMul", "x P", "y")], {"P": np.ones((10, 1), "f4")}, 10),
    "integer": ("number 7, not to a float", [("Cast", "x", "y", {"to": 7})], _SINGLES, 6),
    "training": (
        "is in training mode",
        [("BatchNormalization", "x o o o o", "y", {"training_mode": 1})],
        {"o": np.ones(6, "float32")},
        6,
    ),
    **{
        name: (said, [(name, "x", "y")], _SINGLES, 6)
        for name, said in {
            "Dropout": "operator Dropout is not supported; export",
            "ArgMax": "chooses one of several discrete actions",
        }.items()
    },
    "large": ("requires 2e+18 array elements", _LARGE, {"size": np.array([10**9] * 2)}, 6),
    "column": ("(6, 1), but only rows", [("Transpose", "x", "h"), _SUM], _SINGLES, 6),
    "first axis": (
        "axis other than the last",
        [("ReduceSum", "x a", "y")],
        _SINGLES | {"a": np.array([0])},
        6,
    ),
    "large Mul": ("array elements, but at most", [("Mul", "a b", "h"), _SUM], _TALL, 6),
}


@pytest.mark.parametrize("name", REFUSED)
def test_unsupported_graphs_are_refused(name):
    """Graphs with unsupported inputs, operators, attributes, shapes or sizes are refused by name."""
    said, nodes, constants, states = REFUSED[name]
    assert said in refusal(onnx_file("wrong.onnx", nodes, constants, states=states))


def test_damaged_graphs_and_weights_in_other_files_are_refused():
    """A graph with weights in another file and a damaged graph are refused, and so is an activation
    that is given beside a graph.
    """
    assert "stored in another file; export the weights in" in refusal(external("a.onnx"))
    content = Path(onnx_file("good.onnx", QUADRATIC, _SINGLES)).read_bytes()
    Path("damaged.onnx").write_bytes(content[:-40])
    assert "is damaged or has another format" in refusal("damaged.onnx")
    game = Game(-np.eye(6), np.ones((6, 5)), Q=np.ones(6), R=np.ones(5))
    with pytest.raises(BadInputError, match="already contains the activations"):
        read_critic("good.onnx", game, activation="tanh")


def test_without_onnx_only_onnx_files_are_refused(monkeypatch):
    """Without the package onnx, ONNX files are refused and torch files are read."""
    monkeypatch.setitem(sys.modules, "onnx", None)
    Path("a.onnx").write_bytes(b"")
    assert "ONNX files require the package onnx; type python -m pip install onnx" in refusal(
        "a.onnx"
    )
    read(torch_file("a.pt", {"weight": np.zeros((5, 6))}))


#: Operators of x alone, some with attributes.
_UNARY = [
    *((name, {}) for name in ("Neg", "Tanh", "Relu", "LeakyRelu", "Sigmoid", "Softplus", "Elu")),
    *((name, {}) for name in ("Selu", "Gelu", "Sin", "Erf", "Exp", "Identity", "Abs", "Cos")),
    *((name, {}) for name in ("Softsign", "HardSwish", "HardSigmoid", "Mish")),
    ("Elu", {"alpha": 0.7}),
    ("Selu", {"alpha": 1.5, "gamma": 1.1}),
    ("LeakyRelu", {"alpha": 0.2}),
    ("Gelu", {"approximate": "tanh"}),
    ("Transpose", {"perm": [0, 1]}),
]
#: The first state at which graphs are compared: equal to it, and above and below.
_FIRST = {"c": (3.0 * X)[:1]}
_WEIGHTS = RNG.normal(size=(6, 4)).astype("float32")
#: Graphs with one operator each, compared with ONNX Runtime: nodes, constants, outputs.
GRAPHS = {
    **{f"{name} {how or ''}": ([(name, "x", "y", how)], {}, 6) for name, how in _UNARY},
    **{name: ([(name, "x c", "y")], _FIRST, 6) for name in ("Add", "Sub", "Mul", "Div", "Min")},
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
    "Sqrt": ([("Relu", "x", "a"), ("Add", "a one", "b"), ("Sqrt", "b", "y")], {}, 6),
    "Gemm": (
        [("Gemm", "x W c", "y", {"transB": 1, "alpha": 0.5, "beta": 2.0})],
        {"W": _WEIGHTS.T, "c": _WEIGHTS[0]},
        4,
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
    "Max of three": ([("Max", "x c two", "y")], _FIRST | {"two": np.float32(2)}, 6),
    "Split": (
        [("Split", "x widths", "a b", {"axis": 1}), ("Tanh", "b", "y")],
        {"widths": np.array([2, 4])},
        4,
    ),
    "Concat": ([("Tanh", "x", "t"), ("Concat", "x t", "y", {"axis": 1})], {}, 12),
    # The scale of a distribution, as exported by torch: ones_like(mean) exp(log_std).
    "Shape": (
        [
            ("MatMul", "x W", "m"),
            ("Shape", "m", "s"),
            ("ConstantOfShape", "s", "zeros"),
            ("Equal", "s four", "is_four"),
            ("Where", "is_four s s", "shape"),
            ("Expand", "m shape", "e"),
            ("Add", "e zeros", "y"),
        ],
        {"W": _WEIGHTS, "four": np.array([4])},
        4,
    ),
    "Reciprocal": ([("Exp", "x", "a"), ("Reciprocal", "a", "y")], {}, 6),
    "Log": ([("Exp", "x", "a"), ("Add", "a one", "b"), ("Log", "b", "y")], {}, 6),
}


@pytest.mark.parametrize("name", GRAPHS)
def test_each_operator_equals_onnxruntime(name):
    """Each supported operator gives the values of ONNX Runtime."""
    nodes, constants, outputs = GRAPHS[name]
    single = {"one": np.array(1.0, "float32")}  # says the type of the graph
    path = onnx_file("one.onnx", nodes, single | constants, outputs, opset=21)
    assert_as_onnx_runtime(path, rel=1e-5, abs=1e-6)


def test_an_error_of_the_program_is_not_called_damage(monkeypatch):
    """A right file, of which the program cannot compute something, is not called damaged."""
    path = onnx_file("right.onnx", QUADRATIC, _SINGLES)
    monkeypatch.setattr("controller.critic.network.onnx_graph._outputs_of", lambda *_: {}[0])
    said = refusal(path)
    assert "(KeyError: 0), perhaps by an error of its own" in said
    assert "damage" not in said


def several_outputs(names):
    """Write a graph with outputs of 2, 1 and 1 entries with these names, and return its path."""
    onnx = pytest.importorskip("onnx", reason="the package onnx is not installed")
    sizes = dict(zip(names, (2, 1, 1), strict=True))
    constants = {f"W{size}": np.full((6, size), 0.5, "float32") for size in (1, 2)}
    model = onnx.load(onnx_file("several.onnx", [], constants))
    for name, size in sizes.items():
        model.graph.node.append(onnx.helper.make_node("MatMul", ["x", f"W{size}"], [name]))
    del model.graph.output[:]
    model.graph.output.extend(
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, size])
        for name, size in sizes.items()
    )
    onnx.save(model, "several.onnx")
    return "several.onnx"


def test_outputs_are_told_by_their_names_or_named_in_the_refusal():
    """Of outputs actions, values and log_prob, u and V are read, and log_prob is noted as unused.

    Of outputs with unknown names, the message proposes one, which is accepted. Each output is half
    of the sum of x = (1, ..., 1).
    """
    critic = read(several_outputs(("actions", "values", "log_prob")), inputs=2)
    assert critic.u(np.ones(6)).tolist() == [3.0, 3.0]
    assert float(critic.value(np.ones(6))) == 3.0
    assert critic.declared.notes == ("not used: log_prob",)
    path = several_outputs(("left", "middle", "right"))
    assert 'network="policy=left"' in refusal(path, inputs=2)
    assert read(path, inputs=2, network="policy=left").u(np.ones(6)).tolist() == [3.0, 3.0]
