"""Comparison of each construct between this project's reader and JSBSim."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jsbsim_reference import responses

from constructs.airframe import CONSTRUCTS as AIRFRAME
from constructs.control import CONSTRUCTS as CONTROL
from constructs.functions import CONSTRUCTS as FUNCTIONS
from constructs.jet import jet
from constructs.named import CONSTRUCTS as NAMED
from hfa_aircraft.model import Model
from hfa_jsbsim.reader import read_model
from hfa_support.errors import BadInputError

ALL = {
    f"{kind}: {name}": slots
    for kind, constructs in (
        ("airframe", AIRFRAME),
        ("control", CONTROL),
        ("functions", FUNCTIONS),
        ("properties", NAMED),
    )
    for name, slots in constructs.items()
}
#: Tolerance relative to 1 g and 1 rad/s², or to JSBSim's acceleration if this is larger.
TOLERANCE = 1e-9
#: Tolerance for engines that burn fuel, because JSBSim computes the inertia of the tanks about the
#: center of gravity of the previous step.
_BURNING = 1e-6
#: Seconds in which JSBSim settles.
_SECONDS = 8


@dataclass(frozen=True)
class Judgement:
    """Result of the comparison of one construct.

    verdict: "agrees", "refused", "noted", "silent", "looser" (accepted here, refused by JSBSim) or
      "traceback"
    why: the message, the notes or the difference
    """

    name: str
    verdict: str
    why: str


def compare_constructs(names, folder):
    """Return the results of comparing constructs with JSBSim, each at two random states.

    JSBSim does not evaluate a construct that is refused: it may never end.

    names: names of the constructs
    folder: folder into which the files of the constructs are written
    """
    models = {name: _model(folder, f"c{i}", ALL[name]) for i, name in enumerate(names)}
    read = [name for name, model in models.items() if isinstance(model, Model)]
    points = {name: _points(name, names.index(name)) for name in read}
    items = [
        {"aircraft": f"c{names.index(name)}", "root": str(folder), "point": point}
        for name in read
        for point in points[name]
    ]
    answers = iter(responses(items))
    pairs = {name: [(point, next(answers)) for point in points[name]] for name in read}
    return [_comparison(name, models[name], pairs.get(name, [])) for name in names]


def _points(name, seed):
    """Return two requests to JSBSim for a construct."""
    rng = np.random.default_rng(seed)
    return [_point(rng) | {"burn": "rocket" in name} for _ in range(2)]


def _model(folder, key, slots):
    """Return the model of a construct, or the reason why the file is not read."""
    path = folder / "aircraft" / key / f"{key}.xml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(jet(slots))
    try:
        return read_model(str(path))
    except BadInputError as error:
        return str(error)
    except Exception as error:  # a bug of the reader is a verdict here
        return f"TRACEBACK {type(error).__name__}: {error}"


def _point(rng):
    """Return a request to JSBSim: a random state with random commands."""
    state = {
        "altitude": rng.uniform(2000.0, 9000.0),
        "speed": rng.uniform(250.0, 400.0),
        "alpha": rng.uniform(0.02, 0.15),
        "beta": rng.uniform(-0.1, 0.1),
        "roll": rng.uniform(-0.6, 0.6),
        "pitch": rng.uniform(-0.3, 0.3),
        "yaw": rng.uniform(0.1, 1.0),
    }
    for name in ("roll_rate", "pitch_rate", "yaw_rate"):
        state[name] = rng.uniform(-0.1, 0.1)
    commands = {name: rng.uniform(-0.8, 0.8) for name in ("aileron", "elevator", "rudder")}
    commands |= {"throttle": rng.uniform(0.2, 1.0), "flap": rng.uniform(0.2, 1.0)}
    return {"state": state, "commands": commands, "settle": _SECONDS}


def _comparison(name, model, pairs):
    """Return the result of comparing one construct with JSBSim."""
    if isinstance(model, str):
        verdict = "traceback" if model.startswith("TRACEBACK") else "refused"
        return Judgement(name, verdict, model)
    refusals = [answer for _, answer in pairs if answer is None or "error" in answer]
    if refusals:
        return Judgement(name, "looser", f"JSBSim: {refusals[0]}")
    try:
        miss = max(difference(model, point, answer) for point, answer in pairs)
    except FloatingPointError as error:
        return Judgement(name, "silent", f"no number: {error}")
    if miss < (_BURNING if pairs[0][0]["burn"] else TOLERANCE):
        return Judgement(name, "agrees", f"{miss:.0e}")
    notes = [note for note in model.about.notes if not note.startswith("omitted")]
    if notes:
        return Judgement(name, "noted", f"{miss:.0e} {'; '.join(notes)}")
    return Judgement(name, "silent", f"{miss:.0e}")


def ours_at(model, point, answer):
    """Return states, rates and outputs of the model, by name, where JSBSim answered."""
    state = {name: answer.get(f"state.{name}", answer.get(name, 0.0)) for name in model.states}
    measured = {name for name, signal in model.inputs.items() if signal.unit == "rad"}
    if any("the input is the throttle position" in note for note in model.about.notes):
        measured |= {"throttle"}
    commands = point["commands"] | {name: answer[name] for name in measured}
    x = [state[name] for name in model.states]
    u = [commands.get(name, 0.0) for name in model.inputs]
    levers = {name: commands[name] for name in model.parameters if name in commands}
    tanks = [name for name in model.parameters if name.startswith("tank") and name in answer]
    levers |= {name: answer[name] for name in tanks}
    flown = model.with_parameters(gravity=answer["gravity"], **levers)
    if "c" in state:  # an integral: that with JSBSim's roll acceleration
        at = [flown.rates_at([*x[:-1], end], u)["roll_rate"] for end in (0.0, 1e-3)]
        x[-1] = 1e-3 * (answer["pdot"] - at[0]) / (at[1] - at[0] or 1.0)
    return state, flown.rates_at(x, u), flown.outputs_at(x, u)


def difference(model, point, answer):
    """Return the largest relative difference between the accelerations of the model and of JSBSim.

    A difference is relative to 32 ft/s² or 1 rad/s², or to JSBSim's acceleration if this is larger.
    Raises FloatingPointError if the result is not finite.

    point: state and commands
    answer: JSBSim's response
    """
    state, rates, _ = ours_at(model, point, answer)
    speed, alpha, beta = (state[name] for name in ("speed", "alpha", "beta"))
    along = np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    acceleration = np.array([answer["udot"], answer["vdot"], answer["wdot"]])
    u_speed, v_speed, w_speed = speed * along
    speed_rate = along @ acceleration
    in_plane = u_speed**2 + w_speed**2
    alpha_rate = (u_speed * acceleration[2] - w_speed * acceleration[0]) / in_plane
    beta_rate = (speed * acceleration[1] - v_speed * speed_rate) / (speed * np.sqrt(in_plane))
    linear = [
        rates["speed"] - speed_rate,
        speed * (rates["alpha"] - alpha_rate),
        speed * (rates["beta"] - beta_rate),
    ]
    rotation = np.array([answer["pdot"], answer["qdot"], answer["rdot"]])
    own = np.array([rates[axis] for axis in ("roll_rate", "pitch_rate", "yaw_rate")])
    misses = (
        np.abs(linear).max() / max(32.0, np.abs(acceleration).max()),
        np.abs(own - rotation).max() / max(1.0, np.abs(rotation).max()),
    )
    miss = np.max(misses)  # nan if one of them is
    if not np.isfinite(miss):
        raise FloatingPointError(f"{rates}, JSBSim {answer}")
    return float(miss)
