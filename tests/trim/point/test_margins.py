"""Margins of a variable follow from its value and its limits."""

import math

import pytest

from hfa import Model, NoSolutionError, Signal, trim


def trim_at(value, lowest, highest):
    """Return the trim of x' = u - value at u = value, with these limits of u."""
    return trim(
        Model(
            "box",
            {"x": Signal("m")},
            {"u": Signal("m", nominal=2.0, min=lowest, max=highest)},
            lambda x, u, p, w: ({"x": u.u - value}, {}),
            trim={"x": 0.0},
        )
    )


NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("value", "lowest", "highest", "nearer", "distance", "share", "used"),
    [
        (3.0, -2.0, 10.0, "lowest", 5.0, 5.0 / 12.0, 0.3),
        (-1.5, -2.0, 10.0, "lowest", 0.5, 0.5 / 12.0, 0.75),
        (9.0, -2.0, 10.0, "highest", 1.0, 1.0 / 12.0, 0.9),
        (2.5, 2.0, 6.0, "lowest", 0.5, 0.125, 0.125),
        (-2.5, -6.0, -2.0, "highest", 0.5, 0.125, 0.125),
        (1.0, 0.0, INF, "lowest", 1.0, 0.0, NAN),
        (-1.0, -INF, 5.0, "highest", 6.0, 0.0, NAN),
        (2.0, -INF, INF, "", INF, NAN, NAN),
    ],
)
def test_margins_follow_from_the_limits(value, lowest, highest, nearer, distance, share, used):
    """The margin of u at a value has the distance from the nearer limit, and `share`, this distance over
    the range of u. `used` is the share of the travel from 0 to the limit on the side of the value;
    where 0 is outside of the limits, the travel begins at the limit next to 0.
    """
    margin = trim_at(value, lowest, highest).margins["u"]
    assert (margin.nearer, margin.at_limit) == (nearer, False)
    found = margin.distance, margin.share, margin.used
    assert found == pytest.approx((distance, share, used), nan_ok=True)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_variable_is_at_its_limit_within_a_tolerance(side):
    """A value is at its limit, ± 40 m, if it is at most 1e-6 (2 m + 40 m) inside: 2 m is the nominal size."""
    slack = 1e-6 * (2.0 + 40.0)
    for inward, expected in ((0.99 * slack, True), (1.01 * slack, False)):
        margin = trim_at(side * (40.0 - inward), -40.0, 40.0).margins["u"]
        assert margin.at_limit == expected
        assert margin.nearer == ("highest" if side > 0.0 else "lowest")
        assert margin.nearer_limit == side * 40.0


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_limit_is_exceeded_by_rounding_only(side):
    """A value may be beyond its limit, ± 40 m, by 1e-9 (2 m + 40 m), and not farther: 2 m is the nominal
    size.
    """
    slack = 1e-9 * (2.0 + 40.0)
    assert trim_at(side * (40.0 + 0.9 * slack), -40.0, 40.0).ok
    with pytest.raises(NoSolutionError, match="u at m"):
        trim_at(side * (40.0 + 1.1 * slack), -40.0, 40.0)
