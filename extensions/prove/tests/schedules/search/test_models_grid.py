"""Linear models at breakpoints with a proved interpolation error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from known_models import exact_gain, model_at
from proof_cases import ORIGIN, family
from random_points import INPUT_SCALES

from hfa import NoSolutionError
from hfa_prove import check_certificate, prove_models
from hfa_prove.report import checked_report

WITHIN = 4.9e-4


def test_the_interpolation_error_is_below_its_bound(tmp_path: Path) -> None:
    """The largest interpolation errors at sampled angles are at most their bounds.

    The errors of A, K and the inputs reach at least 40 % of their bounds.
    """
    grid = prove_models(family(), 14.0, 14.5, WITHIN)
    data = grid.data
    report = grid.report()
    places = data["dihedral_deg"]
    bounds = data["error"]
    assert max(bounds.values()) <= WITHIN
    found: dict[str, list[float]] = {name: [] for name in bounds}
    for angle in np.linspace(14.0, 14.5, 9).tolist():
        model = model_at(angle)
        exact = {"A": model.A, "B": model.B, "K": exact_gain(angle)}
        k = int(np.clip(np.searchsorted(places, angle, side="right") - 1, 0, len(places) - 2))
        share = (angle - places[k]) / (places[k + 1] - places[k])
        for name, value in exact.items():
            between = data[name][k] + share * (data[name][k + 1] - data[name][k])
            found[name].append(float(np.linalg.norm(between - value) / np.linalg.norm(value)))
        u = data["inputs_offset"][k] + share * (
            data["inputs_offset"][k + 1] - data["inputs_offset"][k]
        )
        found["inputs"].append(float(np.linalg.norm((u - model.input_offsets) / INPUT_SCALES)))
    for name, least in {"A": 0.5, "B": 0.0, "K": 0.4, "inputs": 0.51}.items():
        assert least * bounds[name] < max(found[name]) <= bounds[name]
    assert report.title.startswith(f"Proved: {len(places)} models from 14 to 14.5 deg")
    units = {row[1:4]: row[5] for row in report.records.rows}
    assert (units["A", "speed", "pitch_rate"], units["K", "throttle", "speed"]) == (
        "(ft/s^2)/(rad/s)",
        "(1)/(ft/s)",
    )
    assert (units["U0", "throttle", ""], len(report.records.rows)) == (
        "1",
        len(places) * (36 + 30 + 30 + 5),
    )
    grid.write(tmp_path / "certificate.json", ORIGIN)
    checked = checked_report(check_certificate(tmp_path / "certificate.json")).data
    assert (checked["nodes"], checked["error"]) == (len(places), bounds)


def test_a_tolerance_too_small_is_reported() -> None:
    """If no grid satisfies the tolerance, NoSolutionError names the tolerance."""
    with pytest.raises(NoSolutionError, match="no grid is proved within 1e-09"):
        prove_models(family(), 14.0, 14.001, 1e-9)
