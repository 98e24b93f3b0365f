"""The command `hfa monte-carlo`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import hfa

from hfa_model import LINEAR_STATES
from hfa_support.jobs.store import open_store

# The command.

NAMED = ("monte-carlo", "--dihedral", "15", "--law", "exact")
BASE = (*NAMED, "--duration", "0.1")


def test_the_command_flies_and_sums_up(tmp_path: Path) -> None:
    store = str(tmp_path / "a.zarr")
    words = (*BASE, "--samples", "8", "--error", "panel_mass=0.05", "--noise", "alpha=0.1", "--turbulence", "3:1750")
    result = hfa(*words, "--json", "-o", store)
    assert (result.code, result.err) == (0, "")
    data = json.loads(result.out)
    assert (data["schema"], data["members"], data["held"]) == ("hfa.monte-carlo-summary/1", 8, 8)
    kept = open_store(Path(store))
    peaks = kept.read("peak_error")[:, LINEAR_STATES.index("alpha")]
    assert data["peak_error"]["alpha"] == pytest.approx(np.quantile(peaks, data["quantiles"]).tolist())
    angles = kept.read("peak_angle_of_attack")
    assert data["peak_deviation"]["angle_of_attack"] == pytest.approx(np.quantile(angles, data["quantiles"]).tolist())
    assert "angle_of_attack" in data["left"]
    assert data["errors"]["panel_mass"]["deviation"] == pytest.approx(kept.read("factors").std(ddof=1))
    again = hfa(*words, "--resume", "-o", store)
    assert "stayed within limits: 8 of 8" in again.out
    assert f"{np.degrees(data['peak_error']['alpha'][3]):.4g}" in again.out
    assert "members not kept" in hfa(*words).out
