"""Trims and linear models on boxes of scheduling values, and trims that proofs do not support."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from known_models import model_at
from proof_cases import family

import hfa
from hfa import BadInputError, NoSolutionError
from hfa.paper import default_parameters, level_model
from hfa_prove import Family
from hfa_prove.check.trims import LinearModelBox, Rejected, linear_model_on
from hfa_prove.enclosure.ball_function import Undecided
from hfa_prove.enclosure.balls import exact
from hfa_prove.search.family import Box, TrimSearch, bisected
from hfa_prove.statements.flight import TrimBox
from hfa_support.linear_table import LinearTable
from trim import release
from trim.hfa.level_flight import LEVEL_FLIGHT


def linear_model(flights: Family, low: float, high: float) -> LinearModelBox:
    return TrimSearch(flights, low, high).linear_model(Box(low, high))


def numbers(values: Any, of: str = "mid") -> np.ndarray:
    return np.array([[float(getattr(entry, of)()) for entry in row] for row in values.tolist()])


@pytest.mark.parametrize("dynamics", ["published", "newton"])
@pytest.mark.parametrize("low", [0.0, 9.5])
def test_enclosures_contain_linear_models(dynamics: str, low: float) -> None:
    """The enclosure on a box of dihedral angles contains the A and B that the product computes.

    The polynomials of the trim inputs agree with the product's trims within 1e-4.
    """
    linear = linear_model(family(dynamics), low, low + 0.5)
    for s in (-1.0, -0.4, 0.0, 1.0):
        model = model_at(low + 0.25 + 0.25 * s, dynamics)
        for found, expected in ((linear.A, model.A), (linear.B, model.B)):
            ball = found.near(exact(s), exact(s * s))
            rounding = 1e-11 * (1.0 + np.abs(expected).max())
            assert np.all(np.abs(numbers(ball) - expected) <= numbers(ball, "rad") + rounding)
        for name, polynomial in linear.trim.polynomials.items():
            expected = getattr(model.point.inputs, name)
            assert float(polynomial.at(exact(s)).center) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("name", ["panel_mass", "hinge_damping"])
def test_enclosures_contain_effects_of_parameter_errors(name: str) -> None:
    """The enclosure contains the change of A and B due to an error of one parameter."""
    values = default_parameters().values
    ends = []
    width = 1e-4 * getattr(values, name)
    linear = linear_model(replace(family(), spread={name: width}), 12.0, 12.03125)
    for sign in (-1.0, 1.0):
        moved = values._replace(**{name: getattr(values, name) + sign * width})
        ends.append(level_model(hfa.aircraft(parameters=moved), math.radians(12.015625)))
    for part in ("A", "B"):
        expected = (getattr(ends[1], part) - getattr(ends[0], part)) / 2.0
        found = getattr(linear, part)
        rest = numbers(found.parts[3], "abs_upper")
        assert np.all(np.abs(numbers(found.parts[4]) - expected) <= rest + 1e-15)
        assert rest.max() <= 0.5 * np.abs(expected).max() or not expected.any()


def test_the_remainder_shrinks_with_the_third_power() -> None:
    """The remainder of the models shrinks with the third power of the box width."""
    rests = []
    for width in (0.2, 0.1, 0.05):
        A = linear_model(family(), 5.0 - width / 2, 5.0 + width / 2).A
        rests.append(float(abs(A.parts[3][3, 1]).upper()))
    orders = np.log2(np.array(rests[:-1]) / rests[1:])
    assert np.all((orders > 2.8) & (orders < 3.6))


@pytest.mark.parametrize("limits", [(0.0, 201.0), (-1.0, 200.0)])
def test_limits_wider_than_the_models_are_refused(limits: tuple[float, float]) -> None:
    """Limits that are wider than the model's are refused."""
    flights = Family(hfa.aircraft(), release(LEVEL_FLIGHT, limits={"throttle": limits}))
    with pytest.raises(BadInputError, match="limits of throttle are wider"):
        flights.flight(14.0, 14.5)


def test_an_interval_without_a_trim_is_named() -> None:
    """Boxes without a trim are refused, and boxes up to the last trim are proved.

    Beyond about 45 deg, elevator_center exceeds its limit of 30 deg.
    """
    search = TrimSearch(family(), 0.0, 50.0)
    with pytest.raises((Undecided, Rejected)):
        search.linear_model(Box(0.0, 20.0))
    with pytest.raises(NoSolutionError, match="no trim"):
        search.linear_model(Box(49.9, 50.1))
    last = 40.0
    without = 60.0
    while without - last > 1e-9:
        middle = (last + without) / 2
        try:
            model_at(middle)
            last = middle
        except NoSolutionError:
            without = middle
    search.linear_model(Box(last - 0.2, last - 0.1))
    with pytest.raises(Rejected, match="elevator_center is not proved to be within its limits"):
        search.linear_model(Box(last - 0.1, last))


def test_models_of_exact_doubles_are_sharper() -> None:
    """Models for exact doubles of the parameters are sharper than models for their decimal values.

    The models for the decimal values contain the models for the doubles.
    """
    search = TrimSearch(family(), 15.0, 15.0)
    point = search.point_trim(15.0)
    models = []
    for decimals, radii in ((False, point.radii), (True, point.wide_radii)):
        box = TrimBox(15.0, 15.0, point.center, radii)
        models.append(linear_model_on(search.flight, box, decimals=decimals).A.range())
    for sharp, wide in zip(models[0].entries(), models[1].entries(), strict=True):
        assert wide.contains(sharp.mid())
        assert float(sharp.rad()) < 1e-40
    assert 1e-16 < float(models[1][3, 1].rad()) < 1e-11


def test_trims_with_other_conditions_are_refused() -> None:
    """Proofs refuse trims whose speed depends on the angle, or that have other free variables."""
    flights = family()
    flights.check(0.0, 20.0)
    assert len(flights.condition(10.0).free) == 4
    table = LinearTable([0.0, np.radians(20.0)], [68.0, 60.0])
    with pytest.raises(
        BadInputError,
        match="speed depends on the dihedral in this flight condition; give one value with --hold speed",
    ):
        replace(flights, flights=release(LEVEL_FLIGHT, hold={"speed": table})).check(0.0, 20.0)
    for free in ("alpha", "dihedral"):
        with pytest.raises(BadInputError, match="a proof requires trims at a given dihedral"):
            replace(flights, flights=release(LEVEL_FLIGHT, free=(free,))).check(0.0, 20.0)


@pytest.mark.parametrize(("low", "high"), [(0.0, 20.0), (14.1, 14.3), (-3.7, 2.9)])
def test_the_halves_of_a_box_cover_it(low: float, high: float) -> None:
    """The two halves of a box have its ends and meet near its middle."""
    (left, _), (right, _) = bisected([Box(low, high)], lambda _: None, 0.6 * (high - low))
    assert (left.low, right.high) == (low, high)
    assert left.high == right.low == pytest.approx((low + high) / 2)
