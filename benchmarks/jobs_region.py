"""The proved region of attraction of the GTM, within the limits of the model."""

from __future__ import annotations

import contextlib
import io
import time
from pathlib import Path

from benchmarks.report import Comparison, Row
from hfa.main import main

#: Seconds that are asked for.
_GOAL = 30.0


def _gtm_region(quick: bool) -> list[Row]:
    """Time the command once, with its report."""
    name = "pendulum.py:VAN_DER_POL" if quick else "gtm.py:GTM"
    aircraft = Path(__file__).parents[1] / "examples" / name
    start = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()):
        assert main(["prove", "region", "--aircraft", str(aircraft)]) == 0
    seconds = time.perf_counter() - start
    timing = Comparison(seconds, _GOAL, _GOAL / seconds)
    return [Row("proved region of the GTM", "a goal of 30 s", timing, 1.0)]


JOBS = {"gtm_region": _gtm_region}
