"""Ranges, rates and files of the search for the proof of a schedule."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from proof_cases import proved, two_trims
from small_loops import J

from hfa_prove.search.family import Box, Family
from hfa_prove.search.proof import CertificateFile, Proof
from hfa_prove.search.schedule import (
    ProvedBox,
    ScheduleSearch,
    _first_weight,
    _gaps,
    _lyapunov,
    _weight,
)
from hfa_prove.statements.schedule import Run
from hfa_support.errors import NoSolutionError
from hfa_support.provenance import Provenance


def test_an_unfinished_certificate_is_written_at_intervals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file is written after 2 s and 9 times the duration of the last writing, and at the end."""
    now = 0.0
    written: list[float] = []
    duration = 0.5

    def write(path: Path, origin: Any) -> None:
        nonlocal now
        written.append(now)
        now += duration

    monkeypatch.setattr("hfa_prove.search.proof.time", SimpleNamespace(monotonic=lambda: now))
    proof = cast(Any, SimpleNamespace(write=write))
    file = CertificateFile(tmp_path / "proof.json", Provenance("a test", "published"))
    for at in (1.9, 2.1, 7.0, 7.2, 10.0):
        now = at
        file.save(proof)
    assert written == [2.1, 7.2]
    file.save(proof, finished=True)
    assert written == [2.1, 7.2, 10.0]
    assert file.known(cast(Any, None), cast(Any, None)) == {}
    with pytest.raises(NoSolutionError, match="no certificate is written"):
        Proof(cast(Any, None), {}).write(tmp_path / "none.json", Provenance("", ""))
    assert list(tmp_path.iterdir()) == []


def test_the_proof_of_a_scalar_schedule_has_its_closed_form() -> None:
    """x' = 1 + p - x² + u with u = -k(p) (x - s), s = sqrt(1 + p): F = -2 s - k, and A = -2 s.

    The decay rate is 0.9 times that at a center. V = P x² with P = W / (2 |F|) decreases while
    |p'| < 2 F² / |F'|.
    """
    data = proved("two trims").data
    p = np.linspace(1.0, 1.5, 501)
    s = np.sqrt(1.0 + p)
    F = -2.0 * s - (0.5 + 0.1 * (p - 1.0))
    slowest = np.min(-F)
    assert data["decay_rate"] == pytest.approx(0.9 * 3.525, rel=1e-9)  # of one box, about 1.25
    assert data["decay_rate"] < slowest
    fastest = np.min(2.0 * F**2 / (1.0 / s + 0.1))
    assert 0.9 * fastest <= data["scheduled_rate"] <= fastest
    assert float(f"{data['scheduled_rate']:.1e}") == data["scheduled_rate"]
    lyapunov = data["lyapunov"]
    (breakpoints,) = lyapunov["scheduled"].values()
    P = np.interp(p, breakpoints, np.array(lyapunov["P"]).ravel())
    slope = np.diff(np.array(lyapunov["P"]).ravel()) / np.diff(breakpoints)
    assert np.all(2.0 * F * P + data["scheduled_rate"] * np.max(np.abs(slope)) < 0.0)
    assert np.max(np.diff(breakpoints)) <= 0.125 * Family(two_trims()).step
    reached = 1.0
    for box in data["boxes"]:
        ((low, high),) = box["scheduled"].values()
        assert low == reached
        reached = high
        (((least, most),),) = box["A"]
        exact = (-2.0 * np.sqrt(1.0 + high), -2.0 * np.sqrt(1.0 + low))
        assert least <= exact[0] < exact[1] <= most
        assert (least, most) == pytest.approx(exact, abs=0.02)
        (((least, most),),) = box["B"]
        assert least <= 1.0 <= most < least + 1e-9
    assert reached == 1.5
    assert data["loop"]["boxes"] == len(data["boxes"])


def test_ranges_of_a_schedule_are_joined_and_cut() -> None:
    """Gaps are what no run covers, and neighbors with equal bounds are one range."""
    runs = [Run(3.0, 4.0, 0, 0), Run(1.0, 2.0, 0, 0), Run(1.5, 1.75, 0, 0)]
    assert _gaps(runs, 0.0, 5.0) == [(0.0, 1.0), (2.0, 3.0), (4.0, 5.0)]
    assert _gaps(runs, 1.0, 4.0) == [(2.0, 3.0)]
    boxes = {
        "loop": [
            ProvedBox(Box(low, high), least, most, 0.0, {})
            for low, high, least, most in (
                (0.0, 1.0, 0, 0), (1.0, 2.0, 0, 0), (3.0, 4.0, 0, 3), (3.0, 3.5, 1, 2),
            )
        ],
        "modes": [ProvedBox(Box(2.0, 2.5), 0, 0, 0.0, {})],
    }  # fmt: skip
    trims = SimpleNamespace(stated_trim=lambda start: start)
    search = cast(Any, SimpleNamespace(boxes=boxes, low=0.0, high=5.0, trims=trims))
    assert ScheduleSearch._runs(search, "loop", 4) == (
        Run(0.0, 2.0, 0, 0), Run(2.0, 3.0, 0, 4), Run(3.0, 3.5, 1, 2), Run(3.5, 4.0, 0, 3),
        Run(4.0, 5.0, 0, 4),
    )  # fmt: skip
    assert ScheduleSearch._stated_trims(search) == (0.0, 3.0)


def test_the_weight_of_a_motion_is_that_of_the_modes() -> None:
    """P is half the identity in the modes of A. A scalar loop may move at 2 A² / |A'|."""
    vectors = np.linalg.eig(J)[1]
    solved = _lyapunov(J, _first_weight(J))
    assert np.allclose(vectors.conj().T @ solved @ vectors, 0.5 * np.eye(2))
    assert np.allclose(J.T @ solved + solved @ J, -_first_weight(J))
    points = [(np.array([[a]]), np.array([[slope]])) for a, slope in ((-1.0, 2.0), (-3.0, 4.0))]
    fastest, W = _weight(points)
    assert fastest == pytest.approx(1.0)
    assert W[0, 0] > 0.0
