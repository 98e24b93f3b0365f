"""Random parameters have the stated covariance; another [covariance] is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from project import ROOT

import hfa
from hfa import BadInputError
from hfa.main import main
from hfa.paper import default_parameters
from hfa_aircraft import in_si
from hfa_aircraft.uncertain import ParameterSpread, spread_of, spread_of_file

UAV = (ROOT / "examples/uav.toml").read_text("utf-8")
COVARIANCE = np.array([[0.04, 0.006, 0.0], [0.006, 0.0025, 0.0], [0.0, 0.0, 0.0]])
VALUES = {"CL_alpha": 3.45, "Cm_alpha": -0.38, "mass": 13.5}


@pytest.mark.parametrize("of_logarithms", [False, True])
def test_draws_have_their_mean_and_covariance(of_logarithms: bool) -> None:
    """4000 draws have the covariance within 10 %; a parameter without variance is constant."""
    spread = ParameterSpread(VALUES, COVARIANCE, of_logarithms)
    center = np.array([*VALUES.values()])
    draws = spread.draws(4000, seed=1)
    apart = center * np.log(draws / center) if of_logarithms else draws - center
    np.testing.assert_allclose(np.cov(apart.T), COVARIANCE, rtol=0.1, atol=1e-12)
    assert (np.abs(apart.mean(axis=0)) < 0.02 * np.abs(center)).all()
    assert np.array_equal(spread.draws(4000, seed=1), draws)


def test_drawn_aircraft_keep_the_limits_of_parameters() -> None:
    """A mass with a wide spread is not negative, and each aircraft has its row of the draws."""
    model = hfa.from_derivatives(ROOT / "examples/uav.toml")
    spread = ParameterSpread({"mass": 13.5}, np.array([[400.0]]))
    masses = [each.parameters["mass"].start for each in spread.aircraft(model, 20, seed=1)]
    assert masses == np.maximum(spread.draws(20, seed=1)[:, 0], 0.0).tolist()
    assert min(masses) == 0.0


def written(names: str, rows: str) -> str:
    Path("uav.toml").write_text(f"{UAV}\n[covariance]\nnames = {names}\nrows = {rows}\n")
    return "uav.toml"


@pytest.mark.parametrize(
    ("names", "rows"),
    [
        ('["CL_beta"]', "[[1.0]]"),
        ('"mass"', "[[1.0]]"),
        ("[]", "[]"),
        ('["mass", "Ixx"]', "[[1.0, 0.0]]"),
        ('["mass"]', "[[1.0, 0.0]]"),
        ('["mass"]', "[[nan]]"),
        ('["mass"]', "[[-1.0]]"),
        ('["mass", "Ixx"]', "[[1.0, 0.5], [0.0, 1.0]]"),
        ('["mass", "Ixx"]', "[[1.0, 1.5], [1.5, 1.0]]"),
    ],
)
def test_another_covariance_is_refused(folder: Path, names: str, rows: str) -> None:
    """Names of parameters and a symmetric, positive semidefinite matrix of their size are needed."""
    model = hfa.from_derivatives(ROOT / "examples/uav.toml")
    with pytest.raises(BadInputError, match=r"\[covariance\] (does not|is not)"):
        spread_of_file(written(names, rows), model)
    with pytest.raises(BadInputError, match=r"has no \[covariance\]"):
        spread_of_file(str(ROOT / "examples/uav.toml"), model)


def test_held_parameters_are_left_out_and_units_are_those_of_the_model(folder: Path) -> None:
    """In SI, values and covariance of the Navion have the factor of their unit; Ixx is held."""
    model = hfa.load_model(str(ROOT / "examples/cessna182.toml"))
    text = (ROOT / "examples/cessna182.toml").read_text("utf-8")
    covariance = '[covariance]\nnames = ["mass", "Ixx", "CL_alpha"]\n'
    rows = "rows = [[4.0, 0.0, 0.02], [0.0, 9.0, 0.0], [0.02, 0.0, 0.04]]\n"
    Path("cessna.toml").write_text(f"{text}\n{covariance}{rows}")
    native = spread_of(model, "cessna.toml", ("Ixx",))
    metric = spread_of(in_si(model), "cessna.toml", ("Ixx",))
    assert native.covariance.tolist() == [[4.0, 0.02], [0.02, 0.04]]
    slug = 14.59390294
    assert metric.values["mass"] == pytest.approx(native.values["mass"] * slug)
    assert metric.values["CL_alpha"] == native.values["CL_alpha"]
    expected = [[4.0 * slug**2, 0.02 * slug], [0.02 * slug, 0.04]]
    np.testing.assert_allclose(metric.covariance, expected)


def test_parameters_of_the_flexible_aircraft_have_spread_logarithms() -> None:
    """The set's covariance is that of its identified parameters; without one it is refused."""
    known = default_parameters()
    spread = spread_of(hfa.aircraft(), known, ("lift_slope",))
    assert spread.of_logarithms
    assert {*spread.values} == {*known.identified} - {"lift_slope"}
    place = known.identified.index("panel_mass")
    own = [*spread.values].index("panel_mass")
    assert spread.covariance[own, own] == known.covariance[place, place]
    with pytest.raises(BadInputError, match="requires the covariance of the parameters"):
        spread_of(hfa.aircraft(), replace(known, covariance=np.zeros((0, 0))), ())


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        (
            "[bands]\nCm_q = [-30.0, -40.0]",
            "band of Cm_q is [-30.0, -40.0]; give the lower limit first",
        ),
        ("[bands]\nCm_q = [-2.0, -1.0]", "outside the band [-2.0, -1.0]; correct the value or the"),
        ("[bands]\nCm_p = [-2.0, -1.0]", "unknown parameter 'Cm_p'; did you mean"),
        ("[bands]\nCm_q = [nan, 1.0]", "band of Cm_q is [nan, 1.0]"),
        ("[bands]\nCm_q = 3.0", "band of Cm_q is 3.0; give [low, high]"),
        ("bands = 3.0", "bands is 3.0; give a table [bands]"),
        ("[sensors]\nbias_alpha = 2.0\n[bands]\nbias_alpha = [0.0, 1.0]", "bias_alpha is 2.0, out"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_a_wrong_band_is_refused(
    entries: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Bands with reversed limits, unknown names or wrong values are refused in one line."""
    Path("found.toml").write_text(f"aircraft = '{ROOT}/examples/uav.toml'\n{entries}")
    assert main(["trim", "--aircraft", "found.toml"]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
