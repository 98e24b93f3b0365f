"""Models converted to SI units agree with the original models after conversion."""

from __future__ import annotations

import pickle
import re

import numpy as np
import pytest
from extension import Extension

import hfa
from hfa import BadInputError, Model, linearize, trim
from hfa_aircraft import in_si
from trim import usual_condition

envelopes = Extension("hfa_flight")

#: English unit -> factor of its SI unit.
FACTORS = {"ft": 0.3048, "slug": 14.593902937206364, "lbf": 4.4482216152605}


def si_factor(unit: str) -> float:
    """Return the factor of a product or quotient of units, with whole powers."""
    factor = 1.0
    above, _, below = unit.partition("/")
    for words, sign in ((above, 1), (below, -1)):
        for word in words.split():
            name, _, power = word.partition("^")
            factor *= FACTORS.get(name, 1.0) ** (sign * int(power or 1))
    return factor


MODELS = [hfa.aircraft("published"), hfa.aircraft("newton")]


def factors(model: Model, names: tuple[str, ...]) -> np.ndarray:
    return np.array([si_factor(model.unit(name)) for name in names])


def test_parameters_envelope_and_pickles_are_converted() -> None:
    """A model in SI units accepts a mass in kg, and its envelope is converted.

    A pickled copy has the same equations.
    """
    model = MODELS[1]
    converted = in_si(model)
    heavier = converted.with_parameters(panel_mass=200.0)
    assert heavier.parameters["panel_mass"].unit == "kg"
    slugs = heavier.native.parameters["panel_mass"].start
    assert slugs == pytest.approx(200.0 / si_factor("slug"))
    point = trim(converted, usual_condition(converted))
    envelope = envelopes.flight_envelope(converted, point)
    own = envelopes.flight_envelope(model, trim(model, usual_condition(model)))
    np.testing.assert_allclose(
        envelope.highest, own.highest * factors(model, tuple(model.states)), rtol=1e-9
    )
    again = pickle.loads(pickle.dumps(heavier))
    assert again.rates_at(point.states, point.inputs) == heavier.rates_at(
        point.states, point.inputs
    )


def test_conditions_and_points_in_other_units_are_refused() -> None:
    """A model in SI units refuses trim conditions and operating points in English units."""
    model = MODELS[0]
    converted = in_si(model)
    with pytest.raises(BadInputError, match="condition and the model have different units"):
        trim(converted, usual_condition(model))
    point = trim(model, usual_condition(model))
    with pytest.raises(BadInputError, match="operating point and the model have different units"):
        linearize(converted, point)


READERS = {
    "table of derivatives": "examples/cessna182.toml",
    "DAVE-ML": "examples/uav.dml",
    "Python": "examples/f16.py:F16",
    "JSBSim": "jsbsim:737",
    "HFA": "",
}


@pytest.mark.parametrize(
    "reader",
    [
        pytest.param(
            each, marks=[] if each in ("HFA", "table of derivatives") else pytest.mark.slow
        )
        for each in READERS
    ],
)
def test_an_aircraft_of_each_reader_is_the_same_in_si(reader: str) -> None:
    """Trim, limits, A and B in SI are those in English units times the factor of each."""
    model = hfa.load_model(READERS[reader]) if READERS[reader] else hfa.aircraft()
    metric = in_si(model)
    for name, signal in model.signals.items():
        factor = si_factor(signal.unit)
        converted = metric.signals[name]
        expected = [
            factor * each for each in (signal.min, signal.max, signal.start, signal.nominal)
        ]
        found = (converted.min, converted.max, converted.start, converted.nominal)
        assert found == pytest.approx(expected), name
        assert converted.assumed == signal.assumed
        assert not {*FACTORS} & {*re.split(r"\W+", converted.unit)}
    point, of_metric = trim(model), trim(metric)
    for name, value in dict(point).items():
        size = abs(value) + 1e-3 * model.signals[name].nominal
        apart = of_metric[name] / si_factor(model.unit(name)) - value
        assert abs(apart) < 1e-6 * size, name
    linear, of_metric_linear = point.linearize(), of_metric.linearize()
    states, inputs = (factors(model, names) for names in (linear.states, linear.inputs))
    scale = np.abs(linear.A).max()
    A = of_metric_linear.A / states[:, None] * states
    B = of_metric_linear.B / states[:, None] * inputs
    np.testing.assert_allclose(A, linear.A, rtol=1e-5, atol=1e-6 * scale)
    np.testing.assert_allclose(B, linear.B, rtol=1e-5, atol=1e-6 * np.abs(linear.B).max())
