"""What a Monte Carlo says in short."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from member_plans import EVERYTHING, with_scenario

from controller import MonteCarlo, Uncertainty, gain_law, stream_monte_carlo
from controller.monte_carlo.monte_carlo_report import MonteCarloResult


def test_a_summary_without_members_that_held_says_so(plan: MonteCarlo, tmp_path: Path) -> None:
    lost = replace(plan, members=1, law=gain_law("wrong sign", -np.array(plan.law.identity["K"])))
    report = MonteCarloResult.of(lost, stream_monte_carlo(lost, tmp_path / "a.zarr")).report()
    data = report.data
    assert "held their envelope: 0 of 1\nleft it, by the state that left first: pitch_rate 1" in report.text()
    assert data["held"] == 0
    assert set(data["effort"].values()) == {None}
    assert data["errors"]["panel_mass"]["deviation"] is None
    assert data["first_left"] < 0.5


@pytest.mark.parametrize("turbulence", [EVERYTHING.turbulence, None])
def test_deviations_are_shown_where_the_air_moves(
    plan: MonteCarlo, tmp_path: Path, turbulence: tuple[float, ...] | None
) -> None:
    few = replace(with_scenario(plan, uncertainty=replace(EVERYTHING, turbulence=turbulence)), members=2)
    text = MonteCarloResult.of(few, stream_monte_carlo(few, tmp_path / "a.zarr")).report().text()
    assert ("peak deviation" in text) == (turbulence is not None)
    assert "rms error dihedral" in text


def test_members_that_are_all_alike_are_said_to_be(plan: MonteCarlo, tmp_path: Path) -> None:
    said = "Note: nothing differs from member to member: give parameter errors, noise or turbulence"
    alike = replace(with_scenario(plan, uncertainty=Uncertainty()), members=1)
    assert said in MonteCarloResult.of(alike, stream_monte_carlo(alike, tmp_path / "a.zarr")).report().text()
    assert said not in MonteCarloResult.of(plan, stream_monte_carlo(plan, tmp_path / "b.zarr")).report().text()
