"""Calls in notebooks: responses of linear models, names of other tools, functions as methods."""

from __future__ import annotations

import pickle
from functools import cache
from pathlib import Path

import casadi as ca
import control
import numpy as np
import pytest
from matplotlib import pyplot
from scipy.linalg import expm

import hfa
from hfa import BadInputError, LinearModel, NoSolutionError, linearize, trim
from hfa_servo.notebook.arguments import ARGUMENTS
from hfa_servo.notebook.calls import ATTRIBUTES

MODEL = hfa.aircraft()


@cache
def _linear() -> LinearModel:
    return linearize(MODEL, trim(MODEL))


def test_step_and_simulate_agree_with_exponentials() -> None:
    """A step response satisfies x' = A x + B, and a simulation of the same input agrees.

    Inputs may be given by name or as an array. Wrong inputs and times are refused.
    """
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
    for stepped in (linear.step("throttle", duration=2.0), linear.step("throttle", time=2.0)):
        assert stepped.outputs.shape[:2] == (6, 1)
        assert stepped.time[-1] == pytest.approx(2.0)
    of_speed = linear.step("throttle", "speed", 2.0).outputs
    assert np.array_equal(of_speed, linear.step(2.0, "throttle", "speed").outputs)
    assert linear.step_response("throttle").outputs.shape[:2] == (6, 1)
    with pytest.raises(BadInputError, match="unknown input 'throtle'; did you mean throttle"):
        linear.step("throtle")


def test_linear_models_have_python_controls_attributes() -> None:
    """A linear model has the attributes of python-control's StateSpace, with named inputs and
    outputs.
    """
    linear = _linear()
    assert linear.ninputs == 5
    assert linear.dcgain() == pytest.approx(linear.C @ -np.linalg.solve(linear.A, linear.B))
    with pytest.raises(AttributeError, match="LinearModel has no attribute 'dcgane'; did you mean"):
        linear.dcgane  # noqa: B018
    loop = linear["pitch_rate", "elevator_center"]
    margins = control.margin(loop.to_control())
    assert loop.margin() == margins
    assert linear.margin(inputs="elevator_center", outputs="pitch_rate") == margins
    assert linear.margin(input="elevator_center", output="pitch_rate") == margins
    assert linear.margin("elevator_center", "pitch_rate") == margins
    assert linear.pole() == pytest.approx(linear.poles())  # MATLAB's name
    with pytest.raises(BadInputError, match="unknown input 'elevator'"):
        linear.damp(inputs="elevator")
    assert {"damp", "modes", "step"} <= set(dir(linear))
    held = linear.discretize(0.1)
    assert np.array_equal(linear.c2d(0.1).A, held.A)
    assert pytest.approx(expm(0.1 * linear.A)) == held.A


def test_methods_of_models_call_python_control() -> None:
    """A linear model's method ctrb() calls python-control's ctrb(A, B) with the matrices of the
    model.

    An error of python-control becomes a one-line message.
    """
    linear = _linear()
    assert np.array_equal(linear.ctrb(), control.ctrb(linear.A, linear.B))
    assert np.array_equal(linear.obsv(), control.obsv(linear.A, linear.C))
    Q, R = np.eye(6), np.eye(5)
    assert linear.care(Q, R)[2] == pytest.approx(control.lqr(linear.to_control(), Q, R)[0])
    for failing in (linear.place, linear.margin, lambda: linear.place([-1.0, -2.0])):
        with pytest.raises(BadInputError, match="python-control's") as error:
            failing()
        assert "\n" not in str(error.value)


def test_transfer_functions_equal_the_models_response() -> None:
    """A transfer function has the frequency response of the model.

    A transfer function is defined for one input and one output only.
    """
    linear = _linear()
    found = linear.transfer_function("elevator_center", "pitch_rate")
    expected = linear["pitch_rate", "elevator_center"].to_control()(2j)
    assert found(2j) == pytest.approx(expected)
    with pytest.raises(BadInputError, match="one input and one output, not 5 and 1"):
        linear.transfer_function(None, "pitch_rate")


def test_bode_and_nyquist_accept_names() -> None:
    """Bode and Nyquist plots select inputs and outputs by name. Unknown names are refused."""
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
    """The plot of a linear model shows poles and zeros."""
    assert "poles x and zeros o, 1/s" in _linear().plot().get_title()
    pyplot.close("all")


def test_a_free_response_is_the_matrix_exponential() -> None:
    """A simulation without inputs returns x(t) = e^(A t) x(0).

    x(0) may be given by name or as an array. A wrong x(0), or a function as input, is refused.
    """
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
    with pytest.raises(
        BadInputError, match=r"initial has shape \(2,\); give an array of shape \(6,\)"
    ):
        linear.simulate(initial=[0.0, 1.0])


def test_simulate_accepts_a_sample_time() -> None:
    """`simulate` with a sample time gives the outputs of `simulate` with times."""
    linear = _linear()
    u = np.random.default_rng(1).normal(size=(5, 101))
    at_times = linear.simulate(u, np.linspace(0.0, 1.0, 101))
    assert linear.simulate(u, dt=0.01).outputs == pytest.approx(at_times.outputs)


def test_keywords_of_python_control_are_accepted() -> None:
    """Calls accept input=, output=, T= and X0= for inputs, outputs, time and initial."""
    linear = _linear()
    usual = linear.step(time=3.0, inputs="throttle", outputs="speed")
    assert np.array_equal(
        linear.step(T=3.0, input="throttle", output="speed").outputs, usual.outputs
    )
    assert linear.simulate(T=1.0, X0={"alpha": 0.1}).outputs[1, 0] == 0.1
    with pytest.raises(BadInputError, match=r"step: .*'timme'; did you mean time\?; the arguments"):
        linear.step(timme=3.0)
    with pytest.raises(BadInputError, match="unexpected keyword argument 'T'"):
        linear.step(time=3.0, T=3.0)


def test_functions_are_methods_of_their_first_argument() -> None:
    """Functions of `hfa` are methods of the type of their first argument.

    A misspelled method gets a suggestion.
    """
    point = MODEL.trim(dihedral=0.2)
    assert point == trim(MODEL, dihedral=0.2)
    linear = MODEL.linearize(point)
    assert np.array_equal(linear.A, linearize(MODEL, point).A)
    game = hfa.paper.published_game(linear)
    assert np.array_equal(game.solve().K, hfa.solve(game).K)
    assert game.verify(hfa.solve(game)).ok
    with pytest.raises(AttributeError, match="Model has no attribute 'solve'"):
        MODEL.solve  # noqa: B018
    with pytest.raises(AttributeError, match=r"'linearise'; did you mean linearize\?"):
        MODEL.linearise  # noqa: B018


def test_attribute_names_of_other_tools_are_accepted() -> None:
    """Attribute names of other tools, such as SciPy's `success`, return the equivalent attribute.

    A name without an equivalent is refused with a suggestion.
    """
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
    solution = hfa.solve(game)
    assert np.array_equal(solution.eigenvalues, solution.closed_loop_eigenvalues)
    assert solution.gamma == game.delta
    analysed = hfa.solve(game)
    assert solution.delta_min == analysed.delta_min
    assert solution.disk_margin == analysed.disk_margin
    assert solution.to_json() == solution.report().json()
    factors = {1.0: "PASS", 1.002: "NEAR", -1.0: "FAIL"}
    assert all(hfa.verify(game, k * solution.K).verdict == word for k, word in factors.items())
    flight = hfa.fly(MODEL, point, K=solution.K, T=0.1)
    assert np.array_equal(flight.t, flight.time)
    assert flight.summary().text() == flight.report().text()
    with pytest.raises(AttributeError, match="LinearModel has no attribute 'success'"):
        _linear().success  # noqa: B018
    assert not {*ATTRIBUTES} & {*ATTRIBUTES.values()}
    assert not any(word in names for word, names in ARGUMENTS.items())


def test_a_missing_argument_is_computed() -> None:
    """Functions accept an earlier member of the chain Model -> OperatingPoint -> LinearModel ->
    Game.

    Further keywords specify the trim and the weights of the game.
    """
    point = trim(MODEL, dihedral=0.2)
    linear = point.linearize()
    for made in (linearize(MODEL, dihedral=0.2), MODEL.linearize(dihedral=0.2), linearize(point)):
        assert np.array_equal(made.A, linear.A)
    weights = {"Q": np.eye(6), "R": np.eye(5)}
    K = hfa.solve(hfa.game(linear, **weights, delta=200.0)).K
    for value in (linear, point):
        assert np.array_equal(hfa.solve(value, **weights, delta=200.0).K, K)
    assert np.array_equal(linear.solve(np.eye(6), np.eye(5), delta=200.0).K, K)
    assert np.array_equal(hfa.lqr(point, **weights).K, hfa.lqr(linear, **weights).K)
    assert hfa.verify(hfa.solve(linear, **weights, delta=200.0), K).ok
    assert np.array_equal(hfa.lqr(MODEL, **weights, dihedral=0.2).K, hfa.lqr(point, **weights).K)
    assert np.array_equal(hfa.solve(MODEL, **weights, delta=200.0, dihedral=0.2).K, K)
    made = hfa.Game(linear, **weights, delta=200.0)
    assert made == hfa.game(linear, **weights, delta=200.0)
    assert made.names == hfa.game(linear, **weights).names
    with pytest.raises(BadInputError, match="A is a Flight"):
        hfa.Game(MODEL.fly(K, seconds=0.1), **weights)


def test_a_gain_file_is_converted_to_aircraft_units(folder: Path) -> None:
    """fly(model, FILE) converts a gain from the units in the file to those of the model."""
    point = trim(MODEL)
    run = hfa.learn(hfa.paper.published_game(point.linearize()), seed=0)
    run.save(Path("learned.npz"))
    initial = {"alpha": 0.01}
    flown = hfa.fly(MODEL, point, run, 0.1, initial=initial).states
    assert np.allclose(hfa.fly(point, "learned.npz", 0.1, initial=initial).states, flown)
    names = run.names
    factors = [0.3048 if unit == "ft/s" else 1.0 for unit in names.state_units]
    units = ["m/s" if unit == "ft/s" else unit for unit in names.state_units]
    assert "m/s" in units
    np.savez("metric.npz", K=run.K / factors, states=names.states, state_units=units)
    assert np.allclose(hfa.fly(point, "metric.npz", 0.1, initial=initial).states, flown)
    np.savez("weights.npz", W=run.weights[-1])
    with pytest.raises(BadInputError, match=r"weights\.npz cannot be read without"):
        hfa.fly(point, "weights.npz", 0.1)


def test_a_gain_closes_a_linear_loop() -> None:
    """linear.closed_loop(K) is z' = (A - B K) z + B v, and linear.margins(K) are the solution's
    margins.
    """
    linear = _linear()
    solution = hfa.lqr(linear, np.eye(6), np.eye(5))
    closed = linear.closed_loop(solution)
    assert np.allclose(closed.A, linear.A - linear.B @ solution.K)
    K, P, poles = solution
    assert K is solution.K is solution[0]
    assert P is solution.P
    assert np.sort_complex(closed.poles()) == pytest.approx(np.sort_complex(poles), rel=1e-6)
    assert closed.input_labels == list(linear.inputs)
    assert solution.certified is True
    for name, margins in linear.margins(solution.K).items():
        assert margins == pytest.approx(solution.loop_margins[name], rel=1e-4, nan_ok=True), name
    with pytest.raises(BadInputError, match="such as the transpose of K"):
        linear.margins(solution.K.T)
    with pytest.raises(NoSolutionError):
        linear.margins(-solution.K)


def test_environments_and_assess_accept_model_values() -> None:
    """environment(model, dihedral=...) and assess(point, FILE) use the trims at the given
    values.
    """
    env = hfa.environment(MODEL, dihedral=[0.1, 0.2])
    assert [point["dihedral"] for point in env.episodes.points] == [0.1, 0.2]
    model = hfa.load_model("examples/gtm.py:GTM")
    file = "examples/gtm_policy/on_time.toml"
    assessed = hfa.assess(trim(model, speed=48.0), file, samples=0)
    assert assessed.radius == hfa.assess(model, file, [48.0], samples=0).radius
    with pytest.raises(BadInputError, match="deployment is a function; give a Deployment, made by"):
        hfa.assess(trim(model), lambda x: x, rate=50)
    with pytest.raises(BadInputError, match="unexpected keyword argument 'sped'"):
        hfa.environment(MODEL, sped=170.0)


def test_prove_selects_the_statement_by_its_arguments() -> None:
    """hfa.prove(game, K) proves statements on a critic. hfa.prove(game) proves the exact
    solution.
    """
    game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [1.0], [1.0], delta=10.0)
    assert hfa.prove(game, [[2.4]]).data["statement"] == "critic"
    assert not hfa.prove(game, np.array([[0.5]])).proved
    with pytest.raises(BadInputError, match="critic is an array of shape"):
        hfa.prove(game, np.ones(2))
    assert hfa.prove(game, hfa.solve(game)).data["distances"].keys() == {"K", "P"}
    assert hfa.prove(game).data["statement"] == "solution"
    with pytest.raises(AttributeError, match=r'write linear.save\("model.mat"\) for MATLAB'):
        hfa.export  # noqa: B018
    gain = hfa.prove(_linear().point, np.ones((5, 6)))
    assert gain.report().title.startswith("Refuted: the gain of the critic does not stabilize")
    with pytest.raises(AttributeError, match="use the command hfa design"):
        hfa.design  # noqa: B018


def test_fly_accepts_a_point_or_a_model() -> None:
    """point.fly(K) starts from this point, and model.fly(K) from the model's default trim."""
    point = trim(MODEL, dihedral=0.2)
    K = hfa.lqr(point, np.eye(6), np.eye(5)).K
    flown = hfa.fly(MODEL, point, K, 0.1, initial={"alpha": 0.01})
    for other in (point.fly(K, 0.1, initial={"alpha": 0.01}), point.simulate(K, T=0.1)):
        assert other.point == point
    assert np.array_equal(point.fly(K, 0.1, initial={"alpha": 0.01}).states, flown.states)
    assert MODEL.fly(K, seconds=0.1).point == trim(MODEL)
    assert trim(point, speed=70.0)["speed"] == 70.0
    with pytest.raises(AttributeError, match="LinearModel has no attribute 'fly'"):
        point.linearize().fly(K)


def test_arguments_of_different_types_have_any_order() -> None:
    """Arguments of different types may be given in any order."""
    game = hfa.paper.published_game(_linear())
    K = hfa.solve(game).K
    assert hfa.verify(K, game).ok
    with pytest.raises(BadInputError, match="no such file"):
        hfa.verify("x.npz", K)


def test_a_file_name_is_accepted_as_a_model() -> None:
    """A text `FILE.py:NAME` is accepted as a model."""
    named = hfa.trim("examples/navion.py:NAVION", speed=180.0)
    assert named.model.name == "Navion"
    with pytest.raises(BadInputError, match="'nothing' is not an aircraft"):
        hfa.trim("nothing")


def test_a_models_trim_can_be_called() -> None:
    """`model.trim` is a mapping of declared values and can be called to find a trim."""
    assert MODEL.trim(dihedral=0.2) == trim(MODEL, dihedral=0.2)
    assert MODEL.trim({"dihedral": 0.2}) == trim(MODEL, dihedral=0.2)
    assert MODEL.trim == dict(MODEL.trim.items())
    changed = MODEL.with_parameters(panel_mass=9.0)
    assert changed.trim().model is changed
    assert pickle.loads(pickle.dumps(MODEL)).trim() == trim(MODEL)


def test_scenario_keywords_are_accepted() -> None:
    """Keywords of a scenario are accepted by `fly`, and a wrong value is refused."""
    point = trim(MODEL)
    delayed = hfa.fly(MODEL, point, delay=0.02, seconds=0.1)
    assert delayed.loop.scenario.delay == 0.02
    with pytest.raises(BadInputError, match="gust is 5; give a gust such as"):
        hfa.fly(MODEL, point, gust=5)


def test_a_linear_model_unpacks_into_its_matrices() -> None:
    """A linear model unpacks into A, B, C and D. python-control refuses the model itself."""
    linear = _linear()
    A, B, C, D = linear
    system = control.ss(*linear)
    assert (system.A == A).all()
    assert (system.D == D).all()
    assert linear.to_control()(2j) == pytest.approx(C @ np.linalg.solve(2j * np.eye(6) - A, B) + D)
    with pytest.raises(TypeError, match="must be a StateSpace"):
        control.ss(linear)
    assert (linear.to_scipy().B == B).all()
    assert linear.x0.tolist() == [linear.point[name] for name in linear.states]
    assert linear.U0.tolist() == linear.u0.tolist() == linear.point.u.tolist()
    assert linear.point.outputs == {name: linear.point[name] for name in MODEL.outputs}
    assert linear.linearize() is linear
    assert np.array_equal(
        hfa.lqr(system, np.eye(6), np.eye(5)).K, hfa.lqr(A, B, np.eye(6), np.eye(5)).K
    )
    assert linear.initial(x0=[0, 0.1, 0, 0, 0, 0])[0].shape[1] == 6


def test_modes_are_an_attribute_method_and_table() -> None:
    """`modes` is an attribute, a method and a table."""
    modes = _linear().modes
    assert modes() is modes
    assert modes.damping.tolist() == [mode.damping for mode in modes]
    assert modes.to_pandas().loc["phugoid", "frequency"] == modes["phugoid"].frequency
    assert "<th>phugoid</th>" in modes._repr_html_()
    assert not hasattr(hfa.sweep(MODEL, dihedral=[0.1]).modes, "_repr_png_")
    with pytest.raises(AttributeError, match="'dampin'; did you mean damping"):
        modes.dampin  # noqa: B018


def test_sweeps_and_flights_have_table_methods() -> None:
    """Sweeps and flights have the methods of a pandas table, and their variables can be plotted
    by name.
    """
    swept = hfa.sweep(MODEL, at=[0.1, 0.2])
    assert np.array_equal(hfa.sweep(MODEL, [0.1, 0.2]).A, swept.A)
    table = swept.to_pandas()
    assert table["dihedral"].tolist() == [0.1, 0.2]
    assert table["phugoid damping"][1] == pytest.approx(swept[1].phugoid.damping)
    assert swept.loc[0.2, "alpha"] == swept["alpha"][1]
    assert [axes.get_ylabel() for axes in swept.plot("alpha", "throttle")] == [
        "alpha, deg",
        "throttle",
    ]
    flight = hfa.fly(MODEL, swept[0].point, seconds=0.1)
    assert flight.describe().loc["max", "speed"] == flight["speed"].max()
    (axes,) = flight.plot("pitch")
    assert axes.lines[0].get_ydata() == pytest.approx(np.degrees(flight["pitch"]))
    point = swept[0].point
    assert point.to_series()["alpha"] == point["alpha"]
    pyplot.close("all")


def test_results_are_saved_and_loaded(tmp_path: Path) -> None:
    """hfa.load reads saved linear models and points. A point requires its model.

    hfa.load also reads deployments and aircraft. Solutions can be written as JSON.
    """
    linear = _linear()
    hfa.save(linear, tmp_path / "linear.npz")
    again = hfa.load(tmp_path / "linear.npz")
    assert again.states == linear.states
    assert all(map(np.array_equal, again, linear))
    assert again.state_units == linear.state_units
    assert again.input_units == linear.input_units
    assert again.model.name == f"linear plant of {linear.model.name}"
    solution = hfa.lqr(linear, np.eye(6), np.eye(5))
    solution.to_json(tmp_path / "solution.json")
    assert np.array_equal(hfa.solve(hfa.game(linear, np.eye(6), np.eye(5))).K, solution.K)
    linear.point.save(tmp_path / "point.json")
    assert hfa.load(tmp_path / "point.json", MODEL) == linear.point
    with pytest.raises(BadInputError, match=r"hfa.load\(FILE, model\)"):
        hfa.load(tmp_path / "point.json")
    assert hfa.load("examples/gtm_policy/on_time.toml").dt > 0.0
    assert hfa.load("examples/uav.toml").name
    assert hfa.damp(linear)[0].shape == (6,)
    with pytest.raises(BadInputError, match=r"hfa.care is a method of results .* control\.care"):
        hfa.care(np.eye(2), np.eye(2), np.eye(2))
    with pytest.raises(AttributeError, match="did you mean solve"):
        hfa.hinf  # noqa: B018


def test_a_solution_plots_its_poles() -> None:
    """The plot of a solution shows the poles of A - B K."""
    assert "poles of A - B K" in hfa.lqr(_linear(), np.eye(6), np.eye(5)).plot().get_title()
    pyplot.close("all")


def test_verify_accepts_a_critic_file_and_keywords(folder: Path) -> None:
    """verify(game, FILE, activation="tanh") returns the verdict on the network in this file."""
    game = hfa.paper.published_game(_linear())
    K = hfa.solve(game).K
    np.savez("policy.npz", **{"0.weight": 0.1 * np.eye(6), "2.weight": -10.0 * K})
    judged = hfa.verify(game, "policy.npz", activation="tanh")
    read = hfa.read_critic("policy.npz", game, activation="tanh")
    assert judged.cost_lost == hfa.verify(game, read).cost_lost
    with pytest.raises(BadInputError, match="unexpected keyword argument 'activations'"):
        hfa.verify(game, "policy.npz", activations="tanh")


def test_missing_attributes_name_the_object_that_has_them() -> None:
    """An entry of a trim's report is an attribute of the operating point.

    The error for an attribute of another object names the expression to write instead.
    """
    linear = _linear()
    point = linear.point
    assert point.loads == point.report().data["loads"]
    for name in ("A", "eigenvalues", "bode"):
        with pytest.raises(AttributeError, match=rf"write point\.linearize\(\)\.{name}"):
            getattr(point, name)
    with pytest.raises(AttributeError, match=r"write linear\.point\.altitude"):
        linear.altitude  # noqa: B018
    swept = hfa.sweep(MODEL, dihedral=[0.1])
    with pytest.raises(AttributeError, match=r"write sweep\.modes\['short period'\]"):
        swept.short_period  # noqa: B018
    assert hfa.linearize(MODEL, at=0.2).point["dihedral"] == 0.2


def test_matrices_as_keywords_make_a_game() -> None:
    """solve(A=, B=, Q=, R=) solves the LQR problem, and with delta= the game."""
    A, B, *_ = _linear()
    Q, R = np.eye(6), np.eye(5)
    matrices = {"A": A, "B": B, "Q": Q, "R": R}
    assert np.array_equal(hfa.solve(**matrices).K, hfa.lqr(A, B, Q, R).K)
    for delta in (300.0, np.inf):
        game = hfa.Game(A, B, Q=Q, R=R, delta=delta)
        assert np.array_equal(hfa.solve(**matrices, delta=delta).P, hfa.solve(game).P)
    with pytest.raises(BadInputError, match="missing a required argument: 'game'"):
        hfa.solve(A=A, Q=Q, R=R)
    with pytest.raises(BadInputError, match="Q or R is missing"):
        hfa.solve(A=A, B=B, Q=Q)


def test_keywords_change_a_game() -> None:
    """solve(game, delta=...) and game.replace(delta=...) change only delta."""
    game = hfa.game(_linear(), np.eye(6), np.eye(5), delta=200.0)
    larger = game.replace(delta=400.0)
    assert larger.delta == 400.0
    assert np.array_equal(hfa.solve(game, delta=400.0).K, hfa.solve(larger).K)
    least = hfa.solve(game).delta_min
    assert hfa.delta_min(game) == game.delta_min == pytest.approx(least)
    assert game.smallest_delta() == game.smallest_delta == game.delta_min
    with pytest.raises(BadInputError, match="unexpected keyword argument 'gama'"):
        hfa.solve(game, gama=400.0)


def test_file_keys_and_degrees_are_available_as_attributes() -> None:
    """Keys of result files are attributes, and each angle has an attribute in degrees
    (`alpha_deg`).

    For quantities that are not angles, there is no such attribute.
    """
    linear = _linear()
    assert linear.operating_point is linear.point
    assert linear.point.alpha_deg == pytest.approx(np.degrees(linear.point.alpha))
    assert hfa.sweep(MODEL, at=[0.1, 0.2]).dihedral_deg.tolist() == pytest.approx(
        np.degrees([0.1, 0.2]).tolist()
    )
    with pytest.raises(AttributeError, match="speed_deg"):
        linear.point.speed_deg  # noqa: B018


def test_an_assessment_at_one_trim_has_its_attributes() -> None:
    """An assessment at one trim has the attributes of its only point."""
    model = hfa.load_model("examples/gtm.py:GTM")
    assessed = hfa.assess("examples/gtm_policy/on_time.toml", model, at=48.0, samples=0)
    assert assessed.delay_limit == assessed.delay_margin == assessed.points[0].delays.limit
    assert assessed.radius == assessed.points[0].radius


def test_training_runs_are_plotted_and_converted() -> None:
    """A training run is plotted and converted to an array."""
    run = hfa.learn(hfa.paper.published_game(_linear()), seed=0)
    assert run.plot().lines[0].get_ydata().tolist() == run.weights[:, 0].tolist()
    assert len(run.history) == len(run.time)
    assert run.to_numpy().shape[0] == len(run.time)
    with pytest.raises(AttributeError, match=r"write model\.trim\(\)\.plot"):
        MODEL.plot()
    pyplot.close("all")


def test_eigenvalues_are_an_attribute_and_a_method() -> None:
    """`eigenvalues` is an attribute and a method, and equals `hfa.eigenvalues`."""
    linear = _linear()
    assert linear.eigenvalues() is not None
    assert np.array_equal(linear.eigenvalues(), hfa.eigenvalues(linear))
    assert repr(linear.eigenvalues).startswith("array(")
    with pytest.raises(AttributeError, match="did you mean Model"):
        hfa.model  # noqa: B018


def test_errors_name_the_correct_call() -> None:
    """The error for a wrong call names the call to use instead.

    Examples are single loops, closed loops and trained policies.
    """
    linear = _linear()
    with pytest.raises(BadInputError, match="give inputs=NAME, outputs=NAME"):
        linear.root_locus()
    game = hfa.paper.published_game(linear)
    solution = hfa.solve(game)
    with pytest.raises(AttributeError, match=r"control.step_response\(solution.closed_loop\)"):
        solution.step_response()

    class Trained:
        """Object with the method `predict` of Stable-Baselines3 policies."""

        def predict(self, observation: np.ndarray) -> np.ndarray:
            return observation

    with pytest.raises(
        BadInputError, match=r"dihedral is \[0\.1, 0\.2\].*hfa\.sweep accepts lists"
    ):
        hfa.trim(MODEL, dihedral=[0.1, 0.2])
    with pytest.raises(BadInputError, match="quickest_flight for the least time"):
        hfa.optimize(MODEL, initial={"alpha": 0.1}, minimize="time")
    with pytest.raises(BadInputError, match="identify: the argument model is missing, only"):
        hfa.identify("flight.csv", states=["speed"])
    with pytest.raises(
        BadInputError, match="the steps of throttle are given as a function; give a gain K"
    ):
        linear.point.simulate(duration=1.0, inputs={"throttle": lambda t: t})
    with pytest.raises(BadInputError, match="or the file in which the policy is saved"):
        hfa.verify(game, Trained())


def _small_critic() -> hfa.Critic:
    """Return a nonlinear critic of a plant with two states and one input."""
    z = ca.SX.sym("z", 2)
    policy = ca.Function("policy", [z], [ca.sin(2.0 * z[0]) - z[1]])
    game = hfa.Game(np.eye(2), np.ones((2, 1)), Q=np.eye(2), R=[1.0])
    return hfa.from_network(game, policy, network="policy")


def test_a_critic_computes_inputs() -> None:
    """u(z) of a network is its policy, and u(z) of a gain is -K z, at one or several states."""
    small = _small_critic()
    assert small.u([0.5, 1.0]) == pytest.approx([np.sin(1.0) - 1.0])
    assert small.u([[0.5, 1.0], [0.0, 0.0]]).shape == (2, 1)
    solution = hfa.solve(hfa.paper.published_game(_linear()))
    z = np.arange(6.0)
    assert hfa.from_gain(solution.game, solution.K).u(z) == pytest.approx(-solution.K @ z)
    assert "variants" not in repr(small)
    swept = hfa.sweep(MODEL, dihedral=[0.0, 0.1])
    assert np.array_equal(swept.sel(dihedral=0.05).A, swept.at(dihedral=0.05).A)


def test_wrong_calls_raise_one_line_errors() -> None:
    """A wrong call raises a one-line error about the call, not an error from inside a function."""

    class Table:
        """Object that is compared entry by entry, like a DataFrame."""

        __hash__ = None  # type: ignore[assignment]

        def __eq__(self, other: object) -> np.ndarray:  # type: ignore[override]
            return np.array([True, False])

    game = hfa.paper.published_game(_linear())
    small = _small_critic()
    for wrong, said in (
        (lambda: hfa.step(), "hfa.step is a method of results"),
        (lambda: hfa.save(5, "x.npz"), r"write result\.save\(...\)$"),
        (lambda: hfa.load("nofile.toml"), "nofile.toml"),
        (lambda: hfa.verify(5, 6), "game is 5"),
        (lambda: hfa.sweep(LinearModel([[0.0]], [[1.0]]).model, at=[1.0]), "cannot sweep 'at'"),
        (lambda: hfa.sweep(MODEL, at=[0.1]).plot(5), "no variable is given to plot"),
        (lambda: hfa.linearize(MODEL, None), "point is None"),
        (lambda: hfa.identify(Table()), "model is a Table; give a Model"),
        (lambda: hfa.identify("flight.csv", "uav.toml"), r"identify\(aircraft, records\)"),
        (lambda: hfa.Model("m", ["x"], {}, lambda x, u, p, w: ({}, {})), "give {name: Signal"),
        (lambda: hfa.Game(np.eye(2), np.eye(2), np.eye(2), np.eye(2)), "third argument is E"),
        (lambda: hfa.optimize(_linear().point, np.ones((5, 6))), "does not accept a gain K"),
        (lambda: hfa.verify(game, lambda t, X: X), "the critic is a function; give a gain K"),
        (lambda: hfa.fly(_linear().point, initial={"alpha": 20.0}), r"1148.72 deg \(20\.\d+ rad\)"),
        (lambda: hfa.fly(_linear().point, small), "computes 1 inputs from 2 states; give a policy"),
        (lambda: hfa.load_policy("policy.onnx"), "give the game as the second argument"),
        (lambda: small.u(np.ones(3)), r"z has shape \(3,\); give \(2,\) or \(N, 2\)"),
    ):
        with pytest.raises(BadInputError, match=said):
            wrong()
    with pytest.raises(AttributeError, match=r"write game\.solve\(\)\.K"):
        hfa.paper.published_game(_linear()).K  # noqa: B018
    assert linearize(MODEL, {"dihedral": 0.2}).point["dihedral"] == 0.2
