"""Ctrl-C while SciPy or CasADi calls Python: it ends the run, and no library adds a word."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable
from types import CodeType, FrameType

import casadi
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

from controller import Game
from controller.riccati.smallest_delta import has_value
from hfa_model import Aircraft
from hfa_support.jobs.interrupts import ended_by_signals
from trim import find_operating_point, identify, load_condition

_LIBRARIES = tuple(module.__file__.rpartition("/")[0] for module in (scipy, casadi))
WORK: dict[str, Callable[[Aircraft, Game], object]] = {
    "ordered Schur form": lambda _, game: has_value(game),
    "array for CasADi": lambda *_: casadi.DM(np.eye(2)),
    "least effort": lambda aircraft, _: find_operating_point(aircraft, load_condition("simvfa-64").at(0.2)),
    "identification": lambda *_: identify(),
}


def interrupted(work: Callable[[], object], seen: set[CodeType]) -> bool:
    """Ctrl-C where a library calls a Python function that is not among those seen; whether there was one."""
    came = False

    def trace(frame: FrameType, *_: object) -> None:
        nonlocal came
        if came or frame.f_code in seen or frame.f_back is None:
            return
        if frame.f_back.f_code.co_filename.startswith(_LIBRARIES):
            came = True
            seen.add(frame.f_code)
            signal.raise_signal(signal.SIGINT)

    try:
        with ended_by_signals():
            sys.settrace(trace)
            work()
            time.sleep(came)  # what Python only prints, or CasADi drops, is given again soon
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(None)
    assert not came, f"Ctrl-C was lost in the last of {len(seen)} functions"
    return False


_LONG = ("least effort", "identification")  # hundreds of functions


@pytest.mark.parametrize("name", [pytest.param(each, marks=[pytest.mark.slow] * (each in _LONG)) for each in WORK])
def test_a_signal_in_a_function_that_a_library_calls_ends_the_run_without_a_word(
    name: str, published_aircraft: Aircraft, game: Game, capfd: pytest.CaptureFixture[str]
) -> None:
    seen = set[CodeType]()
    while interrupted(lambda: WORK[name](published_aircraft, game), seen):
        assert capfd.readouterr() == ("", "")
    assert seen
