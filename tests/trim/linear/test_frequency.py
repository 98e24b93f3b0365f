"""Transfer functions, zeros and reduced models, compared with python-control and SLICOT."""

import control
import numpy as np
import pytest
from cli import hfa
from own_models import F16, NAVION, trimmed

from hfa import LinearModel, aircraft, linearize
from hfa.paper import level_model
from trim import transfers


@pytest.fixture(scope="module", params=["hfa", "f16", "navion"])
def model(request):
    if request.param == "hfa":
        point = level_model(aircraft(), 0.2).point
        return linearize(aircraft(), point, outputs=("gamma", "speed", "dihedral"))
    foreign = F16.with_parameters(xcg=0.3) if request.param == "f16" else NAVION
    return linearize(foreign, trimmed(foreign), outputs=("gamma", "speed", "roll_rate"))


def channel(A, B, C, D):
    (found,) = transfers(LinearModel.of(A, B, C, D))
    return found


def test_a_known_zero_is_found_and_cancels():
    """The zero of (s - 3) / ((s + 1) (s + 2)) is 3; an uncontrollable state at -5 cancels."""
    A = np.diag([-1.0, -2.0, -5.0])
    B = np.array([[1.0], [1.0], [0.0]])
    C = np.array([[-4.0, 5.0, 1.0]])
    found = channel(A, B, C, np.zeros((1, 1)))
    np.testing.assert_allclose(found.zeros, [3.0], atol=1e-12)
    np.testing.assert_allclose(np.sort(found.poles), [-2.0, -1.0], atol=1e-12)
    assert found.gain == pytest.approx(1.0)
    assert channel(A, np.zeros((3, 1)), C, np.zeros((1, 1))).gain == 0.0


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("slow", [0.0, -1e-3])
def test_a_free_body_has_no_static_gain(seed, slow):
    """A free body with a lag of 0.5 s has an infinite static gain. With a spring, the gain is
    finite.

    The coordinates are random, with rounded entries.
    """
    rng = np.random.default_rng(seed)
    T = rng.normal(size=(3, 3))
    A = T @ np.array([[0.0, 1.0, 0.0], [slow, slow, 1.0], [0.0, 0.0, -2.0]]) @ np.linalg.inv(T)
    B = T @ np.array([[0.0], [0.0], [1.0]])
    for row, held in (([1.0, 0.0, 0.0], 500.0), ([0.0, 1.0, 0.0], 0.0)):
        C = np.array([row]) @ np.linalg.inv(T)
        static = channel(A, B, C, np.zeros((1, 1))).static
        assert static == pytest.approx(held if slow else np.inf, rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_the_gains_of_a_random_system_are_those_of_its_matrices(seed):
    """The static gain is D - C A⁻¹ B, with its sign, for any number of zeros and poles."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 4
    A = rng.normal(size=(n, n)) - 0.5 * np.eye(n)
    B, C = rng.normal(size=(n, 1)), rng.normal(size=(1, n))
    D = np.zeros((1, 1)) if seed % 2 else rng.normal(size=(1, 1))
    found = channel(A, B, C, D)
    exact = D - C @ np.linalg.solve(A, B)
    assert found.static == pytest.approx(exact.item(), rel=1e-8)
    at = found.gain * np.prod(2j - found.zeros) / np.prod(2j - found.poles)
    assert at == pytest.approx(control.ss(A, B, C, D)(2j), rel=1e-8)


# Models of fewer states.


def test_residualized_models_equal_python_controls(model):
    """A residualized model equals python-control's and keeps the static gain.

    At low frequency, a residualized model is more accurate than a truncated one.
    """
    follow = ("alpha", "pitch_rate")
    keep = tuple(name for name in model.states if name not in follow)
    reduced = model.select(residualize=follow)
    whole = model.to_control()
    peer = control.model_reduction(
        whole, elim_states=list(follow), method="matchdc", warn_unstable=False
    )
    for name in "ABCD":
        np.testing.assert_allclose(
            getattr(reduced, name), getattr(peer, name), rtol=1e-10, atol=1e-12
        )
    assert reduced.states == keep
    np.testing.assert_allclose(reduced.to_control()(0), whole(0), rtol=1e-8, atol=1e-10)
    slow = 1e-2j
    errors = [
        np.abs(fewer.to_control()(slow) - whole(slow)).max()
        for fewer in (reduced, model.select(keep))
    ]
    assert errors[0] < 0.1 * errors[1]


def test_a_bode_plot_shows_the_response_of_each_channel():
    """Lines of the panels are magnitude and phase of C (jω - A)⁻¹ B + D, over all modes; an output
    that no input affects is named.
    """
    A = np.array([[0.0, 1.0, 0.0], [-4.0, -4e-3, 0.0], [0.0, 0.0, -1.0]])
    linear = LinearModel.of(A, np.eye(3)[:, :2], states=("q", "v", "alone"), inputs=("f", "g"))
    figure = linear.bode()[0].figure
    assert figure.get_supxlabel() == "not drawn: alone"
    panels = [axes for axes in figure.axes if axes.lines]
    for row, (above, below) in enumerate(zip(panels[::2], panels[1::2], strict=True)):
        assert above.get_title() == f"{linear.states[row]}, 1"
        for column, (size, phase) in enumerate(zip(above.lines, below.lines, strict=True)):
            w = np.array(size.get_xdata())
            assert (w[0], w[-1]) == pytest.approx((0.1, 20.0))
            exact = np.linalg.inv(1j * w[:, None, None] * np.eye(3) - A)[:, row, column]
            np.testing.assert_allclose(size.get_ydata(), 20.0 * np.log10(np.abs(exact)), atol=1e-9)
            degrees = np.array(phase.get_ydata())
            turned = np.exp(1j * np.radians(degrees))
            np.testing.assert_allclose(turned, exact / np.abs(exact), atol=1e-9)
            assert np.abs(np.diff(degrees)).max() < 45.0
    assert len(panels) == 4


def test_transfer_functions_that_are_0_are_not_shown(folder):
    """The printed table contains exactly the transfer functions with a gain."""
    linear = LinearModel.of(np.array([[-1.0, 0.0], [0.5, -2.0]]), np.eye(2))
    found = transfers(linear)
    shown = {f"{each.output} / {each.input}" for each in found if each.gain}
    assert shown == {"x1 / u1", "x2 / u1", "x2 / u2"}
    np.savez(folder / "plant.npz", A=linear.A, B=linear.B)
    text = hfa("linearize", "--aircraft", "plant.npz", "--bode").out
    for each in found:
        assert (f"{each.output} / {each.input}" in text) == bool(each.gain)
    (coupled,) = (line for line in text.splitlines() if line.startswith("x2 / u1"))
    assert coupled.split("none")[1].split() == ["-2.0000,", "-1.0000"]
