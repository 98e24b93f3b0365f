"""A tuning file: what it says is what is searched, and what is wrong in it is named."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from refused_files import refusal
from servo_cases import A_Z, write_tuning

from verification.synthesis.tuning_file import load_tuning

AIR = """
[[turbulence]]
dihedral = 9
effectiveness = 0.5
intensity = 2
[turbulence.objective]
dihedral = 50.0
speed = 0.1

[[gusts]]
dihedral = 13
order = 2
length = 250
peak = -5
dynamics = "newton"
"""


def with_air(folder: Path, **changed: object) -> Path:
    path = write_tuning(folder, margin=0.2, fastest=150.0, **changed)
    path.write_text(path.read_text(encoding="utf-8") + AIR, encoding="utf-8")
    return path


def test_what_the_file_says_is_what_is_searched(tmp_path: Path) -> None:
    found = load_tuning(str(with_air(tmp_path)))
    (air,), (gust,) = found.turbulence, found.gusts
    assert (air.dihedral, air.actuator.effectiveness) == (math.radians(9), 0.5)
    assert (air.intensity, air.scale, dict(air.objective)) == (2.0, 1750.0, {"dihedral": 50.0, "speed": 0.1})
    assert (gust.dihedral, gust.actuator.order, gust.length, gust.peak) == (math.radians(13), 2, 250.0, -5.0)
    assert gust.dynamics == "newton"
    assert (found.margin, found.fastest) == (0.2, 150.0)
    assert len(found.places) == 2
    plain = load_tuning(str(write_tuning(tmp_path, abscissa=-0.02)))
    assert (plain.evaluations, plain.seed, plain.abscissa, plain.dynamics) == (12, 1, -0.02, ())
    both = load_tuning(str(write_tuning(tmp_path, dynamics=["newton", "published"])))
    assert both.dynamics == ("newton", "published")
    assert (plain.angles, plain.rate, dict(plain.objective)) == (
        (math.radians(11),),
        math.radians(1),
        {"dihedral": 100},
    )
    assert [(each.name, each.low, each.high) for each in plain.variables] == [("effort", 5.0, 500.0)]
    assert (plain.turbulence, plain.gusts, plain.margin, plain.fastest) == ((), (), 0.0, math.inf)


@pytest.mark.parametrize(
    ("right", "wrong", "named"),
    [
        ("[[gusts]]", "[gusts]", "gusts is no list of tables; write [[gusts]]"),
        ("length = 250", "long = 250", "unknown entry 'long'; gusts 1 has dihedral, order"),
        ("peak = -5", "peak = inf", "gusts 1.peak"),
        ("peak = -5", "", "gusts 1.peak"),
        ('dynamics = "newton"', 'dynamics = "euler"', "gusts 1: unknown dynamics 'euler'; choose from"),
        ('dynamics = "newton"', "dynamics = 3", "3"),
        ("speed = 0.1", "sped = 0.1", "turbulence 1: objective: unknown state of the plant 'sped'; choose from speed"),
        ("[turbulence.objective]\ndihedral = 50.0\nspeed = 0.1", "", "[objective] is empty"),
        ("margin = 0.2", "margin = 0", "margin is 0; give a positive number"),
        ("order = 2", "order = 3", "gusts 1: the order of an actuator is 3"),
        ("dihedral = 100.0", "pitch = 1.0", "objective: unknown integral 'pitch'; choose from dihedral"),
        ("low = 5.0", "low = 5000.0", "variables.effort: give entries, and low below high"),
        (f"{A_Z} = [-1.0, 0.5]", f"{A_Z} = [-1.0]", "cases 1: the lists of ends differ in length"),
        ("angles = [11]", "angles = []", "angles is empty"),
        ("angles = [11]", 'angles = [11]\ndynamics = ["published", "euler"]', "unknown dynamics 'euler'; choose from"),
        ("angles = [11]", 'angles = [11]\ndynamics = "newton"', "dynamics is 'newton'; give a list of names"),
        ("angles = [11]", "angels = [11]", "unknown entry 'angels'; a tuning has design, evaluations"),
        ("rate = 1.0", "rate = 0.0", "rate is 0.0; give a positive number"),
        ("rate = 1.0", "rate = 1.0\nabscissa = 0", "abscissa is 0; it must be below 0"),
        ("evaluations = 12", "evaluations = 0", "evaluations is 0; give a whole number from 1 to 1e+18"),
        ("seed = 1", "seed = -1", "seed is -1; give a whole number from 0 to 1e+18"),
        ("seed = 1", "seed = 1.5", "seed is 1.5; give a whole number"),
        ("rate = 1.0", "rate = 1.0\npower = 0.5", "power is 0.5; it must be at least 1"),
        ("speed = 0.1", "speed = -0.1", "turbulence 1: objective.speed is -0.1; it must not be negative"),
        ("dihedral = 100.0", "dihedral = nan", "objective.dihedral"),
        ("low = 5.0", "low = 0.0", "low is 0.0; give a positive number"),
        ("each = 20", "each = 0", "each is 0; give a positive number"),
        (f"{A_Z} = [-1.0, 0.5]", "", "cases 1: give [cases.ends] with a list for each of dihedral"),
        ("effectiveness = 0.7", 'effectiveness = "much"', "cases 1.effectiveness"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, right: str, wrong: str, named: str) -> None:
    path = with_air(tmp_path)
    text = path.read_text(encoding="utf-8")
    assert text.count(right) == 1
    path.write_text(text.replace(right, wrong), encoding="utf-8")
    assert named in refusal(load_tuning, path)
