"""Levels of flying qualities, and the class of an aircraft, by MIL-F-8785C."""

import math

import pytest

from hfa import Model, Signal, trim
from hfa_support.reporting.rows import Row
from trim import Airplane, graded
from trim.reports.levels import DEFAULT_AIRPLANE, chosen_airplane
from trim.reports.trimmed import Trimmed

DAMPING = "dutch roll damping times frequency"


def levels(airplane, qualities):
    """Return quality -> level."""
    found = graded([Row(name, value) for name, value in qualities.items()], airplane)
    return {row.name: row.level for row in found}


#: Class, category, quality, and values with their levels, just inside and outside of the limits of
#: Tables IV, VI, VII and VIII and Figures 1 to 3 of MIL-F-8785C.
LIMITS = [
    ("I", "A", "short period damping", {0.351: 1, 0.349: 2, 0.249: 3, 0.149: 4}),
    ("I", "A", "short period damping", {1.299: 1, 1.301: 2, 2.01: 3}),
    ("I", "B", "short period damping", {0.301: 1, 0.299: 2, 0.199: 3, 0.149: 4}),
    ("IV", "A", "CAP", {0.281: 1, 0.279: 2, 0.159: 4, 3.59: 1, 3.61: 2, 10.1: 3}),
    ("II-L", "B", "CAP", {0.0851: 1, 0.0849: 2, 0.0379: 4}),
    ("III", "C", "CAP", {0.161: 1, 0.159: 2, 0.0959: 4}),
    ("I", "C", "short period frequency", {0.871: 1, 0.869: 2, 0.599: 3}),
    ("III", "C", "short period frequency", {0.701: 1, 0.699: 2, 0.399: 3}),
    ("II-C", "C", "n/alpha", {2.71: 1, 2.69: 2, 1.79: 3}),
    ("II-L", "C", "n/alpha", {2.01: 1, 1.99: 2, 0.99: 3}),
    ("III", "B", "phugoid damping", {0.041: 1, 0.039: 2}),
    ("IV", "A", "dutch roll damping", {0.191: 1, 0.189: 2, 0.019: 3, -0.01: 4}),
    ("III", "B", "dutch roll damping", {0.081: 1, 0.079: 2, 0.019: 3, -0.01: 4}),
    ("IV", "A", "dutch roll frequency", {1.01: 1, 0.99: 2, 0.39: 4}),
    ("II-L", "A", "dutch roll frequency", {0.41: 1, 0.39: 4}),
    ("I", "C", "dutch roll damping times frequency", {0.151: 1, 0.149: 2, 0.049: 3}),
    ("III", "C", "dutch roll damping times frequency", {0.101: 1, 0.099: 2, 0.049: 3}),
    ("I", "A", "roll time constant", {0.99: 1, 1.01: 2, 1.41: 3, 10.1: 4}),
    ("III", "A", "roll time constant", {1.39: 1, 1.41: 2, 3.01: 3, 10.1: 4}),
    ("II-C", "A", "roll time constant", {1.39: 1, 1.41: 2, 3.01: 3}),
    ("II-C", "C", "roll time constant", {0.99: 1, 1.01: 2, 1.41: 3}),
    ("II-L", "C", "roll time constant", {1.39: 1, 1.41: 2, 3.01: 3, -0.29: 4}),
    ("I", "C", "dutch roll damping times frequency", {-0.01: 4}),
    ("I", "B", "roll time constant", {1.39: 1, 1.41: 2, 3.01: 3, 10.1: 4}),
    ("I", "B", "spiral time to double", {20.1: 1, 19.9: 2, 7.9: 3, 3.9: 4}),
    ("I", "C", "spiral time to double", {12.1: 1, 11.9: 2, 7.9: 3, 3.9: 4}),
    ("I", "B", "roll damping times frequency", {0.51: 1, 0.49: 2, 0.29: 3, 0.14: 4}),
    ("I", "A", "roll damping times frequency", {9.0: 4}),
]


def test_levels_change_at_the_limits_of_the_standard():
    """Values just inside and outside of each limit of MIL-F-8785C have the levels of `LIMITS`, in which 4 is
    worse than level 3.
    """
    for class_, category, quality, level_of in LIMITS:
        for value, level in level_of.items():
            # At 1 rad/s, no limit of ζω in class III is reduced to 0.7 ω.
            found = levels(
                Airplane(class_, category), {"dutch roll frequency": 1.0, quality: value}
            )
            assert found[quality] == level, quality


def test_a_large_bank_per_sideslip_asks_for_more_damping():
    """MIL-F-8785C, 3.3.1.1: 0.014 (ω² φ/β - 20) is added to the least ζω of level 1, 0.15 for class I.

    In class III, ζ = 0.7, ζω = 2.1 at 3 rad/s, is enough, however large φ/β is.
    """
    values = {"dutch roll frequency": 3.0, "dutch roll phi/beta": 5.0}
    least = 0.15 + 0.014 * (9.0 * 5.0 - 20.0)
    for product, level in ((least + 1e-6, 1), (least - 1e-6, 2)):
        found = levels(Airplane("I", "B"), {**values, DAMPING: product})
        assert found[DAMPING] == level
    heavy = {"dutch roll frequency": 3.0, "dutch roll phi/beta": 50.0}
    assert levels(Airplane("III", "B"), {**heavy, DAMPING: 2.11})[DAMPING] == 1


def test_phugoid_of_level_three_doubles_in_55_seconds():
    """MIL-F-8785C permits a time to double of 55 s in level 3; ζ = -ln 2 / (t ω) doubles in t.

    Level 4 is that beyond level 3. The frequency ω is 0.2 rad/s.
    """
    for seconds, level in ((56.0, 3), (54.0, 4)):
        damping = -math.log(2.0) / (seconds * 0.2)
        found = levels(Airplane(), {"phugoid frequency": 0.2, "phugoid damping": damping})
        assert found["phugoid damping"] == level


@pytest.mark.parametrize(
    ("name", "value", "unit", "largest_load_factor", "class_"),
    [
        ("weight", 12_499.0, "lbf", math.inf, "I"),
        ("weight", 12_501.0 * 4.4482216, "N", 5.9, "II-L"),
        ("weight", 60_001.0 * 4.4482216, "N", math.inf, "III"),
        ("weight", 60_001.0, "lbf", 6.1, "IV"),
        ("weight", 60_001.0, "loads", math.inf, "I"),  # no unit of force: no weight
        ("mass", 5_600.0, "kg", math.inf, "I"),  # 12,500 lbf are 5,670 kg or 389 slug
        ("mass", 400.0, "slug", math.inf, "II-L"),
    ],
)
def test_class_follows_from_weight_and_load_factor(name, value, unit, largest_load_factor, class_):
    """Without a class that the user gives, it is that of the weight or of the mass in standard gravity, in
    any unit: I to 12,500 lbf, II-L to 60,000 lbf, then III; with a largest load factor above 6, IV.
    """
    model = Model(
        "body",
        {"V": Signal("m/s", start=50.0), "alpha": Signal("rad")},
        {"T": Signal("N")},
        lambda x, u, p, w: ({"V": u.T, "alpha": -x.alpha}, {name: value, "load_factor": 1.0}),
        outputs={name: Signal(unit), "load_factor": Signal(max=largest_load_factor)},
        trim={"V": 50.0},
    )
    trimmed = Trimmed(trim(model))
    assert chosen_airplane(trimmed, DEFAULT_AIRPLANE).airplane.class_ == class_
