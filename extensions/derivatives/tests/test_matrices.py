"""Linear models from given matrices, without an aircraft."""

from __future__ import annotations

import control
import numpy as np
import pytest

import hfa
from hfa_support.errors import BadInputError

A = np.array([[0.0, 1.0], [2.0, -0.3]])
B = np.array([[0.0], [1.0]])


def test_matrices_alone_define_a_linear_model() -> None:
    """A linear model from A and B has default names, modes, an operating point and a report.

    Linearizing its nonlinear model gives the same A and B.
    """
    linear = hfa.LinearModel(A, B)
    assert (linear.states, linear.inputs, linear.outputs) == (("x1", "x2"), ("u1",), ("x1", "x2"))
    assert linear.modes[0].eigenvalue in np.linalg.eigvals(A)
    assert not linear.is_stable
    assert linear.A["x2", "x1"] == 2.0
    again = hfa.linearize(linear.model, linear.point)
    assert np.array_equal(again.A, A)
    assert np.array_equal(again.B, B)
    assert "x2" in linear.report().text()
    assert linear.to_dict()["A"] == A.tolist()


def test_linear_models_accept_a_b_c_d() -> None:
    """LinearModel(A, B, C, D) has the order of arguments and the response of `control.ss`.

    Linearizing its nonlinear model gives the same C and D.
    """
    C = [[1.0, 2.0]]
    D = [[3.0]]
    linear = hfa.LinearModel(A, B, C, D, states=("q", "v"), inputs=("f",))
    assert linear.to_control()(2j) == pytest.approx(control.ss(A, B, C, D)(2j))
    again = hfa.linearize(linear.model, linear.point, outputs=linear.outputs)
    assert np.array_equal(again.C, C)
    assert np.array_equal(again.D, D)
    assert linear["y1", "f"].zeros() == pytest.approx(linear.zeros())


def test_lqr_of_matrices_equals_python_control() -> None:
    """lqr accepts matrices or a linear model and returns the gain that python-control returns."""
    expected, _, _ = control.lqr(A, B, np.eye(2), np.eye(1))
    for found in (
        hfa.lqr(A, B, np.eye(2), np.eye(1)),
        hfa.lqr(A, B, Q=np.eye(2), R=[1.0]),
        hfa.lqr(hfa.LinearModel(A, B), np.eye(2), np.eye(1)),
    ):
        assert pytest.approx(expected) == found.K


def test_lqr_of_matrices_refuses_a_disturbance() -> None:
    """lqr refuses a delta, which would define a game, and a missing B."""
    with pytest.raises(BadInputError, match="the arguments are linear, Q, R, N"):
        hfa.lqr(A, B, np.eye(2), np.eye(1), None, 100.0)
    with pytest.raises(BadInputError, match="N is 0; give 2"):
        hfa.lqr(A, B, np.eye(2), np.eye(1), 100.0)
    with pytest.raises(BadInputError, match="B is missing"):
        hfa.lqr(A)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"A": A, "B": np.ones((3, 1))}, "B is 3 x 1; give 2 x 1"),
        ({"A": np.ones((2, 3)), "B": B}, "A is 2 x 3; give 2 x 2"),
        ({"A": A, "B": B, "C": np.ones((1, 3))}, "C is 1 x 3; give 1 x 2"),
        ({"A": A, "B": B, "states": ("x",)}, "states has 1 entries"),
        (
            {"A": A, "B": B, "outputs": ("y",)},
            "outputs has 1 names, but C has 2 rows; give a name for each row",
        ),
        ({"A": A * np.nan, "B": B}, "A.0..0. is nan"),
        ({"A": A, "B": B, "E": B}, "cannot have disturbances"),
    ],
)
def test_inconsistent_matrices_are_refused(arguments: dict[str, object], said: str) -> None:
    """Matrices and names of inconsistent sizes, an entry of nan and a disturbance matrix E are
    refused.
    """
    with pytest.raises(BadInputError, match=said):
        hfa.LinearModel(**arguments)  # type: ignore[arg-type]
