"""`hfa servo`: the flights of SimVFA come out again, cases are kept and found again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hfa_model.aircraft import Aircraft
from verification.servo import servo_flights
from verification.servo.cases import ANGLES, CASES, DURATION, REGULATED, simvfa_commands
from verification.servo.reference_model import reference_servo
from verification.servo.servo_flights import ServoFlight, fly_case, run_case
from verification.servo.servo_report import servo_report


def errors(flight: ServoFlight) -> tuple[float, float]:
    """Of dihedral, deg, and of vertical acceleration, ft/s²."""
    angle, acceleration = flight.tracked
    return float(np.degrees(angle.rms)), acceleration.rms


def test_the_commands_are_sixteen_steps_of_seventy_seconds() -> None:
    commands = simvfa_commands()
    assert commands.names == REGULATED
    assert (len(commands.times), DURATION) == (16, 1051.0)
    np.testing.assert_allclose(np.diff(commands.times), 70.0)
    assert np.degrees(commands.values[:, 0]).tolist() == pytest.approx(
        [1, 2, 1, 2, 1, 2, -1, 1, 2, 1, 2, 1, 2, -1, 0, 0]
    )


def test_two_steps_with_a_fault(published_aircraft: Aircraft) -> None:
    """The first 120 s of the case: the adaptive law misses less than the LQR, and the paper's policy is lost."""
    lqr, adaptive, paper = fly_case(published_aircraft, "order-1-fault", {}, 120.0)
    assert [each.law for each in (lqr, adaptive, paper)] == ["simvfa-1", "simvfa-1 adaptive", "paper"]
    assert lqr.lost_at is None
    assert adaptive.lost_at is None
    assert errors(adaptive)[0] < 0.95 * errors(lqr)[0]
    assert paper.lost_at is not None
    assert paper.left == "pitch_rate"
    assert paper.times[-1] == pytest.approx(paper.lost_at, abs=0.05)


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
def test_the_numbers_of_simvfa_come_out_again(published_aircraft: Aircraft, case: str) -> None:
    flights = {flight.law: flight for flight in fly_case(published_aircraft, case, {})}
    for (where, law), theirs in THEIRS.items():
        if where == case:
            assert flights[law].lost_at is None
            np.testing.assert_allclose(errors(flights[law]), theirs, atol=1e-3)
    if case == "order-2-fault":
        lost = flights["simvfa-2"].lost_at
        assert lost is not None
        assert 780.0 < lost < 840.0


def test_a_finished_case_is_kept_and_known_again(
    published_aircraft: Aircraft, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[tuple[str, int, int]] = []
    own = {"ours": reference_servo(published_aircraft, "simvfa-2", ANGLES[9:15])}
    first = run_case(
        published_aircraft, "order-2", own, tmp_path / "out", duration=4.0, progress=lambda *done: told.append(done)
    )
    assert told[-1] == ("order-2", 4, 4)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["order-2.json", "order-2.png"]
    assert [flight["law"] for flight in first["flights"]] == ["simvfa-2", "simvfa-2 adaptive", "ours", "paper"]
    flown = []
    monkeypatch.setattr(servo_flights, "fly_case", lambda *given: flown.append(given) or ())
    monkeypatch.setattr("verification.servo.servo_figure.servo_figure", lambda *_: pytest.fail("drawn again"))
    again = run_case(published_aircraft, "order-2", own, tmp_path / "out", duration=4.0, resume=True)
    assert again == first
    with pytest.raises(pytest.fail.Exception):
        run_case(published_aircraft, "order-2", {}, tmp_path / "out", duration=4.0, resume=True)
    assert len(flown) == 1
    text = servo_report([first]).text()
    assert "case order-2, published dynamics, 4 s" in text
    assert "simvfa-2" in text
