"""The trade-off of a search: of every evaluation the worst error and the worst gust, and the line that bounds them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from servo_cases import A_Z, write_tuning

from verification.synthesis.tuning import Evaluation, InGust
from verification.synthesis.tuning_file import load_tuning
from verification.synthesis.tuning_report import best_of_both, trade_off, tuning_figure

SEEN = [
    Evaluation(2e6, math.inf),  # without a stable loop
    Evaluation(9e3, -1.0, ({"dihedral": 0.001, A_Z: 9.0},), (0.1,), gusts=(0.1,)),  # of no interest after a gust
    Evaluation(1.0, -1.0, ({"dihedral": 0.01, A_Z: 9.0}, {"dihedral": 0.02, A_Z: 9.0}), (0.1, 0.3), gusts=(0.4, 0.8)),
    Evaluation(1.0, -1.0, ({"dihedral": 0.03, A_Z: 1.0},), (0.2,), gusts=(0.5, 0.2)),
    Evaluation(1.0, -1.0, ({"dihedral": 0.03, A_Z: 1.0},), (0.4,), gusts=(0.9, 0.2)),
]


def test_the_worst_error_and_the_worst_gust_of_each(tmp_path: Path) -> None:
    tuning = load_tuning(str(write_tuning(tmp_path)))
    gusts = (InGust(0.2, tuning.cases[0].actuator, 400.0, 20.0),) * 2
    assert trade_off(replace(tuning, gusts=gusts), SEEN).tolist() == [[0.02, 0.8], [0.03, 0.5], [0.03, 0.9]]
    calm = [each._replace(gusts=()) for each in SEEN if len(each.gusts) != 1]
    assert trade_off(tuning, calm)[:, 1].tolist() == [0.3, 0.2, 0.4]
    assert trade_off(tuning, SEEN[:1]).shape == (0, 2)


def test_no_other_is_smaller_in_both() -> None:
    points = np.array([[3.0, 1.0], [1.0, 3.0], [2.0, 2.0], [2.0, 2.5], [2.5, 2.0], [1.0, 4.0]])
    assert best_of_both(points).tolist() == [[1.0, 3.0], [2.0, 2.0], [3.0, 1.0]]
    assert best_of_both(np.zeros((0, 2))).shape == (0, 2)


def test_the_picture_shows_degrees_and_the_envelope(tmp_path: Path) -> None:
    tuning = load_tuning(str(write_tuning(tmp_path)))
    gust = InGust(0.2, tuning.cases[0].actuator, 400.0, 20.0)
    for gusts, heights in (((), np.degrees([0.3, 0.2, 0.4])), ((gust, gust), [0.8, 0.5, 0.9])):
        asked = replace(tuning, gusts=gusts)
        seen = SEEN if gusts else [each._replace(gusts=()) for each in SEEN if len(each.gusts) != 1]
        (axes,) = tuning_figure(asked, seen).axes
        np.testing.assert_allclose(axes.lines[0].get_xdata(), np.degrees([0.02, 0.03, 0.03]))
        np.testing.assert_allclose(axes.lines[0].get_ydata(), heights)
        assert axes.get_xlabel() == "largest rms error of a case, dihedral deg"
        assert len(axes.lines) == (3 if asked.gusts else 2)
