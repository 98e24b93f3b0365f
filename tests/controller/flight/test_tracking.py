"""How fast the surfaces move in a flight."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from controller.flight.tracking import fastest_inputs


def test_the_fastest_step_is_per_second() -> None:
    inputs = np.array([[0.0, 1.0], [0.1, 1.0], [0.4, 1.0], [0.2, 1.0]])
    flight = SimpleNamespace(times=0.01 * np.arange(4), inputs=inputs)
    np.testing.assert_allclose(fastest_inputs(flight), [30.0, 0.0])  # type: ignore[arg-type]
    two = SimpleNamespace(times=0.01 * np.arange(2), inputs=inputs[:2])
    np.testing.assert_allclose(fastest_inputs(two), [10.0, 0.0])  # type: ignore[arg-type]
    alone = SimpleNamespace(times=np.zeros(1), inputs=inputs[:1])
    assert fastest_inputs(alone).tolist() == [0.0, 0.0]  # type: ignore[arg-type]
