"""Parameters, bands and findings of records that SciPy simulated, some with planted faults."""

import math
import re
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from flown_records import (
    AIRCRAFT,
    FREE,
    LONGITUDINAL,
    SENSORS,
    STEP,
    begun,
    record,
    true_value,
)
from scipy.signal import StateSpace, lfilter

import hfa
from hfa import identify
from hfa_support.reporting.text import WIDTH


@cache
def identified(seed=0, pole=0.0):
    """Return the result of a maneuver with sensor noise, from 50 % off the true values."""
    return identify(begun(1.5), record(seed, pole), FREE)


TRUE = {name: true_value(name) for name in FREE}


def chi_square(result, true):
    """Return (θ - true)' C⁻¹ (θ - true) of the estimates θ with the covariance C."""
    errors = np.array([result[name].value - value for name, value in true.items()])
    return float(errors @ np.linalg.solve(result.covariance, errors))


def test_drawn_aircraft_spread_as_the_band_says():
    """Over 200 drawn aircraft, the standard deviation of Cm_alpha is its half band over 1.96."""
    result = identified()
    drawn = [model.parameters["Cm_alpha"].start for model in result.draws(200, seed=1)]
    half = 0.5 * (result["Cm_alpha"].high - result["Cm_alpha"].low)
    assert np.std(drawn) == pytest.approx(half / 1.96, rel=0.15)


def test_gaps_and_several_records():
    """Estimates from a record with missing samples and a second record agree with the true values: the
    chi-square of 7 parameters is below 24.3, which 1 in 1000 exceeds.
    """
    gaps, later = record(1), record(2)
    later["time"] = later["time"] + 100.0
    for name in SENSORS:
        gaps[name][3::4] = math.nan
    result = identify(begun(1.5), [gaps, later], FREE)
    assert result.first_line == "PASS: 7 parameters of 2 records"
    assert chi_square(result, TRUE) < 24.3


def test_a_held_initial_state_is_held():
    """Without a column of pitch, its initial value is fitted, and a wrong value that is held stays wrong."""
    columns = record()
    begin = columns.pop("pitch")[0]
    free = identify(begun(1.2), columns, FREE, inputs="linear")
    held = identify(begun(1.2), columns, FREE, inputs="linear", hold={"pitch": begin + 0.2})
    assert abs(free.starts[0]["pitch"] - begin) < 0.05
    assert "pitch" not in held.starts[0]
    assert held.quantities["speed"].noise > 1.02 * free.quantities["speed"].noise
    with pytest.raises(hfa.BadInputError, match="has a column pitch"):
        identify(begun(1.2), record(), FREE, hold={"pitch": begin})


def late(values):
    """Return a column two samples (0.08 s) late."""
    return np.concatenate([values[:1], values[:1], values[:-2]])


def spike(values):
    """Return a column with a single wrong sample."""
    return values + np.where(np.arange(len(values)) == 99, 5.0, 0.0)


@pytest.mark.parametrize(
    ("column", "fault", "seen", "size"),
    [
        # Sizes in rad/s and rad: that of the spike is planted, the others were found by this test.
        ("pitch_rate", lambda q: 1.3 * q, "pitch_rate", 0.13),
        ("elevator", late, "alpha", 0.02),
        ("alpha", late, "alpha", 0.03),
        ("pitch_rate", spike, "pitch_rate", 5.0),
    ],
)
def test_a_planted_fault_is_seen(column, fault, seen, size):
    """The result names the quantity, how far it is off the model, and when: during the maneuver
    (0.5 to 4.5 s), or at the planted sample.
    """
    wrong = record(seed=11)
    wrong[column] = fault(wrong[column])
    result = identify(begun(1.2), wrong, FREE)
    assert not result.ok
    first, *others = result.findings  # a second one is in the first line where it has room
    both = f"FAIL: {'; '.join([first, *others[:1]])}"
    assert result.first_line == (both if len(both) <= WIDTH else f"FAIL: {first}")
    (clearest,) = [each for each in result.misfits[:2] if each.quantity == seen]
    assert abs(clearest.difference) == pytest.approx(size, rel=0.1)
    if fault is spike:
        assert (clearest.time, clearest.samples) == (pytest.approx(99 * STEP), 1)
        assert f"at {99 * STEP:.4g} s, in 1 sample" in " ".join(str(result).split())
    else:
        assert 0.5 < clearest.time < 4.5
        assert clearest.samples == 0  # no samples stand alone: the difference follows the inputs


def test_parameters_far_from_the_start_are_named():
    """If the elevator of a record has the wrong sign, the estimate of Cm_elevator has the wrong sign. It
    is far from the start of the search, and the report advises to check its units and sign.
    """
    wrong = record(seed=11)
    wrong["elevator"] = 2.0 * wrong["elevator"][0] - wrong["elevator"]
    result = identify(begun(1.2), wrong, FREE)
    assert result["Cm_elevator"].value == pytest.approx(-true_value("Cm_elevator"), rel=0.01)
    assert "Cm_elevator" in result.far
    assert "Cm_elevator" in str(result).partition("Check the units and signs")[2].split("\n\n")[0]


def test_undetermined_parameters_are_named():
    """A parameter that the record does not excite is named, the result does not pass, and no aircraft
    are drawn from it.
    """
    half = {name: column[:100] for name, column in record(model=AIRCRAFT).items()}
    result = identify(AIRCRAFT, half, ("Cm_alpha", "Cm_q", "Cn_r"))
    assert result.undetermined == ("Cn_r",)
    assert not result.ok
    with pytest.raises(hfa.NoSolutionError, match="Cn_r"):
        result.draws(2)


@pytest.mark.parametrize("coloured", [True, False])
def test_a_record_without_motion_fails(coloured):
    """A record of constant columns with white or colored sensor noise determines no parameters."""
    noise, still = record(3, 0.9 * coloured), record(3, sensors={})
    columns = {"time": noise["time"]}
    for name in list(noise)[1:]:
        columns[name] = noise[name] - still[name] + still[name][0]
    result = identify(begun(1.2), columns, FREE)
    assert not result.ok
    assert result.undetermined


def test_biases_of_columns_are_estimated():
    """Biases of 0.02 rad in the pitch and -0.01 rad in the elevator are estimated with six parameters:
    the chi-square of the 8 estimates is below 26.1, which 1 in 1000 exceeds. The bias of an angle is
    printed in degrees.
    """
    wrong = record(seed=5)
    wrong["pitch"] = wrong["pitch"] + 0.02
    wrong["elevator"] = wrong["elevator"] - 0.01
    errors = {"bias_pitch": 0.02, "bias_elevator": -0.01}
    free = (*(name for name in FREE if name != "Cm_0"), *errors)
    begin = begun(1.2).with_parameters(Cm_0=true_value("Cm_0"))
    result = identify(begin, wrong, free)
    assert result.ok
    true = {name: true_value(name) for name in free if name not in errors}
    assert chi_square(result, true | errors) < 26.1
    assert f"{math.degrees(result['bias_pitch'].value):.6g}" in str(result)


def test_noise_slower_than_the_maneuver_fails():
    """Colored noise with a time constant of 2.6 s (pole 0.985 at steps of 0.04 s), longer than the pulses of
    the maneuver, requires bands that are more than 8 times as wide, and the result does not pass.
    """
    result = identify(begun(1.2), record(0, 0.985), FREE)
    assert result.coloured > 8.0  # 8 is the largest factor by which bands are widened
    assert not result.ok


def gains(**values):
    """Return a model of the output y = x + Σ k_i u_i, with x' = -x: its gains k_i start at `values`."""
    return hfa.Model(
        name="gains",
        states={"x": hfa.Signal("1")},
        inputs={f"u_{name}": hfa.Signal("1") for name in values},
        outputs={"y": hfa.Signal("1")},
        parameters={name: hfa.Signal("1", start=value) for name, value in values.items()},
        equations=lambda x, u, p, w: (
            {"x": -x.x},
            {"y": x.x + sum(getattr(p, name) * getattr(u, f"u_{name}") for name in values)},
        ),
        trim={"x": 0.0},
    )


def test_a_model_that_is_linear_in_its_unknowns_has_the_estimate_of_the_closed_form():
    """Estimates, bands, noise and fit of y = Σ k_i u_i + x(0) e^-t, with colored noise and missing samples,
    are those of the weighted normal equations in NumPy. The guess of x(0), 0, has the deviation 1. The
    second input is nearly the first one, and the estimates of both are correlated.
    """
    random = np.random.default_rng(4)
    time, count = 0.05 * np.arange(200), 190
    u = lfilter([1.0], [1.0, -0.8], random.standard_normal((3, 200)))
    u[1] = u[0] + 0.2 * u[1]
    noise = lfilter([1.0], [1.0, -0.6], random.standard_normal(200))
    y = np.array([2.0, -1.0, 0.5]) @ u + 3.0 * np.exp(-time) + noise
    seen = np.arange(200) % 20 != 7
    inputs = {f"u_{name}": values for name, values in zip("abc", u, strict=True)}
    columns = {"time": time, **inputs, "y": np.where(seen, y, np.nan)}
    model, done = gains(a=0.2, b=-1.0, c=5.0), []
    progress = lambda *part: done.append(part)  # noqa: E731
    found = identify(model, columns, ["?"], inputs="linear", progress=progress)

    S, prior = np.column_stack([*u, np.exp(-time)])[seen], np.diag([0.0, 0.0, 0.0, 1.0])
    variance = 1.0
    for _ in range(50):
        normal = S.T @ S / variance + prior
        theta = np.linalg.solve(normal, S.T @ y[seen] / variance)
        v = y[seen] - S @ theta
        variance = v @ v / count
    white = np.linalg.inv(normal)[:3, :3]  # with an unknown x(0)
    unknowns = 4.0 - 1.0 / normal[3, 3]
    beyond = S[:, :3] - np.outer(S[:, 3], S[:, 3] @ S[:, :3]) / variance / normal[3, 3]
    full, place = np.zeros(200), np.flatnonzero(seen)
    full[seen] = v
    pairs = np.array([(seen[lag:] & seen[: 200 - lag]).sum() for lag in range(200)])
    rho = np.array([full[lag:] @ full[: 200 - lag] for lag in range(200)]) / pairs / variance
    limit = 1.959964 / math.sqrt(count)
    first_white = int(np.argmax(rho < limit))
    removed = unknowns / count * (1.0 + 2.0 * rho[1:first_white].sum())
    of_lags = variance * np.where(np.arange(200) < first_white, rho + removed, 0.0)
    score = beyond.T @ of_lags[abs(np.subtract.outer(place, place))] @ beyond / variance**2
    bound = count / (count - unknowns) * white
    widening = np.sqrt(np.maximum(np.diag(white @ score @ white) / np.diag(bound), 1.0))
    expected = bound * np.outer(widening, widening)

    assert [found[name].value for name in "abc"] == pytest.approx(theta[:3], rel=1e-4)
    assert found.starts[0]["x"] == pytest.approx(theta[3], rel=1e-3)
    assert re.search(rf"record 1 +x +{found.starts[0]['x']:.6g}\b", str(found))
    assert found.far == ("a", "c")  # 10 times and a tenth of the start
    assert done[0][0] < done[0][1]
    with pytest.raises(hfa.BadInputError, match="no estimate of 'y'"):
        found["y"]
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-3)
    assert found.coloured == pytest.approx(widening.max(), rel=1e-3)
    assert widening.max() > 1.05
    assert f"factor of up to {widening.max():.2g}" in " ".join(str(found).split())
    for row, name in enumerate("abc"):
        half = 1.959964 * math.sqrt(expected[row, row])
        each = found[name]
        assert f" {100.0 * half / abs(each.value):.2g} %" in str(found)
        assert (each.low, each.high) == pytest.approx(
            (each.value - half, each.value + half), rel=1e-3
        )
    quality = found.quantities["y"]
    assert quality.noise == pytest.approx(math.sqrt(variance), rel=1e-5)
    assert quality.fit == pytest.approx(1.0 - variance / y[seen].var(), rel=1e-5)
    np.testing.assert_allclose(found.residuals[0]["y"][seen], v, atol=1e-3)
    assert quality.white == np.mean(abs(rho[1:26]) < limit)
    ((one, other, coefficient),) = found.correlated
    assert (one, other) == ("a", "b")
    assert coefficient == pytest.approx(white[0, 1] / math.sqrt(white[0, 0] * white[1, 1]))
    assert f"{coefficient:.3f}" in str(found)
    assert found.first_line == "PASS: 3 parameters of 1 record"
    shown = re.search(r"^y +(\S+) % +(\S+) +(\S+) %", str(found), re.M).groups()
    sizes = (f"{100 * quality.fit:.2f}", f"{quality.noise:.6g}", f"{100 * quality.white:.0f}")
    assert shown == sizes


def test_a_misfit_does_not_depend_on_units():
    """The model y = k u + x lacks a term in u². With u and y in other units, the same sample is farthest
    off, by as many units.
    """
    random = np.random.default_rng(1)
    time = 0.1 * np.arange(300)
    u = lfilter([1.0], [1.0, -0.8], random.standard_normal(300))
    y = 2.0 * u + 0.1 * u**2 + 0.05 * random.standard_normal(300)
    found = []
    for of_u, of_y in ((1.0, 1.0), (1e5, 1e-3), (1e-4, 1e2)):
        model = gains(k=of_y / of_u)
        signal = model.outputs["y"]._replace(nominal=of_y)
        model = replace(
            model,
            outputs={"y": signal},
            states={"x": hfa.Signal("1", nominal=of_y)},
            inputs={"u_k": hfa.Signal("1", nominal=of_u)},
        )
        columns = {"time": time, "u_k": of_u * u, "y": of_y * y}
        told = identify(model, columns, ["k"], inputs="linear")
        (misfit,) = told.misfits
        assert misfit.samples == 0
        assert f"at {misfit.time:.4g} s, as the inputs move" in told.first_line
        found.append((misfit.time, misfit.difference / of_y))
    assert found[1] == pytest.approx(found[0], rel=1e-6)
    assert found[2] == pytest.approx(found[0], rel=1e-6)


@pytest.mark.parametrize("kind", ["linear", "steps"])
@pytest.mark.parametrize("start", [1e6, 3e6])
def test_the_inputs_between_samples_are_those_of_the_likelier_fit(kind, start):
    """x' = k u - x, by SciPy of inputs that are held or linear between samples of .2 s. The search begins
    at a limit of k, in units in which the slopes of the likelihood are small, and ends inside.
    """
    model = hfa.Model(
        "lag",
        {"x": hfa.Signal("m")},
        {"u": hfa.Signal("m/s")},
        lambda x, u, p, w: ({"x": p.k * u.u - x.x}, {}),
        parameters={"k": hfa.Signal(start=start, min=1e6, max=3e6)},
        trim={"x": 0.0},
    )
    time, random = 0.2 * np.arange(60), np.random.default_rng(0)
    u, form = 1e-6 * random.standard_normal(60), "foh" if kind == "linear" else "zoh"
    y = StateSpace(-1.0, 2e6, 1.0, 0.0).to_discrete(0.2, form).output(u, None)[1].ravel()
    found = identify(
        model, {"time": time, "u": u, "x": y + 1e-3 * random.standard_normal(60)}, ["k"]
    )
    assert (found.inputs, found.is_chosen) == (kind, True)
    assert found.first_line == "PASS: 1 parameter of 1 record"
    assert found["k"].value == pytest.approx(2e6, rel=1e-3)
    assert found["k"].low < 2e6 < found["k"].high


def test_a_model_without_a_slope_at_its_beginning_is_refused():
    """x' = u - k √x has no slope at 0, where the record begins."""
    tank = hfa.Model(
        "tank",
        {"x": hfa.Signal("m", start=1.0)},
        {"u": hfa.Signal("m/s")},
        lambda x, u, p, w: ({"x": u.u - p.k * ca.sqrt(x.x)}, {}),
        parameters={"k": hfa.Signal(start=1.0)},
    )
    time = 0.1 * np.arange(20)
    columns = {"time": time, "u": np.ones(20), "x": 0.0 * time}
    with pytest.raises(hfa.NoSolutionError, match="diverges with the initial parameter values"):
        identify(tank, columns, ["k"])


def test_an_estimate_ends_at_the_limit_of_its_parameter():
    """Cm_alpha, whose true value is beyond its limit, ends at the limit, and the result says so."""
    limit = 0.9 * true_value("Cm_alpha")
    signals = dict(LONGITUDINAL.parameters)
    signals["Cm_alpha"] = signals["Cm_alpha"]._replace(min=limit, start=0.5 * limit)
    result = identify(replace(LONGITUDINAL, parameters=signals), record(), ["Cm_alpha", "Cm_q"])
    assert result.at_bounds == ("Cm_alpha",)
    assert result["Cm_alpha"].value == limit
    assert "at a limit of the model: Cm_alpha" in str(result)


def test_a_frozen_sensor_is_not_explained():
    """A pitch rate of 0, which contradicts the motion of the other columns, is named, and the result
    does not pass.
    """
    columns = record()
    columns["pitch_rate"] = np.zeros_like(columns["time"])
    result = identify(begun(1.2), columns, FREE)
    assert "pitch_rate" in result.unexplained
    assert not result.ok
