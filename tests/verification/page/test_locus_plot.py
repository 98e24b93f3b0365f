"""The interactive root locus: Plotly takes it; angle, frequency and damping of each point; the marked angles."""

from __future__ import annotations

import numpy as np
import pytest
from plotly.graph_objects import Figure

from hfa_model import Aircraft
from trim import modes_of, sweep
from verification.page.locus_plot import MARKED, locus_plot
from verification.page.main_job import MainJob


def test_hover_tells_the_modes_and_the_printed_angles_are_marked(job: MainJob) -> None:
    plot = locus_plot(job.sweep)
    assert plot is not None
    every, slow = plot.figures
    named = [{trace["name"] for trace in spec["data"]} for spec in (every, slow)]
    marks = {*(f"{angle:g} deg" for angle in MARKED), "chosen angle"}
    assert named[0] == {*job.sweep.mode_names, *marks}
    assert named[1] == {"phugoid", "dihedral (slow)", *marks}
    for spec in (every, slow):
        assert len(Figure(spec).frames) == len(job.points)
    for trace in every["data"]:
        for angle, frequency, damping in trace["customdata"]:
            if np.isfinite(frequency):
                point = next(point for point in job.points if point.dihedral_deg == angle)
                modes = modes_of(point.model.A, point.model.states)
                assert min(abs(mode.frequency - frequency) + abs(mode.damping - damping) for mode in modes) < 1e-4


def test_where_nothing_is_trimmed_there_is_no_plot(published_aircraft: Aircraft) -> None:
    assert locus_plot(sweep(published_aircraft, {"dihedral": np.radians([59.0])})) is None


def test_the_range_holds_every_point(job: MainJob) -> None:
    plot = locus_plot(job.sweep)
    assert plot is not None
    low, high = plot.figures[0]["layout"]["yaxis"]["range"]
    largest = float(np.nanmax(job.sweep.eigenvalues.imag))
    assert (low, high) == (pytest.approx(-high), pytest.approx(largest * 1.12))
