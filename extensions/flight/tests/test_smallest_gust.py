"""The smallest gust with which a policy leaves its limits."""

from dataclasses import replace
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from cli import answer, assert_refused, hfa as run
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

import hfa
from hfa_flight import Scenario, smallest_gusts

#: v' = 3 (w - v): carried by the air at 10 ft/s, with other limits up and down.
KITE = hfa.Model(
    "kite",
    {"v": hfa.Signal("ft/s", min=-1.0, max=2.0)},
    {"push": hfa.Signal("ft/s^2")},
    lambda x, u, p, w: ({"v": 3.0 * (w.updraft - x.v) + u.push}, {"speed": 10.0 + 0.0 * x.v}),
    outputs={"speed": hfa.Signal("ft/s")},
    disturbances={"updraft": hfa.Signal("ft/s")},
    trim={"v": 0.0},
)

#: Few rows, for flights in little time.
COARSE = Scenario(step=0.05, tick=0.05)


def largest_response(length, rate):
    """Return the largest v of v' = 3 w - rate v in a gust with a peak of 1 ft/s, by quadrature."""
    end = length / 10.0

    def response(t):
        gust = lambda s: 0.5 * (1.0 - np.cos(2.0 * np.pi * s / end))  # noqa: E731
        return -quad(lambda s: 3.0 * np.exp(-rate * (t - s)) * gust(s), 0.0, min(t, end))[0]

    return -minimize_scalar(response, bounds=(0.0, 1.5 * end), method="bounded").fun


def test_thresholds_of_a_linear_aircraft_are_those_of_its_response():
    """The thresholds up and down are the limits of v, 2 and -1 ft/s, divided by the largest response of
    v' = 3 (w - v) - 2 v, within 0.5 %. A gust of 0.5 ft has no thresholds: even with a peak of 10 ft/s,
    the airspeed, it does not move the kite to a limit.
    """
    found = smallest_gusts(KITE, hfa.trim(KITE), [[2.0]], [5.0, 0.5], scenario=COARSE)
    up, down, *of_short_gust = found.thresholds
    response = largest_response(length=5.0, rate=3.0 + 2.0)
    assert up.peak == pytest.approx(2.0 / response, rel=0.006)
    assert down.peak == pytest.approx(-1.0 / response, rel=0.006)
    for threshold in (up, down):
        assert abs(threshold.inside) < abs(threshold.peak) <= 1.005 * abs(threshold.inside)
        assert (threshold.by, threshold.length) == ("v", 5.0)
    assert found.smallest == down
    assert [threshold.peak for threshold in of_short_gust] == [None, None]


def test_peaks_are_in_the_unit_of_the_declared_updraft():
    """A kite that declares its updraft in kt, and its speed in ft/s, has thresholds in kt that are those
    of the kite in ft/s.
    """
    knot = 1852.0 / 0.3048 / 3600.0  # ft/s

    def equations(x, u, p, w):
        return KITE.equations(x, u, p, SimpleNamespace(updraft=knot * w.updraft))

    in_knots = replace(KITE, equations=equations, disturbances={"updraft": hfa.Signal("kt")})
    found, other = (
        smallest_gusts(model, hfa.trim(model), None, [5.0, 0.5], scenario=COARSE)
        for model in (KITE, in_knots)
    )
    flown = [knot * threshold.inside for threshold in other.thresholds]
    assert flown == pytest.approx([threshold.inside for threshold in found.thresholds])
    assert "updraft [kt]" in str(other.report())


def fluttering():
    """Return a kite whose load grows while v is 1.5 ft/s: v stays there only at its maximum."""
    return hfa.Model(
        "fluttering kite",
        {"v": hfa.Signal("ft/s", min=-0.2, max=2.0), "load": hfa.Signal("1", max=0.4)},
        {"push": hfa.Signal("ft/s^2")},
        lambda x, u, p, w: (
            {
                "v": 3.0 * (w.updraft - x.v) + u.push,
                "load": 20.0 * ca.exp(-(((x.v - 1.5) / 0.01) ** 2)) - x.load,
            },
            {"speed": 10.0 + 0.0 * x.v},
        ),
        outputs=KITE.outputs,
        disturbances=KITE.disturbances,
        trim={"v": 0.0, "load": 0.0},
    )


def test_a_window_of_gusts_below_the_threshold_is_found():
    """The load of this kite grows past its limit only if the largest v is within 2 % of 1.5 ft/s. Weaker
    and stronger gusts, up to the limit of v, 2 ft/s, leave no limit. The search finds this window.
    """
    model = fluttering()
    found = smallest_gusts(model, hfa.trim(model), None, [5.0], scenario=COARSE)
    up, down = found.thresholds
    assert (up.by, down.by) == ("load", "v")
    assert up.peak * largest_response(length=5.0, rate=3.0) == pytest.approx(1.5, rel=0.01)
    assert 50 < found.flights < 200


@pytest.mark.slow
def test_the_command_finds_the_thresholds():
    """The flexible aircraft without a policy leaves its limit of the pitch rate in an updraft of 2.52
    ft/s, its smallest gust. A downdraft has a threshold, too.
    """
    words = ("fly", "--dihedral", "5", "--policy", "none", "--gust", "smallest:25")
    data = answer(*words)
    up, down = data["thresholds"]
    assert up["peak"] == pytest.approx(2.52, rel=0.01)
    assert data["smallest"] == up
    assert down["peak"] < 0.0
    assert up["by"] == "pitch_rate"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--dihedral 5 --gust smallest:0", "give lengths above 0"),
        (
            "--dihedral 5 --gust smallest --samples 2",
            "--samples cannot be combined with --gust smallest",
        ),
        ("--dihedral 5 --gust smallest --noise speed=.3", "add --filter"),
        (
            "--aircraft examples/pendulum.py:PENDULUM --gust smallest",
            "no state that is recognized as its speed",
        ),
        ("--gust smalest", "give LENGTH:PEAK[:BEGIN] or smallest"),
    ],
)
def test_wrong_options_of_the_smallest_gust_are_refused(words, said):
    """Wrong lengths and words, draws, noise without a filter, an aircraft without speed are refused."""
    assert_refused(run("fly", *words.split()), 2, said)
