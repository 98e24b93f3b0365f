"""FMUs as aircraft: a pendulum written in C, and the FMU that `hfa export` writes."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import zipfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa as run

import hfa

COMPILER = shutil.which("cc")
REFERENCE = os.environ.get("REFERENCE_FMUS")
pytestmark = [
    pytest.mark.skipif(COMPILER is None, reason="there is no C compiler"),
    pytest.mark.usefixtures("folder"),
]
SOURCE = Path(__file__).with_name("pendulum.c")
#: Variables: name -> (value reference, attributes of FMI 2.0, start value, unit).
VARIABLES = {
    "body.angle": (0, 'causality="local" variability="continuous" initial="exact"', 0.3, "rad"),
    "rate": (1, 'causality="local" variability="continuous" initial="exact"', 0.0, "rad/s"),
    "torque": (2, 'causality="input" variability="continuous"', 0.0, "1/s2"),
    "length": (4, 'causality="parameter" variability="tunable" initial="exact"', 2.0, "m"),
    "damping": (5, 'causality="parameter" variability="tunable" initial="exact"', 0.5, "1/s"),
    "der(body.angle)": (6, 'causality="local" variability="continuous"', None, ""),
    "der(rate)": (7, 'causality="local" variability="continuous"', None, ""),
    "height": (8, 'causality="output" variability="continuous"', None, "m"),
}
_STATES = {"der(body.angle)": "body.angle", "der(rate)": "rate"}


def description(version: int, has_derivatives: bool, events: int = 0) -> str:
    """Return modelDescription.xml of the pendulum."""
    provides = (
        f'providesDirectionalDerivative{"s" * (version == 3)}="{str(has_derivatives).lower()}"'
    )
    exchange = f'<ModelExchange modelIdentifier="pendulum" {provides}/>'
    names = list(VARIABLES)
    lines, units = [], sorted({unit for *_, unit in VARIABLES.values() if unit})
    for name, (reference, how, start, unit) in VARIABLES.items():
        given = f'start="{start}" ' * (start is not None) + f'unit="{unit}" ' * bool(unit)
        if name in _STATES:
            state = _STATES[name]
            given += (
                f'derivative="{VARIABLES[state][0] if version == 3 else names.index(state) + 1}"'
            )
        head = f'name="{name}" valueReference="{reference}" {how}'
        lines.append(
            f"<Float64 {head} {given}/>"
            if version == 3
            else f"<ScalarVariable {head}><Real {given}/></ScalarVariable>"
        )
    if version == 3:
        unknowns = '<Output valueReference="8"/>' + "".join(
            f'<ContinuousStateDerivative valueReference="{each}"/>' for each in (6, 7)
        )
        unknowns += "".join(f'<InitialUnknown valueReference="{each}"/>' for each in (6, 7, 8))
        unknowns += '<EventIndicator valueReference="8"/>' * events
        head = 'fmiVersion="3.0" instantiationToken="{1}"'
    else:
        unknown = '<Unknown index="{}"/>'.format
        unknowns = (
            f"<Outputs>{unknown(8)}</Outputs><Derivatives>{unknown(6)}{unknown(7)}</Derivatives>"
            f"<InitialUnknowns>{unknown(6)}{unknown(7)}{unknown(8)}</InitialUnknowns>"
        )
        head = f'fmiVersion="2.0" guid="{{1}}" numberOfEventIndicators="{events}"'
    defined = "".join(f'<Unit name="{unit}"/>' for unit in units)
    return (
        f'<fmiModelDescription {head} modelName="pendulum">{exchange}<UnitDefinitions>{defined}'
        f"</UnitDefinitions><ModelVariables>{''.join(lines)}</ModelVariables>"
        f"<ModelStructure>{unknowns}</ModelStructure></fmiModelDescription>"
    )


@cache
def library(*flags: str) -> bytes:
    """Return the compiled pendulum."""
    words = [COMPILER, "-shared", "-fPIC", "-O1", "-w", *flags, str(SOURCE), "-lm"]
    made = Path(f"pendulum{'_'.join(flags)}.so").absolute()
    subprocess.run([*words, "-o", str(made)], check=True)
    return made.read_bytes()


def fmu(version: int = 2, has_derivatives: bool = False, *flags: str, **changed: str) -> str:
    """Write the FMU of the pendulum to a file of the working folder, and return its path."""
    flags += ("-DFMI3",) * (version == 3) + ("-DDERIVATIVES",) * has_derivatives
    folder = "x86_64-linux" if version == 3 else "linux64"
    with zipfile.ZipFile("pendulum.fmu", "w") as archive:
        text = changed.get("description", description(version, has_derivatives))
        archive.writestr("modelDescription.xml", text)
        archive.writestr(f"binaries/{changed.get('folder', folder)}/pendulum.so", library(*flags))
    return "pendulum.fmu"


@pytest.mark.parametrize("has_derivatives", [True, False])
@pytest.mark.parametrize("version", [2, 3])
def test_trim_and_linear_model_of_a_pendulum(version: int, has_derivatives: bool) -> None:
    """sin(angle) = torque length / gravity at the trim; A, B and C are those of the equations."""
    model = hfa.load_model(fmu(version, has_derivatives)).with_parameters(length=1.0)
    assert (model.states["body_angle"].unit, list(model.parameters)) == (
        "rad",
        ["length", "damping"],
    )
    point = hfa.trim(model, hold={"torque": 1.5})
    angle = math.asin(1.5 / 9.81)
    assert point["body_angle"] == pytest.approx(angle, abs=1e-9)
    linear = hfa.linearize(model, point, outputs=("height",))
    tolerance = 1e-12 if has_derivatives else 1e-8
    np.testing.assert_allclose(
        linear.A, [[0.0, 1.0], [-9.81 * math.cos(angle), -0.5]], atol=tolerance
    )
    np.testing.assert_allclose(linear.B, [[0.0], [1.0]], atol=tolerance)
    np.testing.assert_allclose(linear.C, [[math.sin(angle), 0.0]], atol=tolerance)
    said = point.report().text()
    assert ("exact, by the FMU" in said, "steps 1e-05" in said) == (
        has_derivatives,
        not has_derivatives,
    )


def test_wrong_derivatives_of_an_fmu_are_doubted() -> None:
    """The report of a trim says that derivatives of the FMU are 10 % off its rates."""
    point = hfa.trim(hfa.load_model(fmu(2, True, "-DSCALE=1.1")))
    assert "differ from differences of its rates by 0.1" in point.report().text()


def test_the_exported_aircraft_is_the_aircraft() -> None:
    """Trim, outputs, A and B of the FMU that `hfa export` writes are those of the aircraft."""
    assert run("export", "--dihedral", "10", "-o", "aircraft.fmu").code == 0
    aircraft = hfa.aircraft()
    of_model = hfa.trim(aircraft, dihedral=math.radians(10.0))
    held = {name: of_model[name] for name in ("speed", "gamma", "altitude", "dihedral")}
    held["aileron_center"] = of_model["aileron_center"]
    model = hfa.load_model("aircraft.fmu")
    free = ["throttle", "aileron_outer", "elevator_center", "elevator_outer"]
    of_fmu = hfa.trim(model, hold=held, free=free)
    assert list(model.outputs) == list(aircraft.outputs)
    for name in of_model:
        assert model.unit(name) == aircraft.unit(name)
        assert of_fmu[name] == pytest.approx(of_model[name], rel=1e-9, abs=1e-9), name
    ours, theirs = of_model.linearize(), of_fmu.linearize()
    rows = [theirs.states.index(name) for name in ours.states]
    columns = [theirs.inputs.index(name) for name in ours.inputs]
    scale = np.abs(ours.A).max()
    np.testing.assert_allclose(theirs.A[np.ix_(rows, rows)], ours.A, rtol=1e-7, atol=1e-9 * scale)
    np.testing.assert_allclose(theirs.B[np.ix_(rows, columns)], ours.B, rtol=1e-6, atol=1e-7)


def test_an_fmu_flies_and_its_game_is_solved() -> None:
    """The commands that need numbers alone accept an FMU; the LQR cost of a flight is x'Px."""
    given = ("--aircraft", fmu(), "--Q", "1,1", "--R", "1")
    assert run("solve", *given, "-o", "K.npz").code == 0
    assert run("verify", *given, "--weights", "K.npz").out.startswith("PASS")
    flight = run("fly", *given, "--initial", "body_angle=0.05", "--duration", "40", "--json", "-q")
    P = np.load("K.npz")["P"]
    expected = math.radians(0.05) ** 2 * P[0, 0]
    assert json.loads(flight.out)["cost"] == pytest.approx(expected, rel=1e-4)
    assert flight.err == ""  # nothing is compiled again
    assert run("sweep", *given[:2], "--hold", "length=1:3:1").code == 0


EVENTS = {"description": description(2, False, events=1)}
EVENTS_3 = {"description": description(3, False, events=1)}
REFUSED = {
    "events": (2, EVENTS, "events"),
    "events of FMI 3": (3, EVENTS_3, "events"),
    "co-simulation": (
        2,
        {"description": description(2, False).replace("ModelExchange", "CoSimulation")},
        "model exchange",
    ),
    "FMI 1": (2, {"description": description(2, False).replace('"2.0"', '"1.0"')}, "FMI 1.0"),
    "another system": (2, {"folder": "win32"}, "no library for this system"),
    "damaged": (2, {"description": "<fmi"}, "damaged"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_an_unsuitable_fmu_is_refused(case: str) -> None:
    """FMUs with events, without model exchange or without a library are refused in one line."""
    version, changed, said = REFUSED[case]
    assert_refused(run("trim", "--aircraft", fmu(version, **changed)), 2, said)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("optimize --start body_angle=5 --Q 1,1 --R 1", "the equations call a compiled function"),
        ("export -o folder", "cannot be written as C"),
        ("solve --Q 1,1 --R 1 --order 3", "has no power series"),
    ],
)
def test_commands_that_need_equations_refuse_an_fmu(words: str, said: str) -> None:
    """Best flights, exported code and power series of an FMU are refused in one line."""
    assert_refused(run(*words.split(), "--aircraft", fmu(), "-q"), 2, said)
    assert not Path("folder").exists()


def test_a_data_file_executes_no_fmu() -> None:
    """A file of parameters that names an FMU as its aircraft is refused; no zip file is no FMU."""
    Path("changed.toml").write_text('aircraft = "pendulum.fmu"\n[parameters]\nlength = 3.0\n')
    fmu()
    assert_refused(run("trim", "--aircraft", "changed.toml"), 2, "executes none")
    Path("text.fmu").write_text("no archive")
    assert_refused(run("trim", "--aircraft", "text.fmu"), 2, "not an FMU")


@pytest.mark.skipif(REFERENCE is None, reason="REFERENCE_FMUS names no folder of reference FMUs")
def test_reference_fmus_are_read_or_refused() -> None:
    """A of VanDerPol and Dahlquist at rest; BouncingBall has events.

    The folder REFERENCE_FMUS contains the FMUs of github.com/modelica/Reference-FMUs as NAME.fmu,
    of FMI 2.0 or 3.0. No package of PyPI contains them.
    """
    for name, A in (("VanDerPol", [[0.0, 1.0], [-1.0, 1.0]]), ("Dahlquist", [[-1.0]])):
        model = hfa.load_model(f"{REFERENCE}/{name}.fmu")
        linear = hfa.linearize(model, hfa.trim(model))
        assert linear.A.tolist() == pytest.approx(np.array(A), abs=1e-8)
    assert_refused(run("trim", "--aircraft", f"{REFERENCE}/BouncingBall.fmu"), 2, "events")
