"""Exported C code of aircraft and controllers.

The code compiles without warnings, computes the same numbers as the product, and uses no dynamic
memory. The example loops run.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from c_files import called, footprint, loaded, needs_gcc, ran, written
from controllers import integrating_controller, small_controller
from known_models import model_at
from project import ROOT
from random_points import INPUT_SCALES, STATE_SCALES, rising, state_rates, symbols

import hfa_model
from hfa import BadInputError, OperatingPoint, linearize, trim
from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from hfa_flight import ActuatorBank, CommandSteps, GainPolicy, Scenario, ScheduledController
from hfa_flight.closed_loop import ClosedLoop, NonlinearPlant
from hfa_flight.export.aircraft_c import AIRCRAFT_FILES, c_model_texts
from hfa_flight.export.c_text import write_texts
from hfa_flight.export.controller_c import (
    COMMANDED,
    CONTROLLER_FILES,
    SECONDS,
    c_controller_texts,
    commandable,
    longest_step,
)
from hfa_flight.policies.controller import servo_policy
from hfa_flight.policies.policy import Measurements
from hfa_flight.signals import CommandedStates
from hfa_flight.simulation import CompiledLoop
from hfa_model import LINEAR_STATES, STATES as HFA_STATES, Input
from hfa_support.native.c_code import c_function
from trim.point.condition import usual_condition

pytestmark = needs_gcc
HEADER, SOURCE, EXAMPLE = AIRCRAFT_FILES
EXAMPLES = ROOT / "examples"


@pytest.fixture(scope="module")
def folder(aircraft: Model, tmp_path_factory: pytest.TempPathFactory) -> Path:
    gain = np.arange(30.0).reshape(5, 6) / 100
    linear = model_at(15.0, hfa_model.variant_of(aircraft).name)
    texts = c_model_texts(linear, GainPolicy("any", gain), "from */ here")
    return written(tmp_path_factory.mktemp("c"), texts, SOURCE)


def test_exported_rates_equal_the_model(
    folder: Path, aircraft: Model, point: OperatingPoint
) -> None:
    """At random states, exported C code and the model give equal state rates, with updrafts."""
    (x, u, p), w = symbols(), ca.SX.sym("w")
    ours = ca.Function(
        "ours", [x, u, p, w], [state_rates(x, u, p, hfa_model.variant_of(aircraft), rising(w))]
    )
    random = np.random.default_rng(5)
    dx = np.empty(7)
    for row in range(100):
        state = np.array(point.states) + 0.5 * np.array(STATE_SCALES) * random.uniform(-1, 1, 7)
        control = np.array(point.inputs) + 0.5 * np.array(INPUT_SCALES) * random.uniform(-1, 1, 5)
        updraft = float(row % 5 - 2)
        winds = np.zeros(len(aircraft.disturbances))
        winds[list(aircraft.disturbances).index("updraft")] = updraft
        called(folder, "hfa_rates", state, control, winds, dx)
        known = np.array(
            ours(state, control, np.array(hfa_model.parameters_of(aircraft)), updraft)
        ).ravel()
        np.testing.assert_allclose(dx, known, rtol=1e-14, atol=0)


def test_exported_code_contains_the_models_numbers(folder: Path, aircraft: Model) -> None:
    """The exported policy, the matrix A and the comments of the header contain the numbers, units
    and text of the model.
    """
    model = model_at(15.0, hfa_model.variant_of(aircraft).name)
    gain = np.arange(30.0).reshape(5, 6) / 100
    point = model.point
    x = np.array(point.states) + np.arange(7.0) / 10
    u = np.empty(5)
    called(folder, "hfa_policy", x, u)
    np.testing.assert_allclose(
        u, np.array(point.inputs) - gain @ (np.arange(7.0) / 10)[[0, 1, 3, 4, 5, 6]], rtol=1e-14
    )
    stored = (ctypes.c_double * 36).in_dll(loaded(folder), "hfa_A")
    np.testing.assert_array_equal(np.array(stored).reshape(6, 6), model.A)
    header = (folder / HEADER).read_text(encoding="utf-8")
    assert "HFA_PITCH_RATE, /* rad/s */" in header
    assert "from * / here" in header


@pytest.mark.parametrize(
    "aircraft", ["published", pytest.param("newton", marks=pytest.mark.slow)], indirect=True
)
def test_the_example_loop_runs_with_static_memory(folder: Path) -> None:
    """The example 100 Hz loop runs. The library calls only math functions and has little static
    memory.
    """
    assert list(ran(folder, EXAMPLE, SOURCE))[:2] == ["speed", "alpha"]
    text, data, bss, asked = footprint(folder, SOURCE)
    assert asked <= {
        *(
            "sin",
            "cos",
            "atan2",
            "asin",
            "sqrt",
            "pow",
            "exp",
            "fmin",
            "fmax",
            "sincos",
            "__stack_chk_fail",
        ),
        "_GLOBAL_OFFSET_TABLE_",
    }
    assert text < 64_000
    assert (data, bss) <= (512, 0)


@pytest.mark.parametrize(
    "name", ["navion.py:NAVION", pytest.param("f16.py:F16", marks=pytest.mark.slow)]
)
def test_exported_rates_of_other_aircraft_equal_the_model(name: str, tmp_path: Path) -> None:
    """The exported C code of the Navion and of the F-16 gives the model's rates at 50 random
    states.

    The example loop of the Navion runs.
    """
    model = load_model(str(EXAMPLES / name))
    point = trim(model, usual_condition(model))
    linear = linearize(model, point)
    gain = np.zeros((len(model.inputs), len(model.linear)))
    written(tmp_path, c_model_texts(linear, GainPolicy("none", gain), "here"), SOURCE)
    random = np.random.default_rng(5)
    dx = np.empty(len(model.states))
    still = np.zeros(max(1, len(model.disturbances)))
    for _ in range(50):
        x, u = (
            np.array(at)
            + 0.1
            * np.array([each.nominal for each in of.values()])
            * random.uniform(-1, 1, len(of))
            for at, of in ((point.states, model.states), (point.inputs, model.inputs))
        )
        called(tmp_path, "hfa_rates", x, u, still, dx)
        np.testing.assert_allclose(dx, model.at(x, u).f, rtol=1e-12, atol=1e-12)
    if model.name == "Navion":
        assert list(ran(tmp_path, EXAMPLE, SOURCE)) == list(model.states)


def test_an_operation_without_c_equivalent_is_named() -> None:
    """The error for an operation without a C equivalent, here erf, names the operation."""
    x = ca.SX.sym("x")
    with pytest.raises(
        BadInputError,
        match="rates: the operation OP_ERF cannot be written as C",
    ):
        c_function(ca.Function("f", [x], [ca.erf(x)]), "rates", ("x",), ("y",))


LAW_HEADER, LAW_SOURCE, LAW_EXAMPLE = CONTROLLER_FILES
STATES = 4
HIGHEST = 0.3
Z = "vertical_acceleration_short_period"


@pytest.fixture(scope="module")
def controller(published_aircraft: Model) -> ScheduledController:
    """Return a controller with random matrices, two inputs, four states and two commands.

    One of its three measurements is an actuator position.
    """
    random = np.random.default_rng(3)
    shapes = {
        "A": (STATES, STATES),
        "B": (STATES, 9),
        "C": (2, STATES),
        "D": (2, 9),
        "W": (STATES, 2),
    }
    stacks = {name: random.normal(size=(3, *shape)) for name, shape in shapes.items()}
    stacks["W"][:, 0, 1] = 0.0
    return small_controller(
        published_aircraft,
        **stacks,
        states=tuple("abcd"),
        measurements=(Z, "dihedral", "aileron_outer_position"),
        commands=tuple(f"{name}{signal}" for signal in ("_command", "_command_rate", "_command_end")
                       for name in ("dihedral", Z)),
        inputs=("aileron_outer", "elevator_center"),
    )  # fmt: skip


@pytest.fixture(scope="module")
def law_folder(
    controller: ScheduledController,
    published_aircraft: Model,
    point: OperatingPoint,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    texts = c_controller_texts(controller, published_aircraft, point, "from */ here")
    return written(tmp_path_factory.mktemp("c"), texts, LAW_SOURCE)


def answered(
    law_folder: Path, dihedral: float, measured: np.ndarray, memory: np.ndarray, command: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    limits = np.full(5, HIGHEST)
    u = np.empty(5)
    rate = np.empty(len(memory))
    called(
        law_folder, "hfa_controller", dihedral, measured, memory, command, -limits, limits, u, rate
    )
    return u, rate


def simulated_controller(
    controller: ScheduledController, aircraft: Model, point: OperatingPoint
) -> ca.Function:
    """Return the product's controller as a function (t, x, a, memory) -> (y, commands, u, memory').

    The commands are their values, their rates and their last values. Both are steps. u is saturated
    at ±`HIGHEST`.
    """
    commands = CommandSteps(
        commandable(controller), np.array([0.0, 2.0]), np.array([[0.05, 0.3], [-0.05, 2.0]])
    )
    policy = servo_policy(controller, commands, aircraft, point)
    t = ca.SX.sym("t")
    x = ca.SX.sym("x", 6)
    a = ca.SX.sym("a", 5)
    m = ca.SX.sym("m", STATES)
    seen = Measurements(x, x, a, ca.SX(5, 1))
    limited = ca.fmin(ca.fmax(policy.control(t, seen, m, ca.SX(0, 1)), -HIGHEST), HIGHEST)
    told = [policy.outputs.at(seen), commands.at(t), commands.rate(t), commands.end(t)]
    rate = policy.memory_rate(t, seen, m, ca.SX(0, 1), limited)
    return ca.Function("flown", [t, x, a, m], [*told, limited, rate])


def test_exported_controller_equals_the_simulated_one(
    law_folder: Path,
    controller: ScheduledController,
    published_aircraft: Model,
    point: OperatingPoint,
) -> None:
    """At random states, the exported controller gives the inputs and rates of the simulated
    controller.
    """
    law = simulated_controller(controller, published_aircraft, point)
    random = np.random.default_rng(5)
    worst = 0.0
    limited = 0
    for t in random.uniform(0.0, 5.0, 200):
        x, a, m = (random.normal(size=size) for size in (6, 5, STATES))
        x[LINEAR_STATES.index("dihedral")] = random.uniform(
            -0.3, 0.2
        )  # also beyond both ends of the table
        y, r, slope, goal, known_u, known = (np.array(each).ravel() for each in law(t, x, a, m))
        dihedral = point.states.dihedral + x[LINEAR_STATES.index("dihedral")]
        u, rate = answered(law_folder, float(dihedral), y, np.concatenate([m, r, slope]), goal)
        worst = max(
            worst,
            np.abs(u - known_u).max(),
            np.linalg.norm(rate[:STATES] - known) / np.linalg.norm(known),
        )
        limited += int(np.abs(known_u).max() == HIGHEST)
        A, B, C, D = controller.at(float(dihedral))
        stack = controller.W.reshape(len(controller.breakpoints), -1).T
        flat = [np.interp(dihedral, controller.breakpoints, entry) for entry in stack]
        given = np.concatenate([y, r, slope, goal])
        np.testing.assert_allclose(y[1:], [x[LINEAR_STATES.index("dihedral")], a[2]])
        asked = C @ m + D @ given
        missed = np.clip(asked, -HIGHEST, HIGHEST) - asked
        expected = A @ m + B @ given + np.reshape(flat, (STATES, 2)) @ missed
        np.testing.assert_allclose(known, expected, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(known_u[[2, 3]], asked + missed, atol=1e-12)
        np.testing.assert_allclose(rate[STATES : STATES + 2], slope, rtol=0, atol=0)
        np.testing.assert_allclose(
            rate[STATES + 2 :], 0.25 * (goal - r) - 2.0 * slope, rtol=1e-14, atol=1e-15
        )
    assert worst <= 1e-14
    assert limited > 20


def test_a_step_multiplies_states_by_the_exponential(
    controller: ScheduledController, law_folder: Path
) -> None:
    """Without measurements, limits and commands, a step of 10 ms multiplies the states by exp(0.01
    A).

    The header states the longest permitted step.
    """
    from scipy.linalg import expm

    dihedral = float(np.radians(8.0))
    limits = np.full(5, 1e9)
    u = np.empty(5)
    memory = np.zeros(STATES + 4)
    start = np.array([0.4, -0.2, 0.1, 0.3])
    memory[:STATES] = start
    arguments = (np.zeros(3), np.zeros(2), -limits, limits, 0.01, u)
    called(law_folder, "hfa_controller_step", memory, dihedral, *arguments)
    A, _, C, _ = controller.at(dihedral)
    np.testing.assert_allclose(memory[:STATES], expm(0.01 * A) @ start, rtol=1e-12)
    np.testing.assert_allclose(u[[2, 3]], C @ memory[:STATES], rtol=1e-12)
    assert longest_step(controller) == 1e-3
    assert "0.001 s or less" in (law_folder / LAW_HEADER).read_text("utf-8")


def test_the_controllers_c_code_uses_static_memory(law_folder: Path) -> None:
    """The controller's C code uses little static memory and calls only math functions.

    The header contains names, units and the range of the schedule.
    """
    text, data, bss, asked = footprint(law_folder, LAW_SOURCE)
    assert asked <= {"fmin", "fmax", "ceil", "__stack_chk_fail"}
    assert text < 16_000
    assert (data, bss) <= (256, 0)
    header = (law_folder / LAW_HEADER).read_text("utf-8")
    assert f"HFA_MEASURED_{Z.upper()}, /* ft/s^2 */" in header
    assert "HFA_COMMAND_DIHEDRAL, /* rad */" in header
    assert "from * / here" in header
    assert "5 to 20 deg" in header


# The example loop.

#: Actuators so slow and limits so narrow that the command reaches both limits.
SLOW = ActuatorBank(*(Input(*[each] * 5) for each in (0.2, -50.0, 50.0, 0.002)), order=2)


def simulated_states(
    controller: ScheduledController, aircraft: Model, point: OperatingPoint
) -> np.ndarray:
    """Return the absolute states after `SECONDS` of the product's simulation with the
    controller.
    """
    commands = CommandSteps((), np.zeros(0), np.zeros((0, 0)))
    if controller.commands:
        commands = CommandSteps(("dihedral",), np.zeros(1), np.array([[COMMANDED]]))
    law = servo_policy(controller, commands, aircraft, point)
    initial = np.eye(len(HFA_STATES))[0]
    scenario = Scenario(
        float(SECONDS), 0.01, 0.1, initial, CommandedStates(commands, LINEAR_STATES), actuators=SLOW
    )
    flight = CompiledLoop(ClosedLoop(NonlinearPlant(aircraft, point), law, scenario)).fly()
    return np.asarray(flight.states[-1] + np.array(point.states))


def with_memory(aircraft: Model) -> ScheduledController:
    return integrating_controller(
        aircraft,
        measurements=("aileron_outer_rate", "dihedral"),
        C=np.full((3, 1, 1), -0.5),
        D=np.array([[[0.05, -0.4, 0.4, 0.0]]] * 3),
    )


def without_memory_and_commands(aircraft: Model) -> ScheduledController:
    """Return a controller without memory and commands. Its arrays in C would be empty."""
    shapes = {"A": (3, 0, 0), "B": (3, 0, 1), "C": (3, 1, 0), "W": (3, 0, 1)}
    stacks = {name: np.zeros(shape) for name, shape in shapes.items()} | {
        "D": np.full((3, 1, 1), -0.1)
    }
    return small_controller(aircraft, **stacks, states=(), commands=(), measurements=("dihedral",))


@pytest.mark.parametrize(
    "made", [with_memory, pytest.param(without_memory_and_commands, marks=pytest.mark.slow)]
)
def test_exported_loop_agrees_with_simulation_and_prints_time(
    made: Callable[[Model], ScheduledController],
    published_aircraft: Model,
    point: OperatingPoint,
    tmp_path: Path,
) -> None:
    """The exported example loop reaches the states of the product's simulation and prints its time.

    The loop holds the inputs during a tick, which causes an error proportional to the tick.
    Extrapolated to a tick of 0, the states agree within 3e-5. A planted error in the C code is
    detected.
    """
    controller = made(published_aircraft)
    states = []
    known = simulated_states(controller, published_aircraft, point)
    write_texts(tmp_path, c_controller_texts(controller, published_aircraft, point, "here", SLOW))
    for hertz in (100, 1000):
        said = ran(tmp_path, f"-DHERTZ={hertz}", LAW_EXAMPLE, LAW_SOURCE)
        states.append(np.array([said[name] for name in HFA_STATES]))
        assert 0.0 <= said["microseconds a tick"] < 1000.0  # 0 if the clock is coarse
    size = np.abs(known - np.array(point.states)).max()
    assert size > 0.1
    assert np.abs(states[0] - known).max() < 0.03 * size
    assert np.abs((10 * states[1] - states[0]) / 9 - known).max() < 3e-5 * size
    text = (tmp_path / LAW_EXAMPLE).read_text()
    for name in ("lowest", "highest"):
        (numbers,) = re.findall(rf"double {name}\[.*?\] = {{([^}}]*)}}", text)
        limits = np.array(getattr(SLOW, name)) - point.inputs
        np.testing.assert_allclose([float(each) for each in numbers.split(",")], limits)
    (tmp_path / LAW_EXAMPLE).write_text(text.replace("flown[0] += 1.0", "flown[0] += 1.02"))
    planted = ran(tmp_path, "-DHERTZ=1000", LAW_EXAMPLE, LAW_SOURCE)
    assert (
        max(abs(planted[name] - value) for name, value in zip(HFA_STATES, known, strict=True))
        > 3e-3 * size
    )
