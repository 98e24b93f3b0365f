"""Linear models from given matrices, without an aircraft."""

from pathlib import Path

import cli
import control
import numpy as np
import pytest

import hfa
from hfa import BadInputError

A = np.array([[0.0, 1.0], [2.0, -0.3]])
B = np.array([[0.0], [1.0]])


def test_lqr_of_matrices_equals_python_control():
    """lqr, also with N, gives the gain that python-control returns.

    A missing weight is refused.
    """
    linear, Q = hfa.LinearModel.of(A, B), np.eye(2)
    for N in ((), (0.1 * np.ones((2, 1)),)):
        expected, _, _ = control.lqr(A, B, Q, np.eye(1), *N)
        for plant in ((A, B), (linear,), (control.ss(A, B, Q, 0),)):
            assert pytest.approx(expected) == hfa.lqr(*plant, Q, [1.0], *N).K
    for words in ((A, B), (linear, Q)):
        with pytest.raises(BadInputError, match="is missing; write"):
            hfa.lqr(*words)


@pytest.mark.parametrize("suffix", [".json", ".npz", ".mat"])
def test_a_linear_model_is_read_from_its_file(tmp_path, suffix):
    """A linear model that is saved and loaded has all its entries but those of its aircraft: operating
    point, dynamics, warnings, and modes, whose names the aircraft gives.

    Linearized again, the loaded model has the same matrices. The file of an operating point is refused.
    """
    model = hfa.aircraft()
    point = hfa.trim(model)
    outputs = ("vertical_acceleration", "load_factor", "speed")
    linear = hfa.linearize(model, point, outputs=outputs)
    file = tmp_path / f"linear{suffix}"
    linear.save(file)
    again = hfa.LinearModel.load(file)
    entries, loaded = linear.to_dict(), again.to_dict()
    of_aircraft = {"operating_point", "dynamics", "dihedral_deg", "scheduled", "warnings", "modes"}
    assert {name: loaded.get(name) for name in {*entries} - of_aircraft} == {
        name: value for name, value in entries.items() if name not in of_aircraft
    }
    assert loaded["disturbances"] == ["updraft"]
    assert loaded["output_units"] == ["ft/s^2", "1", "ft/s"]
    computed = hfa.linearize(again.model, again.point, outputs=outputs)
    for name in ("A", "B", "C", "D", "E", "F", "output_offsets"):
        assert np.array_equal(getattr(computed, name), getattr(linear, name))
    assert hfa.trim(again.model).values == pytest.approx(again.point.values)
    again.save(file)
    assert hfa.LinearModel.load(file).warnings == again.warnings
    linear.point.save(tmp_path / "point.json")
    with pytest.raises(BadInputError, match=r"point\.json is not a linear model"):
        hfa.LinearModel.load(tmp_path / "point.json")


def test_labelled_matrices_are_put_in_order():
    """Tables of pandas name the states and inputs, in any order of rows and columns.

    Wrong labels are refused, and labels of weights beside matrices without names.
    """
    pandas = pytest.importorskip("pandas")
    table_A = pandas.DataFrame(A, ["q", "v"], ["q", "v"])
    table_B = pandas.DataFrame(B, ["q", "v"], ["f"])
    linear = hfa.LinearModel.of(table_A.iloc[:, ::-1], table_B.iloc[::-1])
    assert np.array_equal(linear.A, A)
    assert np.array_equal(linear.B, B)
    assert (linear.states, linear.inputs) == (("q", "v"), ("f",))
    Q = pandas.DataFrame(np.diag([1.0, 2.0]), ["q", "v"], ["q", "v"])
    game = hfa.game(linear, Q=Q.iloc[::-1], R=pandas.Series({"f": 3.0}))
    assert game.Q.tolist() == Q.to_numpy().tolist()
    assert game.R.tolist() == [[3.0]]
    with pytest.raises(BadInputError, match="Q has the labels q, w; label each of q, v once"):
        hfa.game(linear, Q=pandas.DataFrame(np.eye(2), ["q", "w"], ["q", "w"]), R=[1.0])
    with pytest.raises(BadInputError, match="Q has labels; give"):
        hfa.lqr(A, B, Q, [1.0])
    gain = pandas.DataFrame([[2.0, 1.0]], ["f"], ["v", "q"])
    assert hfa.from_gain(game, gain).K.tolist() == [[1.0, 2.0]]


def test_modes_of_given_matrices_are_printed(folder):
    """`hfa linearize --aircraft FILE` reports the eigenvalues of A, which may be alone in the file."""
    Path("plant.json").write_text('{"A": [[0.0, 1.0], [-2.0, -0.3]]}')
    (mode,) = cli.answer("linearize", "--aircraft", "plant.json")["modes"]
    assert mode["frequency"] == pytest.approx(2.0**0.5)
    assert mode["damping"] == pytest.approx(0.15 / 2.0**0.5)


OSCILLATOR = '{"A": [[0, 1], [-2, -0.3]], "B": [[0], [1]], '


def test_E_beside_C_and_D_is_refused(folder):
    """E beside C and D may be the descriptor matrix of MATLAB, E x' = A x + B u, or a disturbance matrix: it
    is refused. C and D without E are read.
    """
    Path("plant.json").write_text(OSCILLATOR + '"C": [[1, 0]], "D": [[0]], "E": [[2, 0], [0, 1]]}')
    cli.assert_refused(cli.hfa("linearize", "--aircraft", "plant.json"), 2, "MATLAB's descriptor")
    Path("plant.json").write_text(OSCILLATOR + '"C": [[1, 0]], "D": [[0]]}')
    assert cli.hfa("linearize", "--aircraft", "plant.json").code == 0


def test_a_vector_is_the_gain_of_a_single_input():
    """The gain of one input may be a vector (n,); for two inputs, a vector is refused."""
    linear = hfa.LinearModel.of(A, B)
    assert hfa.margins(linear, [5.0, 2.0])["u1"] == hfa.margins(linear, [[5.0, 2.0]])["u1"]
    with pytest.raises(BadInputError, match="K is 2; give 2 x 2"):
        hfa.margins(hfa.LinearModel.of(A, np.eye(2)), [5.0, 2.0])


@pytest.mark.parametrize(
    ("x", "u", "outputs", "said"),
    [
        ([1.0], [0.0] * 5, (), "x has shape"),
        ([0.0] * 7, "u", (), "u is 'u'; give numbers"),
        ([0.0] * 7, [0.0] * 5, ("lif",), "unknown output 'lif'"),
    ],
)
def test_wrong_vectors_and_unknown_outputs_are_refused(x, u, outputs, said):
    """`Model.at` names the vector, or the output, that is wrong."""
    with pytest.raises(BadInputError, match=said):
        hfa.aircraft().at(x, u, outputs)
