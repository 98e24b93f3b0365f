"""The picture of the eigenvalues: the slow modes beside all of them, and none without trims."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_model import Aircraft
from hfa_support import BadInputError
from trim import sweep


def test_the_slow_modes_have_their_own_panel_and_no_legend_covers_a_curve(published_aircraft: Aircraft) -> None:
    result = sweep(published_aircraft, {"dihedral": np.radians([5.0, 15.0, 59.0])})
    slow = {name for name, is_slow in zip(result.mode_names, result.root_locus.slow, strict=True) if is_slow}
    assert slow == {"phugoid", "dihedral (slow)"}
    figure = result.root_locus.figure()
    assert [len(axes.lines) for axes in figure.axes] == [9, 6]  # modes, both ends, the axis
    assert [axes.get_legend() for axes in figure.axes] == [None, None]
    (legend,) = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels[-2:] == ["dihedral 5 deg", "dihedral 15 deg"]  # the last point that is trimmed


def test_without_a_trim_there_is_no_picture(published_aircraft: Aircraft) -> None:
    with pytest.raises(BadInputError, match="no point of the sweep has a trim"):
        sweep(published_aircraft, {"dihedral": np.radians([59.0])}).root_locus.figure()
