"""Calls that cannot be answered are refused, each with what is wrong."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from own_models import NAVION
from project import ROOT

import hfa
from hfa import BadInputError, LinearModel, Model, Signal, TrimCondition
from hfa.paper import default_parameters, level_flight
from hfa_flight import Waveform
from trim import entry_bands, release, trim_figure

HFA = hfa.aircraft()
GTM = hfa.load_model(f"{ROOT}/examples/gtm.py:GTM")


def cart():
    """Return the cart x' = v, v' = force with the output 1 / x."""

    def equations(x, u, p, w):
        return {"x": x.v, "v": u.force}, {"ratio": 1.0 / x.x}

    states = {"x": Signal("m", start=1.0), "v": Signal("m/s")}
    return Model("cart", states, {"force": Signal("N")}, equations, outputs={"ratio": Signal()})


@cache
def point():
    return hfa.trim(HFA)


def squared(x, u, p, w):
    return {"x": x.v, "v": u.force}, {"ratio": x.v**2}


def written(content):
    """Return the path of a JSON file beside the folder of the test."""
    path = Path("../plant.json")
    path.write_text(json.dumps({k: v for k, v in content.items() if v is not None}))
    return str(path)


def plant(**entries):
    """Return the path of a file with a plant of two states."""
    return written({"A": [[0.0, 1.0], [-2.0, -0.3]], "B": [[0.0], [1.0]], **entries})


def linear():
    return point().linearize()


def heavier(factor):
    """Return the identified parameters with another mass of the panels."""
    found = default_parameters()
    mass = factor * found.values.panel_mass
    return replace(found, values=found.values._replace(panel_mass=mass))


def bode(**chosen):
    """Draw channels of the Navion."""
    return hfa.trim(NAVION).linearize(outputs=("beta",)).select(**chosen).bode()


TWO = LinearModel.of(-np.eye(2), np.eye(2), np.ones((3, 2)), states=("q", "v"), inputs=("f", "g"))
LEVEL = level_flight(0.2)


def coasting():
    """Return v' = -v, which its input does not change."""
    states, inputs = {"speed": Signal("m/s", start=10.0)}, {"push": Signal("N")}

    def equations(x, u, p, w):
        return {"speed": -x.speed}, {}

    return Model("coasting", states, inputs, equations, trim={"speed": 10.0})


def beyond(**changes):
    """Trim the flexible aircraft at a condition with other values or limits."""
    return hfa.trim(HFA, level_flight(**({"dihedral": 0.1} | changes)))


CALLS = {
    "unknown variable 'sped'; did you mean speed": lambda: point()["sped"],
    "'theta'": lambda: point().linearize().A["pitch_rate", "theta"],
    "'holds'": lambda: hfa.trim(HFA, holds={"speed": 70.0}),
    "pitch cannot be residualized": lambda: linear().select(residualize=("pitch",)),
    "the model has no inputs, so no Bode plot exists": lambda: bode(inputs=()),
    "state alpha is both kept and residualized": lambda: linear().select(
        states=("speed", "alpha"), residualize=("alpha",)
    ),
    "trimmed with 'published' dynamics, but the aircraft has 'newton'": lambda: hfa.linearize(
        hfa.aircraft("newton"), point()
    ),
    "bands exist only for the identified parameters": lambda: entry_bands(
        heavier(1.0 + 1e-6), LEVEL, linear()
    ),
    "output y2 is named twice": lambda: TWO[("y2", "y1", "y2"), "f"],
    "error bands exist only for the states": lambda: entry_bands(
        default_parameters(), level_flight(0.2), point().linearize(full=True)
    ),
    "speed is 0 ft/s; give a value between 1 ft/s and 500 ft/s": lambda: beyond(speed=0.0),
    "dihedral is -90 deg; give an angle above -90": lambda: beyond(
        dihedral=-math.pi / 2, limits={"dihedral": (-3.0, 3.0)}
    ),
    "give two different limits, the lower first": lambda: beyond(limits={"alpha": (0.5, 0.1)}),
    "unknown trim variable 'at'": lambda: hfa.trim(replace(HFA, schedule=""), at=0.2),
    "the equations do not depend on push": lambda: hfa.trim(coasting()),
    "C is 1 x 3; give 1 x 2": lambda: LinearModel.of(np.eye(2), np.eye(2), np.ones((1, 3))),
    "outputs has 1 names, but C has 2 rows": lambda: LinearModel.of(
        np.eye(2), np.eye(2), outputs=("y",)
    ),
    "A[0][0] is nan": lambda: LinearModel.of(np.nan * np.eye(2), np.eye(2)),
    "parameter chord is -1; give a number of at least 0": lambda: hfa.aircraft(
        parameters=default_parameters().values._replace(chord=-1.0)
    ),
    "no rate is imposed": lambda: TrimCondition(HFA, HFA.trim, {}),
    "unknown rate 'sped'": lambda: TrimCondition(HFA, HFA.trim, {"sped": 0.0}),
    "the condition is for": lambda: hfa.trim(GTM, level_flight(0.2)),
    "not an equilibrium, and no variable is free": lambda: hfa.trim(
        cart(), hold={"x": 1.0, "v": 1.0, "force": 0.0}
    ),
    "no variable has both a lower and an upper limit": lambda: trim_figure(hfa.trim(cart(), x=1.0)),
    "no free variable changes it from 132.39 N; free what it depends on": lambda: hfa.trim(
        hfa.load_model(f"{ROOT}/examples/uav.toml"), weight=100.0
    ),
    "set it by --hold panel_mass=VALUE": lambda: release(
        level_flight(0.2), hold={"panel_mass": 1.0}
    ),
    "ratio replaces v and must depend affinely on v": lambda: hfa.trim(
        replace(cart(), equations=squared, replaced={"v": "ratio"})
    ),
    "takes no mass": lambda: hfa.load_model(f"{ROOT}/examples/uav.toml", mass="glider.toml"),
    "is not an aircraft; give": lambda: hfa.load_model("examples.gtm"),
    "NONE does not exist; use GTM": lambda: hfa.load_model(f"{ROOT}/examples/gtm.py:NONE"),
    "a waveform has an entry that is not finite": lambda: Waveform(
        np.array([1.0, np.inf]), np.zeros(2)
    ),
    "time is sampled": lambda: hfa.load_model(plant(time="sampled")),
    "the plant is in discrete time": lambda: hfa.load_model(plant(time="discrete")),
    "A is 1 x 2; give a square matrix": lambda: hfa.load_model(plant(A=[[1.0, 2.0]])),
    "there is no A": lambda: hfa.load_model(plant(A=None)),
    "states contains": lambda: hfa.load_model(plant(states=["\x1b", "b"])),
}


@pytest.mark.parametrize("message", CALLS)
def test_calls_without_an_answer_are_refused(message, tmp_path, monkeypatch):
    """Each call of `CALLS`, words of the message -> call, raises BadInputError with these words in one line,
    and writes no file.
    """
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(BadInputError) as refused:
        CALLS[message]()
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
    assert list(Path().iterdir()) == []
