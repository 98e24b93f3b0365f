"""Evaluation of aircraft by JSBSim in a child process, because JSBSim can terminate Python.

This file as a program reads requests [{"aircraft": NAME, "point": {...}}, ...] as
JSON. It writes each of JSBSim's responses on its own line. Responses written before JSBSim
terminates the process are kept. The package jsbsim is required.
"""

import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

#: Radius of the earth, ft, and standard gravity at its surface, ft/s^2.
RADIUS = 20925646.32546
GRAVITY = 32.174049
_PLANET = """<planet name="Sphere">
 <semimajor_axis unit="FT">{radius!r}</semimajor_axis>
 <semiminor_axis unit="FT">{radius!r}</semiminor_axis>
 <rotation_rate unit="RAD/SEC">0</rotation_rate>
 <GM unit="FT3/SEC2">{pull!r}</GM>
 <J2>0</J2>
</planet>"""
#: State of a model -> JSBSim's initial condition. JSBSim requires this order: angles of flow before
#: angles of attitude.
_INITIAL = {
    "altitude": "ic/h-sl-ft",
    "speed": "ic/vt-fps",
    "alpha": "ic/alpha-rad",
    "beta": "ic/beta-rad",
    "roll": "ic/phi-rad",
    "pitch": "ic/theta-rad",
    "yaw": "ic/psi-true-rad",
    "roll_rate": "ic/p-rad_sec",
    "pitch_rate": "ic/q-rad_sec",
    "yaw_rate": "ic/r-rad_sec",
}
_STATE = {
    "altitude": "position/h-sl-ft",
    "speed": "velocities/vt-fps",
    "alpha": "aero/alpha-rad",
    "beta": "aero/beta-rad",
    "roll": "attitude/phi-rad",
    "pitch": "attitude/theta-rad",
    "yaw": "attitude/psi-rad",
    "roll_rate": "velocities/p-rad_sec",
    "pitch_rate": "velocities/q-rad_sec",
    "yaw_rate": "velocities/r-rad_sec",
}
_COMMANDS = {
    "aileron": "fcs/aileron-cmd-norm",
    "elevator": "fcs/elevator-cmd-norm",
    "rudder": "fcs/rudder-cmd-norm",
    "flap": "fcs/flap-cmd-norm",
    "gear": "gear/gear-cmd-norm",
}
#: Accelerations, ft/s^2 and rad/s^2.
AXES = ("udot", "vdot", "wdot", "pdot", "qdot", "rdot")
_MEASURED = {
    "udot": "accelerations/udot-ft_sec2",
    "vdot": "accelerations/vdot-ft_sec2",
    "wdot": "accelerations/wdot-ft_sec2",
    "pdot": "accelerations/pdot-rad_sec2",
    "qdot": "accelerations/qdot-rad_sec2",
    "rdot": "accelerations/rdot-rad_sec2",
    "gravity": "accelerations/gravity-ft_sec2",
    "kcas": "velocities/vc-kts",
    "elevator": "fcs/elevator-pos-rad",
    "left_aileron": "fcs/left-aileron-pos-rad",
    "aileron": "fcs/aileron-pos-rad",
    "rudder": "fcs/rudder-pos-rad",
    "throttle": "fcs/throttle-pos-norm",
    "weight": "inertia/weight-lbs",
    "fbx": "forces/fbx-aero-lbs",
    "fby": "forces/fby-aero-lbs",
    "fbz": "forces/fbz-aero-lbs",
    "l": "moments/l-aero-lbsft",
    "m": "moments/m-aero-lbsft",
    "n": "moments/n-aero-lbsft",
}
_INTEGRATORS = tuple(
    f"simulation/integrator/{kind}/{motion}"
    for kind in ("rate", "position")
    for motion in ("rotational", "translational")
)
#: JSBSim's steps per second, and longest settling time in s.
_RATE = 120
_LONGEST = 120
#: A quantity is steady if it changes by less than this in each of several seconds.
_STEADY = 1e-9
_LONG = 6
#: Number of steps after which earlier forces have no effect.
_STEPS = 10
#: Number of requests to one child process, and its time limit, s.
_BATCH = 10
_SECONDS_OF_CHILD = 20.0
#: Number of attempts for each request.
_TRIES = 5
_MOST_TANKS = 20
#: Step of a flight, s.
_FINE = 1e-3
#: Largest number of missing properties.
_MISSING = 200


def measured(name, points):
    """Return JSBSim's response at each point, or None for a point at which JSBSim fails.

    name: name of an aircraft of JSBSim
    points: {"state": {...}, "commands": {...}} with the names of a `Model`. "held" is
      {property: constant value}.
    """
    items = [{"aircraft": name, "point": point} for point in points]
    answers = responses(items)
    return [None if answer is None or "error" in answer else answer for answer in answers]


def responses(items):
    """Return JSBSim's response to each request, computed in child processes.

    The response is {"error": message} if JSBSim refuses the file, and None if JSBSim terminated or did
    not end. "root" in a request is a folder that contains the folder "aircraft", by default JSBSim's.

    items: requests {"aircraft": NAME, "point": {...}, "root": FOLDER}
    """
    answers = []
    while len(answers) < len(items):
        waiting = list(items)[len(answers) : len(answers) + _BATCH]
        new_answers = _request(waiting)
        answers += new_answers
        if len(new_answers) < len(waiting):
            answers.append(None)  # the request at which JSBSim terminated
    return answers


def _request(items):
    """Return the responses that one child process writes within the time limit."""
    command = [sys.executable, __file__]
    try:
        process = subprocess.run(
            command,
            input=json.dumps(items),
            capture_output=True,
            text=True,
            timeout=_SECONDS_OF_CHILD,
            check=False,
        )
        output = process.stdout
    except subprocess.TimeoutExpired as late:
        output = late.stdout or ""
    text = output.decode() if isinstance(output, bytes) else output
    return [json.loads(line) for line in text.splitlines() if line.startswith("{")]


def main():
    """Read the requests from standard input, write a response for each, and return 0."""
    items = json.load(sys.stdin)
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # JSBSim prints on standard output
    for item in items:
        answers.write(json.dumps(_response(item)) + "\n")
        answers.flush()
    return 0


def _response(item):
    """Return JSBSim's response to a request, or {"error": message}."""
    # A response with nan is computed again, because JSBSim's first step reads uninitialized memory
    # (fokker50).
    answer = {}
    for _ in range(_TRIES):
        try:
            answer = _found(item)
        except Exception as error:  # JSBSim raises its own exceptions
            return {"error": " ".join(str(error).split())[:200]}
        if not math.isnan(answer.get("udot", 0.0)):
            break
    return answer


def _found(item):
    """Return JSBSim's response to a request: a flight, or one fixed state."""
    point = item["point"]
    simulator = _simulator(item)
    for name in _missing(item["aircraft"], item.get("root")):
        simulator[name] = 0.0
    return _simulated(simulator, point) if "flight" in point else _settled(simulator, point)


@lru_cache
def _missing(aircraft, root):
    """Return the properties that JSBSim reports as missing when an aircraft is initialized."""
    # JSBSim reports each missing property by an exception. A separate simulator is used, because
    # the exceptions affect later results.
    simulator = _simulator({"aircraft": aircraft, "root": root, "point": {}})
    return _run(simulator.run_ic, simulator)


def _simulator(item):
    """Return a JSBSim simulator with the aircraft of a request."""
    import jsbsim

    name = item["aircraft"]
    held = item["point"].get("held", {})
    root = Path(item.get("root") or Path(jsbsim.__file__).parent)
    with tempfile.TemporaryDirectory() as folder:
        if held:
            root = _cut(root, name, held, Path(folder))
        simulator = jsbsim.FGFDMExec(str(root))
        simulator.set_debug_level(0)
        if "flight" in item["point"]:
            simulator.set_dt(
                item["point"].get("step", _FINE)
            )  # filters use the time step at which they are loaded
        planet = Path(folder) / "planet.xml"
        radius = item["point"].get("radius", RADIUS)
        planet.write_text(_PLANET.format(radius=radius, pull=GRAVITY * radius * radius))
        simulator.load_planet(str(planet), False)
        if not simulator.load_model(name):
            raise RuntimeError("JSBSim does not load it")
    simulator["simulation/gravity-model"] = 0
    return simulator


def _cut(root, name, held, folder):
    """Copy JSBSim's files of one aircraft to a folder, and return the folder of the copy."""
    copy = folder / "data"
    shutil.copytree(root / "aircraft" / name, copy / "aircraft" / name)
    shutil.copytree(root / "systems", copy / "systems")
    (copy / "engine").symlink_to(root / "engine")
    stems = "|".join(re.escape(full_name) for full_name in held)
    sets = re.compile(rf'(<output>\s*|name\s*=\s*")({stems})(\[0\])?(?=[\s<"])')
    for path in copy.rglob("*.xml"):
        text = path.read_bytes().decode("latin-1")
        path.write_bytes(sets.sub(r"\1cut/\2\3", text).encode("latin-1"))
    return copy


def _start(simulator, state, commands):
    """Set the state and the commands of the simulator, and start the engines."""
    wind = [commands.get(f"wind_{axis}", 0.0) for axis in ("north", "east", "down")]
    for name, full_name in _INITIAL.items():
        simulator[full_name] = state.get(name, 0.0)
    if any(wind):
        for name, value in zip(("u", "v", "w"), _over_ground(state, wind), strict=True):
            simulator[f"ic/{name}-fps"] = value
    _run(simulator.run_ic, simulator)
    for axis, value in zip(("north", "east", "down"), wind, strict=True):
        simulator[f"atmosphere/wind-{axis}-fps"] = value
    for name, full_name in _COMMANDS.items():
        simulator[full_name] = commands.get(name, 0.0)
    propulsion = simulator.get_propulsion()
    for number in range(propulsion.get_num_engines()):
        propulsion.get_engine(number).init_running()
        index = f"[{number}]" if number else ""
        own_throttle = commands.get(f"throttle{number}", commands.get("throttle", 0.0))
        simulator[f"fcs/throttle-cmd-norm{index}"] = own_throttle
        simulator[f"fcs/advance-cmd-norm{index}"] = commands.get("advance", 1.0)
        simulator[f"fcs/feather-cmd-norm{index}"] = commands.get(f"feather{number}", 0.0)
        simulator[f"fcs/mixture-cmd-norm{index}"] = (
            commands.get("mixture", 1.0) * simulator["atmosphere/delta"]
        )
    _load(simulator, commands)


def _fail(simulator, commands):
    """Stop the engines that the commands set to 0, after five simulated seconds."""
    out = [name for name, value in commands.items() if name.startswith("engine") and value == 0.0]
    for _ in range(5 * _RATE if out else 0):
        _run(simulator.run, simulator)
    for name in out:
        _stop(simulator, int(name.removeprefix("engine")))


def _stop(simulator, number):
    """Stop an engine by cutting its fuel and ignition."""
    index = f"[{number}]" if number else ""
    simulator["propulsion/active_engine"] = number
    for name, value in (("cutoff_cmd", 1), ("magneto_cmd", 0)):
        if simulator.query_property_catalog(f"propulsion/{name}"):
            simulator[f"propulsion/{name}"] = value
    simulator["propulsion/active_engine"] = -1
    simulator[f"propulsion/engine{index}/set-running"] = 0


def _over_ground(state, wind):
    """Return the velocity of the aircraft over ground in body axes, ft/s, (3,)."""
    roll, pitch, yaw, alpha, beta = (
        state.get(name, 0.0) for name in ("roll", "pitch", "yaw", "alpha", "beta")
    )
    north, east, down = wind
    along = math.cos(yaw) * north + math.sin(yaw) * east
    across = math.cos(yaw) * east - math.sin(yaw) * north
    forward = math.cos(pitch) * along - math.sin(pitch) * down
    below = math.sin(pitch) * along + math.cos(pitch) * down
    speed = state["speed"]
    return [
        speed * math.cos(alpha) * math.cos(beta) + forward,
        speed * math.sin(beta) + math.cos(roll) * across + math.sin(roll) * below,
        speed * math.sin(alpha) * math.cos(beta) - math.sin(roll) * across + math.cos(roll) * below,
    ]


def _load(simulator, commands):
    """Set the contents of tanks and the weights of point masses."""
    for name, value in commands.items():
        kind = name.rstrip("0123456789")
        index = name.removeprefix(kind)
        place = f"[{index}]" if index != "0" else ""
        if kind == "tank":
            simulator[f"propulsion/tank{place}/contents-lbs"] = value
        elif kind == "pointmass":
            simulator[f"inertia/pointmass-weight-lbs{place}"] = value


def _run(step, simulator):
    """Run a step of the simulation, and return the properties that JSBSim reports as missing."""
    names = []
    for _ in range(_MISSING):
        try:
            step()
        except Exception as error:  # JSBSim raises its own exceptions
            missing = re.search(r"The property (\S+) does not exist", str(error))
            if missing is None:
                raise
            simulator[missing[1]] = 0.0
            # An interrupted initialization leaves the time step at 0.
            simulator.set_dt(1.0 / _RATE)
            names.append(missing[1])
        else:
            return names
    raise RuntimeError("too many properties are missing")


def _settled(simulator, point):
    """Return JSBSim's measurements at a fixed state, after engines and actuators have settled."""
    _freeze_state(simulator)
    commands = point.get("commands", {})
    _start(simulator, point["state"], commands)
    for name, value in point.get("held", {}).items():
        simulator[name] = value
    simulator.set_trim_status(True)  # as in JSBSim's trims, actuators begin in equilibrium
    _run(simulator.run, simulator)
    simulator.set_trim_status(False)
    simulator["propulsion/fuel_freeze"] = 0 if point.get("burn") else 1
    _fail(simulator, commands)
    values = _unsettled(simulator)
    steady = 0
    for second in range(_LONGEST):
        for _ in range(_RATE):
            _run(simulator.run, simulator)
        before = values
        values = _unsettled(simulator)
        moved = max(abs(a - b) for a, b in zip(before, values, strict=True))
        steady = steady + 1 if moved < _STEADY else 0
        if second >= point.get("settle", 20) and steady >= _LONG:
            break
    for _ in range(_STEPS):
        _load(simulator, commands)  # fuel systems transfer fuel in each step
        tanks = _contents(simulator)  # JSBSim uses the mass before the step
        _run(simulator.run, simulator)
    answer = tanks | {name: _value(simulator, full_name) for name, full_name in _MEASURED.items()}
    answer |= {f"state.{name}": simulator[full_name] for name, full_name in _STATE.items()}
    for number in range(simulator.get_propulsion().get_num_engines()):
        prefix = _engine(number)
        answer[f"rpm{number}"] = _value(simulator, f"{prefix}/propeller-rpm")
        answer[f"blade{number}"] = _value(simulator, f"{prefix}/blade-angle")
        answer[f"thrust{number}"] = _value(simulator, f"{prefix}/thrust-lbs")
        answer[f"power{number}"] = _value(simulator, f"{prefix}/power-hp")
    return answer


def _freeze_state(simulator):
    """Turn off the integration of the equations of motion, so that the state is constant."""
    for name in _INTEGRATORS:
        simulator[name] = 0


def _simulated(simulator, point):
    """Simulate a flight in JSBSim and return the final states."""
    # "start" of the result contains the states at the start of the flight, including those of
    # engines, and "states" those at the end of each second. Entries of the request:
    # - "flight": duration, s
    # - "step": time step, s, by default 1 ms
    # - "rest": time before the flight in which engines settle, s
    # - "changes": list of [time, {command: value}], in order
    commands = dict(point.get("commands", {}))
    length = point.get("step", _FINE)
    _start(simulator, point["state"], commands)
    simulator["propulsion/fuel_freeze"] = 1
    leaned = {name: simulator[name] for name in _mixtures(simulator)}
    if "rest" in point:
        orders = {name: simulator[name] for name in _INTEGRATORS}
        _freeze_state(simulator)
        for _ in range(round(point["rest"] / length)):
            _run(simulator.run, simulator)
        for name, order in orders.items():
            simulator[name] = order
    start = _states(simulator) | _of_engines(simulator)
    states = []
    changes = list(point.get("changes", ()))
    second = round(1.0 / length)
    for step in range(round(point["flight"] / length)):
        while changes and changes[0][0] <= step * length + 1e-9:
            _command(simulator, changes.pop(0)[1])
        if "changes" in point:
            _lean(simulator, commands, leaned)
        _run(simulator.run, simulator)
        if (step + 1) % second == 0:
            states.append(_states(simulator))
    return _states(simulator) | {"start": start, "states": states}


def _lean(simulator, commands, leaned):
    """Set the mixture commands for the current air pressure, as in the model."""
    mixture = commands.get("mixture", 1.0) * simulator["atmosphere/delta"]
    for name in _mixtures(simulator):
        if leaned[name] == simulator[name]:
            simulator[name] = leaned[name] = mixture


def _mixtures(simulator):
    """Return the property names of the mixture commands of all engines."""
    count = simulator.get_propulsion().get_num_engines()
    return ["fcs/mixture-cmd-norm" + (f"[{number}]" if number else "") for number in range(count)]


def _states(simulator):
    """Return JSBSim's values of the states of a `Model`, by name."""
    return {name: simulator[full_name] for name, full_name in _STATE.items()}


def _of_engines(simulator):
    """Return JSBSim's values of the engine states of a `Model`, by name. A missing state is 0."""
    values = {}
    parts = {
        **{"rpm": "propeller-rpm", "blade": "blade-angle", "spool": "n2"},
        **{"manifold": "map-inhg", "generator": "n1"},
    }
    for number in range(simulator.get_propulsion().get_num_engines()):
        for name, part in parts.items():
            values[f"{name}{number}"] = _value(simulator, f"{_engine(number)}/{part}")
    return values


def _command(simulator, commands):
    """Set the commands of surfaces and throttles."""
    for name, value in commands.items():
        if name != "throttle":
            simulator[_COMMANDS[name]] = value
            continue
        for number in range(simulator.get_propulsion().get_num_engines()):
            index = f"[{number}]" if number else ""
            simulator[f"fcs/throttle-cmd-norm{index}"] = value


def _contents(simulator):
    """Return the content of each tank by name, lb."""
    contents = {}
    for number in range(_MOST_TANKS):
        index = f"[{number}]" if number else ""
        contents[f"tank{number}"] = _value(simulator, f"propulsion/tank{index}/contents-lbs")
    return contents


def _unsettled(simulator):
    """Return the quantities that become constant when engines settle."""
    count = simulator.get_propulsion().get_num_engines()
    names = [f"{_engine(number)}/propeller-rpm" for number in range(count)]
    names += [_MEASURED[axis] for axis in AXES]
    return [_value(simulator, name) for name in names]


def _engine(number):
    """Return the path of an engine's properties; engine 0 has no index."""
    return f"propulsion/engine[{number}]" if number else "propulsion/engine"


def _value(simulator, name):
    """Return the value of a property, or 0 if the property does not exist."""
    try:
        return float(simulator[name])
    except KeyError:
        return 0.0


if __name__ == "__main__":
    raise SystemExit(main())
