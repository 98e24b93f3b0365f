"""Whole intervals of dihedral, an instability between two angles of a table, and how fast the
dihedral may move."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flint import ctx
from known_models import model_at
from proof_cases import ORIGIN, between, exact_table, family, proved, unstable_between

import hfa_model
from controller.game.gain_schedule import GainSchedule
from controller.riccati.balancing import spectrum
from hfa_model import default_parameters
from hfa_support import BadInputError
from verification import check_certificate, coarsest_grid, prove_schedule
from verification.proof.arithmetic import PRECISION
from verification.proof.search import certificate
from verification.proof.search.certificate import CertificateFile, Proof
from verification.proof.search.proof_report import crossings, gaps, joined
from verification.proof.search.scheduled_loop import LoopTable, segments


def assert_agrees_with_doubles(proof: Proof, table: LoopTable, dynamics: str) -> None:
    """On a grid the proved rate and entries hold."""
    for box in proof.boxes["loop"]:
        for angle in (box["range"][0], sum(box["range"]) / 2, box["range"][1]):
            model = model_at(angle, dynamics)
            found = spectrum(model.A - model.B @ between(table.places, table.K, angle)).abscissa
            assert (found < -box["rate"]) == (box["unstable"] == 0)
            for name in ("A", "B"):
                ends, value = np.array(box[name]), getattr(model, name)
                assert np.all((ends[..., 0] <= value) & (value <= ends[..., 1]))


@pytest.mark.parametrize("dynamics", ["published", pytest.param("newton", marks=pytest.mark.slow)])
def test_a_part_of_the_schedule_is_proved(dynamics: str) -> None:
    """The loop, the modes of A, and a rate, twice which the same Lyapunov function does not
    prove."""
    table = exact_table(14.0, 14.5, dynamics=dynamics)
    proof = prove_schedule(family(dynamics), table, 14.0, 14.5, moving=True)
    assert proof.proved
    assert [joined(proof.covers[name]) for name in ("loop", "modes", "motion")] == [
        [(14.0, 14.5, 0)],
        [(14.0, 14.5, 2)],
        [(14.0, 14.5, 0)],
    ]
    assert proof.data["decay_rate"] > 0.29
    assert_agrees_with_doubles(proof, table, dynamics)
    rate, lyapunov, fastest = proof.statement["place_rate"], proof.statement["lyapunov"], []
    assert rate > 60.0
    for angle in (14.0, 14.0375, 14.0875, 14.125):
        model, P = model_at(angle, dynamics), between(lyapunov["places"], lyapunov["P"], angle)
        slope = (lyapunov["P"][1] - lyapunov["P"][0]) / np.radians(
            lyapunov["places"][1] - lyapunov["places"][0]
        )
        loop = model.A - model.B @ between(table.places, table.K, angle)
        for sign in (-1.0, 1.0):
            growth = loop.T @ P + P @ loop + sign * np.radians(rate) * slope
            assert np.linalg.eigvalsh(growth)[-1] < 0.0
            fastest.append(np.linalg.eigvalsh(growth + sign * np.radians(rate) * slope)[-1])
    assert max(fastest) > 0.0


def test_a_rate_that_the_search_is_wrong_about_is_not_proved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Half as fast again as the same function allows; the loop is proved."""
    monkeypatch.setattr("verification.proof.search.schedule_proof._SHARES", (1.5,))
    proof = prove_schedule(family(), exact_table(14.0, 14.125), 14.0, 14.125, moving=True)
    assert (proof.proved, proof.data["dihedral_rate_deg_s"]) == (False, 0.0)
    assert "open: a moving dihedral from 14 to 14.125 deg" in proof.report().text()
    assert joined(proof.covers["loop"]) == [(14.0, 14.125, 0)]


@pytest.mark.parametrize(
    ("end", "unstable"), [(15.03, 1), pytest.param(15.06, 0, marks=pytest.mark.slow)]
)
def test_an_instability_between_two_angles_is_found_and_refuted(
    end: float, unstable: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    if end < 15.06:  # boxes twice as wide take less time
        monkeypatch.setattr("verification.proof.search.schedule_proof.NARROWEST", 2.0**-9)
    table = unstable_between(15.0, 15.06)
    proof = prove_schedule(family(), table, 15.0, end, moving=True)
    runs = joined(proof.covers["loop"])
    refuted = [run for run in runs if run[2]]
    assert not proof.proved
    assert "motion" not in proof.boxes
    assert any(low <= 15.03 <= high for low, high, _ in refuted)
    for low, high, count in refuted:
        model = model_at((low + high) / 2)
        values = spectrum(
            model.A - model.B @ between(table.places, table.K, (low + high) / 2)
        ).eigenvalues
        assert int(np.sum(values.real > 0.0)) == count
    # At its own angles the table is stable, and there the interval is proved to be.
    assert runs[0][::2] == (15.0, 0)
    assert runs[-1][1:] == (end, unstable)
    # What is open are the places where a mode crosses the axis, and they are narrow.
    still = gaps(proof.covers["loop"], 15.0, end)
    assert 0.0 < sum(high - low for low, high in still) < 0.03
    assert proof.data["decay_rate"] > 0.0
    data, text = proof.report().data, proof.report().text()
    assert (data["proved"], len(data["refuted"]), len(data["loop"]["open"])) == (
        False,
        len(refuted),
        len(still),
    )
    assert text.startswith("Refuted: every dihedral from 15 to")
    assert len(
        [line for line in text.splitlines() if line.startswith("open: the loop from")]
    ) == len(still)


def test_the_angle_where_a_mode_crosses_is_enclosed() -> None:
    """A of `published` gains a third unstable mode at 16.688 deg."""
    proof = proved("crossing")
    assert [count for _, _, count in joined(proof.covers["modes"])] == [2, 3]
    (gap,) = gaps(proof.covers["modes"], 16.6875, 16.6895)
    assert [int(np.sum(spectrum(model_at(end).A).eigenvalues.real > 0.0)) for end in gap] == [2, 3]
    assert crossings(proof) == [(*gap, (2, 3))]
    assert proof.proved


def test_how_many_modes_may_be_unstable_within_the_errors_is_said() -> None:
    """At 11.5 deg `published` has none or two unstable modes, which depends on the parameters; four
    are far left."""
    wide = replace(family(), spread=default_parameters().standard_errors)
    rows = prove_schedule(wide, exact_table(11.5, 11.53125), 11.5, 11.53125).data["modes"]
    assert rows["open"] == [{"from_deg": 11.5, "to_deg": 11.53125, "at_least": 0, "at_most": 2}]


def test_an_interrupted_proof_is_continued_to_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After the loop of a part, and after the modes of A of a part."""
    monkeypatch.setattr(certificate, "_PAUSE", -1.0)
    monkeypatch.setattr(certificate, "_RARELY", 0.0)
    path, whole, table = (
        tmp_path / "certificate.json",
        tmp_path / "whole.json",
        exact_table(13.75, 14.0, 14.25),
    )
    prove_schedule(family(), table, 13.75, 14.25, moving=True, file=CertificateFile(whole, ORIGIN))
    again = CertificateFile(path, ORIGIN, resume=True)

    for share in (0.2, 0.6):

        def interrupted(done: float, total: float, what: str = "", share: float = share) -> None:
            if done > share * total:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            prove_schedule(
                family(),
                table,
                13.75,
                14.25,
                file=CertificateFile(path, ORIGIN),
                progress=interrupted,
            )
        half = json.loads(path.read_text())["boxes"]
        assert (len(half["loop"]), len(half["modes"]) > 0) == (1 + (share > 0.5), share > 0.5)
        assert prove_schedule(family(), table, 13.75, 14.25, moving=True, file=again).proved
        assert ctx.prec == PRECISION  # the checker's is another
        assert path.read_bytes() == whole.read_bytes()
    forged = json.loads(path.read_text())
    forged["boxes"]["loop"][0]["rate"] = 0.5
    path.write_text(json.dumps(forged))
    with pytest.raises(BadInputError, match="edited"):
        prove_schedule(family(), table, 13.75, 14.25, file=again)


def test_what_cannot_be_proved_of_is_refused() -> None:
    """Gains beyond all numbers; intervals without angles, which no box would refute; angles beyond
    the table."""
    table = GainSchedule(np.radians([14.0, 15.0]), np.full((2, 5, 6), 1e308), hfa_model.aircraft())
    with pytest.raises(BadInputError, match="too large to compute with"):
        prove_schedule(family(), table, 14.5, 14.6)
    for low, high in ((15.0, 14.0), (14.5, 14.5), (14.0, float("nan"))):
        with pytest.raises(
            BadInputError, match=f"goes from {low:g} to {high:g}; give the lower end first"
        ):
            prove_schedule(family(), exact_table(14.0, 15.0), low, high)
        with pytest.raises(BadInputError, match="the interval goes from"):
            coarsest_grid(family(), low, high, 1e-3)
    table = exact_table(13.0, 14.0, 15.0)
    assert [(each.low, each.high) for each in segments(table, 13.5, 15.0)] == [
        (13.5, 14.0),
        (14.0, 15.0),
    ]
    with pytest.raises(BadInputError, match=r"the table covers 13 to 15, not 13 to 15.5"):
        segments(table, 13.0, 15.5)


@pytest.mark.parametrize(
    ("angles", "shape"),
    [
        ([], (0, 5, 6)),
        ([15.0, 15.0], (2, 5, 6)),
        ([16.0, 15.0], (2, 5, 6)),
        ([15.0, 16.0], (2, 6, 5)),
    ],
)
def test_a_table_that_is_none_is_refused(angles: list[float], shape: tuple[int, ...]) -> None:
    with pytest.raises(BadInputError):
        GainSchedule(np.radians(angles), np.zeros(shape), hfa_model.aircraft())


@pytest.mark.slow
@pytest.mark.parametrize("errors", [0.0, 1.0])
@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_the_whole_range_is_proved(dynamics: str, errors: float, tmp_path: Path) -> None:
    """Of the identified aircraft with a rate, and of all within one standard error of every
    parameter."""
    angles, flights = np.linspace(0.0, 20.0, 11).tolist(), family(dynamics)
    flights = replace(flights, spread=default_parameters().standard_errors) if errors else flights
    table, path = exact_table(*angles, dynamics=dynamics), tmp_path / "certificate.json"
    proof = prove_schedule(flights, table, 0.0, 20.0, moving=not errors)
    assert proof.proved
    assert proof.data["decay_rate"] > 0.29
    if not errors:
        assert [count for _, _, count in joined(proof.covers["modes"])] == [0, 2, 3]
        assert proof.statement["place_rate"] > 60.0
        assert_agrees_with_doubles(proof, table, dynamics)
        return
    proof.write(path, ORIGIN)
    assert joined(check_certificate(path).covers["loop"]) == [(0.0, 20.0, 0)]
