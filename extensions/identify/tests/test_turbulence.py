"""Filter error method, tested with records of a linear short period in turbulence."""

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

import hfa
from hfa_identify.estimation import identify
from hfa_identify.fit import OutputError
from hfa_identify.prediction import Condition, Predictions
from hfa_identify.records import record_of

TRUE = {"Z_alpha": -2.0, "M_alpha": -12.0, "M_q": -3.0, "M_elevator": -20.0}
SENSORS = {"alpha": 0.002, "pitch_rate": 0.005}
STEP = 0.02
#: Standard deviation of the random change of alpha in 1 s, rad.
GUSTS = 0.02


def short_period(x, u, p, w):
    return {
        "alpha": p.Z_alpha * x.alpha + x.pitch_rate,
        "pitch_rate": p.M_alpha * x.alpha + p.M_q * x.pitch_rate + p.M_elevator * u.elevator,
    }, {}


def model(factor=1.0):
    return hfa.Model(
        name="short period",
        states={"alpha": hfa.Signal("rad", 0.1), "pitch_rate": hfa.Signal("rad/s", 0.2)},
        inputs={"elevator": hfa.Signal("rad", 0.1)},
        parameters={
            name: hfa.Signal("1", abs(value), start=factor * value) for name, value in TRUE.items()
        },
        equations=short_period,
    )


@cache
def record(samples=300, seed=0, lag=100.0):
    """Return the columns of a simulated short period in turbulence, with sensor noise.

    White noise drives alpha, and rotates the air through a first-order lag.

    lag: time constant of the air's rotation, s
    """
    A = np.array(
        [
            [TRUE["Z_alpha"], 1.0, 0.0],
            [TRUE["M_alpha"], TRUE["M_q"], -TRUE["M_q"] / lag],
            [0.0, 0.0, -1.0 / lag],
        ]
    )
    B = np.array([0.0, TRUE["M_elevator"], 0.0])
    fine = STEP / 10
    Phi = expm(A * fine)
    held = np.linalg.solve(A, (Phi - np.eye(3)) @ B)
    random = np.random.default_rng(seed)
    time = STEP * np.arange(samples)
    elevator = 0.03 * np.sign(np.sin(2.0 * time)) * (time > 0.5)
    x = np.zeros(3)
    states = np.empty((samples, 2))
    for place in range(samples):
        states[place] = x[:2]
        for _ in range(10):
            x = Phi @ x + held * elevator[place]
            x[[0, 2]] += GUSTS * np.sqrt(fine) * random.standard_normal()
    noise = random.standard_normal(states.shape) * list(SENSORS.values())
    measured = dict(zip(SENSORS, (states + noise).T, strict=True))
    return {"time": time, "elevator": elevator, **measured}


def test_slopes_of_the_likelihood_equal_finite_differences():
    """The right-hand side of the normal equations agrees with finite differences of the likelihood
    L.

    The unknowns are turbulence with its rotation, noise, parameters, a bias and the initial state.
    Some samples are missing, and there are several integration steps between samples.
    """
    columns = {name: values[:200:5] for name, values in record().items()}
    columns["alpha"] = np.where(np.arange(40) % 7 == 3, np.nan, columns["alpha"])
    read = record_of(model(), columns, {})
    free = ("Z_alpha", "M_q", "bias_alpha")
    condition = Condition.of(model(), [read], tuple(SENSORS), {})
    predictions = Predictions(model(), free, tuple(SENSORS), condition)
    start = np.array([0.01, -0.02, 0.003])
    theta = np.array([each.start for each in predictions.signals.values()])
    theta[-1] = 0.003
    assert predictions.steps_between(read, start, theta) > 1
    bounds = np.tile([-np.inf, np.inf], (len(theta), 1))
    search = OutputError(predictions, [read], bounds, [np.zeros(3)])
    at = search.at(theta, (start,))
    (normal,) = at.normals
    exact = -np.concatenate([normal.g, normal.h])
    for place, slope in enumerate(exact):
        change = 1e-5 * np.eye(len(exact))[place]
        ends = [
            search.at(theta + sign * change[:-3], (start + sign * change[-3:],)).likelihood
            for sign in (1.0, -1.0)
        ]
        assert (ends[0] - ends[1]) / 2e-5 == pytest.approx(slope, rel=1e-3, abs=0.02), place


@pytest.mark.parametrize("lag", [100.0, 0.1])
def test_turbulence_is_estimated_with_the_parameters(lag):
    """Turbulence and parameters are estimated together, with and without rotation of the air.

    (θ - true)' C⁻¹ (θ - true) has a chi-square distribution with 4 degrees of freedom. It exceeds
    18.5 once in 1000 cases.
    """
    found = identify(model(1.3), record(lag=lag), list(TRUE), inputs="steps", turbulence=True)
    assert found.ok
    misses = [each.value - TRUE[name] for name, each in found.parameters.items()]
    assert misses @ np.linalg.solve(found.covariance, misses) < 18.5
    assert found.turbulence["alpha"] == pytest.approx(GUSTS, rel=0.3)
    assert all(each.white > 0.8 for each in found.quantities.values())
    assert "random changes in 1 s of alpha" in found.report().text()


def test_options_excluded_by_turbulence_are_refused():
    """Free delays and planning are refused together with turbulence."""
    with pytest.raises(hfa.BadInputError, match="delay_alpha cannot be free with turbulence"):
        identify(model(), record(), ["M_q", "delay_alpha"], turbulence=True)
    with pytest.raises(hfa.BadInputError, match="cannot be combined"):
        identify(model(), record(), ["M_q"], turbulence=True, plan=True)
