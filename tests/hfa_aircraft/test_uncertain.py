"""Random parameters have the stated covariance; another [covariance] is refused."""

from pathlib import Path

import pytest
from cli import answer, assert_refused, hfa
from project import ROOT

pytest.importorskip("hfa_flight")


def found(aircraft, names, rows):
    """Write a file of identified parameters with a covariance, and return its path."""
    text = f"aircraft = '{ROOT}/examples/{aircraft}.toml'\n"
    Path("found.toml").write_text(f"{text}[covariance]\nnames = {names}\nrows = {rows}\n")
    return "found.toml"


SHAPE = "does not consist of names of parameters and one row for each name"
INDEFINITE = "is not a covariance matrix"


@pytest.mark.parametrize(
    ("names", "rows", "said"),
    [
        ('["CL_beta"]', "[[1.0]]", SHAPE),
        ('["mass"]', "[[nan]]", SHAPE),
        ('["mass", "Ixx"]', "[[1.0, 0.0]]", SHAPE),
        ('["mass", "Ixx"]', "[[1.0, 0.5], [0.0, 1.0]]", INDEFINITE),
        ('["mass", "Ixx"]', "[[1.0, 1.5], [1.5, 1.0]]", INDEFINITE),
    ],
)
@pytest.mark.usefixtures("folder")
def test_an_invalid_covariance_is_refused(names, rows, said):
    """[covariance] must have names of parameters and a symmetric, positive semidefinite matrix.

    CL_beta is no parameter of the aircraft. The last matrix has the eigenvalue -0.5.
    """
    words = ("fly", "--aircraft", found("uav", names, rows), "--draws", "2", "--duration", "0.1")
    assert_refused(hfa(*words), 2, f"found.toml: [covariance] {said}")


@pytest.mark.usefixtures("folder")
def test_drawn_aircraft_do_not_depend_on_units():
    """Aircraft with random mass and lift slope fly the same in SI, but differ from each other."""
    path = found("cessna182", '["mass", "CL_alpha"]', "[[16.0, 0.4], [0.4, 0.04]]")
    words = ("fly", "--aircraft", path, "--policy", "none", "--draws", "3", "--duration", "0.1")
    flown = [
        answer(*words, "--initial", "alpha=1", "-q", *units)["rms_error"]
        for units in ((), ("--units", "si"))
    ]
    assert flown[1]["alpha"] == pytest.approx(flown[0]["alpha"], rel=1e-8)
    assert flown[0]["alpha"][0] < flown[0]["alpha"][-1]  # quantiles of the three flights
    assert flown[1]["speed"] == pytest.approx([0.3048 * v for v in flown[0]["speed"]], rel=1e-8)
