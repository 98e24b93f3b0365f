"""What `hfa export` writes computes the numbers of the product: C source and FMUs."""

import json
import math
import re
import subprocess
import zipfile
from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest
from c_files import called, compiled, needs_gcc
from cli import hfa as command
from innovations import innovations_of
from known_models import exact_gain, model_at
from nominal import nominal_game
from project import ROOT

import hfa
from hfa_flight import Scenario, Waveform
from hfa_flight.export.c_text import sensed_values
from hfa_flight.export.exported_loop import exported_loop, filtered_steering
from hfa_model import LINEAR_STATES, STATES, Input, Parameters, State

pytestmark = needs_gcc
#: Lag, s, and rate limit, deg/s, of the servos.
LAG, RATE = 0.05, 60.0
ANGLES = (5.0, 10.0, 20.0)


def with_surface_servos(model):
    """Return the aircraft of `--servo LAG:RATE`: rate limits of the surfaces alone."""
    rates = {"rad": math.radians(RATE)}
    servos = {
        name: hfa.Servo(LAG, rates.get(signal.unit, math.inf))
        for name, signal in model.inputs.items()
    }
    return hfa.with_servos(model, servos)


def exported(*words):
    """Run `hfa export` for the paper's aircraft at 10 deg, and fail unless it succeeds."""
    result = command("export", "--dihedral", "10", *words)
    assert result.code == 0, result.err


def test_the_end_of_a_comment_in_a_name_ends_no_comment_of_the_code(folder):
    """The code of an aircraft whose name is */ followed by a wrong line compiles."""
    text = (ROOT / "examples/uav.toml").read_text("utf-8")
    Path("uav.toml").write_text(text.replace('name = "Aerosonde"', 'name = "*/ wrong"'), "utf-8")
    weights = ("--Q", ",".join("1" * 8), "--R", ",".join("1" * 4))
    assert command("export", "--aircraft", "uav.toml", *weights, "-o", "c").code == 0
    assert "* / wrong" in (folder / "c/hfa_aircraft.c").read_text("utf-8")
    compiled(folder / "c", "-c", "hfa_aircraft.c", "-o", "aircraft.o")


def test_exported_rates_equal_the_model(folder):
    """At random states, exported C code and the equations give equal state rates, with updrafts."""
    exported("--dynamics", "newton", "-o", "c")
    place = folder / "c"
    compiled(place, "-shared", "-fPIC", "hfa_aircraft.c", "-o", "library.so")
    point = model_at(10.0, "newton").point
    model = point.model
    winds = namedtuple("winds", tuple(model.disturbances))
    random = np.random.default_rng(5)
    for row in range(20):
        updraft = float(row % 5 - 2)  # -2 to 2 ft/s
        x = point.x + random.uniform(-0.2, 0.2, 7) * [9, 1, 99, 1, 1, 1, 1]
        u = point.u + random.uniform(-0.2, 0.2, 5)
        w = winds(*(updraft * (name == "updraft") for name in model.disturbances))
        rates, _ = model.equations(State(*x), Input(*u), Parameters(*model.p), w)
        dx = np.empty(7)
        called(place, "hfa_rates", x, u, np.array(w), dx)
        np.testing.assert_allclose(dx, [float(rates[name]) for name in STATES], rtol=1e-12)


@pytest.fixture
def gains(folder):
    """Return 2 % of the exact gains at ANGLES, (3, 5, 6), also stored in gains.npz."""
    table = np.array([0.02 * exact_gain(angle) for angle in ANGLES])
    np.savez("gains.npz", K=table, dihedral_deg=ANGLES)
    return table


def test_the_policy_in_c_interpolates_a_gain_table(folder, gains):
    """u = u0 - K(dihedral) (x - x0), K linear between the breakpoints and constant beyond."""
    exported("--policy", "gains.npz", "-o", "c")
    compiled(folder / "c", "-shared", "-fPIC", "hfa_aircraft.c", "-o", "library.so")
    point = model_at(10.0).point
    rows = [STATES.index(name) for name in LINEAR_STATES]
    for degrees in (2.0, 5.0, 7.3, 10.0, 14.0, 20.0, 25.0):
        x = point.x + np.array([1.0, 0.01, 5.0, 0.02, 0.03, 0.0, 0.02])
        x[STATES.index("dihedral")] = math.radians(degrees)
        u = np.empty(5)
        called(folder / "c", "hfa_policy", x, u)
        K = [[np.interp(degrees, ANGLES, gains[:, i, j]) for j in range(6)] for i in range(5)]
        expected = point.u - np.array(K) @ (x - point.x)[rows]
        np.testing.assert_allclose(u, expected, rtol=1e-12, err_msg=f"{degrees} deg")
    compiled(folder / "c", "loop_100hz.c", "hfa_aircraft.c", "-o", "loop")  # the example, too
    (K,) = re.findall(r"hfa_K.* = (.*);", (folder / "c/hfa_aircraft.c").read_text())
    np.testing.assert_allclose(json.loads(K.translate(str.maketrans("{}", "[]"))), gains[1])


#: Aircraft file of a body with x' = x^3 + u and |u| <= 2.
CUBIC = """
from hfa import Model, Signal

CUBIC = Model("cubic", {"x": Signal("ft", nominal=3.0)}, {"u": Signal("ft/s", min=-2.0, max=2.0)},
              lambda x, u, p, w: ({"x": x.x**3 + u.u}, {}), trim={"x": 0.5})
"""


def test_a_function_in_c_is_within_the_limits_of_the_inputs(folder):
    """The policy of a value function of order 4 in C gives the inputs of `hfa.read_critic`, within those of
    the aircraft. Its gain is 0, and its example begins at 1 % of the nominal size.
    """
    Path("cubic.py").write_text(CUBIC)
    point = hfa.trim(hfa.load_model("cubic.py:CUBIC"))
    linear = point.linearize()
    game = hfa.game(linear, Q=[1.0], R=[1.0])
    hfa.expand(linear, hfa.solve(game), 4).save("value.npz")
    words = ("export", "--aircraft", "cubic.py:CUBIC", "--policy", "value.npz", "-o", "c")
    assert command(*words).code == 0
    compiled(folder / "c", "-shared", "-fPIC", "hfa_aircraft.c", "-o", "library.so")
    critic, u = hfa.read_critic("value.npz", game), np.empty(1)
    for z in (-0.2, 0.0, 0.1, 3.0):
        called(folder / "c", "hfa_policy", point.x + z, u)
        np.testing.assert_allclose(u, np.clip(point.u + critic.u([z]), -2.0, 2.0), rtol=1e-9)
    assert "hfa_K[1][1] = {{0.0}}" in Path("c/hfa_aircraft.c").read_text()
    assert "flown[HFA_X] += 0.03;" in Path("c/loop_100hz.c").read_text()


def test_the_loop_of_an_fmu_is_that_of_the_flight_in_moving_air():
    """Rates and outputs are those of the equations with winds, from the commands that are held. The sample
    of a policy behind a filter begins at the states, which are known, and its commands act a sample
    late, first those of the trim. A pitot tube and a vane see the winds.
    """
    linear = model_at(10.0)
    point, model = linear.point, linear.model
    noise = {"airspeed": 0.3, "angle_of_attack": 0.003} | dict.fromkeys(
        ("pitch", "pitch_rate", "dihedral", "dihedral_rate"), 0.002
    )
    kalman = hfa.filter(linear, noise, "light:20000")
    policy, _ = kalman.policy(0.02 * exact_gain(10.0)).in_scenario(Scenario(1.0, delay=0.01))
    loop = exported_loop(model, point, filtered_steering(model, policy))
    winds, random = np.zeros(len(model.disturbances)), np.random.default_rng(2)
    winds[list(model.disturbances).index("headwind")] = 2.0
    winds[list(model.disturbances).index("updraft")] = 1.5
    speed, alpha = point["speed"], point["alpha"]
    sensed = sensed_values(policy)(point.x, winds).full().ravel()
    expected = {name: point[name] for name in noise if name in STATES}
    expected |= {"airspeed": math.hypot(speed + 2.0, 1.5)}
    expected |= {"angle_of_attack": alpha + math.atan2(1.5, speed + 2.0)}
    assert dict(zip(policy.sensors, sensed, strict=True)) == pytest.approx(expected, rel=1e-9)

    x = point.x + 0.01 * random.uniform(-1.0, 1.0, 7) * [9, 1, 99, 1, 1, 1, 1]
    held = point.u + 0.01 * random.uniform(-1.0, 1.0, 5)
    errors = 0.1 * innovations_of(kalman)
    v = np.concatenate([winds, errors, held])
    rates, outputs = (part.full().ravel() for part in loop.function(x, v))
    named = namedtuple("named", tuple(model.disturbances))
    given = State(*x), Input(*held), Parameters(*model.p), named(*winds)
    of_model = model.equations(*given)
    np.testing.assert_allclose(rates, [float(of_model[0][name]) for name in STATES], rtol=1e-9)
    plain = exported_loop(model, point, None)
    np.testing.assert_allclose(
        plain.function(x, v[[*range(len(winds)), -5, -4, -3, -2, -1]])[0], rates[:, None]
    )
    np.testing.assert_allclose(outputs[:5], held, rtol=1e-12)
    np.testing.assert_allclose(outputs[5:], [float(of_model[1][name]) for name in model.outputs])
    assert [channel.name for channel in loop.outputs] == [*model.inputs, *model.outputs]

    policy.begin(x)
    memory = np.zeros(loop.sampled.function.numel_in(2))
    acting = point.u
    for number in range(4):
        u, memory = loop.sampled.function(x, v, memory)
        np.testing.assert_allclose(u.full().ravel(), acting, rtol=1e-9, atol=1e-9)
        measured = sensed_values(policy)(x, winds).full().ravel() + errors
        acting = policy(0.01 * number, measured)
        x = x + 1e-3 * random.uniform(-1.0, 1.0, 7)
    assert np.abs(acting - point.u).max() > 1e-4
    assert loop.sampled.starts == tuple(point.u)
    assert loop.sampled.dt == 0.01


def test_an_fmu_simulates_the_flight_in_fmpy(folder):
    """Co-simulation and model exchange of 5 s in FMPy give the flight of `fly`. FMPy's validator
    accepts the FMU. A gain follows a reference, and moves servos.
    """
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    validation = pytest.importorskip("fmpy.validation")
    exported("--policy", "exact", "--servo", f"{LAG}:{RATE}", "-o", "a.fmu")
    model = with_surface_servos(hfa.aircraft())
    point = hfa.trim(model, dihedral=math.radians(10.0))
    policy = hfa.solve(hfa.game(point.linearize())).K
    start = {"speed": point["speed"] + 0.02, "reference_speed": 0.05}
    reference = Waveform(np.eye(11)[0] * 0.05, np.zeros(11))
    off = 0.02 * np.eye(len(point.x))[0]
    scenario = Scenario(5.0, 0.001, 0.1, off, reference=reference)
    flight = hfa.fly(model, point, policy, scenario=scenario, predict=False)
    assert validation.validate_fmu("a.fmu") == []
    units = {
        variable.name: variable.unit
        for variable in fmpy.read_model_description("a.fmu").modelVariables
    }
    assert units["reference_speed"] == "ft/s"
    assert "elevator_center_servo" in units
    with zipfile.ZipFile("a.fmu") as archive:
        parts = {Path(name).parts[0] for name in archive.namelist()}
    assert parts == {"modelDescription.xml", "binaries", "resources", "sources"}
    # States of the flight every 0.1 s.
    known = flight.states[:: round(0.1 / flight.step)]
    for how, solver in (("CoSimulation", {}), ("ModelExchange", {"relative_tolerance": 1e-12})):
        found = fmpy.simulate_fmu(
            "a.fmu", fmi_type=how, stop_time=5.0, output_interval=0.1, start_values=start, **solver
        )
        states = np.array([found[name] for name in point.model.states]).T
        np.testing.assert_allclose(states, known, rtol=1e-7, atol=1e-6, err_msg=how)
    assert np.ptp(known, axis=0).max() > 0.01


#: Noise of the sensors of a filter, and the options that give it.
NOISE = {"speed": 0.3, "pitch": 0.002, "pitch_rate": 0.003, "dihedral": 0.002}
FILTER = [
    "--filter",
    "--turbulence=moderate:40000",
    *(f"--noise={name}={math.degrees(v) if name != 'speed' else v}" for name, v in NOISE.items()),
]


def test_an_fmu_behind_a_filter_simulates_the_flight(folder):
    """Co-simulation in FMPy, in steps of 25 ms that samples of 10 ms do not divide, gives the flight of
    `fly` with a sensor that is 0.02 rad off and commands that act a sample late.
    """
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    validation = pytest.importorskip("fmpy.validation")
    file = f"{ROOT}/examples/pendulum.py:PENDULUM"
    noise = {"angle": 0.01, "rate": 0.02}
    typed = [f"--noise={name}={math.degrees(sigma)}" for name, sigma in noise.items()]
    linear = hfa.trim(hfa.load_model(file)).linearize()
    K = hfa.solve(nominal_game(linear)).K
    np.savez("K.npz", K=K)
    typed += ["--policy", "K.npz", "--delay", "10ms"]
    run = command("export", "--aircraft", file, "--filter", *typed, "-o", "a.fmu")
    assert run.code == 0, run.err
    assert validation.validate_fmu("a.fmu") == []
    point, seconds, interval = linear.point, 0.5, 0.025
    policy = hfa.filter(linear, noise).policy(K)
    off = np.tile([0.02, 0.0], (50, 1))
    scenario = Scenario(seconds, 0.001, 0.01, np.array([0.05, 0.0]), samples=off, delay=0.01)
    flight = hfa.fly(point.model, point, policy, scenario=scenario, predict=False)
    found = fmpy.simulate_fmu(
        "a.fmu",
        stop_time=seconds,
        step_size=interval,
        output_interval=interval,
        start_values={"angle": 0.05, "noise_angle": 0.02},
    )
    known = flight.states[:: round(interval / flight.step)]
    states = np.array([found[name] for name in point.model.states]).T
    np.testing.assert_allclose(states, known, rtol=1e-8, atol=1e-8)
    assert np.ptp(known[:, 1]) > 1e-2


def compiled_filter(folder):
    """Compile the filter in C; return the text of its header, and what that says of the memory."""
    compiled(folder / "c", "-O0", "-shared", "-fPIC", "hfa_filter.c", "-o", "library.so")
    header = Path("c/hfa_filter.h").read_text("utf-8")
    words = ("MEMORY", "KNOWN")
    return header, *(int(re.search(rf"FILTER_{word} (\d+)", header)[1]) for word in words)


def test_an_exported_filter_equals_the_policy_behind_it(folder):
    """The C code gives the commands of the policy, to rounding, over 120 samples with random, impossible,
    missing and frozen values. It is switched on in flight, where the states are not known, and from
    sample 100 on flies from known states: its memory is 0 but for the entry KNOWN of the header, 1.
    """
    exported(*FILTER, "-o", "c")
    _, size, known = compiled_filter(folder)
    linear = model_at(10.0, "published")
    policy = hfa.filter(linear, NOISE, "moderate:40000").policy(exact_gain(10.0))
    last = trim = np.array([linear.point[name] for name in policy.filter.sensors])
    random = np.random.default_rng(1)
    memory, u = np.zeros(size), np.zeros(5)
    for number in range(120):
        y = trim + innovations_of(policy.filter) * random.uniform(-1.0, 1.0, 4)
        if number in (0, 20, 21) or 30 <= number < 45:
            y[1] += 20.0 * innovations_of(policy.filter)[1]  # impossible
        if number in (5, 33):
            y[number % 4] = math.nan  # one of four is missing
        if 50 <= number < 55:
            y[:] = math.nan
        if 22 <= number < 25:
            y = last  # frozen
        if number == 100:  # a flight from known states
            policy.begin(linear.point.x)
            memory = np.eye(1, size, known).ravel()
        last = y
        called(folder / "c", "hfa_filter", memory, y, u)
        np.testing.assert_allclose(u, policy(0.01 * number, y), rtol=1e-12, atol=1e-12)
        # The estimate begins at sample 0, and anew at 1: commands are faded in from then on.
        assert np.array_equal(u, linear.point.u) == (number in (0, 1))
    assert policy.unused > 0


@pytest.mark.slow
def test_an_exported_filter_with_servos_and_a_delay_flies(folder):
    """The example loop of a filter with sensors in the air, biases, servos of 20 ms and commands that act
    10 ms late brings the aircraft back to the trim.
    """
    model = hfa.with_servos(hfa.aircraft(), hfa.Servo(0.02))
    point = hfa.trim(model, dihedral=math.radians(10.0))
    linear = point.linearize()
    sizes = {**dict.fromkeys(linear.states[:6], 0.1), "speed": 20.0, "pitch_rate": 0.05}
    sizes |= {**dict.fromkeys(linear.inputs, 0.1), "throttle": 40.0}
    hfa.solve(hfa.game(linear, sizes=sizes, rate=100.0)).save("K.npz")
    words = "--servo 20ms --rate 100 --delay 10ms --policy K.npz --filter --turbulence light:20000"
    exported(*words.split(), "--sensors", "aircraft", "-o", "c")
    header = Path("c/hfa_filter.h").read_text("utf-8")
    assert "FILTER_AIRSPEED, /* output airspeed, ft/s */" in header
    files = ("loop_filter.c", "hfa_filter.c", "hfa_aircraft.c")
    compiled(folder / "c", "-O0", *files, "-lm", "-o", "loop_filter")
    printed = subprocess.run([str(folder / "c" / "loop_filter")], capture_output=True, text=True)
    ends = {line.split()[0]: float(line.split()[1]) for line in printed.stdout.splitlines()}
    assert abs(ends["speed"] - point["speed"]) < 0.5
    assert abs(ends["pitch_rate"]) < 0.01
