"""The comparison of servos: SimVFA's numbers come out again, findings.md has the stored results, a run resumes."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from project import ROOT

from controller import save_controller
from hfa_model import Aircraft
from hfa_support import BadInputError
from studies.servo.__main__ import main
from studies.servo.comparison import CASES, ServoFlight, fly_case, laws_of, rows_of
from studies.servo.simvfa import reference_servo

FOLDER = ROOT / "studies" / "servo"
FINDINGS = (FOLDER / "findings.md").read_text(encoding="utf-8")


def errors(flight: ServoFlight) -> tuple[float, float]:
    """Of dihedral, deg, and of vertical acceleration, ft/s²."""
    angle, acceleration = flight.tracked
    return float(np.degrees(angle.rms)), acceleration.rms


def test_a_case_is_flown_kept_and_resumed(
    tmp_path: Path, published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In 15 s of the fault the paper's policy is lost as findings.md has it; --resume flies nothing again."""

    def run(*words: str, code: int = 0) -> str:
        monkeypatch.setattr(sys, "argv", ["studies.servo", *words])
        assert main() == code
        return "".join(capsys.readouterr())

    save_controller(tmp_path / "own.npz", reference_servo(published_aircraft, "simvfa-1", np.radians([10.0, 13.0])))
    words = ("fly", "order-1-fault", "-o", str(tmp_path / "out"), "--duration", "15", "--law", "paper")
    words = (*words, "--controller", str(tmp_path / "own.npz"), "--law", str(tmp_path / "own.npz"), "--json")
    first = json.loads(run(*words))
    (case,) = first["cases"]
    own, paper = case["flights"]
    assert (own["lost_at"], paper["left"]) == (None, "pitch_rate")
    assert "  ".join(rows_of(case)[1][1:2]) in FINDINGS
    kept = tmp_path / "out" / "order-1-fault.json"
    before = kept.stat().st_mtime_ns
    assert json.loads(run(*words, "--resume")) == first
    assert (kept.stat().st_mtime_ns, (tmp_path / "out" / "order-1-fault.png").is_file()) == (before, True)
    kept.write_text(kept.read_text("utf-8").replace("pitch_rate", "pitch", 1), encoding="utf-8")
    assert json.loads(run(*words, "--resume"))["cases"][0]["flights"] == case["flights"]
    assert run("fly", "order-3", "-o", "out", code=2).count("\n") == 1
    assert "end after 1051 s" in run("fly", "order-1", "-o", "out", "--duration", "1e5", code=2)
    with pytest.raises(BadInputError, match="order 2 has no law 'simvfa-1'; choose from simvfa-2, simvfa"):
        laws_of(2, {}, ("simvfa-1",))


def test_the_findings_have_the_stored_results() -> None:
    stored = json.loads((FOLDER / "results" / "comparison.json").read_bytes())
    assert [case["case"] for case in stored["cases"] if case["dynamics"] == "published"] == list(CASES)
    for case in stored["cases"]:
        for row in rows_of(case):
            assert f"| {case['case']} | {' | '.join(row)} |" in FINDINGS


#: rms error of dihedral, deg, and of A_z, ft/s²: of SimVFA's own simulation, as a port of it states them.
THEIRS = {
    ("order-1", "simvfa-1"): (0.380, 0.065),
    ("order-1", "simvfa-1 adaptive"): (0.379, 0.065),
    ("order-1-fault", "simvfa-1"): (0.685, 0.202),
    ("order-1-fault", "simvfa-1 adaptive"): (0.408, 0.101),
    ("order-2", "simvfa-2"): (0.446, 0.140),
    ("order-2", "simvfa-2 adaptive"): (0.445, 0.140),
    ("order-2-fault", "simvfa-2 adaptive"): (0.498, 0.322),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_the_numbers_of_simvfa_and_the_stored_ones_come_out_again(published_aircraft: Aircraft, case: str) -> None:
    flights = {flight.law: flight for flight in fly_case(published_aircraft, CASES[case], {})}
    for (where, law), theirs in THEIRS.items():
        if where == case:
            np.testing.assert_allclose(errors(flights[law]), theirs, atol=1e-3)
    found: dict[str, Any] = {"flights": [flight.to_dict() for flight in flights.values()]}
    for law, angle, acceleration, _, outcome in rows_of(found):
        figures = f"{angle} | {acceleration}" if outcome == "held" else angle  # rounding decides how a lost one ends
        assert f"| {case} | {law} | {figures} | " in FINDINGS
        assert (flights[law].lost_at is None) == (outcome == "held")
