"""The stated error of the integration; extensions/flight/tests compares flights with references."""

import numpy as np
import pytest

import hfa
from hfa import Model, Signal
from hfa_flight import Scenario

pytestmark = pytest.mark.usefixtures("flights")


@pytest.fixture
def flights():
    pytest.importorskip("hfa_flight")


def test_the_stated_change_is_that_with_half_the_step():
    """A flight of a large swing with steps of 0.2 s, compared with its flight in half steps."""
    swing = Model(
        "swing",
        {"a": Signal(), "b": Signal()},
        {"u": Signal()},
        lambda x, u, p, w: ({"a": x.b, "b": -4.0 * x.a - x.a * x.a * x.a + u.u}, {}),
        trim={"a": 0.0, "b": 0.0},
    )
    point = hfa.trim(swing)

    def flown(step):
        scenario = Scenario(4.0, step=step, tick=0.2, initial=np.array([1.5, 0.0]))
        return hfa.fly(swing, point, None, scenario=scenario)

    coarse = flown(0.2)
    used = coarse.integration.step
    fine = flown(used / 2.0)
    kept = flown(used)
    changes = []
    for name, after in fine.largest_deviation.items():
        changes.append(abs(after - kept.largest_deviation[name]) / after)
    assert used < 0.2
    assert coarse.integration.change == pytest.approx(max(changes), rel=1e-6)
