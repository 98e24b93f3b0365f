"""Responses of linear models against matrix exponentials and python-control."""

from __future__ import annotations

import control
import numpy as np
import pytest
from matplotlib import pyplot
from scipy.linalg import expm

from hfa import LinearModel

A = np.array([[0.0, 1.0], [-2.0, -0.3]])
B = np.array([[0.0, 0.5], [1.0, 0.0]])
C = np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 2.0]])
D = np.array([[0.0, 0.0], [0.0, 0.0], [3.0, 0.0]])
LINEAR = LinearModel.of(A, B, C, D, states=("q", "v"), inputs=("f", "g"), outputs=("y", "z", "w"))
TIMES = np.linspace(0.0, 2.0, 21)


def exact(t: float, start: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return y(t) from x(0) with constant inputs, from the exponential of [A B; 0 0]."""
    both = np.zeros((4, 4))
    both[:2, :2], both[:2, 2:] = A, B
    x = (expm(both * t) @ np.concatenate([start, u]))[:2]
    return np.asarray(C @ x + D @ u)


def test_simulated_outputs_are_those_of_the_exponential() -> None:
    """Inputs and initial deviations are given by name or as arrays, with a row for each input."""
    start, u = np.array([0.2, -0.1]), np.array([1.0, -0.5])
    expected = np.array([exact(t, start, u) for t in TIMES]).T
    rows = np.tile(u[:, None], TIMES.size)
    for given in ({"f": 1.0, "g": -0.5}, {"f": rows[0], "g": -0.5}, rows, rows.T):
        for initial in ({"q": 0.2, "v": -0.1}, start):
            found = LINEAR.simulate(given, TIMES, initial=initial)
            np.testing.assert_allclose(found.outputs, expected, atol=1e-9)
    alone = LINEAR.simulate({"g": 2.0}, TIMES)
    expected = np.array([exact(t, np.zeros(2), np.array([0.0, 2.0])) for t in TIMES]).T
    np.testing.assert_allclose(alone.outputs, expected, atol=1e-9)


def test_times_are_given_in_each_way() -> None:
    """Times follow from u and dt, from a last time, or from python-control."""
    assert LINEAR.simulate(np.zeros((2, 7)), dt=0.1).time == pytest.approx(0.1 * np.arange(7))
    assert LINEAR.simulate({"f": 1.0}, 2.0, dt=0.25).time == pytest.approx(np.linspace(0.0, 2.0, 9))
    assert LINEAR.simulate({"f": 1.0}, 2.0).time[-1] == pytest.approx(2.0)
    usual = control.step_response(LINEAR.to_control()).time
    assert LINEAR.simulate({"f": 1.0}).time == pytest.approx(usual)
    assert LINEAR.step().time == pytest.approx(usual)


@pytest.mark.parametrize("kind", ["step", "impulse"])
def test_step_and_impulse_are_those_of_each_input(kind: str) -> None:
    """The step is the response to a constant input, and the impulse that from the column of B."""
    found = getattr(LINEAR, kind)(TIMES, outputs=("z", "y"))
    for j, unit in enumerate(np.eye(2)):
        start, u = (np.zeros(2), unit) if kind == "step" else (B[:, j], np.zeros(2))
        expected = np.array([exact(t, start, u)[[1, 0]] for t in TIMES]).T
        np.testing.assert_allclose(found.outputs[:, j], expected, atol=1e-9)
    one = getattr(LINEAR, kind)(TIMES, inputs="g", outputs="y")
    assert np.array_equal(one.outputs[0, 0], found.outputs[1, 1])


def test_the_transfer_function_is_that_of_the_named_channel() -> None:
    """It is C (s - A)⁻¹ B + D of the input and output."""
    function = LINEAR.transfer_function("f", "w")
    expected = C[2] @ np.linalg.solve(2j * np.eye(2) - A, B[:, 0]) + 3.0
    assert function(2j) == pytest.approx(expected)


@pytest.mark.slow
def test_plots_show_the_response_and_the_poles() -> None:
    """Curves of the Nyquist and Bode plots are those of the matrices, the points are the poles."""
    function = LINEAR.transfer_function("f", "w")
    (curve, *_) = LINEAR.nyquist("f", "w").lines
    drawn = np.array(curve.get_xdata()) + 1j * np.array(curve.get_ydata())
    values = function(1j * np.logspace(-2, 2, 4_001))
    assert np.abs(drawn[:, None] - values).min(axis=1).max() < 0.01 * np.abs(values).max()
    assert np.abs(drawn - 3.5).min() < 1e-9
    (poles,) = LINEAR.plot().lines
    found = np.array(poles.get_xdata()) + 1j * np.array(poles.get_ydata())
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(np.linalg.eigvals(A)))
    panels = np.reshape(LINEAR.bode(), (2, 3))
    assert [axes.get_ylabel() for axes in panels[0]] == ["magnitude, dB", "", ""]
    for (above, below), row, feed in zip(panels.T, C, D, strict=True):
        for j, (size, phase) in enumerate(zip(above.lines, below.lines, strict=True)):
            w = np.array(size.get_xdata())
            inner = np.linalg.solve(1j * w[:, None, None] * np.eye(2) - A, B[:, [j]])[..., 0]
            expected = inner @ row + feed[j]
            np.testing.assert_allclose(size.get_ydata(), 20.0 * np.log10(np.abs(expected)))
            degrees = np.array(phase.get_ydata())
            turned = np.exp(1j * np.radians(degrees))
            np.testing.assert_allclose(turned, expected / np.abs(expected), atol=1e-9)
            assert np.abs(np.diff(degrees)).max() < 90.0
    pyplot.close("all")
