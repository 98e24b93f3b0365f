"""Random parameters have the stated covariance; another [covariance] is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli import answer, assert_refused, hfa
from project import ROOT

from hfa.main import main

pytest.importorskip("hfa_flight")


def found(aircraft: str, names: str, rows: str) -> str:
    """Write a file of identified parameters with a covariance, and return its path."""
    text = f"aircraft = '{ROOT}/examples/{aircraft}.toml'\n"
    Path("found.toml").write_text(f"{text}[covariance]\nnames = {names}\nrows = {rows}\n")
    return "found.toml"


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
@pytest.mark.usefixtures("folder")
def test_another_covariance_is_refused(names: str, rows: str) -> None:
    """Names of parameters and a symmetric, positive semidefinite matrix of their size are needed."""
    words = ("fly", "--aircraft", found("uav", names, rows), "--draws", "2", "--duration", "0.1")
    assert_refused(hfa(*words), 2, "[covariance] ")


@pytest.mark.usefixtures("folder")
def test_drawn_aircraft_do_not_depend_on_units() -> None:
    """Mass and lift slope are drawn together: the loops of the drawn aircraft are the same in SI."""
    path = found("cessna182", '["mass", "CL_alpha"]', "[[16.0, 0.4], [0.4, 0.04]]")
    words = ("fly", "--aircraft", path, "--draws", "4", "--duration", "0.5")
    bands = [
        answer(*words, "--units", units)["draws"]["bands"]["abscissa of the loop"]
        for units in ("english", "si")
    ]
    for name in ("low", "value", "high"):
        assert bands[0][name] == pytest.approx(bands[1][name], rel=1e-8)
    assert bands[0]["low"] < bands[0]["value"] < bands[0]["high"]


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
