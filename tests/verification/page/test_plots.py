"""The plots of the page: Plotly takes them, numbers are those of the models, no word of the data ends a script."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from plotly.graph_objects import Figure

from hfa_model import Aircraft
from trim import modes_of, sweep
from verification.page.main_job import MainJob
from verification.page.plots import front_view, in_script, locus_plot


def test_plotly_takes_it_and_the_arrows_are_to_scale(job: MainJob) -> None:
    plot = front_view(job.aircraft, job.points)
    assert plot is not None
    (spec,) = plot.figures
    figure = Figure(spec)
    found = re.search(r"arrows: ([\d.e+-]+) lbf to the foot", plot.text)
    assert found is not None
    assert len(figure.frames) == len(job.points)
    for frame, point in zip(spec["frames"], job.points, strict=True):
        panels, lift, weight, _, sizes = frame["data"]
        if point.model is None:
            assert len(panels["x"]) == len(sizes["x"]) == 0
            continue
        loads = job.aircraft.loads(point.model.point.states, point.model.point.inputs)
        p = job.aircraft.parameters
        lengths = [np.hypot(np.diff(each["x"])[::3], np.diff(each["y"])[::3]) for each in (lift, weight)]
        forces = np.array([loads.outer.lift, loads.center.lift, loads.outer.lift]), p.panel_mass * p.gravity
        for length, force in zip(lengths, forces, strict=True):
            assert length * float(found[1]) == pytest.approx(force, rel=2e-3)
        assert sizes["text"][1] == f"{loads.center.lift:.1f} lbf"
        # The tip of the left panel is a span beyond its hinge, at the dihedral angle.
        x, y = panels["x"][7], panels["y"][7]
        assert np.arctan2(y, x - p.panel_span / 2) == pytest.approx(point.dihedral, abs=1e-4)


def test_data_cannot_leave_its_script() -> None:
    value = {"name": "</script><script>alert(1)", "x": np.array([0.5, np.nan])}
    text = in_script(value)
    assert "<" not in text
    assert json.loads(text) == {"name": "</script><script>alert(1)", "x": [0.5, None]}


def test_hover_shows_the_modes(job: MainJob) -> None:
    plot = locus_plot(job.sweep)
    assert plot is not None
    every, slow = plot.figures
    named = [{trace["name"] for trace in spec["data"]} for spec in (every, slow)]
    assert named[0] == {*job.sweep.mode_names, "chosen angle"}
    assert named[1] == {"phugoid", "dihedral (slow)", "chosen angle"}
    for spec in (every, slow):
        assert len(Figure(spec).frames) == len(job.points)
    for trace in every["data"]:
        for angle, frequency, damping in trace.get("customdata", ()):
            if np.isfinite(frequency):
                point = next(point for point in job.points if point.dihedral_deg == angle)
                modes = modes_of(point.model.A, point.model.states)
                assert min(abs(mode.frequency - frequency) + abs(mode.damping - damping) for mode in modes) < 1e-4


def test_where_nothing_is_trimmed_there_is_no_plot(job: MainJob, published_aircraft: Aircraft) -> None:
    assert front_view(job.aircraft, job.points[-1:]) is None
    assert locus_plot(sweep(published_aircraft, {"dihedral": np.radians([59.0])})) is None
