"""The FMU in FMPy: its validator, its simulation against ours, and what the library refuses."""

from __future__ import annotations

import shutil
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controller.export import fmu
from controller.export.c_model import CModel
from controller.export.fmu import description, variables, write_fmu
from controller.flight.closed_loop import CompiledLoop
from controller.flight.plants import NonlinearPlant
from controller.flight.scenario import Scenario, loop_of
from controller.policy.policies import GainPolicy, gain_constants
from controller.policy.signals import Signal, zero
from hfa_model.aircraft import Aircraft
from hfa_model.provenance import Provenance
from hfa_model.support.errors import NoSolutionError
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES
from trim.linear.linearize import linearize
from trim.point.operating_point import OperatingPoint

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytestmark = pytest.mark.skipif(fmu.c_compiler() is None, reason="there is no C compiler")
SECONDS, STEP = 60.0, 0.001
START = {"speed": 69.0, "pitch_rate": 0.01}
ORIGIN = Provenance("hfa export", date="2026-09-21T14:13:20Z")


@pytest.fixture(scope="module")
def what(published_aircraft: Aircraft, point: OperatingPoint, gain: np.ndarray) -> CModel:
    return CModel(published_aircraft, linearize(published_aircraft, point), gain, "from <here> & now")


@pytest.fixture(scope="module", params=[False, True], ids=["aircraft", "with policy"])
def unit(request: pytest.FixtureRequest, what: CModel, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bool]:
    path = tmp_path_factory.mktemp("fmu") / "aircraft.fmu"
    write_fmu(what, path, ORIGIN, with_policy=request.param)
    return path, request.param


def ours(what: CModel, with_policy: bool) -> np.ndarray:
    """States each tenth of a second, (601, 7): the policy follows a speed 0.5 ft/s above trim."""
    point = what.model.point
    initial = np.array([START.get(name, value) for name, value in point.states._asdict().items()]) - point.states
    follow = zero(len(LINEAR_STATES))
    if with_policy:
        follow = Signal(np.eye(6)[0] * 0.5, np.zeros(6), ())
    scenario = Scenario(duration=SECONDS, step=STEP, tick=0.1, initial=initial, reference=follow)
    loop = loop_of(NonlinearPlant(what.aircraft, point), GainPolicy(zero(len(INPUTS))), scenario, point)
    constants = gain_constants(what.gain if with_policy else np.zeros((5, 6)))
    flight = CompiledLoop(loop).fly(
        initial, lambda _: constants, step=STEP, steps_per_tick=100, ticks=600, compile_code=False
    )
    return np.asarray(flight.states[::100] + np.array(point.states))


def test_60_seconds_are_ours(unit: tuple[Path, bool], what: CModel) -> None:
    path, with_policy = unit
    start: dict[str, Any] = START | ({"reference_speed": 0.5} if with_policy else {})
    known = ours(what, with_policy)
    for kind, solver in (("CoSimulation", {}), ("ModelExchange", {"relative_tolerance": 1e-12})):
        found = fmpy.simulate_fmu(
            str(path), fmi_type=kind, stop_time=SECONDS, output_interval=0.1, start_values=start, **solver
        )
        states = np.array([found[name] for name in STATES]).T
        np.testing.assert_allclose(states, known, rtol=1e-8, atol=1e-8, err_msg=kind)
    assert abs(known[-1, 0] - known[0, 0]) > 0.1  # it moved


def test_the_validator_is_content(unit: tuple[Path, bool]) -> None:
    path, with_policy = unit
    assert fmpy.validation.validate_fmu(str(path)) == []
    read = fmpy.read_model_description(str(path))
    assert {each.name: each.unit for each in read.modelVariables}["speed"] == "ft/s"
    assert ("reference_speed" in {each.name for each in read.modelVariables}) == with_policy
    with zipfile.ZipFile(path) as archive:
        assert {Path(name).parts[0] for name in archive.namelist()} == {
            *("modelDescription.xml", "binaries", "resources", "sources")
        }
        assert {each.date_time for each in archive.infolist()} == {(2026, 9, 21, 14, 13, 20)}


def test_a_planted_fault_is_seen_by_the_validator(what: CModel, tmp_path: Path) -> None:
    text = description(what, ORIGIN, "0", with_policy=False).replace('<Unit name="ft/s">', '<Unit name="knot">')
    with zipfile.ZipFile(tmp_path / "wrong.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", text)
    assert fmpy.validation.validate_fmu(str(tmp_path / "wrong.fmu"))


def test_a_state_is_kept_and_a_wrong_guid_refused(unit: tuple[Path, bool], tmp_path: Path) -> None:
    path, _ = unit
    read, folder = fmpy.read_model_description(str(path)), fmpy.extract(str(path), str(tmp_path / "unit"))
    instance = fmpy.instantiate_fmu(folder, read, "CoSimulation")
    instance.setupExperiment(startTime=0.0)
    instance.enterInitializationMode()
    instance.exitInitializationMode()
    instance.doStep(0.0, 0.5)
    kept, seen = instance.getFMUState(), instance.getReal(range(26))
    kept = instance.deserializeFMUState(instance.serializeFMUState(kept))
    instance.doStep(0.5, 0.5)
    assert instance.getReal(range(26)) != seen
    instance.setFMUState(kept)
    assert instance.getReal(range(26)) == seen
    for call in (
        lambda: instance.setReal([7], [0.0]),
        lambda: instance.getReal([26]),
        lambda: instance.getInteger([0]),
        lambda: instance.doStep(1.0, -1.0),
    ):
        with pytest.raises(Exception, match="status 3"):
            call()
    instance.freeInstance()
    read.guid = "another"
    with pytest.raises(Exception, match="instantiate"):
        fmpy.instantiate_fmu(folder, read, "CoSimulation")


def test_variables_are_in_order(what: CModel) -> None:
    listed = variables(what, True)
    assert [each.reference for each in listed] == list(range(26))
    assert [each.name for each in listed if each.rate_of == 7] == ["der(dihedral_rate)"]


def test_the_sources_have_no_warning(unit: tuple[Path, bool], tmp_path: Path) -> None:
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no gcc")
    with zipfile.ZipFile(unit[0]) as archive:
        archive.extractall(tmp_path)
    words = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only", "fmi2_aircraft.c"]
    assert subprocess.run([compiler, *words], cwd=tmp_path / "sources", capture_output=True).stderr == b""


@pytest.mark.parametrize(("compiler", "said"), [(None, "needs a C compiler"), ("/bin/false", "cannot compile the FMU")])
def test_without_a_compiler_nothing_is_written(
    compiler: str | None, said: str, what: CModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fmu, "c_compiler", lambda: compiler)
    with pytest.raises(NoSolutionError, match=said):
        write_fmu(what, tmp_path / "a.fmu", ORIGIN, with_policy=False)
    assert list(tmp_path.iterdir()) == []
