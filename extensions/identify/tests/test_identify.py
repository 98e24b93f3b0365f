"""Parameters identified from records simulated with SciPy, and from records with planted faults."""

import math
import pickle
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from flown_records import SENSORS, longitudinal, noisy_columns
from project import ROOT
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

import hfa
from hfa.main import main
from hfa_aircraft.readers.derivatives.read import from_derivatives
from hfa_identify.bands import noise_of
from hfa_identify.estimation import identify
from hfa_identify.excitation import still_quantities
from hfa_identify.records import Record, read_record, record_of
from hfa_identify.response import Responses
from hfa_identify.search import Search
from hfa_support.native.bound import BoundFunction

UAV = str(ROOT / "examples" / "uav.toml")
FREE = ("CL_0", "CL_alpha", "CD_0", "Cm_0", "Cm_alpha", "Cm_q", "Cm_elevator")
AIRCRAFT = from_derivatives(UAV)
#: Longitudinal motion of the aircraft, in which most faults are planted.
LONGITUDINAL = longitudinal(AIRCRAFT)
SECONDS = 8.0
STEP = 0.04


def doublets(time):
    """Return the elevator deflection from trim of a 3-2-1-1 input, rad, (N,).

    The amplitude is 2 deg. The input begins at 0.5 s, and its time unit is 0.4 s.

    time: s, (N,)
    """
    edges = 0.5 + 0.4 * np.array([0.0, 3.0, 5.0, 6.0, 7.0])
    levels = np.radians(2.0) * np.array([1.0, -1.0, 1.0, -1.0, 0.0])
    place = np.searchsorted(edges, time, side="right") - 1
    return np.where(place < 0, 0.0, levels[np.maximum(place, 0)])


@cache
def simulated_maneuver(model=LONGITUDINAL):
    """Return times, inputs and states of a 3-2-1-1 maneuver, simulated with SciPy."""
    point = hfa.trim(model)
    time = np.arange(0.0, SECONDS, STEP)
    inputs = np.tile(np.array(point.inputs), (len(time), 1))
    inputs[:, list(model.inputs).index("elevator")] += doublets(time)
    f = BoundFunction(model.functions())

    def rates(at, x):
        u = [np.interp(at, time, column) for column in inputs.T]
        return f.at(x, u, model.p)[0]

    ends = (0.0, time[-1])
    solved = solve_ivp(
        rates, ends, list(point.states), t_eval=time, rtol=1e-9, atol=1e-11, max_step=STEP
    )
    return time, inputs, solved.y.T


def record(seed=0, coloured=False, first=0.0, model=LONGITUDINAL):
    """Return the columns of the 3-2-1-1 maneuver with sensor noise.

    coloured: whether the noise is autocorrelated
    first: time of the first sample, s
    """
    time, inputs, states = simulated_maneuver(model)
    generator = np.random.default_rng(seed)
    columns = {"time": time + first}
    columns |= {name: inputs[:, place] for place, name in enumerate(model.inputs)}
    for name, size in SENSORS.items():
        noise = generator.standard_normal(len(time))
        if coloured:
            noise = lfilter([1.0], [1.0, -0.9], noise)
            noise /= noise.std()
        columns[name] = states[:, list(model.states).index(name)] + size * noise
    return columns


def begun(factor=1.5):
    """Return the aircraft with every free parameter multiplied by `factor`."""
    return LONGITUDINAL.with_parameters(**{name: factor * true_value(name) for name in FREE})


@cache
def found(seed=0, coloured=False):
    return identify(begun(), record(seed, coloured), FREE)


def true_value(name):
    return AIRCRAFT.parameters[name].start


def test_estimates_agree_with_the_true_parameters():
    """From initial values 50 % off, the estimates agree with the true parameters.

    (θ - true)' C⁻¹ (θ - true) has a chi-square distribution with 7 degrees of freedom. It exceeds
    24.3 once in 1000 cases. Each band is narrower than 30 % of its estimate.
    """
    result = found()
    assert result.ok
    assert result.first_line == "PASS: 7 parameters of 1 record; assumed 0: bias_elevator"
    misses = np.array([each.value - true_value(name) for name, each in result.parameters.items()])
    assert misses @ np.linalg.solve(result.covariance, misses) < 24.3
    for each in result.parameters.values():
        assert each.high - each.low < 0.3 * abs(each.value)


def test_pandas_tables_and_flights_are_accepted_as_records():
    """Pandas tables and flights are accepted as records. Units are read from the names of columns.

    The residuals have the standard deviations of the sensors, which are also estimated. A call without `free` is an error.
    """
    pandas = pytest.importorskip("pandas")
    columns = record()
    table = pandas.DataFrame(columns).rename(columns={"alpha": "alpha [deg]", "time": "time [s]"})
    table["alpha [deg]"] = np.degrees(table["alpha [deg]"])
    same = identify(begun(), table, FREE)
    assert same.parameters["Cm_q"].value == pytest.approx(found().parameters["Cm_q"].value)
    assert same["Cm_q"] is same.parameters["Cm_q"]
    assert same.to_pandas().set_index("parameter").loc["Cm_q", "value"] == same["Cm_q"].value
    with pytest.raises(hfa.BadInputError, match="did you mean Cm_q"):
        same["Cm_qq"]
    (residuals,) = same.residuals
    for name, size in SENSORS.items():
        assert residuals[name].std() == pytest.approx(size, rel=0.15)
        assert same.quantities[name].noise == pytest.approx(size, rel=0.15)
    with pytest.raises(hfa.BadInputError, match="at least one of mass, Ixx"):
        identify(begun(), table)
    with pytest.raises(hfa.BadInputError, match="unexpected keyword argument 'states'"):
        identify(begun(), table, states=["alpha"])
    moved = {"elevator": [(0.0, 0.03), (0.6, -0.03), (1.2, 0.0)]}
    flight = hfa.fly(LONGITUDINAL, hfa.trim(LONGITUDINAL), moved, seconds=1.9)
    off = LONGITUDINAL.with_parameters(Cm_q=1.5 * true_value("Cm_q"))
    again = identify(off, flight, ["Cm_q"], inputs="steps")
    assert again.parameters["Cm_q"].value == pytest.approx(true_value("Cm_q"), rel=1e-3)


def test_colored_residuals_widen_the_bands():
    """With colored noise, the correction of the bands is larger and the report suggests turbulence."""
    assert found().coloured < 1.5
    assert found(coloured=True).coloured > 2.0
    assert all(each.white < 0.8 for each in found(coloured=True).quantities.values())
    text = " ".join(found(coloured=True).report().text().split())
    assert "colored: turbulence (add --turbulence)" in text


def test_the_variance_of_slow_noise_is_corrected():
    """The estimated variance of slow noise is right within 10 %, although a fit absorbs part of it.

    Four slow sensitivities are fitted to noise with a pole of 0.9. The variance of the residuals
    alone is below 0.85 of the true variance.
    """
    generator = np.random.default_rng(0)
    S = lfilter([1.0], [1.0, -0.95], generator.standard_normal((200, 4)), axis=0)
    variances = []
    for _ in range(200):
        white = generator.standard_normal(400)
        noise = math.sqrt(1.0 - 0.9**2) * lfilter([1.0], [1.0, -0.9], white)[200:]
        theta = np.linalg.lstsq(S, noise)[0]
        residual = noise - S @ theta
        fit = SimpleNamespace(
            theta=theta,
            noise=np.ones(1),
            residuals=(residual[:, None],),
            present=(np.ones((200, 1), dtype=bool),),
            information=S.T @ S,
            projected=(S[:, None],),
            responses=(SimpleNamespace(slopes=S[:, None]),),
            normals=(SimpleNamespace(of_start=np.zeros((0, 0))),),
        )
        variances.append((residual.var(), noise_of(fit)[0][0].variance))
    uncorrected, corrected = np.mean(variances, axis=0)
    assert uncorrected < 0.85
    assert 0.9 < corrected < 1.1


def test_sensitivities_agree_with_differences():
    """Sensitivities to parameters and initial states agree with finite differences.

    There are several integration steps between samples.
    """
    model = LONGITUDINAL
    coarse = {name: values[::8] for name, values in record().items()}
    read = record_of(model, coarse, {})
    responses = Responses(model, FREE[3:5], ("alpha", "gamma"))
    theta = np.array([true_value(name) for name in FREE[3:5]])
    start = np.array([35.0, 0.01, 0.02, 0.01])
    assert responses.steps_between(read, start, theta) > 1
    exact = responses.of(read, start, theta)
    for place in range(2):
        change = np.eye(2)[place] * 1e-6
        above = responses.of(read, start, theta + change).y
        below = responses.of(read, start, theta - change).y
        slope = (above - below) / 2e-6
        np.testing.assert_allclose(exact.slopes[:, :, place], slope, rtol=1e-5, atol=1e-6)
    change = np.eye(4)[1] * 1e-6
    slope = (responses.of(read, start + change, theta).y - exact.y) / 1e-6
    np.testing.assert_allclose(exact.slopes[:, :, 3], slope, rtol=1e-3, atol=1e-3)


def test_gaps_and_several_records_are_used():
    """A record with missing samples is identified together with a second one, and validated with a
    third.
    """
    gaps = record(1)
    for name in SENSORS:
        gaps[name][3::4] = math.nan
    result = identify(begun(), [gaps, record(2, first=100.0)], FREE, validate=[record(3)])
    assert result.ok
    assert result.records == ("record 1", "record 2")
    assert all(each.theil < 0.3 for each in result.quantities.values())
    assert result.quantities["speed"].theil < 0.01


def test_undetermined_parameters_are_named():
    """A parameter that the record does not excite is reported as undetermined, with the state that
    did not move.
    """
    half = {name: column[:100] for name, column in record(model=AIRCRAFT).items()}
    result = identify(AIRCRAFT, half, ("Cm_alpha", "Cm_q", "Cn_r"))
    assert not result.ok
    assert result.undetermined == {"Cn_r": "yaw_rate"}
    assert "not determined: Cn_r (yaw_rate did not move)" in result.first_line
    with pytest.raises(hfa.NoSolutionError, match="do not determine Cn_r"):
        result.draws(2)


def test_states_without_a_sensor_can_be_moved():
    """A state without a sensor counts as moved if the simulation moves it.

    The elevator moves the pitch rate, but not the yaw rate.
    """
    time, inputs, states = simulated_maneuver(AIRCRAFT)
    model = AIRCRAFT
    pitch = list(model.states).index("pitch")
    measured = {"pitch": states[:, pitch]}
    records = [Record("flight", time, inputs, measured)]
    names = ("Cm_q", "Cn_r")
    search = Search(Responses(model, names, ("pitch",)), records, {})
    assert still_quantities(search, names) == {"Cm_q": "", "Cn_r": "yaw_rate"}


def record_with_steps(moves, seconds):
    """Return the columns of a record with stepwise inputs and sensor noise.

    moves: inputs, as `hfa.fly` accepts them
    seconds: duration, s
    """
    flight = hfa.fly(LONGITUDINAL, hfa.trim(LONGITUDINAL), moves, seconds=seconds)
    return noisy_columns(LONGITUDINAL, flight, 20, seed=0)


@pytest.mark.slow
def test_the_search_converges_from_coefficients_70_percent_off():
    """The search converges with 12 lateral coefficients that are 70 % off at the start.

    The first fit of short windows treats the roll rate as noise. A second fit is therefore needed.
    """
    model = AIRCRAFT
    free = [name for name in model.parameters if name.startswith(("CY", "Cl_", "Cn_"))]
    moves = {
        "aileron": [(0.5, 0.1), (1.5, -0.1), (2.2, 0.0)],
        "rudder": [(3.0, 0.12), (4.0, -0.12), (5.0, 0.0)],
    }
    flight = hfa.fly(model, hfa.trim(model), moves, seconds=6)
    sensors = {"beta": 0.003, "roll_rate": 0.01, "yaw_rate": 0.01, "roll": 0.003}
    columns = noisy_columns(model, flight, 20, 0, sensors)
    factors = np.random.default_rng(79).choice([0.3, 1.7], len(free)).tolist()
    values = {name: model.parameters[name].start for name in free}
    begun_at = {name: factor * values[name] for name, factor in zip(free, factors, strict=True)}
    result = identify(model.with_parameters(**begun_at), columns, free, inputs="steps")
    assert result.converged
    assert not result.unexplained
    for name, each in result.parameters.items():
        assert abs(each.value - values[name]) < 2.0 * (each.high - each.low), name


def late(values, samples=2):
    return np.concatenate([np.full(samples, values[0]), values[:-samples]])


@pytest.mark.parametrize(
    ("column", "fault", "named"),
    [
        pytest.param(
            "elevator",
            lambda e: 2.0 * e[0] - e,
            "elevator has the wrong sign",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "elevator",
            lambda e: e * math.pi / 180.0,
            "elevator is in radians, read as degrees",
            marks=pytest.mark.slow,
        ),
        ("pitch_rate", lambda q: 1.2 * q, "scale_p"),
        ("elevator", late, "delay_elevator of 0.08"),
        ("speed", lambda v: v + 4.0, "bias_speed of"),
        pytest.param("alpha", lambda a: -a, "alpha has the wrong sign", marks=pytest.mark.slow),
        (
            "pitch_rate",
            lambda q: q + np.where(np.arange(len(q)) == 99, 5.0, 0.0),
            "an outlier of pitch_rate at 3.96 s",
        ),
        pytest.param(
            "pitch_rate",
            lambda q: np.degrees(q) + np.where(np.arange(len(q)) == 99, 20.0, 0.0),
            "pitch_rate is in deg/s, read as rad/s",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_planted_fault_is_named(column, fault, named):
    """A planted fault of a column is reported, although free parameters partly compensate it."""
    wrong = record(seed=11)
    wrong[column] = fault(wrong[column])
    result = identify(begun(1.2), wrong, FREE)
    assert not result.ok
    assert named in result.first_line


@pytest.mark.parametrize(
    ("name", "factor", "named"),
    [
        ("Cm_alpha", 1.2, "FAIL: Cm_alpha = -0.37"),
        pytest.param(
            *("Cm_0", 0.3, "FAIL: Cm_0 = -0.0234 instead of the given value, or bias_elevator"),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_value_contradicted_by_the_record_is_reported(name, factor, named):
    """A wrong value that the user gives for a parameter is reported.

    The value is also reported if a sensor error explains the record equally well.
    """
    free = [each for each in FREE if each != name]
    given = {name: factor * true_value(name)}
    assert identify(begun(1.2), record(seed=21), free, given=given).first_line.startswith(named)


@pytest.mark.slow
def test_exchanged_columns_are_named():
    """Two exchanged columns are reported in the first line."""
    wrong = record(seed=2)
    wrong["alpha"], wrong["pitch"] = wrong["pitch"], wrong["alpha"]
    result = identify(begun(1.2), wrong, FREE)
    assert result.first_line.startswith("FAIL: alpha and pitch are exchanged")


@pytest.mark.slow
def test_a_unit_error_compensated_by_parameter_is_named():
    """A thrust recorded in lbf is reported, although a free drag coefficient compensates the
    wrong unit.
    """
    moves = {"thrust": [(1.0, 6.0), (3.0, -6.0), (5.0, 0.0)], "elevator": [(5.5, 0.04), (6.2, 0.0)]}
    columns = record_with_steps(moves, 10)
    assert identify(begun(1.2), columns, FREE, inputs="steps").ok
    columns["thrust"] = columns["thrust"] / 4.448222
    assert "thrust is in lbf" in identify(begun(1.2), columns, FREE, inputs="steps").first_line


def test_a_planted_delay_agrees_with_its_estimate():
    """A planted delay of the speed by 0.08 s agrees with its estimate within twice the band.

    The half-width of the band is between 0.03 and 0.12 s. The half-width for the delay of the pitch
    rate is below 0.005 s.
    """
    wrong = record(seed=1)
    wrong["speed"] = late(wrong["speed"])
    errors = identify(begun(1.2), wrong, FREE).column_errors
    delay = errors["delay_speed"]
    assert abs(delay.value - 0.08) < 2.0 * delay.half
    assert 0.03 < delay.half < 0.12
    assert errors["delay_pitch_rate"].half < 0.005


def test_a_bias_that_parameters_compensate_is_stated():
    """A bias of alpha that CL_0 and Cm_0 can compensate has a wide band.

    The report contains this bias, and states that the parameters' bands assume a bias of 0.
    """
    wrong = record(seed=1)
    wrong["alpha"] = wrong["alpha"] + math.radians(1.0)
    result = identify(begun(1.2), wrong, FREE)
    bias = result.column_errors["bias_alpha"]
    assert bias.half > math.radians(1.0)
    assert bias.bands > 10.0
    assert "bias_alpha" in str(result)
    assert result.column_errors["bias_elevator"].value is None
    assumed = str(result).partition("The bands assume ")[2].partition("\n\n")[0]
    assert assumed.startswith("no bias of elevator, thrust, speed, alpha, pitch, no scale")
    assert all(len(line) <= 100 for line in assumed.splitlines())


def lag(rates, start):
    """Return a model of one state x with x' = rates(u, k, x), and a record of x' = u - x.

    The input of the record is a pulse of 2 s.

    start: value of the parameter k at the start of a search
    """
    model = hfa.Model(
        name="lag",
        states={"x": hfa.Signal("1", nominal=1.0)},
        inputs={"u": hfa.Signal("1", nominal=1.0)},
        parameters={"k": hfa.Signal("1/s", nominal=1.0, start=start)},
        equations=lambda x, u, p, w: ({"x": rates(u.u, p.k, x.x)}, {}),
        trim={"x": 0.0},
    )
    time = np.arange(0.0, 10.0, 0.0125)
    pulse = np.where((time >= 1.0) & (time < 3.0), 1.0, 0.0)
    rise = 1.0 - np.exp(-(time - 1.0))
    fall = rise[time <= 3.0][-1] * np.exp(-(time - 3.0))
    x = np.where(time < 1.0, 0.0, np.where(time <= 3.0, rise, fall))
    return model, {"time": time, "u": pulse, "x": x}


def test_equivalent_sign_errors_are_both_named():
    """For a linear model, a wrong sign of the input and of the state are reported together.

    Only the sign of the input is wrong. The record cannot distinguish the two faults.
    """
    model, columns = lag(lambda u, k, x: u - k * x, 1.5)
    noise = np.random.default_rng(0).standard_normal(len(columns["x"]))
    wrong = columns | {"x": columns["x"] + 0.02 * noise, "u": -columns["u"]}
    wrong = {name: values[::8] for name, values in wrong.items()}
    result = identify(model, wrong, ["k"], inputs="steps")
    assert "x has the wrong sign, or u has the wrong sign" in result.first_line


SECOND = "FAIL: a second estimate explains the record equally well: k = {:.4g} (or {:.4g})"


def test_a_second_minimum_is_named():
    """With x' = u - k² x and a search that begins at k = 3.5, a second estimate at -k is reported.

    It is not reported if the limits of k exclude it.
    """
    model, columns = lag(lambda u, k, x: u - k**2 * x, 3.5)
    noise = np.random.default_rng(0).standard_normal(len(columns["x"]))
    result = identify(model, columns | {"x": columns["x"] + 0.01 * noise}, ["k"], inputs="steps")
    found = result.parameters["k"].value
    assert abs(found) == pytest.approx(1.0, abs=0.1)
    assert result.other_minimum["k"] == pytest.approx(-found, abs=0.01)
    assert result.first_line == SECOND.format(-found, found)
    positive = replace(model, parameters={"k": hfa.Signal("1/s", 1.0, 0.0, start=1.2)})
    columns["x"] = columns["x"] + 0.01 * noise
    assert identify(positive, columns, ["k"], inputs="steps").ok


def test_a_minimum_that_is_not_mirrored_is_named():
    """A second estimate that is not the negative of the first is reported.

    The rate depends on (k - 1) (3 - k), which is equal at 1.5 and at 2.5.
    """
    model, columns = lag(lambda u, k, x: u - (k - 1) * (3 - k) / 0.75 * x, 1.4)
    noise = np.random.default_rng(0).standard_normal(len(columns["x"]))
    result = identify(model, columns | {"x": columns["x"] + 0.01 * noise}, ["k"], inputs="steps")
    assert result.other_minimum["k"] == pytest.approx(4.0 - result.parameters["k"].value, abs=0.01)
    assert "a second estimate explains the record equally well: k = 2." in result.first_line


@pytest.mark.parametrize(
    ("coloured", "moved"), [(True, 0.0), pytest.param(False, 1e-5, marks=pytest.mark.slow)]
)
def test_a_record_without_motion_is_named(coloured, moved):
    """A record of sensor noise alone is refused, also if an input moves slightly."""
    columns = record(seed=3, coloured=coloured)
    time, inputs, states = simulated_maneuver()
    model = LONGITUDINAL
    for name in SENSORS:
        place = list(model.states).index(name)
        columns[name] = columns[name] - states[:, place] + states[0, place]
    elevator = inputs[0, list(model.inputs).index("elevator")]
    columns["elevator"] = elevator + moved * np.random.default_rng(1).standard_normal(len(time))
    with pytest.raises(
        hfa.NoSolutionError, match="record 1: the model explains none of the recorded motion"
    ):
        identify(begun(1.2), columns, FREE)


def test_noise_slower_than_the_maneuver_fails():
    """Noise with a time constant of about a second is reported as too slow for the correction.

    The correction widens the bands for colored noise.
    """
    model, columns = lag(lambda u, k, x: u - k * x, 1.2)
    noise = np.random.default_rng(0).standard_normal(2000)
    slow = lfilter([1.0], [1.0, -0.985], noise)[-len(columns["x"]) :]
    result = identify(model, columns | {"x": columns["x"] + 0.02 * slow}, ["k"], inputs="steps")
    assert result.coloured > 8.0
    assert "residuals are colored beyond the correction" in result.first_line


def test_errors_of_sensors_are_estimated():
    """Planted biases, scale errors and delays are within 1.3 band widths of their estimates.

    The report prints the bias of an angle in degrees.
    """
    wrong = record(seed=5)
    wrong["pitch"] = late(wrong["pitch"]) + 0.02
    wrong["pitch_rate"] = 1.1 * wrong["pitch_rate"]
    errors = {"bias_pitch": 0.02, "delay_pitch": 0.08, "scale_pitch_rate": 0.1}
    result = identify(begun(1.2), wrong, (*FREE, *errors))
    assert result.ok
    for name, planted in errors.items():
        each = result.parameters[name]
        assert abs(each.value - planted) < 1.3 * (each.high - each.low)
    bias = result.parameters["bias_pitch"]
    (line,) = [line for line in str(result).splitlines() if line.startswith("bias_pitch")]
    assert line.split()[1] == f"{math.degrees(bias.value):.6g}"
    assert line.split()[-1] == "deg"


def test_stepwise_inputs_are_recognized():
    """A record with stepwise inputs fails if the inputs are interpolated linearly.

    The first line recommends --inputs steps.
    """
    moves = [(0.5, 0.04), (1.7, -0.04), (2.5, 0.04), (2.9, -0.04), (3.3, 0.0)]
    columns = record_with_steps({"elevator": moves}, 5)
    rows = np.sort(np.random.default_rng(5).permutation(len(columns["time"]))[:180])
    uneven = {name: values[rows] for name, values in columns.items()}
    first = identify(begun(1.2), uneven, FREE).first_line
    assert first.startswith("FAIL: inputs are constant between samples; add --inputs steps")


def test_records_that_disagree_are_named():
    """Records of two aircraft whose Cm_q differs by 50 % are reported to disagree on Cm_q."""
    other = LONGITUDINAL.with_parameters(Cm_q=1.5 * true_value("Cm_q"))
    result = identify(begun(1.2), [record(1), record(2, model=other)], FREE)
    assert not result.ok
    assert "records disagree on Cm_q" in "; ".join(result.findings)


def test_drawn_aircraft_have_the_covariance():
    """The spread of Cm_alpha of drawn aircraft agrees with the covariance within 15 %.

    The first drawn aircraft is trimmed.
    """
    result = found()
    drawn = result.draws(200, seed=1)
    values = np.array([model.parameters["Cm_alpha"].start for model in drawn])
    place = list(result.parameters).index("Cm_alpha")
    assert values.std() == pytest.approx(math.sqrt(result.covariance[place, place]), rel=0.15)
    assert hfa.trim(drawn[0]).states.alpha < 0.05


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": lambda t: t[::-1]}, "time does not increase at sample 2"),
        ({"time": lambda t: np.where(t == t[7], t[6], t)}, "time does not increase at sample 8"),
        ({"elevator": lambda e: np.where(e == e.max(), np.nan, e)}, "elevator has no value"),
        ({"alpha": lambda a: np.full_like(a, 0.01)}, "as from a frozen sensor"),
        ({"alpha": lambda a: np.where(np.arange(len(a)) > 100, a[100], a)}, "repeats one value"),
        ({"alpha": lambda a: np.where(np.arange(len(a)) // 6 == 9, a[54], a)}, "value 6 times"),
        ({"alpha": lambda a: np.where(a == a.max(), np.inf, a)}, "alpha contains infinite values"),
        ({"alpha": lambda a: a[:-1]}, "alpha has 199 samples, but time has 200"),
        ({"alpha": lambda a: np.full_like(a, np.nan)}, "alpha has 0 finite values"),
        ({"elevator": None}, "elevator=VALUE, or in Python hold={'elevator': VALUE}"),
        ({"time": None}, "has no column time"),
    ],
)
def test_a_faulty_record_is_refused(change, message):
    """Records with faulty times, missing columns, gaps of inputs or frozen sensors are refused."""
    columns = record()
    for name, fault in change.items():
        if fault is None:
            del columns[name]
        else:
            columns[name] = fault(columns[name])
    with pytest.raises(hfa.BadInputError, match=message):
        identify(begun(), columns, FREE)


def test_constant_columns_before_first_input_are_accepted():
    """Columns that are all constant until the first input are not reported as frozen.

    A column that is constant while another moves is reported.
    """
    columns = record()
    for values in columns.values():
        if values is not columns["time"]:
            values[:12] = values[0]
    read = record_of(LONGITUDINAL, columns, {})
    assert read.measured["alpha"][11] == read.measured["alpha"][0]
    columns["speed"][5] += 0.1
    with pytest.raises(hfa.BadInputError, match="alpha repeats one value 12 times"):
        record_of(LONGITUDINAL, columns, {})


def test_wrong_names_are_refused():
    """Unknown parameters, unknown columns and an empty list of records are refused."""
    with pytest.raises(hfa.BadInputError, match="has no parameter 'Cm_p'"):
        identify(begun(), record(), ["Cm_p"])
    with pytest.raises(hfa.BadInputError, match="unknown column 'aplha'"):
        identify(begun(), {**record(), "aplha": record()["alpha"]}, FREE)
    with pytest.raises(hfa.BadInputError, match="no records"):
        identify(begun(), [], FREE)


def written(path, columns, units):
    """Write columns to a CSV file.

    units: column -> unit in degrees, to which the column is converted from radians
    """
    heads = [f"{name} [{units[name]}]" if name in units else name for name in columns]
    table = np.column_stack(
        [values * (180.0 / math.pi if name in units else 1.0) for name, values in columns.items()]
    )
    rows = [",".join(heads), *(",".join(map(repr, row)) for row in table.tolist())]
    Path(path).write_text("\n".join(rows))


def test_the_command_writes_an_aircraft(folder, capsys):
    """`hfa identify` reads a CSV file in degrees and writes an aircraft file that can be trimmed."""
    written(
        "flight.csv",
        record(model=AIRCRAFT),
        {"alpha": "deg", "elevator": "deg", "pitch_rate": "deg/s"},
    )
    words = ["identify", "flight.csv", "--aircraft", UAV, "--free", "Cm_alpha,Cm_q"]
    assert main([*words, "-o", "found.toml", "--picture", "fit.png"]) == 0
    printed = capsys.readouterr().out
    assert "PASS: 2 parameters of 1 record" in printed
    assert "uav.toml (SHA-256" in " ".join(printed.split())
    model = hfa.load_model("found.toml")
    assert model.parameters["Cm_q"].start == pytest.approx(true_value("Cm_q"), rel=0.1)
    assert model.parameters["Cm_q"].start != true_value("Cm_q")
    assert main(["trim", "--aircraft", "found.toml"]) == 0


@pytest.mark.parametrize("is_python", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_written_file_names_its_aircraft(is_python, folder, capsys):
    """The file names the aircraft relative to itself and contains the values fixed by --given.

    Both files can be moved together. A changed aircraft is refused. An aircraft in Python is given
    by the user.
    """
    for name in ("data", "results"):
        Path(name).mkdir()
    aircraft = Path("data/uav.toml")
    aircraft.write_text(Path(UAV).read_text())
    given = str(aircraft)
    if is_python:
        aircraft = Path("data/uav.py")
        aircraft.write_text(f"import hfa\nUAV = hfa.from_derivatives({UAV!r})\n")
        given = f"{aircraft}:UAV"
    written("flight.csv", record(model=AIRCRAFT.with_parameters(CD_0=0.05)), {})
    words = ["identify", "flight.csv", "--aircraft", given, "--free", "Cm_q"]
    assert main([*words, "--given", "CD_0=0.05", "-o", "results/found.toml"]) == 0
    Path("elsewhere").mkdir()
    for name in ("data", "results"):
        Path(name).rename(Path("elsewhere", name))
    arguments = ("elsewhere/results/found.toml",)
    if is_python:
        arguments = (f"elsewhere/{given}", *arguments)
    found = hfa.load_model(*arguments)
    if is_python:
        words = ["trim", "--aircraft", f"elsewhere/{given}"]
        assert main([*words, "--parameters", "elsewhere/results/found.toml", "--draws", "2"]) == 0
        assert "parameters elsewhere/results/found.toml (" in capsys.readouterr().out
    assert found.parameters["CD_0"].start == 0.05
    assert found.parameters["Cm_q"].start != true_value("Cm_q")
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.p, found.p)
    moved = Path("elsewhere", aircraft)
    moved.write_text(moved.read_text() + "\n# changed")
    with pytest.raises(hfa.BadInputError, match="SHA-256"):
        hfa.load_model(*arguments)


def test_a_wrong_unit_is_refused(folder, capsys):
    """A column in a unit of another quantity is refused."""
    written("flight.csv", record(model=AIRCRAFT), {"alpha": "m"})
    words = ["identify", "flight.csv", "--aircraft", UAV, "--free", "Cm_q"]
    assert main(words) == 2
    assert "flight.csv: alpha is in m; give alpha in rad" in capsys.readouterr().err


def test_a_flight_file_is_accepted_as_a_record(folder):
    """A file written by `hfa fly` is accepted as a record. The last column of the file, the
    provenance, is ignored.
    """
    model = hfa.load_model(UAV)
    written("flight.csv", record(model=AIRCRAFT), {})
    head, first, *rows = Path("flight.csv").read_text().splitlines()
    text = "\n".join([f"{head},about", f"{first},hfa", *(f"{row}," for row in rows)])
    Path("flown.csv").write_text(text)
    ours, theirs = (read_record(name, model, {}) for name in ("flown.csv", "flight.csv"))
    np.testing.assert_array_equal(ours.inputs, theirs.inputs)
    assert ours.measured.keys() == theirs.measured.keys()
