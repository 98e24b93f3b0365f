"""Files of pictures: the same for the same data, with where they come from below them and in their metadata."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from hfa_support.reporting.figure import new_figure, save


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
