"""Calls that cannot be answered are refused, each with what is wrong."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from project import ROOT

import hfa
from hfa import BadInputError, Model, Signal, TrimCondition
from hfa.paper import default_parameters, level_flight
from trim import InterpolatedModel, entry_bands, modes_of, release, trim_points
from trim.linear.linear_model import LinearModel

HFA = hfa.aircraft()
GTM = hfa.load_model(f"{ROOT}/examples/gtm.py:GTM")


def cart(rate: Callable[[Any, Any], Any] = lambda x, u: u.force) -> Model:
    """Return the cart x' = v, v' = force with an output that is not finite at x = 0."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        return {"x": x.v, "v": rate(x, u)}, {"ratio": 1.0 / x.x}

    states = {"x": Signal("m", start=1.0), "v": Signal("m/s")}
    return Model("cart", states, {"force": Signal("N")}, equations, outputs={"ratio": Signal()})


@cache
def point() -> hfa.OperatingPoint:
    return hfa.trim(HFA)


@cache
def swept(first: float = 68.0) -> hfa.Sweep:
    return hfa.sweep(HFA, {"dihedral": [0.1, 0.2], "speed": [first, 70.0]})


def loaded_with(tmp_path: Path, **entries: Any) -> LinearModel:
    path = tmp_path / "linear.json"
    path.write_text(json.dumps(point().linearize().to_dict() | entries))
    return LinearModel.load(path)


CALLS: dict[str, Callable[[Path], Any]] = {
    "shape (2, 3); give shape (2, 2)": lambda _: modes_of(np.ones((2, 3)), ("a", "b")),
    "shape (2, 2); give shape (3, 3)": lambda _: modes_of(np.eye(2), ("a", "b", "c")),
    "A has an entry that is not finite": lambda _: modes_of(np.eye(2) * np.nan, ("a", "b")),
    "1 units for 6 names": lambda path: loaded_with(path, state_units=["ft/s"]),
    "error bands exist only for the states": lambda _: entry_bands(
        default_parameters(), level_flight(0.2), point().linearize(full=True)
    ),
    "no rate is imposed": lambda _: TrimCondition(HFA, HFA.trim, {}),
    "the rate of speed is nan": lambda _: TrimCondition(HFA, HFA.trim, {"speed": math.nan}),
    "unknown rate 'sped'": lambda _: TrimCondition(HFA, HFA.trim, {"sped": 0.0}),
    "gamma is both free and held": lambda _: release(
        level_flight(0.2), free=("gamma",), hold={"gamma": 0.0}
    ),
    "the condition is for": lambda _: hfa.trim(GTM, level_flight(0.2)),
    "not an equilibrium, and no variable is free": lambda _: hfa.trim(
        cart(), hold={"x": 1.0, "v": 1.0, "force": 0.0}
    ),
    "not the result of a trim and has no limits": lambda _: replace(point(), problem=None).plot(),
    "no variable has both a lower and an upper limit": lambda _: hfa.trim(cart(), x=1.0).plot(),
    "fewer than two values of speed": lambda _: InterpolatedModel(
        hfa.sweep(HFA, {"dihedral": [0.1, 0.2], "speed": [68.0]})
    ),
    "the sweep has no trim at dihedral": lambda _: InterpolatedModel(swept(5.0)),
    "speed is outside the sweep, 68 ft/s to 70 ft/s": lambda _: InterpolatedModel(swept()).at(
        dihedral=0.15, speed=70.1
    ),
    "dihedral is outside the sweep": lambda _: InterpolatedModel(swept()).at(
        dihedral=[0.05, 0.15], speed=69.0
    ),
    "an argument is missing or unknown": lambda _: InterpolatedModel(swept()).at(dihedral=0.15),
    "no point of the sweep has a trim": lambda _: hfa.sweep(HFA, speed=[5.0, 6.0]).plot(),
    "the columns of a list of points have": lambda _: hfa.sweep(
        HFA, {"dihedral": [0.1, 0.2], "speed": [68.0]}, listed=True
    ),
    "no variable is swept": lambda _: hfa.sweep(HFA, {}),
    "points (maximum": lambda _: hfa.sweep(
        HFA, {name: np.linspace(0.01, 0.02, 4000) for name in ("dihedral", "gamma")}
    ),
    "values have shape (1, 1); give (N, 2)": lambda _: trim_points(
        HFA, ("dihedral", "speed"), np.ones((1, 1))
    ),
    "values have shape (2,)": lambda _: trim_points(HFA, ("dihedral",), np.ones(2)),
    "the values of speed are 68.0; give a list": lambda _: hfa.sweep(HFA, {"speed": 68.0}),
    "parameter gravity is nan": lambda _: hfa.aircraft(
        parameters=default_parameters().values._replace(gravity=math.nan)
    ),
    "panel_span is -1; give a number of at least 0": lambda _: hfa.aircraft(
        parameters=default_parameters().values._replace(panel_span=-1.0)
    ),
}


@pytest.mark.parametrize("message", CALLS)
def test_unanswerable_calls_are_refused(message: str, tmp_path: Path) -> None:
    """Each call is refused with the name of its fault, in one line."""
    with pytest.raises(BadInputError) as refused:
        CALLS[message](tmp_path)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)
