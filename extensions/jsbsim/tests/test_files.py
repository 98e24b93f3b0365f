"""Content of files that is supported, and content that is refused with file and line."""

import re

import numpy as np
import pytest
from cli import assert_refused, hfa as run
from constructs.jet import jet, slope
from small_aircraft import (
    CONTROL,
    LIFT,
    REST,
    force,
    glider,
    with_elevator,
    written,
)

from hfa import BadInputError, NoSolutionError, load_model, trim

TABLE = "<table> <independentVar>aero/alpha-rad</independentVar> <tableData>{}</tableData> </table>"
#: States of the glider: 120 ft/s, alpha 0.1 rad, 1000 ft; all others are 0.
STATES = [120.0, 0.1, *[0.0] * 7, 1000.0]
#: Its commands of elevator, aileron and rudder.
CENTERED = [0.0] * 3


def model_of(folder, text):
    return load_model(written(folder, text))


def test_a_glider_is_read_by_path(tmp_path):
    """A glider outside JSBSim's folder is trimmed on its polar C_D = 0.03 + 0.05 C_L².

    The lift coefficient is 5 alpha. Pitch has the coefficients -1 for alpha and for the surface,
    which moves 0.3 rad for the command 1.
    """
    model = model_of(tmp_path, glider())
    point = trim(model, hold={"speed": 120.0})
    outputs = model.outputs_at(point.states, point.inputs)
    lift = 5.0 * point.states.alpha
    assert np.tan(outputs["gamma"]) == pytest.approx(-(0.03 + 0.05 * lift**2) / lift, rel=1e-10)
    assert point.inputs.elevator == pytest.approx(-point.states.alpha / 0.3, rel=1e-10)


def test_provenance_changes_with_every_file(tmp_path):
    """The digest of an aircraft changes if a letter of a file that it includes does."""
    control = '<flight_control file="stick"/>'
    text = glider(control=control)
    stick = tmp_path / "aircraft" / "glider" / "stick.xml"
    written(tmp_path, text)
    stick.write_text(CONTROL)
    before = model_of(tmp_path, text).source.digest
    alone = tmp_path / "alone.xml"  # its other files are in the folder of the option
    alone.write_text(text)
    apart = load_model(f"{alone}?folder={stick.parent}")
    assert apart.rates_at(STATES, CENTERED) == model_of(tmp_path, text).rates_at(STATES, CENTERED)
    stick.write_text(CONTROL.replace("Elevator Gain", "Elevator gain"))
    after = model_of(tmp_path, text).source.digest
    assert before != after


#: A glider whose elevator follows a command that the file declares and nothing sets.
DECLARED = glider(
    control=CONTROL.replace("fcs/elevator-cmd-norm", "fcs/elevon-cmd").replace(
        "<channel",
        '<property value="-0.1">fcs/elevon-cmd</property><property>fcs/idle-cmd</property><channel',
        1,
    )
)


def notes_on(model, name):
    """Return the notes of a model that contain a name."""
    return [note for note in model.about.notes if name in note]


def test_a_declared_command_is_an_input_that_a_trim_keeps(tmp_path):
    """The command fcs/elevon-cmd, which the file declares as -0.1 and nothing sets, is an input that a
    trim keeps at -0.1.

    A note, and the refusal of the trim, propose --free, with which a trim solves for it. The note does
    not name fcs/idle-cmd, which moves nothing.
    """
    path = written(tmp_path, DECLARED)
    model = load_model(path)
    assert model.trim["elevon_cmd"] == -0.1
    (note,) = notes_on(model, "fcs/elevon-cmd")
    assert "--free" in note
    assert "idle-cmd" not in note
    assert_refused(run("trim", "--aircraft", path), 1, "no free input changes pitch_rate")
    freed = run("trim", "--aircraft", path, "--free", "fcs/elevon-cmd", "--hold", "speed=120")
    assert "elevon_cmd -0." in freed.out
    assert trim(model, free="fcs/elevon-cmd", speed=120.0)["elevon_cmd"] < 0.0


def test_a_command_after_inputs_is_free_in_a_trim(tmp_path):
    """With ?inputs=fcs/elevon-cmd, a trim solves for this command, without a note: it is that of the
    elevator of the plain glider.
    """
    model = load_model(f"{written(tmp_path, DECLARED)}?inputs=fcs/elevon-cmd")
    assert not notes_on(model, "fcs/elevon-cmd")
    assert model.inputs["elevon_cmd"].start == -0.1
    assert model.about.aliases["fcs/elevon-cmd"] == "elevon_cmd"
    point = trim(model, hold={"speed": 120.0})
    plain = trim(model_of(tmp_path, glider()), hold={"speed": 120.0})
    assert point.inputs.elevon_cmd == pytest.approx(plain.inputs.elevator, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("no xml", r"glider.xml:1: the file is not valid XML \(syntax error\)"),
        (
            "<fdm_config><metrics></fdm_config>",
            r"glider.xml:1: the file is not valid XML \(mismatched tag\)",
        ),
        (
            '<!DOCTYPE a [\n<!ENTITY b SYSTEM "file:///etc/passwd">]><fdm_config>&b;</fdm_config>',
            r"glider.xml:2: the file is not valid XML \(error in processing external entity reference\)",
        ),
        (
            "<FDM_CONFIG NAME='old'/>",
            (
                r"glider.xml:1: <FDM_CONFIG> is not an aircraft file of JSBSim; give a file that begins with"
                r" <fdm_config>"
            ),
        ),
        ("<fdm_config/>", r"glider.xml: the aircraft has no <metrics>; add this element"),
        (
            glider(more='<buoyant_forces/><system file="/etc/passwd"/>'),
            r"glider.xml:\d+: the file /etc/passwd is outside the aircraft's folders",
        ),
        (
            glider(more='<system file="../../../../secret"/>'),
            r"glider.xml:\d+: the file ../../../../secret is outside the aircraft's folders",
        ),
        (
            glider(more='<system file="absent"/>'),
            r"glider.xml:\d+: the file absent is not in .*Systems",
        ),
        (glider(more="<buoyant_forces/>"), r"glider.xml:\d+: <buoyant_forces> in <fdm_config>"),
        (
            glider(LIFT.replace("LIFT", "SPIN")),
            r"glider.xml:\d+: the name SPIN of <axis> is unknown; use DRAG, AXIAL, X, SIDE",
        ),
        (
            glider(force("LIFT", TABLE.format("\n1 2\n"))),
            r"glider.xml:\d+: an axis of the table has only one breakpoint; give at least two",
        ),
        (
            glider(force("LIFT", TABLE.format("\n1 2\n1 3\n"))),
            r"glider.xml:\d+: the breakpoints of the table do not increase; give breakpoints",
        ),
        (
            glider(force("LIFT", TABLE.format("\n1 2\nx 3\n"))),
            r"glider.xml:\d+: 'x 3' is not a row of numbers",
        ),
        (
            glider(force("LIFT", "<random/>")),
            r"glider.xml:\d+: the operation <random> is not supported",
        ),
        (
            glider(force("LIFT", "<quotient> <v>1</v> </quotient>")),
            r"glider.xml:\d+: the number of elements in <quotient> is 1; give 2",
        ),
        (
            glider(LIFT + REST + force("SIDE", "<p>- aero/beta-rad</p>")),
            r"glider.xml:\d+: '- aero/beta-rad' is neither a number nor a property name",
        ),
        (
            glider(
                LIFT.replace("aero/alpha-rad", "aero/a")
                + '<function name="aero/a"> <sum> <p>aero/b</p> <v>1</v> </sum> </function>'
                + '<function name="aero/b"> <sum> <p>aero/a</p> <v>1</v> </sum> </function>'
            ),
            r"glider.xml:\d+: aero/a depends on itself; break the loop of functions",
        ),
        (
            glider(force("LIFT", "<v>1</v>") + force("DRAG", "<v>2</v>")).replace(
                "<function>", '<function name="aero/a">'
            ),
            r"glider.xml:\d+: aero/a is the name of another function \(.*glider.xml:\d+\); give this",
        ),
        (
            glider().replace('<wingarea unit="FT2"> 150', '<wingarea unit="ACRE"> 150'),
            r'glider.xml:4: <wingarea> has the unit "ACRE", which is not supported; give the value in FT2',
        ),
        (
            glider().replace(" 1500 ", " heavy "),
            r"glider.xml:\d+: <emptywt> contains 'heavy'; give a finite number",
        ),
        (
            glider(more="<propulsion> <engine> <brushless_dc_motor/> </engine> </propulsion>"),
            r"glider.xml:\d+: <engine> has no <thruster>; add <thruster>",
        ),
        (
            glider(
                more=(
                    "<propulsion> <engine> <rotor_engine/> <thruster> <rotor/> </thruster> "
                    "</engine> </propulsion>"
                )
            ),
            r"glider.xml:\d+: <rotor_engine> is not supported; use turbine_engine,",
        ),
    ],
)
def test_a_fault_is_reported_with_file_and_line(tmp_path, text, fault):
    """A fault in a file is reported in one line with file name and line number."""
    with pytest.raises(BadInputError) as caught:
        model_of(tmp_path, text)
    message = str(caught.value)
    assert re.search(fault, message)
    assert "\n" not in message


#: A system that sets a property, the slot, to sim/in, which nothing sets.
SETS = (
    '<system name="s"> <channel name="c"> <pure_gain name="s/c"> <input>sim/in</input>'
    " <gain>1</gain> <output>{}</output> </pure_gain> </channel> </system>"
)


def test_a_property_that_nothing_sets_is_a_constant(tmp_path):
    """A side force that reads sim/gust, which nothing sets, has the parameter gust, 0 as in JSBSim.

    A note proposes --hold. With gust = 1, the side force coefficient is 2.
    """
    path = written(tmp_path, glider(LIFT + REST + force("SIDE", slope(2.0, "sim/gust"))))
    model = load_model(path)
    assert any(re.search(r"--hold.*glider.xml: \d+ sim/gust", each) for each in model.about.notes)
    assert model.about.aliases["sim/gust"] == "gust"
    x, u = STATES, CENTERED
    still, pushed = (model.with_parameters(gust=value).rates_at(x, u)["beta"] for value in (0, 1))
    assert still == pytest.approx(load_model(written(tmp_path, glider())).rates_at(x, u)["beta"])
    # beta' = SIDE / (m V) and SIDE = 2 q S; L = 0.5 q S at 0.1 rad
    outputs = model.outputs_at(x, u)
    side_to_momentum = outputs["lift_to_weight"] * 32.174049 / 0.5 * 2.0 / 120.0
    assert pushed - still == pytest.approx(side_to_momentum, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("propulsion/engine/friction-hp", ""),
        ("propulsion/engine[3]/n1", ""),
        ("atmosphere/turb-rate", ""),
        ("simulation/gravity-model", "moves a force in JSBSim"),
    ],
)
def test_a_system_may_not_set_what_moves_a_force_in_jsbsim(tmp_path, name, said):
    """A system that sets the gravity model of JSBSim is refused, since the reader would not follow it.
    One that sets turbulence, or a property of an engine, which the glider does not have, is read.
    """
    path = written(tmp_path, glider(more=SETS.format(name)))
    if said:
        with pytest.raises(BadInputError, match=rf"glider.xml:\d+: {name} {said}"):
            load_model(path)
    else:
        assert load_model(path).rates_at(STATES, CENTERED)


def test_a_throttle_without_thrust_is_noted(tmp_path):
    """A warning says that the throttle moves no thrust, as sim/fuel or engine0 is 0, by which the file
    opens the tank and the engine runs.
    """
    valve = (
        '<pure_gain name="fcs/probe"> <input>sim/fuel</input> <gain>1</gain>'
        " <output>propulsion/tank/priority</output> </pure_gain>"
    )
    path = written(tmp_path, jet({"channels": f'<channel name="c"> {valve} </channel>'}), "small")
    model = load_model(path)
    assert model.warnings == ("the throttle moves no thrust",)
    assert model.with_parameters(fuel=1.0).warnings == ()
    stopped = model.with_parameters(fuel=1.0, engine0=0.0)
    assert stopped.warnings == ("the throttle moves no thrust",)


def test_a_constant_that_no_control_reads_is_no_input(tmp_path):
    """The constant sim/gust, which pitches the glider in place of the elevator, is a parameter, and not an
    input: it is no command, since no control component reads it.
    """
    text = glider(LIFT + REST.replace("fcs/elevator-pos-rad", "sim/gust"))
    assert "gust" in model_of(tmp_path, text).parameters


def test_a_constant_that_would_close_a_loop_is_no_parameter(tmp_path):
    """A switch s gives its own output fcs/s, a loop, if sim/on is 1, and else the stick.

    The constant sim/on, which nothing sets, is 0. It is no parameter, since another value would close
    the loop, and a note names it.
    """
    switch = (
        '<switch name="s"> <default value="fcs/elevator-cmd-norm"/> <test value="fcs/s">'
        " sim/on == 1 </test> <output>fcs/elevator-pos-rad</output> </switch>"
    )
    side = force("SIDE", slope(2.0, "sim/on")) + "</aerodynamics>"
    model = model_of(tmp_path, with_elevator(switch).replace("</aerodynamics>", side))
    assert model.inputs["elevator"].unit == "1"
    assert "on" not in model.parameters
    assert notes_on(model, "sim/on")


def summed(loop):
    """Return the text of the glider whose elevator is the stick plus fcs/x, which a loop sets."""
    stick = '<summer name="e"> <input>fcs/elevator-cmd-norm</input> <input>fcs/x</input>'
    return with_elevator(f"{loop} {stick} <output>fcs/elevator-pos-rad</output> </summer>")


@pytest.mark.parametrize("gain", ["1", "1.5"])
def test_a_loop_that_does_not_settle_is_no_steady_value(gain, tmp_path):
    """A sum with its own past, an integrator, and a loop that grows leave the surface as the input."""
    text = summed(
        '<summer name="fcs/x"> <input>aero/alpha-rad</input> <input>fcs/y</input> </summer>'
        f'<pure_gain name="fcs/y"> <input>fcs/x</input> <gain>{gain}</gain> </pure_gain>'
    )
    assert model_of(tmp_path, text).inputs["elevator"].unit == "rad"


def test_an_integrator_that_moves_makes_no_trim(tmp_path):
    """The integral of the pitch rate moves the elevator: level flight has a trim, a turn has none."""
    integral = (
        '<integrator name="fcs/x"> <input>velocities/q-rad_sec</input> <c1>1</c1> </integrator>'
    )
    model = model_of(tmp_path, summed(integral))
    assert trim(model, speed=120.0)["x"] == 0.0
    with pytest.raises(NoSolutionError, match="x by"):
        trim(model, speed=120.0, turn_rate=0.2)


def test_what_moves_no_force_is_no_reason_to_refuse(tmp_path):
    """A random number times a property that nothing sets, 0, is read, and one that changes the lift is
    refused together with another fault, each with what it changes and by which property.
    """
    hidden = "<product> <random/> <p>sim/gust</p> </product>"
    plain, read = (
        model_of(tmp_path, glider(force("LIFT", "<v>0.4</v>", *more) + REST))
        for more in ((), (hidden,))
    )
    rates = plain.rates_at(STATES, CENTERED)
    assert read.rates_at(STATES, CENTERED) == pytest.approx(rates, rel=1e-12)
    assert "gust" not in read.parameters
    named = '<function name="aero/noise"> <random/> </function>'
    text = glider(named + force("LIFT", "<p>aero/noise</p>", "<urandom/>") + REST)
    with pytest.raises(BadInputError) as caught:
        model_of(tmp_path, text)
    assert re.search(
        r":\d+: the operation <random>.* by aero/noise.*\); .*<urandom>.*alpha", str(caught.value)
    )


def test_a_surface_behind_an_integrator_is_an_input(tmp_path):
    """If the stick acts through an integrator, the surface position, limited by <clipto>, is the input of
    the model. In trim, the pitching moment coefficient -alpha - elevator is 0.
    """
    pid = (
        '<pid name="e"> <input>fcs/elevator-cmd-norm</input> <kp>1</kp> <ki>0.1</ki> <clipto>'
        " <min>-0.2</min> <max>0.3</max> </clipto> <output>fcs/elevator-pos-rad</output> </pid>"
    )
    model = model_of(tmp_path, with_elevator(pid))
    elevator = model.inputs["elevator"]
    assert (elevator.unit, elevator.min, elevator.max) == ("rad", -0.2, 0.3)
    assert notes_on(model, "the integrator has no steady-state value")
    point = trim(model, hold={"speed": 120.0})
    assert point.inputs.elevator == pytest.approx(-point.states.alpha, rel=1e-10)


def test_lift_by_rate_of_alpha_gives_analytical_rate(tmp_path):
    """With an additional lift 0.02 q S alpha', alpha' is the alpha' without it, divided by
    1 + 0.02 q S / (m V).
    """
    term = slope(0.02, "aero/alphadot-rad_sec")
    model = model_of(tmp_path, glider(force("LIFT", slope(5.0, "aero/alpha-rad"), term) + REST))
    plain = model_of(tmp_path, glider())
    rate = model.rates_at(STATES, CENTERED)["alpha"]
    without = plain.rates_at(STATES, CENTERED)["alpha"]
    outputs = plain.outputs_at(STATES, CENTERED)
    # L / W = 5 alpha q S / (m g), with g in ft/s²
    pressure_per_momentum = outputs["lift_to_weight"] / (5.0 * 0.1) * 32.174049 / 120.0
    assert rate == pytest.approx(without / (1.0 + 0.02 * pressure_per_momentum), rel=1e-9)
