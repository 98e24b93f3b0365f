"""Exported FMUs in FMPy: validation, simulation compared with the product, and refused calls."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from c_files import compiled, needs_gcc
from controllers import integrating_controller

from hfa import OperatingPoint
from hfa_aircraft.model import Model
from hfa_flight import ActuatorBank, CommandSteps, GainPolicy, Policy, Scenario, Waveform
from hfa_flight.closed_loop import ClosedLoop, NonlinearPlant
from hfa_flight.export import fmu
from hfa_flight.export.controller_c import controller_steering
from hfa_flight.export.exported_loop import (
    ExportedLoop,
    exported_loop,
    following_a_reference,
)
from hfa_flight.export.fmu import description, write_fmu
from hfa_flight.policies.controller import servo_policy
from hfa_flight.signals import CommandedStates
from hfa_flight.simulation import CompiledLoop
from hfa_model import LINEAR_STATES, STATES, Input
from hfa_support.provenance import Provenance

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytest.importorskip("fmpy.validation")  # not loaded with FMPy
pytestmark = pytest.mark.skipif(fmu.c_compiler() is None, reason="there is no C compiler")
SECONDS = 60.0
STEP = 0.001
START = {"speed": 69.0, "pitch_rate": 0.01}
ORIGIN = Provenance("hfa export", date="2026-09-21T14:13:20Z")


ACTUATORS = ActuatorBank(
    Input(*[0.5] * 5), Input(*[-50.0] * 5), Input(*[50.0] * 5), Input(*[0.1] * 5), order=2
)


class Unit(NamedTuple):
    """An exported FMU, and the product's simulation of the same flight.

    known: states every 0.1 s, (601, 7)
    """

    kind: str
    path: Path
    loop: ExportedLoop
    start: dict[str, float]
    known: np.ndarray


@pytest.fixture(
    scope="module", params=["aircraft", pytest.param("gain", marks=pytest.mark.slow), "controller"]
)
def unit(
    request: pytest.FixtureRequest,
    published_aircraft: Model,
    point: OperatingPoint,
    gain: np.ndarray,
    tmp_path_factory: pytest.TempPathFactory,
) -> Unit:
    kind = request.param
    path = tmp_path_factory.mktemp("fmu") / "aircraft.fmu"
    aircraft = published_aircraft
    law = GainPolicy("none", 0.0 * gain)
    start = {}
    happens = {}
    exported = []
    if kind == "gain":
        law = GainPolicy("exact", gain)
        start = {"reference_speed": 0.5}
        exported = [following_a_reference(aircraft, law)]
        happens = {"reference": Waveform(np.eye(6)[0] * 0.5, np.zeros(6))}
    elif kind == "controller":
        controller = integrating_controller(aircraft, W=np.full((3, 1, 1), 0.1))
        commands = CommandSteps(("dihedral",), np.zeros(1), np.array([[0.02]]))
        law = servo_policy(controller, commands, aircraft, point)
        start = {"command_dihedral": 0.02}
        exported = [controller_steering(controller, aircraft, point), ACTUATORS]
        happens = {"reference": CommandedStates(commands, LINEAR_STATES), "actuators": ACTUATORS}
    loop = exported_loop(aircraft, point, *exported)
    write_fmu(loop, path, ORIGIN)
    return Unit(kind, path, loop, START | start, simulated_states(aircraft, point, law, **happens))


def simulated_states(
    aircraft: Model, point: OperatingPoint, law: Policy, **happens: Any
) -> np.ndarray:
    initial = (
        np.array([START.get(name, value) for name, value in point.states._asdict().items()])
        - point.states
    )
    scenario = Scenario(duration=SECONDS, step=STEP, tick=0.1, initial=initial, **happens)
    flight = CompiledLoop(ClosedLoop(NonlinearPlant(aircraft, point), law, scenario)).fly()
    return np.asarray(flight.states[::100] + np.array(point.states))


def test_60_seconds_in_fmpy_equal_the_simulation(unit: Unit) -> None:
    """FMPy and the product simulate equal states for 60 s, in co-simulation and in model exchange."""
    assert len(unit.known) == 601
    for kind, solver in (("CoSimulation", {}), ("ModelExchange", {"relative_tolerance": 1e-12})):
        found = fmpy.simulate_fmu(
            str(unit.path),
            fmi_type=kind,
            stop_time=SECONDS,
            output_interval=0.1,
            start_values=unit.start,
            **solver,
        )
        states = np.array([found[name] for name in STATES]).T
        np.testing.assert_allclose(states, unit.known, rtol=1e-8, atol=1e-8, err_msg=kind)
    assert abs(unit.known[-1, 0] - unit.known[0, 0]) > 0.1  # it moved


def test_fmpys_validator_accepts_the_fmu(unit: Unit, tmp_path: Path) -> None:
    """FMPy's validator accepts the FMU and reports a planted wrong unit."""
    path = unit.path
    assert fmpy.validation.validate_fmu(str(path)) == []
    read = fmpy.read_model_description(str(path))
    units = {each.name: each.unit for each in read.modelVariables}
    assert units["speed"] == "ft/s"
    assert ("reference_speed" in units) == (unit.kind == "gain")
    assert ("controller_dihedral_integral" in units) == (unit.kind == "controller")
    assert units.get("command_dihedral", "rad") == "rad"
    with zipfile.ZipFile(path) as archive:
        assert {Path(name).parts[0] for name in archive.namelist()} == {
            *("modelDescription.xml", "binaries", "resources", "sources")
        }
        assert {each.date_time for each in archive.infolist()} == {(2026, 9, 21, 14, 13, 20)}
    text = description(unit.loop, ORIGIN, "0").replace('<Unit name="ft/s">', '<Unit name="knot">')
    with zipfile.ZipFile(tmp_path / "wrong.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", text)
    assert fmpy.validation.validate_fmu(str(tmp_path / "wrong.fmu"))


def test_saved_fmu_states_are_restored(unit: Unit, tmp_path: Path) -> None:
    """A saved state of the FMU is restored. Wrong calls and a wrong GUID are refused."""
    path = unit.path
    states = len(unit.loop.states)
    count = 2 * states + len(unit.loop.outputs) + len(unit.loop.inputs)
    read = fmpy.read_model_description(str(path))
    folder = fmpy.extract(str(path), str(tmp_path / "unit"))
    instance = fmpy.instantiate_fmu(folder, read, "CoSimulation")
    instance.setupExperiment(startTime=0.0)
    instance.enterInitializationMode()
    instance.exitInitializationMode()
    instance.doStep(0.0, 0.5)
    kept = instance.getFMUState()
    seen = instance.getReal(range(count))
    kept = instance.deserializeFMUState(instance.serializeFMUState(kept))
    instance.doStep(0.5, 0.5)
    assert instance.getReal(range(count)) != seen
    instance.setFMUState(kept)
    assert instance.getReal(range(count)) == seen
    for call in (
        lambda: instance.setReal([states], [0.0]),
        lambda: instance.getReal([count]),
        lambda: instance.getInteger([0]),
        lambda: instance.doStep(1.0, -1.0),
    ):
        with pytest.raises(Exception, match="status 3"):
            call()
    instance.freeInstance()
    read.guid = "another"
    with pytest.raises(Exception, match="instantiate"):
        fmpy.instantiate_fmu(folder, read, "CoSimulation")


@needs_gcc
def test_fmu_sources_compile_without_warnings(unit: Unit, tmp_path: Path) -> None:
    """The C sources in the FMU compile without warnings."""
    with zipfile.ZipFile(unit.path) as archive:
        archive.extractall(tmp_path)
    compiled(tmp_path / "sources", "-Wno-shadow", "-fsyntax-only", fmu.WRAPPER, fmu.SOURCE)
