"""A sweep of the 737 of JSBSim against python-control's `find_operating_point` on the same compiled
equations. Without JSBSim's data there are no figures."""

from __future__ import annotations

import importlib.util
from functools import partial

import numpy as np

from benchmarks.jobs_models import f16_peer
from benchmarks.report import Row, in_turn
from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from trim.point.condition import release, usual_condition
from trim.sweeps.points import TRIMMED, trim_points


def rows(quick: bool = False) -> list[Row]:
    """Trims and linear models over airspeed and altitude, without and with a compiler."""
    if importlib.util.find_spec("jsbsim") is None:
        return []
    model = load_model("jsbsim:737")
    side, peer_count = (10, 2) if quick else (100, 50)
    speeds, altitudes = np.meshgrid(np.linspace(220.0, 320.0, side), np.linspace(5e3, 25e3, side))
    grid = np.column_stack([speeds.ravel(), altitudes.ravel()])
    held = {"speed": 500.0, "altitude": 15000.0}
    peer = f16_peer(release(usual_condition(model), hold=held))
    peer_speeds = np.linspace(460.0, 640.0, peer_count)
    comparisons = []
    for compiled in (False, True):
        timing = in_turn(
            partial(_sweep, model, grid, compiled),
            partial(peer, "speed", peer_speeds),
            len(grid),
            peer_count,
            repeats=1 if quick else 3,
        )
        job = f"{len(grid)} points of the 737 of JSBSim, kcas x altitude"
        how = "generated C" if compiled else "no compiler"
        by = "python-control (hybr, from the neighbour) + linearize"
        comparisons.append(Row(f"{job}, {how}", by, timing, 100.0))
    return comparisons


def _sweep(model: Model, grid: np.ndarray, compiled: bool) -> None:
    """Trim and linearize all points."""
    points = trim_points(model, ("kcas", "altitude"), grid, compile_code=compiled)
    assert (points.status == TRIMMED).all()
