"""Aircraft from stability files of AVL, compared with AVL's own forces and eigenvalues."""

import math
import pickle
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from cli import assert_refused, hfa, refused

import hfa as tool
from hfa import BadInputError

EXAMPLES = Path(__file__).parents[3] / "examples"
PRINTED = (EXAMPLES / "glider.st").read_text()
TABLE = (EXAMPLES / "glider.toml").read_text()
#: Forces of AVL 3.52 at other states than the run case of the file: alpha, beta, aileron, elevator,
#: rudder, deg; p, q, r over V, rad/m, in body axes; Cl, Cm, Cn about body axes; CL.
AVL_FORCES = [
    ((2.42020, 2.0, 0.0, -0.44993, 0.0), (0.0, 0.0, 0.0), (-0.00359, -0.00034, 0.00205), 0.59932),
    ((2.42020, 0.0, 0.0, -0.44993, 0.0), (1.665e-3, 0, 7e-5), (-0.00648, 0.0, -0.00083), 0.6),
    ((2.42020, 0.0, 0.0, -0.44993, 0.0), (-3.5e-5, 0, 8.33e-4), (0.00081, 0.0, -0.00026), 0.6),
    ((2.42020, 0.0, 0.0, -0.44993, 0.0), (0.0, 5.333e-3, 0.0), (0.0, -0.07812, 0.0), 0.62365),
    ((2.42020, 0.0, 3.0, -0.44993, 0.0), (0.0, 0.0, 0.0), (-0.02145, 0.00018, -0.00013), 0.59999),
    ((2.42020, 0.0, 0.0, 1.55007, 0.0), (0.0, 0.0, 0.0), (0.0, -0.08101, 0.0), 0.61528),
    ((2.42020, 0.0, 0.0, -0.44993, 4.0), (0.0, 0.0, 0.0), (-0.00057, 0.00027, 0.0039), 0.59998),
    ((3.42020, 0.0, 0.0, -0.44993, 0.0), (0.0, 0.0, 0.0), (0.0, -0.04394, 0.0), 0.70305),
]


@pytest.fixture
def glider(folder):
    """A folder with the stability file `glider.st` and its table `glider.toml`."""
    Path("glider.st").write_text(PRINTED)
    Path("glider.toml").write_text(TABLE)
    return folder


def coefficients(model, angles, over_speed):
    """Return Cl, Cm, Cn about body axes, computed from angular accelerations, and CL and CD.

    angles: alpha, beta, aileron, elevator, rudder, deg
    over_speed: p, q, r over V, rad/m
    """
    alpha, beta, aileron, elevator, rudder = (math.radians(each) for each in angles)
    speed = 35.28865  # m/s, of the file
    rates = speed * np.array(over_speed)
    state = {"speed": speed, "alpha": alpha, "beta": beta, "roll": 0.0, "pitch": alpha, "yaw": 0.0}
    state |= dict(zip(("roll_rate", "pitch_rate", "yaw_rate"), rates, strict=True))
    state["altitude"] = 0.0
    inputs = {"thrust": 0.0, "aileron": aileron, "elevator": elevator, "rudder": rudder}
    parameters = {name: signal.start for name, signal in model.parameters.items()}
    vectors = (SimpleNamespace(**each) for each in (state, inputs, parameters))
    changes, outputs = model.equations(*vectors, None)
    turning = [float(changes[name]) for name in ("roll_rate", "pitch_rate", "yaw_rate")]
    # Inertias, density, wing area and lengths of glider.toml and glider.st.
    inertia = np.array([[700.0, 0.0, 60.0], [0.0, 650.0, 0.0], [60.0, 0.0, 1250.0]])
    moment = inertia @ turning + np.cross(rates, inertia @ rates)
    force = 0.5 * 1.225 * speed**2 * 9.0
    lift, drag = (float(outputs[f"{name}_coefficient"]) for name in ("lift", "drag"))
    return moment / (force * np.array([12.0, 0.75, 12.0])), lift, drag


def of_older_version():
    """Return the file as AVL 3.40 writes it: without CD, Cl and Cn of controls in body axes."""
    lines = [line for line in PRINTED.splitlines() if "force CD" not in line]
    text = "\n".join(lines)
    value = {name: float(number) for name, number in re.findall(r"(\w+)\s*=\s*(-?[\d.]+)", PRINTED)}
    alpha = math.radians(value["Alpha"])
    for k in (1, 2, 3):
        roll, yaw = value[f"Cld0{k}"], value[f"Cnd0{k}"]
        body = {
            "Cl": roll * math.cos(alpha) - yaw * math.sin(alpha),
            "Cn": yaw * math.cos(alpha) + roll * math.sin(alpha),
        }
        for name, number in body.items():
            text = re.sub(rf"{name}d0{k} =\s*\S+", f"{name}d{k} = {number:.7f}", text)
        text = re.sub(rf"(C[LYm]d)0{k} =", rf"\g<1>{k} =", text)
    return text


@pytest.mark.parametrize("form", ["printed", "older"])
def test_moments_and_lift_agree_with_those_of_avl(form, glider):
    """Moments about body axes and CL at other angles and rates than those of the file are AVL's, in each form
    of the file. At the state of the file, CL and CD are the printed ones.

    Rows of `AVL_FORCES`: angles and deflections, deg; rates over speed, rad/m; Cl, Cm, Cn; CL.
    """
    text = {"printed": PRINTED, "older": of_older_version()}
    Path("glider.st").write_text(text[form])
    if form == "older":
        Path("glider.toml").write_text("CD_CL2 = 0.02\n" + TABLE)
    model = tool.load_model("glider.toml")
    for angles, over_speed, moments, lift in AVL_FORCES:
        found, found_lift, _ = coefficients(model, angles, over_speed)
        # AVL's pitching moment is not linear in beta and in the lateral controls.
        allowed = 0.01 * np.abs(moments) + [2e-5, 5e-4, 2e-5]
        assert (np.abs(found - moments) < allowed).all()
        assert found_lift == pytest.approx(lift, abs=1e-3)
    at_file = (2.42020, 0.0, 0.0, -0.44993, 0.0)
    _, found_lift, drag = coefficients(model, at_file, over_speed=(0.0, 0.0, 0.0))
    assert (found_lift, drag) == pytest.approx((0.6, 0.02725), abs=1e-6)


def test_a_fixed_control_keeps_its_deflection(glider):
    """An elevator with one value in the table, 1 deg, is no input: Cm_0 has the moment of its deflection.

    Cmtot is 0 in the file, in which the elevator is at -0.44993 deg.
    """
    Path("glider.toml").write_text(
        TABLE.replace('elevator = ["-25 deg", "25 deg"]', 'elevator = "1 deg"')
    )
    model = tool.load_model("glider.toml")
    assert "elevator" not in model.inputs
    moment = model.parameters["Cm_0"].start
    # Cmd02 = -0.040525 per degree
    assert moment == pytest.approx(-0.040525 * (1.0 + 0.44993), rel=1e-6)


def test_a_stability_file_with_its_table_is_the_aircraft_of_the_table(glider):
    """`--aircraft glider.st --mass glider.toml` is the aircraft of glider.toml, also pickled.

    A file that the table does not name is refused, and each option without the other.
    """
    named = tool.load_model("glider.toml")
    given = tool.load_model("glider.st", mass="glider.toml")
    assert given.parameters == named.parameters
    assert pickle.loads(pickle.dumps(given)).inputs == named.inputs
    assert hfa("trim", "--aircraft", "glider.st", "--mass", "glider.toml").code == 0
    Path("other.st").write_text(PRINTED)
    with pytest.raises(BadInputError, match=r"glider.toml names glider.st, not other.st"):
        tool.load_model("other.st", mass="glider.toml")
    assert_refused(hfa("trim", "--aircraft", "glider.st"), 2, "glider.st", "--mass")
    assert_refused(hfa("trim", "--mass", "glider.toml"), 2, "--mass", "--aircraft FILE.st")


#: Text of the stability file, the text in its place, and the message.
FILES = [
    ("Clb =  -0.100443", "Clb =  ********", "Clb is '********'"),
    ("Beta  =   0.00000", "Beta  =   2.00000", "Beta is 2;"),
    ("qc/2V =   0.00000", "qc/2V =   0.01000", "qc/2V is 0.01;"),
    ("Standard axis orientation,  X fwd, Z down", "Geometric axis orientation,  X aft, Z up",
     "x is aft"),
    ("Clp =  -0.650798", "Clp =   0.000000", "Clp is 0"),
    ("   aileron  ", "   mass     ", "the control 'mass' cannot be"),
    ("CLa =   5.911822", "", "CLa is missing"),
    ("   rudder          =   0.00000\n", "", "3 controls have derivatives, but only 2 have a deflection"),
    ("Xref = 0.30000", "Xref = 0.35000", "moments about [0.35, 0, 0]"),
    (" Stability-axis derivatives...", " Body-axis derivatives...", "no stability derivatives"),
    (PRINTED, PRINTED + PRINTED, "given twice; write each run case to a file of its own"),
    (PRINTED, of_older_version(), f"CD_CL2 = {1.0 / (math.pi * 0.9895 * 16.0):.5g}"),
]  # fmt: skip
#: Beginning of a line of the table, the line in its place, and the message.
ENTRIES = [
    ('length = "m"', "", 'add length = "m"'),
    ("center_of_gravity", "", "add center_of_gravity = [x, y, z]"),
    (
        "rudder",
        "",
        'rudder, a control of glider.st, is missing; add rudder = ["-25 deg", "25 deg"]',
    ),
    ("mass = 420", "", "missing entries: mass"),
    ("center_of_gravity", "center_of_gravity = [0.3, 0.0]", "give [x, y, z]"),
    ("center_of_gravity", "center_of_gravity = [0.3, 0.0, 0.1]", "moments about [0.3, 0, 0]"),
    ("wing_area", "wing_area = 9.0", "wing_area is in glider.st too"),
]


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [*(("glider.st", *row) for row in FILES), *(("glider.toml", *row) for row in ENTRIES)],
)
def test_faulty_files_are_refused(file, old, new, message, glider):
    """Each fault of the stability file or of its table is named in one line. In the stability file, the text
    `old` is replaced by `new`; in the table, the line that begins with it.
    """
    if file == "glider.st":
        Path(file).write_text(PRINTED.replace(old, new))
    else:
        kept = [line for line in TABLE.splitlines() if not line.startswith(old)]
        Path(file).write_text("\n".join([new, *kept]))
    said = refused(tool.load_model, "glider.toml")
    assert message in said
    if "*" in new:  # AVL's print of a number that is too long, which the message finds by its line
        assert f"glider.st, line {PRINTED.partition(old)[0].count(chr(10)) + 1}" in said


def test_inviscid_drag_and_another_mach_number_are_noted(glider):
    """Drag without profile drag, and a file for another Mach number, are noted in reports.

    CD_0 in the table removes the note of the drag.
    """
    assert tool.load_model("glider.toml").about.notes == ()
    changed = PRINTED.replace("CDvis =   0.02000", "CDvis =   0.00000")
    Path("glider.st").write_text(changed.replace("Mach  =     0.000", "Mach  =     0.700"))
    of_drag, of_mach = tool.load_model("glider.toml").about.notes
    assert "CDvis 0" in of_drag
    assert "Mach 0.7" in of_mach
    Path("glider.toml").write_text("CD_0 = 0.03\n" + TABLE)
    assert len(tool.load_model("glider.toml").about.notes) == 1
