"""What a search says: weights of angles in degrees, and nothing of what was not flown."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from servo_cases import A_Z, write_tuning

from verification.synthesis.tuning import Evaluation, InGust, Tuned
from verification.synthesis.tuning_file import load_tuning
from verification.synthesis.tuning_report import error_name, shown_error, tuning_report


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("dihedral", ("dihedral deg", math.pi), 180.0),
        ("speed", ("speed", 2.0), 2.0),
        ("dihedral_integral", ("dihedral_integral", 3.0), 3.0),
    ],
)
def test_states_that_are_angles_are_shown_in_degrees(name: str, value: tuple[str, float], shown: float) -> None:
    assert (error_name(name), shown_error(value[1], name)) == (value[0], pytest.approx(shown))


@pytest.mark.parametrize(
    ("best", "checks", "said"),
    [
        (Evaluation(1e6, 0.15), ["abscissa"], "FAIL abscissa: a loop has 0.15 1/s, so nothing was flown"),
        (Evaluation(2e6, math.inf), ["abscissa"], "FAIL abscissa: there is no controller, so nothing was flown"),
        (
            Evaluation(9.0, -1.0, ({"dihedral": 0.01, A_Z: 1.0},), (0.01,), gusts=(1.5,), margin=0.1, fastest=9.0),
            ["abscissa", "rate", "margin", "gust_1"],
            "FAIL gust_1: in gust 1 the aircraft leaves its envelope",
        ),
    ],
)
def test_what_was_not_flown_is_not_judged(tmp_path: Path, best: Evaluation, checks: list[str], said: str) -> None:
    tuning = load_tuning(str(write_tuning(tmp_path)))
    tuning = replace(tuning, margin=0.2, gusts=(InGust(0.2, tuning.cases[0].actuator, 400.0, 20.0),))
    first = tuning.first_values()
    report = tuning_report(tuning, Tuned(first, best, first, best, (best,)))
    assert [check["name"] for check in report.data["checks"]] == checks
    assert not report.data["ok"]
    assert said in report.text()
    assert ("figure" in report.text()) == bool(best.rates)


def test_the_rate_is_in_degrees_for_a_person_and_in_radians_in_data(tmp_path: Path) -> None:
    tuning = load_tuning(str(write_tuning(tmp_path, rate=0.25)))
    flown = Evaluation(9.0, -1.0, ({"dihedral": 0.01, A_Z: 1.0},), (math.radians(0.5),), margin=0.1, fastest=9.0)
    report = tuning_report(tuning, Tuned(tuning.first_values(), flown, tuning.first_values(), flown, (flown,)))
    (row,) = [line.split() for line in report.text().splitlines() if line.startswith("rate")]
    assert row == ["rate", "deg/s", "0.5", "0.25", "FAIL"]
    (rate,) = [check for check in report.data["checks"] if check["name"] == "rate"]
    assert (rate["value"], rate["limit"]) == (math.radians(0.5), math.radians(0.25))
