"""Figures in a page: no word of the data ends the script that holds it."""

from __future__ import annotations

import json
import re

import numpy as np

from verification.page.interactive import InteractivePlot, in_script


def test_data_cannot_leave_its_script() -> None:
    value = {"name": "</script><script>alert(1)", "x": np.array([0.5, np.nan])}
    text = in_script(value)
    assert "<" not in text
    assert json.loads(text) == {"name": "</script><script>alert(1)", "x": [0.5, None]}


def test_each_figure_has_a_box_with_what_it_shows() -> None:
    plot = InteractivePlot("two.png", 'a "text" <1>', lambda: None, ({"data": []}, {"data": []}))  # type: ignore[arg-type]
    html = plot.html()
    boxes, scripts = re.findall(r'<div class="plot" id="([^"]*)"', html), re.findall(r'data-plot="([^"]*)"', html)
    assert boxes == scripts == ["plot-two-1", "plot-two-2"]
    assert html.count("a &quot;text&quot; &lt;1&gt;") == 3
