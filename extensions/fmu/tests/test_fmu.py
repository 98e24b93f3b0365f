"""FMUs as aircraft: a pendulum written in C, and the FMU that `hfa export` writes."""

import json
import math
import re
import shutil
import subprocess
import zipfile
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cli import SCRIPT, assert_refused, hfa as run
from scipy.integrate import solve_ivp

import hfa

COMPILER = shutil.which("cc") or ""
pytestmark = [
    pytest.mark.skipif(not COMPILER, reason="there is no C compiler"),
    pytest.mark.usefixtures("folder"),
]
#: angle' = rate, rate' = torque - (9.81 / length) sin(angle) - damping rate. Its head lists faults.
SOURCE = Path(__file__).with_name("pendulum.c")
#: Variables: name -> (value reference, attributes of FMI 2.0, start value, unit).
VARIABLES = {
    "body.angle": (0, 'causality="local" variability="continuous" initial="exact"', 0.3, "rad"),
    "rate": (1, 'causality="local" variability="continuous" initial="exact"', 0.0, "rad/s"),
    "torque": (2, 'causality="input"', 0.0, "1/s2"),
    "length": (4, 'causality="parameter" variability="tunable" initial="exact"', 2.0, "m"),
    "damping": (5, 'causality="parameter" variability="tunable" initial="exact"', 0.5, "1/s"),
    "der(body.angle)": (6, 'causality="local" variability="continuous"', None, ""),
    "der(rate)": (7, 'causality="local" variability="continuous"', None, ""),
    "height": (8, 'causality="output" variability="continuous"', None, "m"),
}
_STATES = {"der(body.angle)": "body.angle", "der(rate)": "rate"}


def description(version=2, fault="", has_derivatives=False, **of_variables):
    """Return modelDescription.xml of the pendulum.

    fault: faults and variants in pendulum.c
    of_variables: name of a variable, with "_" for other characters -> its attributes
    """
    provides = (
        f'providesDirectionalDerivative{"s" * (version == 3)}="{str(has_derivatives).lower()}"'
    )
    exchange = f'<ModelExchange modelIdentifier="pendulum" {provides}/>'
    names = list(VARIABLES)
    lines, units = [], sorted({unit for *_, unit in VARIABLES.values() if unit})
    for name, (reference, usual, start, unit) in VARIABLES.items():
        how = of_variables.get(name.replace(".", "_"), usual)
        given = f'start="{start}" ' * (start is not None)
        # The angle has its unit by its type.
        given += f'declaredType="{name}" ' if unit == "rad" else f'unit="{unit}" ' * bool(unit)
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
    event = "event" in fault
    # The declared dependencies are too sparse: no rate depends on the torque.
    if version == 3:
        unknowns = '<Output valueReference="8"/>' + "".join(
            f'<ContinuousStateDerivative valueReference="{each}" dependencies="1"/>'
            for each in (6, 7)
        )
        unknowns += "".join(f'<InitialUnknown valueReference="{each}"/>' for each in (6, 7, 8))
        unknowns += '<EventIndicator valueReference="8"/>' * event
        head = f'fmiVersion="3.0" instantiationToken="{fault}"'
        typed = '<Float64Type name="body.angle" unit="rad" min="-1.5"/>'
    else:
        unknown = '<Unknown index="{}" dependencies="2"/>'.format
        unknowns = (
            f"<Outputs>{unknown(8)}</Outputs><Derivatives>{unknown(6)}{unknown(7)}</Derivatives>"
            f"<InitialUnknowns>{unknown(6)}{unknown(7)}{unknown(8)}</InitialUnknowns>"
        )
        head = f'fmiVersion="2.0" guid="{fault}" numberOfEventIndicators="{int(event)}"'
        typed = '<SimpleType name="body.angle"><Real unit="rad" min="-1.5"/></SimpleType>'
    defined = "".join(f'<Unit name="{unit}"/>' for unit in units)
    return (
        f'<fmiModelDescription {head} modelName="pendulum">{exchange}<UnitDefinitions>{defined}'
        f"</UnitDefinitions><TypeDefinitions>{typed}</TypeDefinitions>"
        f"<ModelVariables>{''.join(lines)}</ModelVariables>"
        f"<ModelStructure>{unknowns}</ModelStructure></fmiModelDescription>"
    )


@cache
def library(version):
    """Return the compiled pendulum."""
    words = [COMPILER, "-shared", "-fPIC", "-O1", "-w", *["-DFMI3"] * (version == 3), str(SOURCE)]
    made = Path(f"pendulum{version}.so").absolute()
    subprocess.run([*words, "-lm", "-o", str(made)], check=True, timeout=120)
    return made.read_bytes()


def fmu(fault="", version=2, has_derivatives=False, folder="", name="pendulum.fmu", **of_variables):
    """Write the FMU of the pendulum, by default of length 2 and damping .5, and return its path.

    fault: faults and variants of pendulum.c
    """
    text = description(version, fault, has_derivatives, **of_variables)
    return packed(text, version, folder, name)


#: Version of FMI -> folder of a library for this system.
FOLDERS = {2: "linux64", 3: "x86_64-linux"}


def packed(text, version=2, folder="", name="pendulum.fmu"):
    """Write an FMU with the library of the pendulum.

    folder: folder of the library, of another system; by default that of this one
    """
    folder = folder or FOLDERS[version]
    with zipfile.ZipFile(name, "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.writestr(f"binaries/{folder}/pendulum.so", library(version))
    return name


def unwrapped(text):
    """Return a text without its line breaks."""
    return " ".join(text.split())


def by_turns(kinds):
    """Return each kind with FMI 2 and 3, in turn: one of the two cases is marked as slow."""
    return [
        pytest.param(kind, version, marks=pytest.mark.slow if (place + version) % 2 else ())
        for place, kind in enumerate(kinds)
        for version in (2, 3)
    ]


@pytest.mark.parametrize(("has_derivatives", "version"), by_turns([True, False]))
def test_trim_and_linear_model_of_a_pendulum(has_derivatives, version):
    """rate' = torque - 9.81 sin(angle) - .5 rate, of length 1: sin(angle) = 1.5 / 9.81 at the trim.

    A, B and C of the height -cos(angle) follow, exact with derivatives of the FMU.
    """
    written = fmu("", version, has_derivatives)
    model = hfa.load_model(written).with_parameters(length=1.0)
    assert model.states["body_angle"].unit == "rad"
    assert list(model.parameters) == ["length", "damping"]
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
    # Without derivatives of the FMU, differences with these steps h: the error h² / 6 is rounding.
    error = re.search(r"steps 2e-06 .* error\s+about (\S+)", said, re.S)
    assert ("exact, by the FMU" in said) == has_derivatives == (error is None)
    assert error is None or float(error[1]) < 1e-8
    assert "as continuous" not in said
    assert "derivatives of the FMU differ" not in said


def test_names_that_become_alike_are_told_apart():
    """body.angle and body_angle have different names, and a note says which is which."""
    text = description().replace('name="rate"', 'name="body_angle"')
    model = hfa.load_model(packed(text))
    assert list(model.states) == ["body_angle", "body_angle_"]
    note = "names alike: body_angle is body.angle, body_angle_ is body_angle"
    assert note in model.about.notes
    assert not any("alike" in each for each in hfa.load_model(fmu()).about.notes)


def test_a_prefix_of_all_states_is_left_out_of_their_names():
    """The states plane[1].body.angle and plane[1].body.rate of the FMU become angle and rate, and keep
    their full names if an output has the name angle.
    """
    text = description().replace('name="body.angle"', 'name="plane[1].body.angle"')
    text = text.replace('name="rate"', 'name="plane[1].body.rate"')
    model = hfa.load_model(packed(text))
    assert list(model.states) == ["angle", "rate"]
    typed = ("plane[1].body.angle", "plane_1_body_angle", "angle")
    assert {model.about.name_of(name) for name in typed} == {"angle"}
    text = text.replace('name="height"', 'name="angle"')
    states = hfa.load_model(packed(text)).states
    assert list(states) == ["plane_1_body_angle", "plane_1_body_rate"]


def test_wrong_derivatives_of_an_fmu_have_a_warning():
    """A derivative that the FMU gives 10 % too large ("scaled") has a warning in the report."""
    point = hfa.trim(hfa.load_model(fmu("scaled", has_derivatives=True)))
    assert "differ from differences of its rates by 0.1" in point.report().text()


@pytest.mark.slow
def test_an_exported_fmu_has_the_trim_and_model_of_its_aircraft():
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


@pytest.mark.slow
def test_a_flight_of_an_fmu_costs_the_exact_value():
    """A flight with the exact gain from x = (.05 deg, 0) costs x'Px, with P of the exact solution."""
    given = ("--aircraft", fmu(), "--Q", "1,1", "--R", "1")
    assert run("solve", *given, "-o", "K.npz").code == 0
    words = "--policy exact --initial body_angle=0.05 --duration 40 --json -q"
    flight = run("fly", *given, *words.split())
    P = np.load("K.npz")["P"]
    expected = math.radians(0.05) ** 2 * P[0, 0]
    assert json.loads(flight.out)["cost"] == pytest.approx(expected, rel=1e-4)


SUITABLE = description()
UNSUITABLE = {
    "co-simulation": (SUITABLE.replace("ModelExchange", "CoSimulation"), "model exchange"),
    "FMI 1": (SUITABLE.replace('"2.0"', '"1.0"'), "FMI 1.0"),
    "damaged": ("<fmi", "not valid XML"),
    "no number": (SUITABLE.replace('start="0.3"', 'start="often"'), "often"),
    "too many states": (
        SUITABLE.replace(
            "</ModelVariables>",
            "".join(
                f'<ScalarVariable name="x{i}" valueReference="{100 + i}" causality="input"><Real '
                'start="0"/></ScalarVariable>'
                for i in range(20_000)
            )
            + "</ModelVariables>",
        ),
        "2000",
    ),
    "no states": (SUITABLE.replace("Derivatives>", "Others>"), "no continuous states"),
    "whole": (re.sub('<Real( [^>]*"rad/s")', r"<Integer\1", SUITABLE), "rate is Integer"),
}


@pytest.mark.parametrize("case", UNSUITABLE)
def test_an_unsuitable_fmu_is_refused(case):
    """Other kinds of FMUs and damaged ones are refused in one line."""
    text, said = UNSUITABLE[case]
    assert_refused(run("trim", "--aircraft", packed(text)), 2, said)


def test_an_fmu_for_another_system_is_refused():
    """An FMU for another system is refused with the system that it supports."""
    assert_refused(run("trim", "--aircraft", fmu(folder="win32")), 2, "this system (found: win32)")


#: Fault of pendulum.c -> words of `hfa`, and the reason in its line. Calls fail at angles above 1
#: rad, as 70 deg; an event is at .5 rad, as before 40 deg.
FAILURES = {
    "error": ("trim --hold body_angle=70", "returns error (fallen over)"),
    "discard": ("linearize --hold body_angle=70", "returns discard"),
    "timed": ("trim --hold torque=1", "depend on time"),
    "event jump": ("trim --hold body_angle=40 --hold rate=1", "changes its states"),
    "unready": ("trim", "ExitInitializationMode returns discard"),
    "endless": ("trim", "100 iterations"),
    "dead": ("trim", "ends the process"),
    "stuck": ("trim", "does not return within"),
}


@pytest.mark.parametrize(("fault", "version"), by_turns(FAILURES))
def test_a_failure_of_the_library_is_refused_in_one_line(fault, version, monkeypatch):
    """A failed call is refused in one line, and nothing is printed on standard output."""
    if fault == "stuck":  # only this call lasts until the limit of time
        monkeypatch.setattr("hfa_fmu.read._LONGEST_RUN", 0.1)
    words, said = FAILURES[fault]
    # a trim at a held angle
    given = ["--free", "torque", "--free", "rate_dot"] if "body_angle" in words else []
    result = run(*words.split(), *given, "--aircraft", fmu(fault, version))
    assert_refused(result, 2, said)


@pytest.mark.parametrize(
    ("fault", "said", "angle", "units"),
    [("error", "returns error", 1.0, ("--units", "si")), ("event", "event", 0.5, ())],
)
def test_a_flight_into_a_failure_or_an_event_is_refused(fault, said, angle, units):
    """A flight from the angle 0 with 200 deg/s is refused where it reaches 1 rad, where calls fail, or
    .5 rad, where the event is. The refusal has the time: more than angle / rate, since gravity slows
    the pendulum, by at most 30 %.

    A flight that stays below passes. The FMU's height in ft makes `--units si` convert.
    """
    text = description(fault=fault).replace('unit="m"', 'unit="ft"')
    given = ("--aircraft", packed(text), *units, "--policy", "none", "--duration")
    refused = run("fly", *given, "2", "--initial", "rate=200")
    assert_refused(refused, 1, said)
    time = float(re.search(r"it is met at\s+([0-9.]+) s", refused.err)[1])
    assert 1.0 < time * np.radians(200.0) / angle < 1.3
    calm = run("fly", *given, "0.1", "--initial", "rate=1")
    assert calm.out.startswith("PASS")


@pytest.mark.parametrize("version", [2, 3])
def test_the_equations_after_an_event_are_linearized(version):
    """A has the damping .5 before an event at an angle of .5, and 1 after it; at the event there is
    no linear model.
    """
    model = hfa.load_model(fmu("event", version))
    assert not any("searches begin" in note for note in model.about.notes)
    for angle, damping in ((0.4, 0.5), (0.6, 1.0)):
        point = hfa.trim(model, hold={"body_angle": angle}, free=["torque"])
        assert point.linearize().A["rate", "rate"] == pytest.approx(-damping, abs=1e-8)
    point = hfa.trim(model, hold={"body_angle": 0.5}, free=["torque"])
    with pytest.raises(hfa.NoSolutionError, match=r"event indicator 1|height \(now"):
        point.linearize()


def test_differences_replace_derivatives_that_fail():
    """If the FMU's derivatives fail ("nodd"), the note has the failed call, and A and B are those of
    rate' = torque - (9.81 / 2) sin(angle) - .5 rate by differences.
    """
    point = hfa.trim(hfa.load_model(fmu("nodd", has_derivatives=True)))
    linear = point.linearize()
    pull = -9.81 / 2.0 * math.cos(point["body_angle"])
    np.testing.assert_allclose(linear.A, [[0.0, 1.0], [pull, -0.5]], atol=1e-8)
    np.testing.assert_allclose(linear.B, [[0.0], [1.0]], atol=1e-8)
    assert "fmi2GetDirectionalDerivative returns error" in unwrapped(point.report().text())


def added(version, head, kind, of_kind):
    """Return the entry of a variable that the pendulum has in addition."""
    if version == 3:
        return f"<{kind} {head} {of_kind}/>"
    return f"<ScalarVariable {head}><{kind} {of_kind}/></ScalarVariable>"


def with_parameters(version, kind="", causality="parameter"):
    """Return a pendulum with a fixed damping, a Boolean `the.moon` and a number of `links`.

    kind: FMI's type of the number of links
    causality: that of the two
    """
    text = description(version, damping='causality="parameter" variability="fixed" initial="exact"')
    how = f'causality="{causality}" variability="{"discrete" if causality == "input" else "fixed"}"'
    moon = added(version, f'name="the.moon" valueReference="3" {how}', "Boolean", 'start="false"')
    kind = kind or ("Integer" if version == 2 else "Int32")
    declared = 'start="1"' + ' declaredType="Links"' * (kind == "Enumeration")
    links = added(version, f'name="links" valueReference="10" {how}', kind, declared)
    items = "".join(
        f'<Item name="{name}" value="{value}"/>' for value, name in ((1, "a"), (4, "b"))
    )
    typed = {
        2: f'<SimpleType name="Links"><Enumeration>{items}</Enumeration></SimpleType>',
        3: f'<EnumerationType name="Links">{items}</EnumerationType>',
    }
    text = text.replace("</TypeDefinitions>", f"{typed[version]}</TypeDefinitions>")
    text = text.replace("</ModelVariables>", f"{moon}{links}</ModelVariables>")
    return packed(text, version)


@pytest.mark.parametrize("causality", ["parameter", "input"])
@pytest.mark.parametrize(("kind", "version"), by_turns(["", "Enumeration"]))
def test_parameters_of_all_types_are_held(version, kind, causality):
    """A fixed damping, the truth value `the.moon` and the whole number `links` are held.

    Gravity is 9.81, or 1.62 on the moon, divided by 4 links; the length is 2. Inputs of truth values
    and whole numbers are held like parameters.
    """
    model = hfa.load_model(with_parameters(version, kind, causality))
    names = ["torque", "length", "damping", "the_moon", "links"]
    assert [*model.inputs, *model.parameters] == names
    for moon, gravity in ((1, 1.62), (0, 9.81)):
        changed = model.with_parameters(the_moon=moon, damping=0.7, links=4)
        A = hfa.trim(changed).linearize().A
        np.testing.assert_allclose(A[1], [-gravity / 8.0, -0.7], atol=1e-8)


def test_a_parameter_that_is_a_whole_number_requires_one():
    """A truth value or whole number can be held at a whole number within its limits alone, and the
    report lists such parameters.
    """
    written = with_parameters(2)
    said = unwrapped(run("trim", "--full", "--aircraft", written, "--hold", "the_moon=1").out)
    assert "parameters that --hold sets: length, damping, the_moon, links" in said
    assert "whole numbers (1 is true, 0 false): the_moon, links" in said
    for typed, refusal in (
        ("the_moon=0.5", "the parameter the_moon is 0.5; hold it at a whole number"),
        ("links=1.5", "the parameter links is 1.5; hold it at a whole number"),
        ("links=3e9", "give at most"),
        ("the_moon=2", "give at most 1"),
        ("the_moon=true", "'true'; give a finite number (1 for true, 0 for false)"),
    ):
        assert_refused(run("trim", "--aircraft", written, "--hold", typed), 2, refusal)


def test_a_derivative_by_a_whole_number_is_nan():
    """Derivatives of the rates by `the.moon` and `links` are not a number. Those by states, input,
    length (9.81 / length² sin(angle) of rate') and damping are.
    """
    model = hfa.load_model(with_parameters(2))
    by_state, by_input, by_parameter = rates_of(model).jacobian()([0.3, 0.0], [0.0], model.p, 0.0)
    assert np.isfinite(by_state.full()).all()
    assert np.isfinite(by_input.full()).all()
    by_length, by_damping, *by_whole = by_parameter.full().T
    assert by_length == pytest.approx([0.0, 9.81 / 4.0 * math.sin(0.3)], abs=1e-7)
    assert by_damping == pytest.approx([0.0, 0.0], abs=1e-7)
    assert np.isnan(by_whole).all()
    assert model.about.fault() == ""


@pytest.mark.slow
def test_parameters_of_an_fmu_are_identified():
    """Length and damping are those of SciPy's record of the pendulum. The FMU also has parameters that
    are whole numbers.
    """
    time = np.linspace(0.0, 1.0, 11)

    def rates(_, x):
        return x[1], -9.81 / 1.5 * math.sin(x[0]) - 0.7 * x[1]

    flown = solve_ivp(rates, (0.0, 1.0), [0.3, 0.0], t_eval=time, rtol=1e-9, atol=1e-12).y
    record = {"time": time, "torque": 0.0 * time, "body_angle": flown[0], "rate": flown[1]}
    found = hfa.identify(hfa.load_model(with_parameters(2)), record, ["length", "damping"])
    assert found["length"].value == pytest.approx(1.5, rel=1e-2)
    assert found["damping"].value == pytest.approx(0.7, rel=1e-2)


def rates_of(model):
    """Return the function (x, u, p) -> rates."""
    symbols = model.layout.symbols("x", "u", "p")
    rates, _ = model.layout.expressions(symbols, ())
    return ca.Function("rates", symbols, [rates])


@pytest.mark.parametrize("version", [2, 3])
def test_an_event_at_the_start_values_hinders_no_trim(version):
    """The trim at the angle 0 is found although the start angle of .5 is at the event, and the report
    says that searches begin beside the event.
    """
    text = description(version, "event").replace('start="0.3"', 'start="0.5"')
    point = hfa.trim(hfa.load_model(packed(text, version)))
    assert point["body_angle"] == pytest.approx(0.0, abs=1e-9)
    said = unwrapped(point.report().text())
    assert "as at the start values: searches begin" in said


def test_types_of_variables_discrete_inputs_and_capital_suffixes_are_read():
    """The type of a variable gives its unit and limits, an input that changes in steps is taken as
    continuous, with a note, and the name of the file may end in .FMU.
    """
    steps = 'causality="input" variability="discrete"'
    written = fmu("steps", name="PENDULUM.FMU", torque=steps)
    model = hfa.load_model(written)
    angle = model.states["body_angle"]
    assert (angle.unit, angle.min) == ("rad", -1.5)
    linear = hfa.linearize(model, hfa.trim(model, hold={"torque": 1.5}))
    np.testing.assert_allclose(linear.B, [[0.0], [1.0]], atol=1e-8)
    assert "taken as continuous: torque" in unwrapped(hfa.trim(model).report().text())


@pytest.mark.slow
def test_a_library_that_does_not_return_ends_with_sigterm():
    """SIGTERM ends a command whose library hangs at an angle above 1 rad (70 deg), with one line."""
    words = ["trim", "--hold", "body_angle=70", "--free", "torque", "--aircraft", fmu("hangs")]
    child = subprocess.Popen([SCRIPT, *words], stderr=subprocess.PIPE, text=True)
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(3.0)
    child.terminate()
    _, said = child.communicate(timeout=10.0)
    assert (child.returncode, said) == (143, "hfa: terminated\n")


def test_the_fmu_that_casadi_exports_is_read():
    """A and B are those of x'' = -x - .3 x' + 2 u, in FMI 3.0 with declared dependencies and
    derivatives.
    """
    fmpy = pytest.importorskip("fmpy", reason="FMPy, which has FMI's headers, is not installed")
    made = ca.DaeBuilder("spring")
    x, v, u = made.add("x"), made.add("v"), made.add("u", "input")
    made.eq(made.der(x), v)
    made.eq(made.der(v), -x - 0.3 * v + 2.0 * u)
    made.export_fmu()
    headers = Path(fmpy.__file__).with_name("c-code")
    words = [COMPILER, "-shared", "-fPIC", "-w", f"-I{headers}", "spring.c", "spring_wrap.c"]
    subprocess.run([*words, "-o", "spring.so", "-lm"], check=True, timeout=120)
    with zipfile.ZipFile("spring.fmu", "w") as archive:
        archive.write("modelDescription.xml")
        archive.write("spring.so", "binaries/x86_64-linux/spring.so")
    model = hfa.load_model("spring.fmu")
    linear = hfa.trim(model).linearize()
    np.testing.assert_allclose(linear.A, [[0.0, 1.0], [-1.0, -0.3]], atol=1e-12)
    np.testing.assert_allclose(linear.B, [[0.0], [2.0]], atol=1e-12)


def test_a_data_file_executes_no_fmu():
    """A .toml file of parameters that names an FMU as its aircraft is refused, since the FMU's library
    would be executed.
    """
    Path("changed.toml").write_text('aircraft = "pendulum.fmu"\n[parameters]\nlength = 3.0\n')
    fmu()
    assert_refused(run("trim", "--aircraft", "changed.toml"), 2, "executes none")
