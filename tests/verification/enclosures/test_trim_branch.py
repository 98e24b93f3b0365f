"""The branch of trims and the linear model over a box of dihedrals, and which trims a statement may be about."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import flint
import numpy as np
import pytest
from flint import arb
from known_models import model_at
from proof_cases import family

from hfa_model import Aircraft, default_parameters
from hfa_support import BadInputError, NoSolutionError
from hfa_support.linear_table import LinearTable
from trim import level_model, release
from trim.point.condition import LEVEL_FLIGHT
from verification.arithmetic.ball_function import Undecided
from verification.arithmetic.balls import exact
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.place_box import PlaceBox
from verification.enclosures.trim_branch import TrimBranch


def at(form: TaylorModel, s: float) -> np.ndarray:
    """The enclosure at one place of the box: midpoints, and radii."""
    rows = (form.parts[0] + form.away(exact(s), exact(s * s))).tolist()
    return np.array([[(float(entry.mid()), float(entry.rad())) for entry in row] for row in rows])


@pytest.mark.parametrize("dynamics", ["published", "newton"])
@pytest.mark.parametrize("low", [0.0, 9.5])
def test_the_program_s_models_lie_in_the_enclosure(dynamics: str, low: float) -> None:
    box = PlaceBox(low, low + 0.5)
    branch = TrimBranch(family(dynamics))
    forms = branch.forms(box)
    for tau in (-0.25, -0.1, 0.0, 0.25):
        model = model_at(low + 0.25 + tau, dynamics)
        for form, expected in (
            (forms.A, model.A),
            (forms.B, model.B),
            (branch.inputs(forms), model.input_offsets[:, None]),
        ):
            found = at(form, tau / 0.25)
            rounding = 1e-11 * (1.0 + np.abs(expected).max())
            assert np.all(np.abs(found[..., 0] - expected) <= found[..., 1] + rounding)


@pytest.mark.parametrize("name", ["panel_mass", "hinge_damping"])
def test_what_the_error_of_a_parameter_does_lies_in_its_enclosure(name: str) -> None:
    values = default_parameters().values
    width = 1e-4 * getattr(values, name)
    box = PlaceBox(12.0, 12.03125)
    forms = TrimBranch(replace(family(), spread={name: width})).forms(box)
    ends = []
    for sign in (-1.0, 1.0):
        moved = Aircraft(values._replace(**{name: getattr(values, name) + sign * width}))
        ends.append(level_model(moved, math.radians(float(box.middle))))
    for part in ("A", "B"):
        expected = (getattr(ends[1], part) - getattr(ends[0], part)) / 2.0
        rows = getattr(forms, part).parts[4].tolist()
        middle, radius = (
            np.array([[float(getattr(each, of)()) for each in row] for row in rows]) for of in ("mid", "rad")
        )
        assert np.all(np.abs(middle - expected) <= radius + 1e-4 * np.abs(expected).max())
        assert radius.max() <= 0.5 * np.abs(expected).max()


def test_the_remainder_shrinks_with_the_third_power() -> None:
    branch = TrimBranch(family())
    rests = []
    for width in (0.2, 0.1, 0.05):
        form = branch.forms(PlaceBox(5.0 - width / 2, 5.0 + width / 2)).A
        rests.append(float(abs(form.parts[3][3, 1]).upper()))
    orders = np.log2(np.array(rests[:-1]) / rests[1:])
    assert np.all((orders > 2.8) & (orders < 3.6))


def test_a_box_that_is_too_wide_is_said() -> None:
    with pytest.raises(Undecided):
        TrimBranch(family()).forms(PlaceBox(0.0, 20.0))


def test_an_angle_without_a_trim_is_said() -> None:
    with pytest.raises(NoSolutionError, match="no trim"):
        TrimBranch(family()).forms(PlaceBox(49.9, 50.1))


def test_inputs_near_their_limits_are_named() -> None:
    """Beyond 40 deg elevator_center reaches 30 deg: a box that ends just before the last trim cannot rule it out."""
    branch = TrimBranch(family())
    last, without = 40.0, 60.0
    while without - last > 1e-9:
        middle = (last + without) / 2
        try:
            model_at(middle)
            last = middle
        except NoSolutionError:
            without = middle
    assert branch.beyond_limits(branch.forms(PlaceBox(last - 0.2, last - 0.1))) is None
    assert branch.beyond_limits(branch.forms(PlaceBox(last - 0.1, last))) == "elevator_center"


def test_doubles_alone_give_a_sharper_model() -> None:
    flights = family()
    sharp = TrimBranch(replace(flights, decimals=False)).model_at(15.0)[0]
    wide = TrimBranch(flights).model_at(15.0)[0]
    for one, other in zip(sharp.entries(), wide.entries(), strict=True):
        assert other.contains(one.mid())
        assert float(one.rad()) < 1e-40
    assert 1e-16 < float(wide[3, 1].rad()) < 1e-11


# Which trims a statement may be about, and boxes of dihedral.


def test_the_paper_s_flights_are_taken() -> None:
    flights = family()
    flights.check(0.0, 20.0)
    assert len(flights.condition(10.0).free) == 4


def test_what_changes_with_the_dihedral_is_to_be_held() -> None:
    table = LinearTable([0.0, np.radians(20.0)], [68.0, 60.0])
    changing = replace(family(), flights=release(LEVEL_FLIGHT, hold={"speed": table}))
    with pytest.raises(BadInputError, match="speed changes with the dihedral in this condition; --hold it"):
        changing.check(0.0, 20.0)
    replace(changing, flights=release(LEVEL_FLIGHT, hold={"speed": 64.0})).check(0.0, 20.0)


@pytest.mark.parametrize("settings", [{"free": ("alpha",)}, {"free": ("dihedral",)}])
def test_other_trims_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(BadInputError, match="a proof takes trims at a given dihedral"):
        replace(family(), flights=release(LEVEL_FLIGHT, **settings)).check(0.0, 20.0)


@pytest.mark.parametrize(("low", "high"), [(0.0, 20.0), (14.1, 14.3), (-3.7, 2.9)])
def test_the_halves_of_a_box_cover_it_and_its_place_reaches_its_ends(low: float, high: float) -> None:
    flint.ctx.prec = 106  # as proofs have it: middle and radius are exact
    box = PlaceBox(low, high)
    left, right = box.halves()
    assert (left.low, right.high) == (low, high)
    assert left.high == right.low == pytest.approx((low + high) / 2)
    assert (box.middle - box.radius, box.middle + box.radius) == (arb(low), arb(high))
    assert box.places.contains(arb(low))
    assert box.places.contains(arb(high))
