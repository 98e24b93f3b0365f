"""Code for the vector unit: the same numbers, at any count of points, and none without a compiler."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from hfa_support.native import machine_code as generated
from hfa_support.native.vector_code import _machine, vector_code

pytestmark = pytest.mark.skipif(generated.c_compiler() is None, reason="no C compiler on this machine")


def some_function() -> ca.Function:
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 2)
    parts = [ca.sin(x[0]) * ca.cos(x[0]), ca.atan2(x[1], p[0]), ca.fmin(x[0], p[1]), ca.fmax(x[1], 0), ca.exp(x[0])]
    return ca.Function("some", [x, p], [ca.vertcat(*parts, x[0] ** 2.5 / p[0])])


@pytest.mark.parametrize("count", [0, 1, 7, 256, 1000])
def test_every_row_is_that_of_the_function(count: int) -> None:
    run = vector_code(some_function())
    assert run is not None
    random = np.random.default_rng(count)
    x, p = random.uniform(0.1, 2.0, (count, 2)), random.uniform(0.5, 2.0, (count, 2))
    known = np.array([np.array(some_function()(*row)).ravel() for row in zip(x, p, strict=True)]).reshape(count, 6)
    np.testing.assert_allclose(run(x, p), known, rtol=1e-14, atol=1e-15)


def test_what_is_not_finite_stays_so() -> None:
    run = vector_code(some_function())
    assert run is not None
    assert np.isnan(run(np.array([[np.nan, 1.0]]), np.ones((1, 2)))[0, 0])
    with pytest.raises(ValueError, match=r"some takes tables with \[2, 2\] columns"):
        run(np.ones((3, 1)), np.ones((3, 2)))


def test_without_a_compiler_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generated, "c_compiler", lambda: None)
    assert vector_code(some_function()) is None


def test_a_machine_is_its_processor_and_not_its_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of /proc/cpuinfo the models and flags count, not how fast a core runs now."""
    cpu = "processor : 0\nmodel name : A\ncpu MHz : 2000.1\nflags : avx2"
    texts = (cpu, cpu.replace("2000.1", "2100.7"), cpu.replace("avx2", "sse2"), cpu.replace(": A", ": B"))
    found = []
    for text in texts:
        monkeypatch.setattr(Path, "read_text", lambda *_, text=text, **__: text)
        found.append(_machine())
    assert found[0] == found[1]
    assert len(set(found)) == 3
