"""Files of pictures: the same for the same data, with where they come from below them and in their metadata."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from hfa_support.reporting.figure import enlarge_first_second, new_figure, save

TIMES = np.linspace(0.0, 20.0, 2001)
DIP = 0.05 * np.sin(TIMES) - np.exp(-5.0 * TIMES)
FLAT = np.full(2001, 0.1)


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_the_origin_is_in_the_file_and_the_file_is_made_again(suffix: str, tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}{suffix}" for number in (1, 2)]
    for path in paths:
        figure = new_figure(4.0, 3.0)
        figure.subplots().plot([0.0, 1.0])
        save(figure, path, "hfa 0, parameters c1fb")
    assert paths[0].read_bytes() == paths[1].read_bytes()
    assert b"hfa 0, parameters c1fb" in paths[0].read_bytes()


def test_the_caption_has_its_own_strip(tmp_path: Path) -> None:
    for name, source in (("plain", ""), ("signed", "origin " * 60)):
        figure = new_figure(4.0, 3.0)
        figure.subplots().set_facecolor("red")
        save(figure, tmp_path / f"{name}.png", source)
    plain, signed = (imread(tmp_path / f"{name}.png") for name in ("plain", "signed"))
    assert plain.shape == signed.shape
    lowest = [
        int(np.flatnonzero((image[:, :, :3] == (1.0, 0.0, 0.0)).all(axis=2).any(axis=1)).max())
        for image in (plain, signed)
    ]
    assert lowest[1] < lowest[0] - 40  # six lines of small print below the axes


@pytest.mark.parametrize(
    ("scale", "depth", "sign", "size"),
    [
        ("linear", 2.0, 1.0, 1.0),
        ("linear", 2.0, -1.0, 0.05),
        ("asinh", 20.0, -1.0, 1.0),
        ("asinh", 20.0, 1.0, 0.05),
    ],
)
def test_the_inset_shows_the_first_second_where_no_later_curve_runs(
    scale: str, depth: float, sign: float, size: float
) -> None:
    """size: of what follows; where it takes all the height, room is made."""
    figure = new_figure(5.4, 3.7)
    axes = figure.subplots()
    axes.set_yscale(scale)
    lines = axes.plot(TIMES, sign * (depth * DIP + size * np.sin(TIMES)), "-.", lw=3.0, color="C4")
    lines += axes.plot(TIMES, sign * FLAT, color="0.5", ls=(0, (5, 1, 1, 1, 1, 1)))
    lines += axes.plot([0.0], [sign], "x")
    axes.axvline(5.0)
    limit = axes.axhline(0.3 * sign)
    inset = enlarge_first_second(axes)
    assert inset is not None
    assert inset.get_title() == "first second, s"
    for line, drawn in zip(lines, inset.get_lines(), strict=True):
        points = line.get_xydata()
        np.testing.assert_array_equal(drawn.get_xydata(), points[points[:, 0] <= 1.0])
        for name in ("color", "linewidth", "marker"):
            assert getattr(drawn, f"get_{name}")() == getattr(line, f"get_{name}")(), name
    figure.draw_without_rendering()
    box = inset.get_tightbbox().transformed(axes.transData.inverted())
    later = np.concatenate([limit.get_ydata(), *(line.get_ydata()[line.get_xdata() > 1.0] for line in lines)])
    assert later.max() < min(box.y0, box.y1) or later.min() > max(box.y0, box.y1)
    bottom, top = axes.get_ylim()
    assert bottom < min(box.y0, box.y1)
    assert max(box.y0, box.y1) < top
    assert bottom < min(line.get_ydata().min() for line in lines)
    assert max(line.get_ydata().max() for line in lines) < top


@pytest.mark.parametrize(
    "curve",
    [(TIMES, np.sin(TIMES)), (TIMES, FLAT), (TIMES[:400], DIP[:400]), (TIMES[:1], FLAT[:1]), ([], []), None],
    ids=["slow", "flat", "short", "lost", "nothing", "none"],
)
def test_what_has_no_transient_has_no_inset(curve: tuple[np.ndarray, np.ndarray] | None) -> None:
    axes = new_figure(5.4, 3.7).subplots()
    if curve is not None:
        axes.plot(*curve)
    assert enlarge_first_second(axes) is None
    assert axes.child_axes == []
