"""Parameters, bands and findings of records that SciPy simulated, some with planted faults."""

import math
import re
from dataclasses import replace
from functools import cache

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

import hfa
from hfa import identify


@cache
def identified(seed=0, pole=0.0):
    """Return the result of a maneuver with sensor noise, from 50 % off the true values."""
    return identify(begun(1.5), record(seed, pole), FREE)


TRUE = {name: true_value(name) for name in FREE}


def chi_square(result, true):
    """Return (θ - true)' C⁻¹ (θ - true) of the estimates θ with the covariance C."""
    errors = np.array([result[name].value - value for name, value in true.items()])
    return float(errors @ np.linalg.solve(result.covariance, errors))


def test_residuals_are_the_noise_of_the_sensors():
    """Residuals of a record, and the noise that the result states, have the standard deviations of the
    sensors; the fit is the explained share of the variance, 1 - Σ residual² / Σ (measured - mean)².
    """
    result, measured = identified(), record(0, 0.0)
    for name, size in SENSORS.items():
        unexplained = (
            (result.residuals[0][name] ** 2).sum() / np.var(measured[name]) / len(measured[name])
        )
        assert 1.0 - result.quantities[name].fit == pytest.approx(unexplained, rel=1e-9)
        assert result.residuals[0][name].std() == pytest.approx(size, rel=0.15)
        assert result.quantities[name].noise == pytest.approx(size, rel=0.15)


def test_drawn_aircraft_spread_as_the_band_says():
    """Over 200 drawn aircraft, the standard deviation of Cm_alpha is its half band over 1.96."""
    result = identified()
    drawn = [model.parameters["Cm_alpha"].start for model in result.draws(200, seed=1)]
    half = 0.5 * (result["Cm_alpha"].high - result["Cm_alpha"].low)
    assert np.std(drawn) == pytest.approx(half / 1.96, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_bands_contain_the_true_values(pole):
    """At least 90 % of the bands of 40 records contain the true value, with white noise and with
    colored noise; no residuals are said to follow the inputs.
    """
    covered = []
    for seed in range(40):
        result = identify(begun(1.2), record(seed, pole), FREE)
        for name, estimate in result.parameters.items():
            covered.append(estimate.low < true_value(name) < estimate.high)
        assert not result.misfits
    assert np.mean(covered) > 0.9


def test_colored_noise_widens_the_bands():
    """Each band of a record with a noise pole of 0.9 is 2 to 7 times as wide as with white noise.

    At low frequency the noise is √19 = 4.4 times as large. `coloured` is the factor by which the bands
    were widened, and `white` the fraction of lags without autocorrelation.
    """
    white, colored = identified(), identified(pole=0.9)
    for name in FREE:
        wide, narrow = (each[name].high - each[name].low for each in (colored, white))
        assert 2.0 < wide / narrow < 7.0
    assert white.coloured < 1.5 < colored.coloured
    assert min(each.white for each in colored.quantities.values()) < 0.6
    assert min(each.white for each in white.quantities.values()) > 0.8
    assert colored.ok


def test_gaps_and_several_records():
    """Estimates from a record with missing samples and a second record agree with the true values: the
    chi-square of 7 parameters is below 24.3, which 1 in 1000 exceeds.
    """
    gaps, later = record(1), record(2)
    later["time"] = later["time"] + 100.0
    for name in SENSORS:
        gaps[name][3::4] = math.nan
    result = identify(begun(1.5), [gaps, later], FREE)
    assert result.ok
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
    (clearest,) = [each for each in result.misfits[:2] if each.quantity == seen]
    assert abs(clearest.difference) == pytest.approx(size, rel=0.1)
    if fault is spike:
        assert (clearest.time, clearest.samples) == (pytest.approx(99 * STEP), 1)
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


@pytest.mark.parametrize("coloured", [True, pytest.param(False, marks=pytest.mark.slow)])
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


def test_the_initial_value_of_an_unmeasured_state_is_estimated():
    """In the record of y = 2 u + x, x' = -x, the state x is not measured, and begins at 3 in place of 0,
    its trim. The estimate of the gain is 2 nevertheless, although a sample is a whole time constant.

    The report has the initial value, and the band in percent of the estimate.
    """
    generator = np.random.default_rng(4)
    time, u = np.arange(60.0), generator.standard_normal(60)
    y = 2.0 * u + 3.0 * np.exp(-time) + 1e-3 * generator.standard_normal(60)
    record, done = {"time": time, "u_k": u, "y": y}, []
    result = identify(gains(k=1.0), record, ["k"], progress=lambda *part: done.append(part))
    assert result.ok
    assert result.steps <= 3  # y is linear in gain and initial value
    assert result["k"].value == pytest.approx(2.0, abs=1e-3)
    assert result.starts[0]["x"] == pytest.approx(3.0, abs=5e-3)
    said = str(result)
    assert re.search(rf"record 1 +x +{result.starts[0]['x']:.6g}\b", said)
    assert f" {50.0 * (result['k'].high - result['k'].low) / result['k'].value:.2g} %" in said
    assert done[0][0] < done[0][1]
    with pytest.raises(hfa.BadInputError, match="no estimate of 'y'"):
        result["y"]


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
