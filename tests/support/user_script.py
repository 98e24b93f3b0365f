"""A user's script with every public name of `hfa`.

The script is checked by type checkers and is not run.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import hfa


def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the state derivatives and outputs of a cart with a damped pendulum."""
    rates = {"speed": (u.thrust - p.drag * x.speed**2 - w.gust) / p.mass, "angle": -x.angle}
    return rates, {"load": x.speed * ca.cos(x.angle)}


model: hfa.Model = hfa.Model(
    name="cart",
    states={
        "speed": hfa.Signal("m/s", nominal=10.0, min=1.0, max=99.0, start=10.0),
        "angle": hfa.Signal("rad"),
    },
    inputs={"thrust": hfa.Signal("N", nominal=10.0, min=0.0, max=1e4)},
    equations=equations,
    parameters={"mass": hfa.Signal("kg", 10.0, start=10.0), "drag": hfa.Signal(start=0.1)},
    disturbances={"gust": hfa.Signal("N")},
    outputs={"load": hfa.Signal("m/s")},
    trim={"speed": 10.0},
).with_parameters(mass=11)
for other in ("examples/uav.dml", "examples/navion.py:NAVION"):
    print(hfa.load_model(other).inputs["elevator"].max)
uav: hfa.Model = hfa.from_derivatives({"wing_area": 1.0, "thrust": [0.0, 10.0]})
flexible: hfa.Model = hfa.aircraft()

# Trims and linear models.
condition = hfa.TrimCondition(model, {**model.trim, "speed": 10.0})
point: hfa.OperatingPoint = hfa.trim(model, hold={"speed": 12})
thrust: float = point["thrust"] + point.inputs.thrust
linear: hfa.LinearModel = hfa.linearize(model, point)
eigenvalues: np.ndarray[Any, Any] = np.linalg.eigvals(linear.A)
names: list[str] = [mode.name for mode in linear.modes]
print(linear.select(["speed"], ["thrust"]).step(), linear.bode(inputs=["thrust"]))
sweep = hfa.sweep(model, {"speed": np.linspace(10.0, 12.0, 3)})
length: int = len(sweep)
point.report().save(Path("point.json"))
print(hfa.trim(model), hfa.solve, hfa.verify, hfa.optimize, hfa.prove_solution, hfa.prove_region)

# Games and critics: matrices are arrays or lists.
game: hfa.Game = hfa.game(linear, [1.0, 2.0], [[3.0]], delta=30.0)
game = hfa.game(linear, {"speed": 1.0}, {"thrust": 2.0})
game = hfa.Game([[1.0]], np.eye(1), [[1.0]], [1.0], [1.0], delta=2.0)
solution: hfa.Solution = hfa.solve(game)
expansion: hfa.Expansion = hfa.expand(linear, solution, order=2)
print(hfa.track(linear, solution, {"dihedral": 0.1, "speed": "2sin(0.5t)"}).reachable)
print(hfa.lqr([[1.0]], [[1.0]], [1.0], [3.0]).delta_min, hfa.prove_critic)
print(hfa.margins(linear, solution.K)["thrust"].phase, hfa.LinearModel.of([[1.0]], [[1.0]]).B)
run = hfa.learn(game, "normalized", 0)
critic: hfa.Critic = hfa.from_weights(game, run.weights[-1], run.basis)
for critic in (
    hfa.from_gain(game, [[1.0]]),
    hfa.from_value(game, solution.P),
    hfa.from_network(game, "critic.onnx"),
    hfa.read_critic("K.npz", game),
):
    verdict: hfa.Verdict = hfa.verify(game, critic)
    if not verdict.ok:
        print(verdict.report().text())

# Flights.
turbulence: hfa.Turbulence = hfa.Turbulence("light", 1000.0)
flight: hfa.Flight = hfa.fly(model, point, [[1.0, 2.0]], 10.0)
figure = flight.plot()
best: hfa.BestFlight = hfa.optimize(model, point, {"speed": 1.0}, Q=[1.0, 1.0], R=[1.0])
seconds: float = hfa.optimize(model, point, {"speed": 1.0}, minimize="time").seconds
found = hfa.identify(model, "record.csv", free=["mass"])
deployment = hfa.Deployment(
    policy={"file": solution.K},
    observation={"speed": {}},
    action={"thrust": {"box": [-1, 1], "map": "trim + a"}},
    timing={"dt": 0.02},
)
assessment: hfa.Assessment = hfa.assess(model, deployment, samples=10)
environment = hfa.environment(model, deployment, turbulence=turbulence)
environments = hfa.vector_environment(model, deployment, count=8)
paper_game: hfa.Game = hfa.paper.published_game(hfa.paper.level_model(flexible, 0.26))
try:
    hfa.trim(model, hold={"speed": 1e9})
except hfa.NoSolutionError as error:
    print(error)
except hfa.BadInputError as error:
    print(error)
