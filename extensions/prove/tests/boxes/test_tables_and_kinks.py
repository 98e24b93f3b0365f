"""Proofs by boxes of equations with tables, kinks away from the trim and far bells."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli import hfa

AIRCRAFT = """
import casadi as ca
from hfa import Model, Signal

table = ca.interpolant("moment", "linear", [[-3.0, -1.0, 0.0, 1.0, 3.0]], [-.6, -.5, 0.0, .5, .6])
smooth = ca.interpolant("smooth", "bspline", [[-4.0, -1.0, 0.0, 1.0, 4.0]], [-.6, -.5, 0.0, .5, .6])
MOMENTS = {
    "linear": lambda angle: 0.5 * angle,
    "table": table,
    "smooth": smooth,
    "bell": lambda angle: 0.5 * angle + 0.1 * ca.exp(-((angle - 9.0) / 0.2) ** 2),
    "dead_zone": lambda angle: angle - ca.fmax(0, ca.fabs(angle) - 0.6),
}


def model(name):
    def equations(x, u, p, w):
        return {"angle": x.rate, "rate": u.torque + MOMENTS[name](x.angle) - 0.5 * x.rate}, {}

    torque = Signal("N m", nominal=1.0, min=-0.7, max=0.7)
    states = {"angle": Signal("rad"), "rate": Signal("rad/s")}
    return Model(name, states=states, inputs={"torque": torque}, equations=equations,
                 trim={"angle": 0.0, "rate": 0.0})


LINEAR, TABLE, SMOOTH, BELL, DEAD_ZONE = map(model, MOMENTS)
"""


@pytest.mark.parametrize("name", ["LINEAR", "TABLE", "SMOOTH", "BELL", "DEAD_ZONE"])
def test_a_region_about_the_trim_is_proved(name: str, tmp_path: Path) -> None:
    """Tables, kinks away from the trim and far bells do not prevent a proof by boxes."""
    (tmp_path / "aircraft.py").write_text(AIRCRAFT)
    of = f"{tmp_path / 'aircraft.py'}:{name}"
    words = ("--degree", "2", "--seconds", "3", "--prover", "boxes")
    assert hfa("prove", "region", "--aircraft", of, *words).code == 0


def test_the_default_prover_of_kinks_is_boxes(tmp_path: Path) -> None:
    """Equations with a kink at the trim that acts elsewhere are proved without --prover."""
    (tmp_path / "aircraft.py").write_text(AIRCRAFT)
    of = f"{tmp_path / 'aircraft.py'}:DEAD_ZONE"
    assert hfa("prove", "region", "--aircraft", of, "--degree", "2", "--seconds", "3").code == 0
