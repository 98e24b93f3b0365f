"""What `hfa export` writes computes the numbers of the product: C source and FMUs."""

from __future__ import annotations

import math
import zipfile
from collections import namedtuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_files import called, compiled, needs_gcc, ran
from cli import hfa as command
from controllers import integrating_controller
from known_models import exact_gain, model_at

import hfa
from hfa_flight import (
    ActuatorBank,
    CommandedStates,
    CommandSteps,
    Scenario,
    Waveform,
    save_controller,
    servo_policy,
)
from hfa_model import LINEAR_STATES, STATES, Input

pytestmark = needs_gcc
#: Rate limit, deg/s, so low that the command of a controller reaches it.
RATE = 0.2
LAG = 0.2


def surfaces_bank(model: hfa.Model) -> ActuatorBank:
    """Return the actuators of `--actuators LAG:RATE:2`: rate limits of the surfaces alone."""
    lowest, highest = (
        Input(*[getattr(signal, end) for signal in model.inputs.values()]) for end in ("min", "max")
    )
    rates = [
        math.radians(RATE) if signal.unit == "rad" else math.inf for signal in model.inputs.values()
    ]
    return ActuatorBank(Input(*[LAG] * 5), lowest, highest, Input(*rates), order=2)


def exported(*words: str) -> None:
    result = command("export", "--dihedral", "10", *words)
    assert result.code == 0, result.err


@pytest.fixture
def controller(folder: Path) -> Any:
    """Return a controller with memory that measures a rate, stored in servo.npz."""
    growing = np.array([0.5, 1.0, 2.0])[:, None, None]  # with the angle
    made = integrating_controller(
        model_at(10.0).point.model,
        measurements=("aileron_outer_rate", "dihedral"),
        C=-0.5 * growing,
        D=growing * np.array([0.05, -0.4, 0.4, 0.0]),
        W=np.full((3, 1, 1), 0.1),
    )
    save_controller("servo.npz", made)
    return made


def flown(policy: Any, seconds: float, *, commanded: float | None, **happens: Any) -> Any:
    """Return a flight from 1 ft/s above the trim speed at 10 deg, with a commanded dihedral."""
    point = model_at(10.0).point
    if commanded is not None:
        steps = CommandSteps(("dihedral",), np.zeros(1), np.array([[commanded]]))
        policy = servo_policy(policy, steps, point.model, point)
        happens |= {
            "reference": CommandedStates(steps, LINEAR_STATES),
            "actuators": surfaces_bank(point.model),
        }
    scenario = Scenario(seconds, 0.001, 0.1, np.eye(len(STATES))[0], **happens)
    return hfa.fly(point.model, point, policy, scenario=scenario, predict=False)


@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_exported_rates_equal_the_model(folder: Path, dynamics: str) -> None:
    """At random states, exported C code and the equations give equal state rates, with updrafts."""
    exported("--dynamics", dynamics, "-o", "c")
    place = folder / "c"
    compiled(place, "-shared", "-fPIC", "hfa_aircraft.c", "-o", "library.so")
    point = model_at(10.0, dynamics).point
    model = point.model
    winds = namedtuple("winds", tuple(model.disturbances))
    random = np.random.default_rng(5)
    for row in range(100):
        updraft = float(row % 5 - 2)
        x = np.array(point.states) + random.uniform(-0.2, 0.2, 7) * [9, 1, 99, 1, 1, 1, 1]
        u = np.array(point.inputs) + random.uniform(-0.2, 0.2, 5)
        w = winds(*(updraft if name == "updraft" else 0.0 for name in model.disturbances))
        rates, _ = model.equations(
            type(point.states)(*x), type(point.inputs)(*u), _parameters(model), w
        )
        dx = np.empty(7)
        called(place, "hfa_rates", x, u, np.array(w), dx)
        np.testing.assert_allclose(dx, [float(rates[name]) for name in STATES], rtol=1e-12)


def _parameters(model: hfa.Model) -> Any:
    return namedtuple("parameters", tuple(model.parameters))(*model.p.tolist())


def test_the_exported_loop_of_a_controller_agrees_with_its_flight(
    folder: Path, controller: Any
) -> None:
    """The program reaches the states of the flight after 20 s, extrapolated to ticks of 0.

    It holds the inputs during a tick, an error proportional to the tick. A wrong start is found.
    """
    exported("--controller", "servo.npz", "--actuators", f"{LAG}:{RATE}:2", "-o", "c")
    known = flown(controller, 20.0, commanded=0.01).states[-1]
    size = np.abs(known - np.array(model_at(10.0).point.states)).max()
    assert size > 0.1

    def states(hertz: int) -> np.ndarray:
        said = ran(folder / "c", f"-DHERTZ={hertz}", "controller_100hz.c", "hfa_controller.c")
        return np.array([said[name] for name in STATES])

    coarse, fine = states(100), states(1000)
    assert np.abs(coarse - known).max() < 0.03 * size
    assert np.abs((10 * fine - coarse) / 9 - known).max() < 1e-4 * size
    program = folder / "c" / "controller_100hz.c"
    program.write_text(program.read_text().replace("flown[0] += 1.0", "flown[0] += 1.02"))
    assert np.abs(states(1000) - known).max() > 3e-3 * size


@pytest.mark.parametrize(
    "kind", ["aircraft", pytest.param("gain", marks=pytest.mark.slow), "controller"]
)
def test_an_fmu_simulates_the_flight_in_fmpy(
    folder: Path, kind: str, request: pytest.FixtureRequest
) -> None:
    """Co-simulation and model exchange of 20 s; FMPy's validator accepts the FMU."""
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    validation = pytest.importorskip("fmpy.validation")
    start = {"speed": model_at(10.0).point["speed"] + 1.0}
    if kind == "aircraft":
        exported("-o", "a.fmu")
        flight = flown(None, 20.0, commanded=None)
    elif kind == "gain":
        exported("--law", "exact", "-o", "a.fmu")
        start["reference_speed"] = 0.9
        reference = Waveform(np.eye(6)[0] * 0.9, np.zeros(6))
        flight = flown(exact_gain(10.0), 20.0, commanded=None, reference=reference)
    else:
        controller = request.getfixturevalue("controller")
        exported("--controller", "servo.npz", "--actuators", f"{LAG}:{RATE}:2", "-o", "a.fmu")
        start["command_dihedral"] = 0.02
        flight = flown(controller, 20.0, commanded=0.02)
    assert validation.validate_fmu("a.fmu") == []
    units = {each.name: each.unit for each in fmpy.read_model_description("a.fmu").modelVariables}
    assert units["speed"] == "ft/s"
    assert ("reference_speed" in units) == (kind == "gain")
    assert ("controller_dihedral_integral" in units) == (kind == "controller")
    with zipfile.ZipFile("a.fmu") as archive:
        parts = {Path(name).parts[0] for name in archive.namelist()}
    assert parts == {"modelDescription.xml", "binaries", "resources", "sources"}
    every = round(0.1 / flight.step)
    known = flight.states[::every]
    for how, solver in (("CoSimulation", {}), ("ModelExchange", {"relative_tolerance": 1e-12})):
        found = fmpy.simulate_fmu(
            "a.fmu", fmi_type=how, stop_time=20.0, output_interval=0.1, start_values=start, **solver
        )
        states = np.array([found[name] for name in STATES]).T
        np.testing.assert_allclose(states, known, rtol=1e-8, atol=1e-8, err_msg=how)
    assert abs(known[-1, 0] - known[0, 0]) > 0.1
