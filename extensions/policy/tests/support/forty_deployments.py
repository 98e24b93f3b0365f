"""Forty deployments of exact gains on five aircraft: twenty right ones, twenty with one mistake."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

import hfa
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_policy.assessor import Assessor

EXAMPLES = Path(__file__).resolve().parents[4] / "examples"
DT = 0.01
#: Name of an aircraft -> its model and the value of its scheduling variable, or None.
AIRCRAFT: dict[str, tuple[Callable[[], hfa.Model], float | None]] = {
    "hfa": (hfa.aircraft, np.radians(10.0)),
    "newton": (lambda: hfa.aircraft("newton"), np.radians(15.0)),
    "gtm": (lambda: hfa.load_model(f"{EXAMPLES / 'gtm.py'}:GTM"), 45.0),
    "uav": (lambda: hfa.load_model(f"{EXAMPLES / 'uav.toml'}"), None),
    "f16": (lambda: hfa.load_model(f"{EXAMPLES / 'f16_constant.py'}:F16"), 502.0),
}
#: Mistakes of each aircraft's four wrong deployments.
MISTAKES = {
    "hfa": ("degrees", "observations exchanged", "reversed", "wrong sample time"),
    "newton": ("no normalizer", "absolute", "scale twice", "order of the file"),
    "gtm": ("degrees", "reversed", "actions exchanged", "degrees of the file"),
    "uav": ("absolute", "reversed", "scale twice", "observations exchanged"),
    "f16": ("no normalizer", "degrees", "action in degrees", "wrong sample time"),
}
#: Mistake -> kind of the deployment in which it is made, by default "file".
_RIGHT_OF = {
    "degrees": "normalizer",
    "observations exchanged": "normalizer",
    "no normalizer": "normalizer",
    "absolute": "normalizer",
    "reversed": "box",
    "scale twice": "box",
    "actions exchanged": "box",
    "action in degrees": "box",
}
RIGHT = ("gain", "normalizer", "box", "file")


class Trimmed(NamedTuple):
    """An aircraft at a trim, its exact gain, and the spread of its states in training.

    K: (m, k), of u = -K x for the weights 1/nominal²
    sizes: size of an action, (m,)
    """

    model: hfa.Model
    point: hfa.OperatingPoint
    K: np.ndarray
    sizes: np.ndarray


@cache
def trimmed(name: str) -> Trimmed:
    """Return an aircraft at its trim."""
    make, value = AIRCRAFT[name]
    model = make()
    point = hfa.trim(model) if value is None else hfa.trim(model, at=value)
    linear = hfa.linearize(model, point)
    Q = {state: model.states[state].nominal ** -2.0 for state in linear.states}
    R = {signal: model.inputs[signal].nominal ** -2.0 for signal in linear.inputs}
    K = hfa.solve(hfa.game(linear, Q, R)).K
    sizes = np.array([0.5 * signal.nominal for signal in model.inputs.values()])
    return Trimmed(model, point, np.asarray(K), sizes)


@cache
def spread_in_training(name: str) -> np.ndarray:
    """Return the standard deviations of the linear states in training, (k,).

    They are a quarter of the ranges in flights with the exact gain.
    """
    given = trimmed(name)
    deployed = Deployed(deployment(name, "gain", Path()), given.model)
    (point,) = Assessor(deployed, (given.point,), samples=1).assessed()
    return np.array([(each.highest - each.lowest) / 4.0 for each in point.observations])


def deployment(name: str, kind: str, folder: Path) -> Deployment:
    """Return a right deployment of one kind: gain, normalizer, box or file."""
    given = trimmed(name)
    model = given.model
    o = ca.SX.sym("o", given.K.shape[1])
    K = given.K
    observation: dict[str, Any] = {state: {} for state in model.linear}
    action: dict[str, Any] = {signal: {} for signal in model.inputs}
    policy: dict[str, Any] = {}
    if kind == "normalizer":
        spread = spread_in_training(name)
        K = given.K * spread
        policy["normalizer"] = {
            "mean": [0.0] * len(spread),
            "variance": (spread**2).tolist(),
            "epsilon": 1e-12,
        }
    if kind == "box":
        K = given.K / given.sizes[:, None]
        action = {
            signal: {"box": [-1000.0, 1000.0], "map": f"trim + {float(size)!r} * a"}
            for signal, size in zip(model.inputs, given.sizes, strict=True)
        }
    if kind == "file":
        path = folder / f"{name}.npz"
        units = [model.unit(state) for state in model.linear]
        names = {"states": model.linear, "inputs": tuple(model.inputs), "state_units": units}
        np.savez(path, K=K, dt=DT, **names)
        policy["file"] = str(path)
    else:
        policy["file"] = ca.Function("gain", [o], [-ca.DM(K) @ o])
    return Deployment(policy, observation, action, {"dt": DT})


def mistaken(name: str, mistake: str, folder: Path) -> Deployment:
    """Return a deployment with one mistake."""
    model = trimmed(name).model
    right = deployment(name, _RIGHT_OF.get(mistake, "file"), folder)
    observation, action = dict(right.observation), dict(right.action)
    angle = next(state for state in model.linear if model.unit(state) == "rad")
    first, second = [*action][:2] if len(action) > 1 else (next(iter(action)),) * 2
    if mistake in ("degrees", "degrees of the file"):
        observation[angle] = {"scale": float(np.radians(1.0))}
        return right.changed(observation=observation)
    if mistake in ("observations exchanged", "order of the file"):
        names = [*observation]
        place = names.index(angle)
        names[0], names[place] = names[place], names[0]
        return right.changed(observation={each: observation[each] for each in names})
    if mistake == "no normalizer":
        policy = {key: entry for key, entry in right.policy.items() if key != "normalizer"}
        return right.changed(policy=policy)
    if mistake == "absolute":
        far = max(model.linear, key=lambda state: abs(trimmed(name).point[state]))
        return right.changed(observation={**observation, far: {"about": 0.0}})
    if mistake == "reversed":
        turned = action[second]["map"].replace("+", "-")
        return right.changed(action={**action, second: {**action[second], "map": turned}})
    if mistake == "scale twice":
        factor = float(trimmed(name).sizes[1])
        twice = f"{action[second]['map']} * {factor!r}"
        return right.changed(action={**action, second: {**action[second], "map": twice}})
    if mistake == "action in degrees":
        map_ = f"{action[first]['map']} * {float(np.degrees(1.0))!r}"
        return right.changed(action={**action, first: {**action[first], "map": map_}})
    if mistake == "actions exchanged":
        names = [second, first, *[*action][2:]]
        return right.changed(action={each: action[each] for each in names})
    assert mistake == "wrong sample time"
    return right.changed(timing={"dt": 5.0 * DT})
