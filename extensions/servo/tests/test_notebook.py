"""Calls of notebooks: responses of linear models, words of other tools, functions as methods."""

from __future__ import annotations

from functools import cache

import control
import numpy as np
import pytest
from matplotlib import pyplot
from scipy.linalg import expm

import hfa
from hfa import BadInputError, LinearModel, find_operating_point, linearize
from hfa_servo.notebook.calls import ARGUMENTS, ATTRIBUTES

MODEL = hfa.aircraft()


@cache
def _linear() -> LinearModel:
    return linearize(MODEL, find_operating_point(MODEL))


def test_step_and_simulate_agree_with_exponentials() -> None:
    """After a step x = A⁻¹ (e^At - 1) B, here by d/dt x = A x + B at an instant."""
    linear = _linear()
    time = np.linspace(0.0, 2.0, 2001)
    stepped = linear.step(time)
    assert isinstance(stepped, control.TimeResponseData)
    assert stepped.outputs.shape == (6, 5, 2001)
    x = stepped.outputs[:, 3]
    slope = (x[:, 1001] - x[:, 999]) / (time[1001] - time[999])
    assert slope == pytest.approx(linear.A @ x[:, 1000] + linear.B[:, 3], rel=1e-3, abs=1e-3)
    rows = np.eye(5)[3][:, None] * np.ones(2001)
    for u in ({"elevator_center": 1.0}, rows, rows.T):
        assert linear.simulate(u, time).outputs == pytest.approx(x, rel=1e-9, abs=1e-9)
    with pytest.raises(BadInputError, match="unknown input"):
        linear.simulate({"elevator_centre": 1.0}, time)
    with pytest.raises(BadInputError, match="2001 values"):
        linear.simulate({"throttle": [1.0, 2.0]}, time)
    with pytest.raises(BadInputError, match=r"give \(5, 2001\)"):
        linear.simulate(np.ones((7, 3)), time)
    with pytest.raises(BadInputError, match="time has fewer"):
        linear.simulate(np.ones((5, 9)))
    assert linear.simulate({"throttle": 1.0}).outputs[:, -1] == pytest.approx(
        linear.step().outputs[:, 0, -1]
    )
    pulse = linear.impulse(time, inputs="elevator_center").outputs[:, 0, 1000]
    assert pulse == pytest.approx(slope, rel=1e-3, abs=1e-3)
    named = linear.step(time, inputs="elevator_center", outputs=["pitch", "alpha"])
    assert named.outputs[:, 0] == pytest.approx(x[[2, 1]], rel=1e-9, abs=1e-9)
    with pytest.raises(BadInputError, match="time is 'throttle'; give a number"):
        linear.step("throttle")


def test_transfer_functions_have_the_response_of_the_model() -> None:
    linear = _linear()
    found = linear.transfer_function("elevator_center", "pitch_rate")
    expected = linear["pitch_rate", "elevator_center"].to_control()(2j)
    assert found(2j) == pytest.approx(expected)
    with pytest.raises(BadInputError, match="5 inputs and 1 outputs"):
        linear.transfer_function(None, "pitch_rate")


def test_bode_and_nyquist_take_names() -> None:
    linear = _linear()
    assert len(linear.bode(inputs="throttle", outputs="speed")) == 2
    axes = linear.nyquist(inputs="elevator_center", outputs="alpha")
    assert axes.lines
    assert "alpha / elevator_center" in axes.get_title()
    with pytest.raises(BadInputError, match="single loop"):
        linear.nyquist()
    with pytest.raises(BadInputError, match="unknown output"):
        linear.bode(outputs=("sped",))
    pyplot.close("all")


def test_poles_and_zeros_are_drawn() -> None:
    assert "poles x and zeros o, 1/s" in _linear().plot().get_title()
    pyplot.close("all")


def test_a_free_response_is_the_matrix_exponential() -> None:
    """x(t) = e^(A t) x(0), for a start by name or as an array, without inputs."""
    linear = _linear()
    start = 0.05 * np.eye(6)[linear.states.index("alpha")]
    for initial in ({"alpha": 0.05}, start):
        free = linear.simulate(time=2.0, initial=initial, dt=0.01)
        assert free.time[-1] == pytest.approx(2.0)
        assert free.outputs[:, 100] == pytest.approx(expm(linear.A) @ start, abs=1e-9)
    with pytest.raises(BadInputError, match="unknown state 'aoa'; did you mean alpha"):
        linear.simulate(initial={"aoa": 0.05})
    with pytest.raises(BadInputError, match="u is a function"):
        linear.simulate(lambda t: 0.1, time=1.0)
    with pytest.raises(BadInputError, match=r"initial is of shape \(2,\); give \(6,\)"):
        linear.simulate(initial=[0.0, 1.0])


def test_a_sample_time_replaces_the_times() -> None:
    linear = _linear()
    u = np.random.default_rng(1).normal(size=(5, 101))
    at_times = linear.simulate(u, np.linspace(0.0, 1.0, 101))
    assert linear.simulate(u, dt=0.01).outputs == pytest.approx(at_times.outputs)


def test_keywords_of_python_control_are_accepted() -> None:
    """input=, output=, T= and X0= name the arguments inputs, outputs, time and initial."""
    linear = _linear()
    usual = linear.step(time=3.0, inputs="throttle", outputs="speed")
    assert np.array_equal(
        linear.step(T=3.0, input="throttle", output="speed").outputs, usual.outputs
    )
    assert linear.simulate(T=1.0, X0={"alpha": 0.1}).outputs[1, 0] == 0.1
    with pytest.raises(BadInputError, match=r"step: .*'timme'; did you mean time\?; its arguments"):
        linear.step(timme=3.0)
    with pytest.raises(BadInputError, match="unexpected keyword argument 'T'"):
        linear.step(time=3.0, T=3.0)


def test_functions_of_hfa_are_methods_of_their_first_argument() -> None:
    point = MODEL.find_operating_point(dihedral=0.2)
    assert point == find_operating_point(MODEL, dihedral=0.2)
    linear = MODEL.linearize(point)
    assert np.array_equal(linear.A, linearize(MODEL, point).A)
    game = hfa.paper.published_game(linear)
    assert np.array_equal(game.solve().K, hfa.solve(game).K)
    assert game.verify(hfa.solve_game(game)).ok
    with pytest.raises(AttributeError, match="Model has no attribute 'solve'"):
        MODEL.solve  # noqa: B018
    with pytest.raises(AttributeError, match=r"'linearise'; did you mean linearize\?"):
        MODEL.linearise  # noqa: B018


def test_words_of_other_tools_are_attributes_of_results() -> None:
    """`success` of SciPy and others return the attribute of the same meaning, where it exists."""
    point = _linear().point
    assert point.success is point.converged is point.ok is True
    game = hfa.paper.published_game(_linear())
    phugoid = _linear().phugoid
    assert phugoid is not None
    assert (phugoid.name, phugoid.zeta) == ("phugoid", phugoid.damping)
    assert phugoid.wn == phugoid.omega == phugoid.frequency
    with pytest.raises(AttributeError, match=r"Mode has no attribute 'dampin'; did you mean damp"):
        phugoid.dampin  # noqa: B018
    with pytest.raises(AttributeError, match="'theta'; did you mean pitch"):
        point.theta  # noqa: B018
    assert _linear().stable is _linear().is_stable
    solution = hfa.solve_game(game)
    assert np.array_equal(solution.eigenvalues, solution.closed_loop_eigenvalues)
    assert solution.gamma == game.delta
    analysed = hfa.solve(game)
    assert solution.delta_min == analysed.delta_min
    assert solution.disk_margin == analysed.disk_margin
    assert solution.to_json() == solution.report().json()
    flight = hfa.fly(MODEL, point, K=solution.K, T=0.1)
    assert np.array_equal(flight.t, flight.time)
    assert flight.summary().text() == flight.report().text()
    with pytest.raises(AttributeError, match="LinearModel has no attribute 'success'"):
        _linear().success  # noqa: B018
    assert not {*ATTRIBUTES} & {*ATTRIBUTES.values()}
    assert not any(word in names for word, names in ARGUMENTS.items())
