"""The bands of a linear model: whose they are, and what has none."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import hfa

from hfa_model.aircraft import Aircraft
from hfa_model.parameters import ParameterSet, save_parameters
from hfa_model.support.errors import BadInputError
from hfa_model.variants import Published, Rival
from trim.linear import bands
from trim.linear.bands import Bands, bands_known, entry_bands, rival_parameters
from trim.linear.linearize import linearize
from trim.point.condition import level_flight
from trim.point.solve import find_operating_point

CONDITION = level_flight(np.radians(10.0))


def heavier(parameters: ParameterSet, factor: float) -> ParameterSet:
    """The same file, covariance and all, with another panel mass in it."""
    return replace(parameters, values=parameters.values._replace(panel_mass=factor * parameters.values.panel_mass))


def bands_of(parameters: ParameterSet) -> Bands:
    aircraft = Aircraft(parameters.values)
    return entry_bands(parameters, CONDITION, linearize(aircraft, find_operating_point(aircraft, CONDITION)))


def test_structure_is_the_distance_to_the_rival(parameter_set: ParameterSet) -> None:
    found, rival = bands_of(parameter_set), rival_parameters()
    ours, other = Aircraft(parameter_set.values, Published()), Aircraft(rival.values, Rival(**rival.structure))
    one, two = (linearize(aircraft, find_operating_point(aircraft, CONDITION)) for aircraft in (ours, other))
    np.testing.assert_allclose(found.A_structure, np.abs(one.A - two.A), atol=1e-9)
    np.testing.assert_allclose(found.B_structure, np.abs(one.B - two.B), atol=1e-9)
    assert 1e-4 < found.A.max() < 1e-2


def test_the_same_identification_elsewhere_has_the_same_bands(parameter_set: ParameterSet) -> None:
    elsewhere = heavier(parameter_set, 1 + 1e-9)
    assert bands_known(elsewhere)
    np.testing.assert_allclose(bands_of(elsewhere).A, bands_of(parameter_set).A, rtol=0.01, atol=1e-6)


@pytest.mark.parametrize("factor", [1.1, 1 + 1e-6])
def test_an_edited_copy_has_no_bands(parameter_set: ParameterSet, factor: float) -> None:
    with pytest.raises(BadInputError, match="bands are known for the identified parameters"):
        bands_of(heavier(parameter_set, factor))


def test_without_covariance_there_are_no_bands(parameter_set: ParameterSet) -> None:
    with pytest.raises(BadInputError, match="with their covariance"):
        bands_of(replace(parameter_set, covariance=np.zeros((0, 0))))


@pytest.mark.parametrize("values", ["rival", "packaged"])
def test_a_rival_has_no_bands(parameter_set: ParameterSet, values: str) -> None:
    rival = rival_parameters()
    if values == "packaged":
        rival = replace(rival, values=parameter_set.values)
    with pytest.raises(BadInputError, match="bands are known for the identified parameters"):
        bands_of(rival)


def test_a_model_of_other_states_has_no_bands(parameter_set: ParameterSet, published_aircraft: Aircraft) -> None:
    whole = linearize(published_aircraft, find_operating_point(published_aircraft, CONDITION), full=True)
    with pytest.raises(BadInputError, match="bands are known for the states speed, alpha, pitch"):
        entry_bands(parameter_set, CONDITION, whole)


def test_nothing_that_is_given_is_computed_again(
    parameter_set: ParameterSet, published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One trim and one linear model, both the rival's."""
    model = linearize(published_aircraft, find_operating_point(published_aircraft, CONDITION))
    called = []
    for function in (linearize, find_operating_point):
        monkeypatch.setattr(
            bands, function.__name__, lambda one, *rest, f=function, **more: called.append(one) or f(one, *rest, **more)
        )
    entry_bands(parameter_set, CONDITION, model)
    assert [aircraft.variant.name for aircraft in called] == ["rival", "rival"]


def test_the_command_says_that_an_edited_copy_has_none(tmp_path: Path, parameter_set: ParameterSet) -> None:
    path = tmp_path / "heavier.toml"
    save_parameters(heavier(parameter_set, 1.1), path, "10 % heavier")
    words = ("linearize", "--dihedral", "10", "--parameters", str(path))
    said = hfa(*words)
    assert (said.code, said.err) == (0, "")
    assert "No uncertainty bands: they are known for the six printed states of the identified aircraft only" in said.out
    assert "Largest uncertainty band" not in said.out
    assert not {"A_band", "B_band"} & set(json.loads(hfa(*words, "--json").out))
    assert "Largest uncertainty band" in hfa("linearize", "--dihedral", "10").out
