"""The drawing of the slider: Plotly takes it, and its arrows are the forces to the scale that is said."""

from __future__ import annotations

import re

import numpy as np
import pytest
from plotly.graph_objects import Figure

from verification.page.front_view import front_view
from verification.page.main_job import MainJob


def test_plotly_takes_it_and_the_arrows_are_to_scale(job: MainJob) -> None:
    plot = front_view(job.aircraft, job.points, "trim.png")
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


def test_one_point_needs_no_frames_and_none_no_drawing(job: MainJob) -> None:
    alone = front_view(job.aircraft, job.points[:1], "trim-5.png")
    assert alone is not None
    assert alone.figures[0]["frames"] == []
    assert "dihedral 5 deg" in alone.text
    assert front_view(job.aircraft, job.points[-1:], "trim-59.png") is None
