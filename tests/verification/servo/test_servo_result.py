"""The table of docs/servo.md is that of the stored results."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from project import ROOT

from verification.servo.servo_result import rows_of, servo_report

RESULTS = ROOT / "docs" / "results" / "servo.json"


def test_the_document_has_the_stored_results() -> None:
    data = json.loads(RESULTS.read_text(encoding="utf-8"))
    text = (ROOT / "docs" / "servo.md").read_text(encoding="utf-8")
    for result in data["cases"]:
        for row in rows_of(result):
            assert f"| {result['case']} | {' | '.join(row)} |" in text
    assert len(data["cases"]) == 4


def what_flew(run: dict[str, Any]) -> str:
    """The law and what its command says of the actuators."""
    command = run["provenance"]["command"]
    order, fault = ", order 2" * ("--actuators 0.5:60:2" in command), ", fault" * ("--fault 0.2:0.5:0" in command)
    return f"{run['law']}{order}{fault}"


def test_the_document_has_the_stored_turbulence() -> None:
    data = json.loads(RESULTS.with_name("servo_turbulence.json").read_text(encoding="utf-8"))
    text = (ROOT / "docs" / "servo.md").read_text(encoding="utf-8")
    both = {"servo", "servo-gusts", "servo-gusts, fault"}
    expected = {(law, dynamics) for law in both for dynamics in ("published", "newton")}
    expected |= {("servo-gusts, order 2", "published"), ("servo-gusts, order 2, fault", "published")}
    assert {(what_flew(run), run["dynamics"]) for run in data["runs"]} == expected
    assert len(data["runs"]) == len(expected)
    for run in data["runs"]:
        errors = " | ".join(f"{math.degrees(error):.2f}" for error in run["rms_error"]["dihedral"])
        flown = f"{what_flew(run)} | {run['dynamics']} | {run['duration']:g} s"
        assert f"| {flown} | {run['held']} of {run['members']} | {errors} |" in text


def test_the_report_says_angles_in_degrees_and_what_was_lost() -> None:
    flight = {
        "law": "one",
        "rms_error": {"dihedral": 0.01, "vertical_acceleration_short_period": 0.25},
        "fastest_surface": 0.02,
        "lost_at": 12.5,
        "left": "pitch_rate",
    }
    result = {"case": "order-1", "dynamics": "newton", "duration": 60.0, "flights": [flight]}
    assert rows_of(result) == [("one", "0.573", "0.250", "1.15", "pitch_rate left at 12.5 s")]
    assert rows_of({**result, "flights": [{**flight, "lost_at": None}]})[0][-1] == "held"
    report = servo_report([result])
    assert "case order-1, newton dynamics, 60 s" in report.text()
    assert report.data["cases"][0]["flights"][0]["lost_at"] == pytest.approx(12.5)
