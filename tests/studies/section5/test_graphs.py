"""The histories of a critic's weights: the largest by name, the others as one bundle, nothing left out."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from controller import basis
from studies.section5.graphs import increments_panel, weights_panel


def test_the_largest_weights_are_named_and_none_is_lost() -> None:
    functions = basis("quadratic", 3)  # z1 z1, z1 z2, z1 z3, z2 z2, z2 z3, z3 z3
    times, ends = np.linspace(0.0, 1.0, 5), np.array([0.1, -9.0, 3.0, 4.0, 0.2, -5.0])
    critic = SimpleNamespace(basis=functions, weights=np.outer(times, ends))
    record = SimpleNamespace(critic=critic, times=times)
    panel = weights_panel("case", record, 10.0)  # type: ignore[arg-type]
    assert [line.label for line in panel.lines] == ["the other 2", "z1 z2", "z1 z3", "z2^2", "z3^2"]
    others, *named = panel.lines
    np.testing.assert_array_equal(others.y[-1], [0.1, 0.2])
    np.testing.assert_array_equal([line.y[-1] for line in named], [-9.0, 3.0, 4.0, -5.0])
    steps = increments_panel("case", record, 10.0)  # type: ignore[arg-type]
    assert [line.label for line in steps.lines] == [line.label for line in panel.lines]
    np.testing.assert_allclose(steps.lines[1].y, -9.0 / 4)
