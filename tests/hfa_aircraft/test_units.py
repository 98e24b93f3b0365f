"""Models converted to SI units agree with the original models after conversion."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from twins import PLANE, named

import hfa
from hfa import BadInputError, linearize, trim
from hfa.extend import About
from hfa_aircraft import in_si
from trim import usual_condition

#: Unit -> number of SI units in it.
FACTORS = {
    **{"ft": 0.3048, "slug": 14.593902937206364, "lbf": 4.4482216152605},
    **{"deg": np.pi / 180.0, "hp": 745.6998715822702, "inHg": 3386.389},
}


def si_factor(unit):
    """Return the factor of a product or quotient of units, with whole powers."""
    factor = 1.0
    above, _, below = unit.partition("/")
    for words, sign in ((above, 1), (below, -1)):
        for word in words.split():
            name, _, power = word.partition("^")
            factor *= FACTORS.get(name, 1.0) ** (sign * int(power or 1))
    return factor


def factors(model, names):
    return np.array([si_factor(model.unit(name)) for name in names])


def test_parameters_envelope_and_pickles_are_converted():
    """A model in SI units accepts a mass in kg, its envelope is converted, and a pickled copy has
    the same rates.
    """
    model = hfa.aircraft()
    converted = in_si(model)
    heavier = converted.with_parameters(panel_mass=200.0)
    assert heavier.parameters["panel_mass"].unit == "kg"
    slugs = heavier.native.parameters["panel_mass"].start
    assert slugs == pytest.approx(200.0 / si_factor("slug"))
    point = trim(converted, usual_condition(converted))
    envelopes = pytest.importorskip("hfa_flight")
    envelope = envelopes.flight_envelope(converted, point)
    own = envelopes.flight_envelope(model, trim(model, usual_condition(model)))
    np.testing.assert_allclose(
        envelope.highest, own.highest * factors(model, model.states), rtol=1e-9
    )
    again = pickle.loads(pickle.dumps(heavier))
    assert again.rates_at(point.states, point.inputs) == heavier.rates_at(
        point.states, point.inputs
    )


def test_conditions_and_points_in_other_units_are_refused():
    """A model in SI units refuses trim conditions and operating points in English units."""
    model = hfa.aircraft()
    converted = in_si(model)
    with pytest.raises(BadInputError, match="condition and the model have different units"):
        trim(converted, usual_condition(model))
    point = trim(model, usual_condition(model))
    with pytest.raises(BadInputError, match="operating point and the model have different units"):
        linearize(converted, point)


@pytest.mark.parametrize("seed", [0, 1])
def test_an_aircraft_in_random_units_equals_the_aircraft_written_in_si(seed):
    """PLANE is written in SI units; `named(seed)` is the same aircraft in random units, with times in
    minutes. Converted to SI units, it has the signals, trim, A, B, sheet and disturbance of PLANE.
    """

    def weighted(model, size):
        """Return the aircraft with weights and a disturbance of alpha, whose unit is `size` rad."""
        weights = {"Q": {"alpha": 3.0 * size**2, "speed": 0.0}, "E": ("alpha",)}
        return replace(model, about=About(weights=weights))

    drawn, plane = named(seed), weighted(PLANE, 1.0)
    rad = drawn.sizes["alpha"]  # the unit of alpha, rad
    model = in_si(weighted(drawn.model, rad))
    assert model.native.time_unit == "min"
    assert model.time_unit == "s"
    for name, signal in plane.signals.items():
        found = model.signals[name]
        assert found.unit == signal.unit
        assert found[1:5] == pytest.approx(signal[1:5]), name  # nominal, min, max, start
    heavier = (each.with_parameters(mass="1100 kg") for each in (model, plane))
    rates = [each.rates_at([50, 0.1, 0.2, 0.1, 900], [0.1, 800]) for each in heavier]
    assert rates[0] == pytest.approx(rates[1])
    point, expected = trim(model, speed="100 kt"), trim(plane, speed="100 kt")
    assert dict(point) == pytest.approx(dict(expected), abs=1e-9)
    linear, expected_linear = point.linearize(), expected.linearize()
    np.testing.assert_allclose(linear.A, expected_linear.A, atol=1e-9)
    np.testing.assert_allclose(linear.B, expected_linear.B, atol=1e-9)
    for row, expected_row in zip(point.sheet, expected.sheet, strict=True):
        assert (row.name, row.unit) == (expected_row.name, expected_row.unit)
        if not isinstance(row.value, str):  # a bound of rounding
            assert row.value == pytest.approx(expected_row.value, rel=1e-6, abs=1e-9), row.name
    declared = rad / 60.0  # a unit of alpha per minute
    np.testing.assert_allclose(
        hfa.game(linear, R=np.eye(len(linear.inputs))).E, [[0.0], [declared], [0.0], [0.0]]
    )
