"""Whole intervals of dihedral, and an instability between two angles of a table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import hfa
from known_models import model_at
from proof_cases import ORIGIN, exact_table, family, unstable_between

from controller.policy.gain_table import GainTable
from controller.riccati.balancing import spectrum
from hfa_model import default_parameters
from hfa_support import BadInputError
from hfa_support.reporting.text import Table
from verification import check_certificate, coarsest_grid, prove_schedule
from verification.proof.certificate_file import ScheduleCertificate
from verification.proof.proof_report import schedule_proof_report
from verification.proof.schedule_proof import Cover, ScheduleProof, joined
from verification.proof.scheduled_loop import LoopTable


def gain_at(table: LoopTable, degrees: float) -> np.ndarray:
    flat = table.K.reshape(len(table.K), -1)
    return np.array([np.interp(degrees, table.places, column) for column in flat.T]).reshape(table.K[0].shape)


def assert_agrees_with_doubles(proof: ScheduleProof, dynamics: str) -> None:
    """On a grid the proved rate and entries hold."""
    for each in proof.loop.proved:
        for angle in (each.box.low, (each.box.low + each.box.high) / 2, each.box.high):
            model = model_at(angle, dynamics)
            found = spectrum(model.A - model.B @ gain_at(proof.table, angle)).abscissa
            assert (found < -each.rate) == (each.unstable == 0)
            for name in ("A", "B"):
                ends, value = getattr(each.model, name), getattr(model, name)
                assert np.all((ends[..., 0] <= value) & (value <= ends[..., 1]))


@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_a_part_of_the_schedule_is_proved(dynamics: str) -> None:
    proof = prove_schedule(family(dynamics), exact_table(13.0, 15.0, dynamics=dynamics), 13.0, 15.0)
    assert proof.proved
    assert proof.loop.counts == [(13.0, 15.0, 0)]
    assert proof.modes.counts == [(13.0, 15.0, 2)]
    assert proof.rate > 0.29
    assert_agrees_with_doubles(proof, dynamics)


@pytest.mark.parametrize(("end", "unstable"), [(15.03, 1), pytest.param(15.06, 0, marks=pytest.mark.slow)])
def test_an_instability_between_two_angles_is_found_and_refuted(end: float, unstable: int) -> None:
    table = unstable_between(15.0, 15.06)
    proof = prove_schedule(family(), table, 15.0, end)
    assert not proof.proved
    assert any(low <= 15.03 <= high for low, high, _ in proof.refuted)
    for low, high, count in proof.refuted:
        model = model_at((low + high) / 2)
        values = spectrum(model.A - model.B @ gain_at(table, (low + high) / 2)).eigenvalues
        assert int(np.sum(values.real > 0.0)) == count
    # At its own angles the table is stable, and there the interval is proved to be.
    assert proof.loop.counts[0][::2] == (15.0, 0)
    assert proof.loop.counts[-1][1:] == (end, unstable)
    # What is open are the places where a mode crosses the axis, and they are narrow.
    assert 0.0 < sum(high - low for low, high in proof.loop.gaps) < 0.03
    assert proof.rate > 0.0
    assert replace(proof, loop=Cover((), ())).rate == 0.0
    report = schedule_proof_report(proof)
    assert f"boxes: {len(proof.loop.proved)} for the loop, {len(proof.modes.proved)} for" in report.text()
    (loop,) = [each for each in report.parts if isinstance(each, Table) and each.header[0].startswith("loop")]
    assert [row[1] for row in loop.rows].count("open") == len(proof.loop.gaps)
    assert len(loop.rows) == len(proof.loop.gaps) + len(proof.loop.counts)


def test_the_angle_where_a_mode_crosses_is_enclosed() -> None:
    """A of `published` gains a third unstable mode at 16.688 deg."""
    proof = prove_schedule(family(), exact_table(16.68, 16.70), 16.68, 16.70)
    assert [count for _, _, count in proof.modes.counts] == [2, 3]
    (gap,) = proof.modes.gaps
    assert 16.68 < gap[0] < gap[1] < 16.70
    assert gap[1] - gap[0] < 0.005
    assert proof.crossings == [(*gap, (2, 3))]
    assert proof.proved


def test_how_many_modes_may_be_unstable_within_the_errors_is_said() -> None:
    """At 11.5 deg `published` has none or two unstable modes, which depends on the parameters; four are far left."""
    wide = replace(family(), spread=default_parameters().standard_errors)
    proof = prove_schedule(wide, exact_table(11.5, 11.53125), 11.5, 11.53125)
    assert proof.crossings == [(11.5, 11.53125, (0, 2))]
    rows = schedule_proof_report(proof).data["modes"]
    assert rows["open"] == [{"from_deg": 11.5, "to_deg": 11.53125, "at_least": 0, "at_most": 2}]


def test_what_was_covered_is_not_proved_again() -> None:
    table = exact_table(13.0, 14.0)
    saved: list[tuple[Cover, Cover]] = []
    whole = prove_schedule(family(), table, 13.0, 14.0, save=lambda *covers: saved.append(covers))
    count = len(saved)
    resumed: list[tuple[Cover, Cover]] = []
    half = count // 2
    again = prove_schedule(family(), table, 13.0, 14.0, known=saved[half], save=lambda *covers: resumed.append(covers))
    assert len(resumed) == count - 1 - half
    assert count > 3
    for first, second in ((whole.loop, again.loop), (whole.modes, again.modes)):
        assert [each.box for each in first.proved] == [each.box for each in second.proved], "bisected another way"
    assert again.loop.counts == whole.loop.counts
    assert again.modes.counts == whole.modes.counts


def test_gains_beyond_all_numbers_are_refused() -> None:
    table = GainTable(np.array([14.0, 15.0]), np.full((2, 5, 6), 1e308))
    with pytest.raises(BadInputError, match="too large to compute with"):
        prove_schedule(family(), table, 14.5, 14.6)


@pytest.mark.parametrize(
    ("angles", "shape"),
    [([], (0, 5, 6)), ([15.0, 15.0], (2, 5, 6)), ([16.0, 15.0], (2, 5, 6)), ([15.0, 16.0], (2, 6, 5))],
)
def test_a_table_that_is_none_is_refused(angles: list[float], shape: tuple[int, ...]) -> None:
    with pytest.raises(BadInputError):
        GainTable(np.array(angles), np.zeros(shape))


@pytest.mark.slow
@pytest.mark.parametrize("errors", [0.0, 1.0])
@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_the_whole_range_is_proved(dynamics: str, errors: float, tmp_path: Path) -> None:
    """Of the identified aircraft, and of all within one standard error of every parameter."""
    angles, flights = np.linspace(0.0, 20.0, 11).tolist(), family(dynamics)
    flights = replace(flights, spread=default_parameters().standard_errors) if errors else flights
    table, path = exact_table(*angles, dynamics=dynamics), tmp_path / "certificate.json"
    proof = prove_schedule(flights, table, 0.0, 20.0)
    assert proof.proved
    assert proof.rate > 0.29
    if not errors:
        assert [count for _, _, count in proof.modes.counts] == [0, 2, 3]
        assert_agrees_with_doubles(proof, dynamics)
        return
    ScheduleCertificate(flights, table, 0.0, 20.0, path, ORIGIN).finish(proof)
    assert joined(check_certificate(path).covers["loop"]) == [(0.0, 20.0, 0)]


@pytest.mark.parametrize(("low", "high"), [(15.0, 14.0), (14.5, 14.5), (14.0, float("nan"))])
def test_nothing_is_proved_of_an_interval_without_angles(low: float, high: float) -> None:
    """Once: proved, since no box was refuted."""
    with pytest.raises(BadInputError, match=f"goes from {low:g} to {high:g}; give the lower end first"):
        prove_schedule(family(), exact_table(14.0, 15.0), low, high)
    with pytest.raises(BadInputError, match="the interval goes from"):
        coarsest_grid(family(), low, high, 1e-3)


def test_gains_over_the_speed_of_another_aircraft(tmp_path: Path) -> None:
    """The polynomial GTM from 40 to 50 m/s: proved, and verified by other means."""
    own, saved = ("--aircraft", "examples/gtm.py:GTM"), str(tmp_path / "gtm.json")
    assert "Proved: every speed from 40 to 50 m/s" in hfa("prove", "schedule", *own, "--at", "40:50", "-o", saved).out
    assert hfa("prove", *own, "--check", saved).out.startswith("Verified, proved: speed from 40 to 50 m/s")
