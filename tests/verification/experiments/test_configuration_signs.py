"""The angle of attack misses its command whatever the lost signs are, and docs/experiments.md says by how much."""

from __future__ import annotations

from pathlib import Path

import pytest
from experiment_readings import reading_file

from verification.experiments.configuration import load_reading
from verification.experiments.experiment_flights import FlightPlan, fly
from verification.experiments.flown_laws import EXACT
from verification.experiments.setting import make_setting

DOCUMENT = Path(__file__).parents[3] / "docs" / "experiments.md"
SINE, COSINE = "sine = [[0.11, 0.22, 0.0, 0.11, 0.0, 0.11]]", "cosine = [[0.0, 0.0, 0.22, 0.0, 0.11, 0.0]]"
NOTHING = "[[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]"
COMMAND = "constant = [7.0, 0.1, 0.0, 0.0, 0.5, 0.0]"


@pytest.mark.parametrize(
    ("said", "changes"),
    [
        ("{} without the disturbance", {SINE: f"sine = {NOTHING}", COSINE: f"cosine = {NOTHING}"}),
        (
            "{} with its sign turned",
            {
                SINE: "sine = [[-0.11, -0.22, 0.0, -0.11, 0.0, -0.11]]",
                COSINE: "cosine = [[0.0, 0.0, -0.22, 0.0, -0.11, 0.0]]",
            },
        ),
        ("{} with that of the angle's command turned", {COMMAND: "constant = [7.0, -0.1, 0.0, 0.0, 0.5, 0.0]"}),
        ("{} with that of the dihedral's", {COMMAND: "constant = [7.0, 0.1, 0.0, 0.0, -0.5, 0.0]"}),
    ],
)
def test_the_error_of_alpha_with_other_signs_is_the_one_of_the_document(
    tmp_path: Path, said: str, changes: dict[str, str]
) -> None:
    setting = make_setting(load_reading(reading_file(tmp_path, {"step = 1e-4": "step = 1e-3"} | changes)))
    error = fly(setting, FlightPlan(5.0, EXACT), "5.1").metrics["relative_error"]["alpha"]
    assert error > 10.0 * setting.reading["criteria"]["close"]
    assert said.format(f"{error:.3g}") in " ".join(DOCUMENT.read_text(encoding="utf-8").split())
