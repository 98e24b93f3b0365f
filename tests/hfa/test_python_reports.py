"""Reports in Python equal those of the commands, and mention no command-line option."""

from __future__ import annotations

import re

import numpy as np
import pytest
from cli import hfa as command
from project import ROOT

import hfa

NAVION = f"{ROOT}/examples/navion.py:NAVION"


def without_source(text: str) -> str:
    return re.sub(r"\n+hfa \d+\.\d+\.\d+, .*\Z", "", text, flags=re.S).rstrip()


@pytest.mark.parametrize(
    ("aircraft", "hold", "words"),
    [
        ("", {"dihedral": np.radians(10.0)}, ("--dihedral", "10")),
        (
            NAVION,
            {"speed": 180.0},
            ("--aircraft", NAVION, "--hold", "speed=180"),
        ),
    ],
)
def test_a_points_report_equals_the_commands(
    aircraft: str, hold: dict[str, float], words: tuple[str, ...]
) -> None:
    """The report of an operating point in Python equals the text of `hfa trim`."""
    model = hfa.load_model(aircraft) if aircraft else hfa.aircraft()
    point = hfa.trim(model, hold=hold)
    printed = without_source(command("trim", *words).out)
    printed = re.sub(r"\n\npublished and newton.*", "", printed, flags=re.S)  # of the command
    assert printed == point.report().text()
    assert point.report().data["search"]["unknowns"] >= 4
