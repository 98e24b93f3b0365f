"""Aircraft from tables of derivatives.

Their modes are compared with published modes and with independent equations. Faulty tables are
refused.
"""

import math
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from ambiance import Atmosphere
from cli import refusal, refused
from project import ROOT

from hfa import from_derivatives, linearize, trim

#: kg/m³ in a slug/ft³.
SLUG_PER_FT3 = 515.3788183931961
#: A slug is lbf s²/ft, and a pound-force 9.80665 m/s² times a pound.
LBM_PER_SLUG = 9.80665 / 0.3048


def density(altitude):
    """Return the density at an altitude in m, kg/m³, from q = ρ/2 at 1 m/s."""
    model = from_derivatives(f"{ROOT}/examples/uav.toml")
    state = [1.0, *[0.0] * 8, altitude]
    found = 2.0 * model.outputs_at(state, [0.0] * 4, ("dynamic_pressure",))["dynamic_pressure"]
    assert found == pytest.approx(float(Atmosphere(altitude).density[0]), rel=5e-5)
    return found


SURFACES = {key: ["-25 deg", "25 deg"] for key in ("elevator", "aileron", "rudder")}
#: R. C. Nelson, Flight Stability and Automatic Control, 2nd ed., 1998, Table B.1, without C_Lq and
#: with C_nbeta 0.0701, as in examples 4.3 and 5.2.
NAVION = {
    "units": "english",
    "geometry": {"wing_area": 184.0, "span": 33.4, "chord": 5.7},
    "mass": {"mass": 2750.0 / 32.2, "Ixx": 1048.0, "Iyy": 3000.0, "Izz": 3530.0},
    "condition": {"speed": 176.0, "altitude": 0.0},
    "CL_0": 0.41, "CL_alpha": 4.44, "CL_elevator": 0.355,
    "CD_0": 0.05, "CD_alpha": 0.33,
    "Cm_alpha": -0.683, "Cm_q": -9.96, "Cm_alphadot": -4.36, "Cm_elevator": -0.923,
    "CY_beta": -0.564, "CY_rudder": 0.157,
    "Cl_beta": -0.074, "Cl_p": -0.41, "Cl_r": 0.107, "Cl_aileron": -0.134, "Cl_rudder": 0.0118,
    "Cn_beta": 0.0701, "Cn_p": -0.0575, "Cn_r": -0.125, "Cn_aileron": 0.0035, "Cn_rudder": -0.072,
    "thrust": [0.0, 1500.0],
    "elevator": ["-23 deg", "23 deg"],
    "aileron": ["-23 deg", "23 deg"],
    "rudder": ["-23 deg", "23 deg"],
}  # fmt: skip
#: B. Etkin, L. D. Reid, Dynamics of Flight, 3rd ed., 1996: Boeing 747 at 774 ft/s.
_ALTITUDE = 39871.6
_MACH = 774.0 / 968.07
_DRAG = 0.043
B747 = {
    "units": "english",
    "geometry": {"wing_area": 5500.0, "span": 195.7, "chord": 27.31},
    "mass": {"mass": 636636.0 / 32.2, "Ixx": 0.183e8, "Iyy": 0.331e8, "Izz": 0.497e8,
             "Ixz": -0.156e7},
    "condition": {"speed": 774.0, "altitude": _ALTITUDE},
    "CL_0": 0.654, "CL_alpha": 4.920 - _DRAG, "CL_q": 5.921, "CL_alphadot": -5.896,
    "CL_mach": 0.1060 / _MACH,
    "CD_0": _DRAG, "CD_alpha": 0.654 - 0.2193, "CD_mach": (0.1080 - 2.0 * _DRAG) / _MACH,
    "Cm_alpha": -1.023, "Cm_q": -23.92, "Cm_alphadot": -6.314, "Cm_mach": 0.1043 / _MACH,
    "CY_beta": -0.8771,
    "Cl_beta": -0.2797, "Cl_p": -0.3295, "Cl_r": 0.304, "Cl_aileron": 0.01,
    "Cn_beta": 0.1946, "Cn_p": -0.04073, "Cn_r": -0.2737, "Cn_rudder": -0.1,
    "Cm_elevator": -1.444,
    "thrust": [0.0, 200000.0],
    **SURFACES,
}  # fmt: skip
#: Eigenvalues printed there in Sections 6.2 and 6.7.
PRINTED_747 = {
    "phugoid": -0.003289 + 0.06723j,
    "short period": -0.3719 + 0.8875j,
    "spiral": -0.0072973,
    "roll": -0.56248,
    "dutch roll": -0.033011 + 0.94655j,
}

#: R. K. Heffley, W. F. Jewell, Aircraft Handling Qualities Data, NASA CR-2144, 1972, Tables II-1
#: and II-2: NT-33A, power approach. Derivatives are in stability axes and moments of inertia in
#: body axes. The thrust acts along the flight path, because the printed C_L supports the complete
#: weight. The limits of the surfaces are assumed.
NT33A = {
    "units": "english",
    "geometry": {"wing_area": 234.8, "span": 37.54, "chord": 6.72},
    "axes": "stability",
    "mass": {"weight": 11800.0, "Ixx": 12700.0, "Iyy": 20700.0, "Izz": 32001.0, "Ixz": 480.0},
    "condition": {"speed": 228.0, "altitude": 0.0, "alpha": "2.2 deg"},
    "thrust_angle": "-2.2 deg",
    "CL_0": 0.813, "CL_alpha": 5.22, "CL_elevator": 0.34,
    "CD_0": 0.135, "CD_alpha": 0.54,
    "Cm_alpha": -0.401, "Cm_q": -10.0, "Cm_alphadot": -5.0, "Cm_elevator": -0.89,
    "CY_beta": -0.72, "CY_rudder": 0.17,
    "Cl_beta": -0.127, "Cl_p": -0.57, "Cl_r": 0.20, "Cl_aileron": 0.14, "Cl_rudder": -0.002,
    "Cn_beta": 0.049, "Cn_p": -0.045, "Cn_r": -0.16, "Cn_aileron": -0.009, "Cn_rudder": -0.073,
    "thrust": [0.0, 5000.0],
    **SURFACES,
}  # fmt: skip
#: Factors of the denominators in Tables II-4 and II-8: damping and natural frequency, rad/s, or
#: decay rate, 1/s.
PRINTED_NT33A = {
    "phugoid": (0.0948, 0.172),
    "short period": (0.622, 1.59),
    "dutch roll": (0.0609, 1.13),
    "spiral": (0.0318,),
    "roll": (2.20,),
}

#: J. Roskam, Airplane Flight Dynamics and Automatic Flight Controls, Part I: damping and natural
#: frequency, rad/s, or decay rate, 1/s, of the Cessna 182 in cruise.
PRINTED_C182 = {
    "phugoid": (0.129, 0.171),
    "short period": (0.844, 5.27),
    "dutch roll": (0.207, 3.24),
    "roll": (1.0 / 0.077,),
    "spiral": (1.0 / 55.9,),
}


class Published(NamedTuple):
    """Printed modes of a table, the largest relative error, and a planted error.

    printed: each mode as an eigenvalue, as (decay rate,), or as (damping, natural frequency)
    mistake: entries that are wrong
    affected: the modes that then differ by more than the largest error
    held: parameters that differ from those of the table
    """

    table: Any
    printed: dict[str, Any]
    error: float
    mistake: dict[str, Any]
    affected: set[str]
    held: dict[str, float] | None = None


LATERAL = {"dutch roll", "roll", "spiral"}
PUBLISHED = {
    "747": Published(
        B747, PRINTED_747, 0.003, {"Cn_beta": 0.21, "Cm_q": -26.0}, {*PRINTED_747}, {"gravity": 32.2}
    ),
    "nt33a": Published(NT33A, PRINTED_NT33A, 0.004, {"axes": "body"}, LATERAL),
    "propeller": Published(  # with CT_u = 2 C_T1, the thrust is constant
        tomllib.loads((ROOT / "examples/cessna182.toml").read_text()),
        PRINTED_C182, 0.004, {"CT_u": -0.064}, {"phugoid"},
    ),
}  # fmt: skip


def linear_model(table, **held):
    model = from_derivatives(table).with_parameters(**held)
    return linearize(model, trim(model))


def root_of(printed):
    """Return the eigenvalue of a printed mode."""
    if not isinstance(printed, tuple):
        return complex(printed)
    if len(printed) == 1:
        return complex(-printed[0])
    damping, frequency = printed
    return frequency * complex(-damping, math.sqrt(1.0 - damping**2))


@pytest.mark.parametrize("name", PUBLISHED)
def test_modes_agree_with_published_modes(name):
    """Each mode of a published table has the printed eigenvalue within the largest error of the case. A
    planted mistake changes the modes that it affects by more, and no others.
    """
    case = PUBLISHED[name]
    table = {key: value for key, value in case.table.items() if key != "longitudinal"}
    table |= case.table.get("longitudinal", {})
    for given, affected in ((table, set()), ({**table, **case.mistake}, case.affected)):
        values = np.linalg.eigvals(linear_model(given, **(case.held or {})).A)
        roots = {mode: root_of(printed) for mode, printed in case.printed.items()}
        differing = {m for m, root in roots.items() if np.abs(values / root - 1).min() > case.error}
        assert differing == affected


def test_slope_and_coefficient_of_the_thrust_are_equivalent():
    """dT/dV = q̄ S (CT_u + 2 CT_0)/V_0 with CT_0 = CD_0 gives the same modes as CT_u."""
    text = Path("examples/cessna182.toml").read_text()
    table = tomllib.loads(text)
    del table["longitudinal"]["CT_u"]
    # Altitude, speed, wing area, CT_u and CD_0 of cessna182.toml.
    force = 0.5 * density(5000.0 * 0.3048) / SLUG_PER_FT3 * 220.1**2 * 174.0
    slope = force * (-0.096 + 2.0 * 0.032) / 220.1
    other = linear_model({**table, "thrust_slope": f"{slope} lbf/(ft/s)"})
    expected = np.sort_complex(np.linalg.eigvals(linear_model("examples/cessna182.toml").A))
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(other.A)), expected, rtol=1e-9)


#: Piper Cherokee PA-28-180 at 50 m/s in air of 1.06 kg/m³: dimensional derivatives divided by mass
#: and moments of inertia, of a public course (aircraftflightmechanics.com, "Final Examples").
CHEROKEE = {
    "dimensional": "divided by mass",
    "geometry": {"wing_area": 15.0, "span": 9.11, "chord": 1.6},
    "mass": {"mass": 1090.0, "Ixx": 3100.0, "Iyy": 1700.0, "Izz": 1400.0},
    "condition": {"speed": 50.0, "altitude": 1468.0},
    "CL_0": 1090.0 * 9.80665 / (0.5 * 1.06 * 2500.0 * 15.0), "CD_0": 0.0615,
    "Xu": -0.06728, "Xw": 0.02323, "Zu": -0.396, "Zw": -1.729, "Zq": -1.6804,
    "Mw": -0.2772, "Mwdot": -0.0197, "Mq": -2.207,
    "Yv": -0.1444, "Lv": -0.1166, "Nv": 0.174, "Lp": -2.283, "Np": -1.732, "Lr": 1.053,
    "Nr": -1.029, "Y_rudder": 2.113, "L_rudder": 0.6133, "N_rudder": -6.583, "L_aileron": 3.101,
    "Z_elevator": -17.01, "M_elevator": -44.71,
    **SURFACES,
}  # fmt: skip


def cherokee_by_hand():
    """Return A for u, w, q, pitch and v, p, r, roll of the Cherokee, from the printed numbers."""
    d, gravity, speed = CHEROKEE, 9.80665, 50.0
    rates = [[d["Xu"], d["Xw"], 0.0, -gravity], [d["Zu"], d["Zw"], speed + d["Zq"], 0.0],
             [0.0, d["Mw"], d["Mq"], 0.0], [0.0, 0.0, 1.0, 0.0]]  # fmt: skip
    lag = np.eye(4)
    lag[2, 1] = -d["Mwdot"]
    lateral = [[d["Yv"], 0.0, -speed, gravity], [d["Lv"], d["Lp"], d["Lr"], 0.0],
               [d["Nv"], d["Np"], d["Nr"], 0.0], [0.0, 1.0, 0.0, 0.0]]  # fmt: skip
    return np.linalg.solve(lag, rates), np.array(lateral)


@pytest.mark.parametrize("form", ["not divided", "with respect to angles", "stability axes"])
def test_dimensional_derivatives_give_the_modes_of_their_matrices(form):
    """A table of dimensional derivatives (the Cherokee's), in three further forms, gives the modes of the
    matrices written down from the derivatives.

    The elevator acts on the pitch rate by M_elevator + Mwdot Z_elevator.
    """
    table = dict(CHEROKEE)
    # Mass and moments of inertia, by the first letter of a derivative.
    mass = {"X": 1090.0, "Y": 1090.0, "Z": 1090.0, "L": 3100.0, "M": 1700.0, "N": 1400.0}
    if form == "not divided":
        table = {
            name: value * mass[name[0]] if isinstance(value, float) and name[0] in mass else value
            for name, value in CHEROKEE.items()
        }
        table["dimensional"] = form
    elif form == "with respect to angles":
        pairs = {"Xw": "Xalpha", "Zw": "Zalpha", "Mw": "Malpha", "Mwdot": "Malphadot"}
        pairs |= {"Yv": "Ybeta", "Lv": "Lbeta", "Nv": "Nbeta"}
        for name, other in pairs.items():
            table[other] = 50.0 * table.pop(name)  # the speed is 50 m/s: w = 50 alpha
    elif (
        form == "stability axes"
    ):  # body axes at 4 deg, with the inertia about stability axes unchanged
        angle = math.radians(4.0)
        cos, sin = math.cos(angle), math.sin(angle)
        table |= {"axes": "stability", "alpha": angle, "thrust_angle": -angle}
        table["mass"] = {
            **CHEROKEE["mass"],
            "Ixx": 3100.0 * cos**2 + 1400.0 * sin**2,
            "Izz": 3100.0 * sin**2 + 1400.0 * cos**2,
            "Ixz": (1400.0 - 3100.0) * sin * cos,
        }
    linear = linear_model(table)
    elevator = CHEROKEE["M_elevator"] + CHEROKEE["Mwdot"] * CHEROKEE["Z_elevator"]
    assert linear.B["pitch_rate", "elevator"] == pytest.approx(elevator, rel=1e-3)
    found = np.linalg.eigvals(linear.A)
    for matrix in cherokee_by_hand():
        for printed in np.linalg.eigvals(matrix):
            assert np.min(np.abs(found - printed)) < 2e-3 * abs(printed) + 2e-4


def test_each_entry_has_its_own_unit():
    """Derivatives with a unit are converted, also those with respect to rates; others follow `per`.

    Lengths in inches and millimeters, and a mass in pounds, are converted.
    """
    units = {
        "per": "deg",
        "Cm_alpha": f"{-0.683!r} 1/rad",
        "CL_alpha": math.radians(4.44),
        "CL_elevator": f"{math.radians(0.355)!r} 1/deg",
        "Cm_q": f"{math.radians(-9.96)!r} 1/deg",
        "Cl_p": "-0.41 1/rad",
        "geometry": {"wing_area": 184.0, "span": "400.8 in", "chord": "1737.36 mm"},
        "mass": {**NAVION["mass"], "mass": f"{NAVION['mass']['mass'] * LBM_PER_SLUG!r} lbm"},
    }
    table = {**NAVION, **units}
    for name in ("CD_alpha", "CY_beta", "CY_rudder", "Cl_beta", "Cl_aileron", "Cl_rudder"):
        table[name] = math.radians(NAVION[name])
    for name in ("Cm_elevator", "Cn_beta", "Cn_aileron", "Cn_rudder"):
        table[name] = f"{math.radians(NAVION[name])!r} 1/deg"
    given = from_derivatives(table).parameters
    for name, signal in from_derivatives(NAVION).parameters.items():
        assert given[name].start == pytest.approx(signal.start, rel=1e-12), name
    np.testing.assert_allclose(linear_model(table).A, linear_model(NAVION).A, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"Cm_aplha": -0.6}, "did you mean Cm_alpha"),
        ({"Cm_flap": 0.1}, "flap has no limits"),
        ({"Zw": -2.0}, 'give dimensional = "divided by mass"'),
        ({"dimensional": "divided by mass", "Zw": -2.0}, "CL_alpha and Zw state the same effect"),
        ({"CT_u": 0.1, "thrust_slope": 0.2}, "CT_u and thrust_slope state the same effect"),
        ({"CT_u": 0.1, "CD_0": 0.0}, "whose coefficient is 0; correct CD_0"),
        ({"dimensional": "divided by mass", "Xq": 1.0, "alpha": 0.1}, 'give axes = "stability"'),
        ({"CL_alpha": "steep"}, "CL_alpha is 'steep'; give a finite number"),
        ({"elevator": [1.0, -1.0]}, "lower limit is not less than the upper limit"),
        ({"left flap": [0.0, 0.1]}, "limit of an input"),
        ({"thrust": 0.1}, "thrust has a single value"),
        ({5: 0.1}, "5 is not the name of an entry"),
        ({"elevator": ["-20 m", "20 m"]}, "in m; give elevator in rad or deg"),
        ({"geometry": {"span": 33.4, "chord": 5.7}}, "missing entries: wing_area"),
        ({"mass": {"mass": -1.0, "Ixx": 1.0, "Iyy": 1.0, "Izz": 1.0}}, "give a positive number"),
        ({"Ixz": 1e6}, "Ixx Izz must exceed Ixz^2"),
        ({"tail_arm": 1.0}, "add cg"),
        ({"flap": 20.0}, "flap is 20.0; give text"),
        ({"span": 30.0}, "'span' is given twice"),
        ({"condition": {"speed": 176.0, "altitude": 160000.0}}, "altitude is 160000 ft; give"),
    ],
)
def test_faulty_entries_are_refused(change, message):
    """A faulty entry of a table of derivatives is refused with its name."""
    said = refused(from_derivatives, {**NAVION, **change})
    assert "the table" in said
    assert message in said


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (b"wing_area,0.5,s\n", "row 2: wing_area is in s; give wing_area in"),
        (b"wing_area,,m^2\n", "row 2: 'wing_area' has no value"),
        (b"# a note\n\nspan,1,\nspan,2,\n", "row 5: 'span' is given twice"),
        (b"span,\xff,\n", "row 2: span is 'ÿ'; give a finite number"),
        (b"span,1\n", "row 2 has 2 cells, but row 1 has 3"),
        (b"name\nspan\n", "has no columns name and value"),
    ],
)
def test_faulty_rows_are_refused(folder, rows, message):
    """A faulty row of a CSV file is refused with its number, as is one without a column of values."""
    head = b"" if rows.startswith(b"name") else b"name,value,unit\n"
    Path("uav.csv").write_bytes(head + rows)
    assert message in refusal(from_derivatives, "uav.csv")
