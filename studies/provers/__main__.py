"""Sets that the two provers of `hfa prove region` prove for the same loops in the same time.

The loops are the paper's aircraft at 10 deg, the GTM and two statically unstable flying wings, each
with the gain of its exact game. The study takes ten minutes.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import hfa
from hfa_prove.problem import loop_at
from hfa_prove.search.region import PROVERS, proved_region
from hfa_prove.search.region_search import RegionProblem
from hfa_prove.statements.loop import Gain
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from studies.provers.aircraft import LARGE, SMALL


def _paper() -> RegionProblem:
    point = hfa.trim(hfa.aircraft(), hfa.paper.level_flight(math.radians(10.0)))
    linear = point.linearize()
    return _problem(linear, hfa.solve(hfa.paper.published_game(linear)))


def _lqr(model: hfa.Model) -> RegionProblem:
    """Return the loop of an aircraft with the LQR of the weights 1/nominal²."""
    linear = hfa.trim(model).linearize()
    Q = [model.signals[name].nominal ** -2 for name in linear.states]
    R = [model.signals[name].nominal ** -2 for name in linear.inputs]
    return _problem(linear, hfa.solve(hfa.game(linear, Q, R)))


def _problem(linear: hfa.LinearModel, solution: Any) -> RegionProblem:
    return RegionProblem(loop_at(linear, Gain(solution.K)), [("P of the game", solution.P)])


LOOPS: Mapping[str, Callable[[], RegionProblem]] = {
    "flexible aircraft, 10 deg": _paper,
    "GTM": lambda: _lqr(hfa.load_model("examples/gtm.py:GTM")),
    "small flying wing": lambda: _lqr(SMALL),
    "large flying wing": lambda: _lqr(LARGE),
}


def row(name: str, seconds: float) -> tuple[str, ...]:
    """Return a row of the table: the size of the set of each prover, and its processor time.

    name: name of the loop in `LOOPS`
    seconds: limit of the processor time of each prover, s
    """
    problem = LOOPS[name]()
    cells = [name]
    for prover in PROVERS:
        begin = time.process_time()
        try:
            size = f"{proved_region(problem, (prover,), degree=2, seconds=seconds).set.size:.4g}"
        except NoSolutionError as error:
            size = str(error)
        cells += [size, f"{time.process_time() - begin:.0f} s"]
    return tuple(cells)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study and print the table."""
    parser = argparse.ArgumentParser("python -m studies.provers", description=__doc__)
    parser.add_argument("--loop", action="append", choices=list(LOOPS), metavar="NAME")
    parser.add_argument("--seconds", type=float, default=60.0, metavar="S")
    options = parser.parse_args(argv)
    rows = [row(name, options.seconds) for name in options.loop or LOOPS]
    heading = ("loop", *(f"{name}{what}" for name in PROVERS for what in (", size", ", time")))
    print(Report("Regions of attraction by both provers", (Table(heading, rows),)).text())
    return 0


if __name__ == "__main__":
    sys.exit(main())
