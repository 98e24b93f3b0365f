"""Random parameters have the stated covariance; another [covariance] is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli import assert_refused, hfa
from project import ROOT

from hfa.main import main

UAV = (ROOT / "examples/uav.toml").read_text("utf-8")


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
    Path("uav.toml").write_text(f"{UAV}\n[covariance]\nnames = {names}\nrows = {rows}\n")
    words = ("fly", "--aircraft", "uav.toml", "--draws", "2", "--duration", "0.1")
    assert_refused(hfa(*words), 2, "covariance")


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
