"""A sweep of trims of JSBSim's 737, and the environment of the c172p.

The sweep is compared with python-control's `find_operating_point` on the same compiled equations.
The environment is compared with frames simulated by JSBSim. Without the package jsbsim there are no
figures.
"""

from __future__ import annotations

import importlib.util
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.jobs_models import evaluations, f16_peer
from benchmarks.report import Limit, Row, in_turn, shortest
from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from hfa_flight.held_step import parts_of_a_sample, step_of_integration
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_policy.episodes import Episodes
from hfa_policy.gymnasium_environment import AircraftEnvironment
from hfa_support.native.row_code import row_code
from trim.point.condition import release, usual_condition
from trim.point.solve import trim
from trim.sweeps.points import TRIMMED, trim_points

#: JSBSim's frames per second.
_RATE = 120.0
#: Timed episodes of a single environment, which take as long as JSBSim's run. The first hundred
#: steps after the work of another program take half as long again.
_EPISODES = 20
#: Rows of a timed call, so many that the overhead of the call is negligible.
_ROWS = 256


def _sweeps(quick: bool) -> list[Row]:
    """Return comparisons of trims and linear models of the 737 over airspeed and altitude."""
    if importlib.util.find_spec("jsbsim") is None:
        return []
    model = load_model("jsbsim:737")
    side, peer_count = (10, 2) if quick else (100, 50)
    speeds, altitudes = np.meshgrid(np.linspace(220.0, 320.0, side), np.linspace(5e3, 25e3, side))
    grid = np.column_stack([speeds.ravel(), altitudes.ravel()])
    held = {"speed": 500.0, "altitude": 15000.0}
    condition = release(usual_condition(model), hold=held)
    peer = f16_peer(condition)
    peer_speeds = np.linspace(460.0, 640.0, peer_count).tolist()
    timing = in_turn(
        partial(_sweep, model, grid),
        partial(peer, "speed", peer_speeds),
        len(grid),
        peer_count,
        repeats=1 if quick else 3,
    )
    flights = np.column_stack([np.linspace(460.0, 640.0, len(grid)), grid[:, 1]])
    limit = evaluations(model, ("speed", "altitude"), flights, condition)
    job = f"{len(grid)} points of the 737 of JSBSim, kcas x altitude"
    by = "python-control (hybr, from the neighbour) + linearize"
    return [Row(job, by, timing, 20.0, limit=limit)]


def _environments(quick: bool) -> list[Row]:
    """Return comparisons of environments of the c172p with JSBSim, or an empty list."""
    if importlib.util.find_spec("jsbsim") is None:
        return []
    cases = ((1, 256, 3.0), (6, 256, 3.0), (1, 1, 1.0), (6, 1, 2.0))
    return [_environment(frames, count, target, quick) for frames, count, target in cases]


def _environment(frames: int, count: int, target: float, quick: bool) -> Row:
    """Return the comparison of environments of the c172p, under random actions, with JSBSim."""
    import jsbsim

    dt = frames / _RATE
    deployment = Deployment(
        policy={},
        observation={"speed": {}, "alpha": {}, "pitch_rate": {}, "pitch": {}},
        action={"elevator": {"box": [-0.1, 0.1]}},
        timing={"dt": dt},
    )
    model = load_model("jsbsim:c172p")
    steps = 5 if quick else 100
    point = trim(model, usual_condition(model))
    episodes = Episodes(Deployed(deployment, model), [point], count)
    one = AircraftEnvironment(Episodes(Deployed(deployment, model), [point], 1))
    random = np.random.default_rng(0)
    numbers = np.arange(count)
    actions = random.uniform(-0.1, 0.1, (count, 1))
    simulator = jsbsim.FGFDMExec(str(Path(jsbsim.__file__).parent))
    simulator.set_debug_level(0)
    simulator.load_model("c172p")
    simulator.set_dt(1.0 / _RATE)
    for name, value in {"h-sl-ft": 5000.0, "vc-kts": 80.0}.items():
        simulator[f"ic/{name}"] = value
    simulator.run_ic()

    def of_one() -> None:
        for _ in range(_EPISODES):
            one.reset()
            for _ in range(steps):
                one.step(actions[0])

    def of_many() -> None:
        episodes.begin(numbers, random)
        for _ in range(steps):
            episodes.step(actions)

    def peer() -> None:
        simulator.reset_to_initial_conditions(0)
        for _ in range(20 * steps * frames):
            simulator.run()

    repeats = 1 if quick else 5
    if count == 1:
        timing = in_turn(of_one, peer, _EPISODES * steps, 20 * steps, repeats=repeats)
    else:
        timing = in_turn(of_many, peer, count * steps, 20 * steps, repeats=repeats)
    function = step_of_integration(model.layout, model.linear).find_function("rate")
    rate = row_code(function, one_row=count == 1)
    still = np.zeros(len(model.linear))
    row = np.concatenate([point.states, point.inputs, still, model.p])
    table = np.tile(row, (_ROWS, 1))
    evaluated = 4 * parts_of_a_sample([point], dt)
    limit = Limit(
        evaluated * shortest(partial(rate, table), _ROWS), f"{evaluated} evaluations of the rates"
    )
    each = f"each of {count} environments" if count > 1 else "one environment"
    job = f"a step of {1e3 * dt:.3g} ms of {each} of the c172p"
    return Row(job, f"FGFDMExec.run of JSBSim, {frames} a step", timing, target, limit=limit)


def _sweep(model: Model, grid: np.ndarray) -> None:
    """Trim and linearize a model at all points, and assert that each point is trimmed."""
    points = trim_points(model, ("kcas", "altitude"), grid)
    assert (points.status == TRIMMED).all()


JOBS = {"737": _sweeps, "environments": _environments}
