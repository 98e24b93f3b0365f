"""Frequency responses and reduced models of linear models."""

import control
import numpy as np
import pytest
from own_models import F16

import hfa
from hfa import LinearModel


@pytest.mark.parametrize("aircraft", [hfa.aircraft(), F16.with_parameters(xcg=0.3)])
def test_residualized_models_equal_python_controls(aircraft):
    """The states alpha and pitch rate are residualized: their rates are set to 0, which keeps the static
    gain. The model equals that of python-control, whose method "matchdc" does the same.

    At 0.01 rad/s, it is more accurate than a truncated model, whose states are left out.
    """
    model = hfa.trim(aircraft).linearize(outputs=("gamma", "speed", "pitch"))
    omitted = ("alpha", "pitch_rate")
    kept = tuple(name for name in model.states if name not in omitted)
    reduced = model.select(residualize=omitted)
    whole = model.to_control()
    peer = control.model_reduction(
        whole, elim_states=list(omitted), method="matchdc", warn_unstable=False
    )
    for name in "ABCD":
        np.testing.assert_allclose(
            getattr(reduced, name), getattr(peer, name), rtol=1e-10, atol=1e-12
        )
    assert reduced.states == kept
    with pytest.raises(hfa.BadInputError, match="unknown state 'alfa'"):
        model.select(["alpha", "alfa"])
    with pytest.raises(hfa.BadInputError, match="unknown output 'alfa'"):
        model.point.linearize(outputs=("alpha", "alfa"))
    winds = hfa.linearize(aircraft, model.point, disturbances=tuple(aircraft.disturbances)[:2])
    i, o = (list(map(winds.states.index, names)) for names in (kept, omitted))
    A, E = winds.A, winds.E
    slow_E = E[i] - A[np.ix_(i, o)] @ np.linalg.solve(A[np.ix_(o, o)], E[o])
    assert pytest.approx(slow_E, rel=1e-10, abs=1e-12) == winds.select(residualize=omitted).E
    np.testing.assert_allclose(reduced.to_control()(0), whole(0), rtol=1e-8, atol=1e-10)
    slow = 1e-2j  # s at 0.01 rad/s
    errors = [
        np.abs(each.to_control()(slow) - whole(slow)).max()
        for each in (reduced, model.select(kept))
    ]
    assert errors[0] < 0.1 * errors[1]


def test_a_bode_plot_shows_the_response_of_each_channel():
    """Lines of the panels are magnitude and phase of C (jω - A)⁻¹ B + D, to a decade beyond the modes
    at 1 and 2 rad/s.

    Phases have no jumps, also at the peak with the damping ratio 0.001. The output `alone`, which
    no input affects, is named.
    """
    A = np.array([[0.0, 1.0, 0.0], [-4.0, -4e-3, 0.0], [0.0, 0.0, -1.0]])
    linear = LinearModel.of(A, np.eye(3)[:, :2], states=("q", "v", "alone"), inputs=("f", "g"))
    figure = linear.bode()[0].figure
    assert figure.get_supxlabel() == "not drawn: alone"
    # For each output, a panel of magnitudes above one of phases; in each, a line for each input.
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
