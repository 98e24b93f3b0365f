"""Proofs over intervals of dihedral: stability, refutation, moving dihedral, and resumed proofs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flint import ctx
from known_models import model_at
from proof_cases import (
    ORIGIN,
    between,
    exact_loop,
    family,
    loop_in_doubles,
    proved,
    unstable_between,
)

import hfa
from hfa import BadInputError
from hfa.paper import default_parameters
from hfa_flight.schedule.gain_schedule import GainSchedule
from hfa_prove import check_certificate, prove_schedule
from hfa_prove.enclosure.precision import PRECISION
from hfa_prove.search import proof as certificate
from hfa_prove.search.loops import Loop
from hfa_prove.search.proof import CertificateFile, Proof
from hfa_prove.statements.schedule import Run


def counts(runs: tuple[Run, ...]) -> list[tuple[int, int]]:
    return [(run.least, run.most) for run in runs]


def loop_at(loop: Loop, angle: float, dynamics: str = "published") -> np.ndarray:
    model = model_at(angle, dynamics)
    return loop_in_doubles(loop, model.A, model.B, angle).base


def assert_agrees_with_doubles(proof: Proof, loop: Loop, dynamics: str) -> None:
    """Assert that the loop has the proved decay rate, and A and B the proved bounds, on a grid."""
    for box in proof.data["boxes"]:
        low, high = box["dihedral_deg"]
        for angle in (low, (low + high) / 2, high):
            values = np.linalg.eigvals(loop_at(loop, angle, dynamics))
            assert values.real.max() < -proof.data["decay_rate"]
            for name in ("A", "B"):
                ends = np.array(box[name])
                value = getattr(model_at(angle, dynamics), name)
                rounding = 1e-11 * (1.0 + np.abs(value).max())
                assert np.all(ends[..., 0] - rounding <= value)
                assert np.all(value <= ends[..., 1] + rounding)


@pytest.mark.parametrize("dynamics", ["published", pytest.param("newton", marks=pytest.mark.slow)])
def test_a_part_of_the_schedule_is_proved(dynamics: str) -> None:
    """Stability, the number of unstable modes and a bound on the dihedral rate are proved.

    The Lyapunov function decreases at the proved rate. At twice the rate, the same function does
    not decrease at some angle.
    """
    loop = exact_loop(14.0, 14.5, dynamics=dynamics)
    proof = prove_schedule(family(dynamics), loop, 14.0, 14.5, moving=True)
    assert proof.proved
    assert counts(proof.statement.loop) == [(0, 0)]
    assert counts(proof.statement.modes) == [(2, 2)]
    assert proof.data["decay_rate"] > 0.29
    assert_agrees_with_doubles(proof, loop, dynamics)
    rate = proof.data["dihedral_rate_deg_s"]
    lyapunov = proof.witness["motion"]
    fastest = []
    assert rate > 60.0
    width = lyapunov["breakpoints"][1] - lyapunov["breakpoints"][0]
    slope = (lyapunov["P"][1] - lyapunov["P"][0]) / np.radians(width)
    for angle in (14.0, 14.0375, 14.0875, 14.125):
        P = between(lyapunov["breakpoints"], lyapunov["P"], angle)
        A = loop_at(loop, angle, dynamics)
        for sign in (-1.0, 1.0):
            growth = A.T @ P + P @ A + sign * np.radians(rate) * slope
            assert np.linalg.eigvalsh(growth)[-1] < 0.0
            fastest.append(np.linalg.eigvalsh(growth + sign * np.radians(rate) * slope)[-1])
    assert max(fastest) > 0.0


def test_a_dihedral_rate_too_large_is_not_proved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A dihedral rate 1.5 times as large as the Lyapunov function allows is not proved.

    Stability at constant dihedral is proved.
    """
    # The planted fault: a search that claims too much.
    monkeypatch.setattr("hfa_prove.search.schedule._SHARES", (1.5,))
    proof = prove_schedule(family(), exact_loop(14.0, 14.125), 14.0, 14.125, moving=True)
    assert (proof.proved, proof.data["dihedral_rate_deg_s"]) == (False, 0.0)
    assert "open: a moving dihedral from 14 to 14.125 deg" in proof.report().text()
    assert counts(proof.statement.loop) == [(0, 0)]


@pytest.mark.slow
@pytest.mark.parametrize(("end", "unstable"), [(15.03, 1), (15.06, 0)])
def test_instability_between_two_angles_is_refuted(
    end: float, unstable: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gains that are unstable between two stable angles are refuted, with the number of modes.

    The open angles, where a mode crosses the axis, form narrow intervals.
    """
    if end < 15.06:  # boxes twice as wide take less time
        monkeypatch.setattr("hfa_prove.search.schedule.NARROWEST", 2.0**-9)
    loop = unstable_between(15.0, 15.06)
    proof = prove_schedule(family(), loop, 15.0, end, moving=True)
    runs = proof.statement.loop
    refuted = [run for run in runs if run.least > 0]
    assert not proof.proved
    assert "motion" not in proof.witness
    assert any(run.low <= 15.03 <= run.high for run in refuted)
    for run in refuted:
        values = np.linalg.eigvals(loop_at(loop, (run.low + run.high) / 2))
        assert run.least == run.most == int(np.sum(values.real > 0.0))
    # At the angles of the table the loop is stable, and the ends of the interval are proved.
    assert (runs[0].low, runs[0].most) == (15.0, 0)
    assert (runs[-1].high, runs[-1].most) == (end, unstable)
    # Only narrow intervals, where a mode crosses the axis, are open.
    still_open = [run for run in runs if run.least < run.most]
    assert 0.0 < sum(run.high - run.low for run in still_open) < 0.03
    assert proof.data["decay_rate"] > 0.0
    data = proof.report().data
    text = proof.report().text()
    found = (data["proved"], len(data["refuted"]), len(data["loop"]["open"]))
    assert found == (False, len(refuted), len(still_open))
    assert text.startswith("Refuted: every dihedral from 15 to")
    assert text.count("\nopen: the loop from") == len(still_open)


def test_the_angle_where_a_mode_crosses_is_enclosed() -> None:
    """The dihedral angle at which a mode of A crosses the imaginary axis is enclosed.

    At 16.688 deg, a third mode of the `published` dynamics becomes unstable.
    """
    proof = proved("crossing")
    assert counts(proof.statement.modes) == [(2, 2), (2, 3), (3, 3)]
    crossing = proof.statement.modes[1]
    for end, count in ((crossing.low, 2), (crossing.high, 3)):
        assert int(np.sum(np.linalg.eigvals(model_at(end).A).real > 0.0)) == count
    assert proof.proved


def test_parameter_errors_give_bounds_on_unstable_modes() -> None:
    """With parameter errors, the data contain bounds on the number of unstable modes.

    From 11.5 to 11.53125 deg, A of `published` has 0 to 2 unstable modes.
    """
    wide = replace(family(), spread=default_parameters().standard_errors)
    rows = prove_schedule(wide, exact_loop(11.5, 11.53125), 11.5, 11.53125).data["modes"]
    assert rows["open"] == [{"from_deg": 11.5, "to_deg": 11.53125, "at_least": 0, "at_most": 2}]


@pytest.mark.slow
def test_a_resumed_proof_has_identical_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A proof that is interrupted and resumed writes the same bytes as an uninterrupted one.

    The proof is interrupted in the part about the loop, and in the part about the modes of A. An
    edited file is refused.
    """
    # Without this, a short proof ends before its certificate is first written.
    monkeypatch.setattr(certificate, "_PAUSE", -1.0)
    monkeypatch.setattr(certificate, "_RARELY", 0.0)
    path = tmp_path / "certificate.json"
    whole = tmp_path / "whole.json"
    loop = exact_loop(13.75, 14.0, 14.25)
    prove_schedule(family(), loop, 13.75, 14.25, moving=True, file=CertificateFile(whole, ORIGIN))
    again = CertificateFile(path, ORIGIN, resume=True)

    for share in (0.2, 0.6):

        def interrupted(done: float, total: float, what: str = "", share: float = share) -> None:
            if done > share * total:
                raise KeyboardInterrupt

        file = CertificateFile(path, ORIGIN)
        with pytest.raises(KeyboardInterrupt):
            prove_schedule(family(), loop, 13.75, 14.25, file=file, progress=interrupted)
        half = json.loads(path.read_text())["witness"]
        assert (len(half["loop"]), len(half["modes"]) > 0) == (1 + (share > 0.5), share > 0.5)
        assert prove_schedule(family(), loop, 13.75, 14.25, moving=True, file=again).proved
        assert ctx.prec == PRECISION  # the checker uses another precision
        assert path.read_bytes() == whole.read_bytes()
    forged = json.loads(path.read_text())
    forged["witness"]["loop"][0]["rate"] = 0.5
    path.write_text(json.dumps(forged))
    with pytest.raises(BadInputError, match="edited"):
        prove_schedule(family(), loop, 13.75, 14.25, file=again)


def test_unusable_gains_and_intervals_are_refused() -> None:
    """Gains that overflow, and intervals without low < high or beyond the table, are refused."""
    huge = np.full((2, 5, 6), 1e308)
    table = GainSchedule(np.radians([14.0, 15.0]), huge, hfa.aircraft())
    with pytest.raises(BadInputError, match="the matrix of the loop overflows"):
        prove_schedule(family(), table, 14.5, 14.6)
    for low, high in ((15.0, 14.0), (14.5, 14.5), (14.0, float("nan"))):
        said = f"the interval is {low:g} to {high:g}; give two different finite ends"
        with pytest.raises(BadInputError, match=said):
            prove_schedule(family(), exact_loop(14.0, 15.0), low, high)
    loop = exact_loop(13.0, 14.0, 15.0)
    assert loop.segments(13.5, 15.0) == [(13.5, 14.0), (14.0, 15.0)]
    with pytest.raises(BadInputError, match=r"the table of gains covers 13 to 15, not 13 to 15.5"):
        loop.segments(13.0, 15.5)


@pytest.mark.parametrize(
    ("angles", "shape"),
    [
        ([], (0, 5, 6)),
        ([15.0, 15.0], (2, 5, 6)),
        ([16.0, 15.0], (2, 5, 6)),
        ([15.0, 16.0], (2, 6, 5)),
    ],
)
def test_inconsistent_gain_tables_are_refused(angles: list[float], shape: tuple[int, ...]) -> None:
    """Gain tables that are empty, not increasing or of wrong shape are refused."""
    with pytest.raises(BadInputError):
        GainSchedule(np.radians(angles), np.zeros(shape), hfa.aircraft())


@pytest.mark.slow
@pytest.mark.parametrize("errors", [0.0, 1.0])
@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_the_whole_range_is_proved(dynamics: str, errors: float, tmp_path: Path) -> None:
    """The full range of 0 to 20 deg is proved for the identified aircraft, with a rate.

    The range is also proved for all aircraft within one standard error of every parameter, without
    a rate.
    """
    angles = np.linspace(0.0, 20.0, 11).tolist()
    flights = family(dynamics)
    if errors:
        flights = replace(flights, spread=default_parameters().standard_errors)
    loop = exact_loop(*angles, dynamics=dynamics)
    path = tmp_path / "certificate.json"
    proof = prove_schedule(flights, loop, 0.0, 20.0, moving=not errors)
    assert proof.proved
    assert proof.data["decay_rate"] > 0.29
    if not errors:
        exactly = [least for least, most in counts(proof.statement.modes) if least == most]
        assert exactly == [0, 2, 3]
        assert proof.data["dihedral_rate_deg_s"] > 60.0
        assert_agrees_with_doubles(proof, loop, dynamics)
    proof.write(path, ORIGIN)
    assert counts(check_certificate(path).statement.loop) == [(0, 0)]
