"""The branch of trims and the linear model over a box of dihedrals, and which trims a statement may
be about."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from flint import arb
from known_models import model_at
from proof_cases import family

import hfa_model
from hfa_model import default_parameters
from hfa_support import BadInputError, NoSolutionError
from hfa_support.linear_table import LinearTable
from trim import level_model, release
from trim.hfa.level_flight import LEVEL_FLIGHT
from verification.proof.arithmetic.ball_function import Undecided
from verification.proof.arithmetic.balls import exact
from verification.proof.enclosures.trim_branch import PlaceBox, TrimBranch, bisected


def numbers(values: Any, of: str = "mid") -> np.ndarray:
    return np.array([[float(getattr(entry, of)()) for entry in row] for row in values.tolist()])


@pytest.mark.parametrize("dynamics", ["published", "newton"])
@pytest.mark.parametrize("low", [0.0, 9.5])
def test_the_program_s_models_lie_in_the_enclosure(dynamics: str, low: float) -> None:
    branch = TrimBranch(family(dynamics))
    forms = branch.forms(PlaceBox(low, low + 0.5))
    for s in (-1.0, -0.4, 0.0, 1.0):
        model = model_at(low + 0.25 + 0.25 * s, dynamics)
        for form, expected in ((forms.A, model.A), (forms.B, model.B)):
            found, rounding = (
                form.parts[0] + form.away(exact(s), exact(s * s)),
                1e-11 * (1.0 + np.abs(expected).max()),
            )
            assert np.all(np.abs(numbers(found) - expected) <= numbers(found, "rad") + rounding)
        for name, (c0, c1, c2, *_) in forms.trim.items():
            assert c0 + c1 * s + c2 * s * s == pytest.approx(
                getattr(model.point.inputs, name), rel=1e-4
            )


@pytest.mark.parametrize("name", ["panel_mass", "hinge_damping"])
def test_what_the_error_of_a_parameter_does_lies_in_its_enclosure(name: str) -> None:
    values, box = default_parameters().values, PlaceBox(12.0, 12.03125)
    width = 1e-4 * getattr(values, name)
    forms, ends = TrimBranch(replace(family(), spread={name: width})).forms(box), []
    for sign in (-1.0, 1.0):
        moved = hfa_model.aircraft(
            parameters=values._replace(**{name: getattr(values, name) + sign * width})
        )
        ends.append(level_model(moved, math.radians(float(box.middle))))
    for part in ("A", "B"):
        expected, found = (
            (getattr(ends[1], part) - getattr(ends[0], part)) / 2.0,
            getattr(forms, part).parts[4],
        )
        away, radius = np.abs(numbers(found) - expected), numbers(found, "rad")
        assert np.all(away <= radius + 1e-4 * np.abs(expected).max())
        assert radius.max() <= 0.5 * np.abs(expected).max()


def test_the_remainder_shrinks_with_the_third_power() -> None:
    branch, rests = TrimBranch(family()), []
    for width in (0.2, 0.1, 0.05):
        form = branch.forms(PlaceBox(5.0 - width / 2, 5.0 + width / 2)).A
        rests.append(float(abs(form.parts[3][3, 1]).upper()))
    orders = np.log2(np.array(rests[:-1]) / rests[1:])
    assert np.all((orders > 2.8) & (orders < 3.6))


def test_where_there_is_no_enclosure_no_trim_or_none_within_limits_is_said() -> None:
    """Beyond 40 deg elevator_center reaches 30 deg: a box that ends just before the last trim
    cannot rule it out."""
    branch = TrimBranch(family())
    with pytest.raises(Undecided):
        branch.forms(PlaceBox(0.0, 20.0))
    with pytest.raises(NoSolutionError, match="no trim"):
        branch.forms(PlaceBox(49.9, 50.1))
    last, without = 40.0, 60.0
    while without - last > 1e-9:
        middle = (last + without) / 2
        try:
            model_at(middle)
            last = middle
        except NoSolutionError:
            without = middle
    branch.forms(PlaceBox(last - 0.2, last - 0.1))
    with pytest.raises(Undecided, match="elevator_center may lie beyond its limits"):
        branch.forms(PlaceBox(last - 0.1, last))


def test_doubles_alone_give_a_sharper_model() -> None:
    sharp, wide = (
        TrimBranch(replace(family(), decimals=each)).model_at(15.0)[0] for each in (False, True)
    )
    for one, other in zip(sharp.entries(), wide.entries(), strict=True):
        assert other.contains(one.mid())
        assert float(one.rad()) < 1e-40
    assert 1e-16 < float(wide[3, 1].rad()) < 1e-11


def test_trims_that_a_statement_is_not_about_are_refused() -> None:
    flights = family()
    flights.check(0.0, 20.0)
    assert len(flights.condition(10.0).free) == 4
    table = LinearTable([0.0, np.radians(20.0)], [68.0, 60.0])
    with pytest.raises(
        BadInputError, match="speed changes with the dihedral in this condition; --hold it"
    ):
        replace(flights, flights=release(LEVEL_FLIGHT, hold={"speed": table})).check(0.0, 20.0)
    for free in ("alpha", "dihedral"):
        with pytest.raises(BadInputError, match="a proof takes trims at a given dihedral"):
            replace(flights, flights=release(LEVEL_FLIGHT, free=(free,))).check(0.0, 20.0)


@pytest.mark.parametrize(("low", "high"), [(0.0, 20.0), (14.1, 14.3), (-3.7, 2.9)])
def test_the_halves_of_a_box_cover_it_and_its_place_reaches_its_ends(
    low: float, high: float
) -> None:
    box = PlaceBox(low, high)
    (left, _), (right, _) = bisected([box], lambda _: None, 0.6 * (high - low))
    assert (left.low, right.high) == (low, high)
    assert left.high == right.low == pytest.approx((low + high) / 2)
    assert (box.middle - box.radius, box.middle + box.radius) == (arb(low), arb(high))
    assert box.places.contains(arb(low))
    assert box.places.contains(arb(high))
