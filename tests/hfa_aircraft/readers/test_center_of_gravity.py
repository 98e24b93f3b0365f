"""Other centers of gravity, compared with equations of the tests in numpy and with AVL at both places."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from project import ROOT
from six_dof import GRAVITY, SixDof, air

import hfa as tool
from hfa import from_derivatives, linearize, trim

HERE = Path(__file__).parent
UAV = tomllib.loads((ROOT / "examples/uav.toml").read_text())
#: An own aircraft with all entries that a moved center of gravity concerns.
TABLE = UAV | {
    "cg": 0.25,
    "thrust_height": 0.05,
    "thrust_angle": 0.06,
    "CL_q": 6.0,
    "CL_alphadot": 1.5,
    "Cm_alphadot": -4.0,
    "CY_p": 0.1,
    "CY_r": 0.3,
}


def assert_equal_rates(model, reference):
    """Compare the rates of a spinning, banked, slipping aircraft with those of other equations.

    Without lift by the rate of alpha, which `SixDof.loads` lacks, lift, drag, moment and load factor
    are compared, too.

    reference: `SixDof` of the same table, about the center of gravity of the model
    """
    # speed, alpha, beta, three rates, roll, pitch, yaw, altitude
    x = [38.0, 0.15, -0.6, 0.4, -0.3, 0.5, 0.7, -0.4, 0.3, 900.0]
    u = np.array([25.0, 0.2, -0.1, 0.15])
    speed, alpha, beta, *spin, roll, pitch, _, altitude = x
    in_plane = speed * np.cos(beta)
    velocity = np.array([in_plane * np.cos(alpha), speed * np.sin(beta), in_plane * np.sin(alpha)])
    f = reference.rates(np.array([*velocity, *spin, roll, pitch]), u, altitude)
    along = velocity @ f[:3] / speed
    down = np.array([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])
    turning = (spin[1] * np.sin(roll) + spin[2] * np.cos(roll)) / np.cos(pitch)
    expected = [
        along,
        (velocity[0] * f[2] - velocity[2] * f[0]) / in_plane**2,
        (speed * f[1] - velocity[1] * along) / (speed * in_plane),
        *f[3:],
        turning,
        -velocity @ down,
    ]
    assert list(model.rates_at(x, u).values()) == pytest.approx(expected, rel=1e-4)
    if reference.get("CL_alphadot"):
        return
    at = air(altitude, reference.warmer)
    force, _, lift, drag, moment = reference.loads(
        np.array([alpha, beta, speed]), np.array(spin), u, at
    )
    normal = (force[0] * np.sin(alpha) - force[2] * np.cos(alpha)) / (
        reference.entries["mass"] * GRAVITY
    )
    pressed = 0.5 * at.density * speed**2 * reference.entries["wing_area"]
    names = ("lift", "drag", "pitching_moment", "load_factor", "turn_rate")
    assert model.outputs_at(x, u, names) == pytest.approx(
        dict(zip(names, (pressed * lift, pressed * drag, moment, normal, turning), strict=True)),
        rel=1e-4,
    )


@pytest.mark.parametrize(
    ("cg", "warmer", "CL_alphadot"), [(0.2, 0.0, 0.0), (0.28, 15.0, 60.0), (0.35, 0.0, 0.0)]
)
def test_rates_at_another_center_of_gravity_equal_independent_equations(cg, warmer, CL_alphadot):
    """At three centers of gravity, in chords, the rates and loads equal those of `SixDof`, equations of the
    tests that sum the forces of the table at its point and move them to the center by r x F.

    The second case has air 15 K warmer than the standard, and a large lift by the rate of alpha.
    """
    table = TABLE | {"CL_alphadot": CL_alphadot}
    model = from_derivatives(table).with_parameters(cg=cg, isa=warmer)
    assert_equal_rates(model, SixDof(table, cg, warmer))


def test_a_tail_arm_scales_the_damping():
    """A center of gravity 0.1 chord behind that of the table shortens the tail arm l = 0.9 m.

    All lift by rates acts at the tail, C_mq = -C_Lq l/c. The shorter arm l - Δ reduces the speed of
    the tail at the same pitch rate, and thus the lift C_Lq, by the factor 1 - Δ/l. `SixDof` moves
    this lift to the new center, where its moment has the factor once more.
    """
    arm, chord = 0.9, 0.18994
    moved = (0.3 - 0.2) * chord
    tail = {"CL_q": 5.0, "CL_alphadot": 1.5, "Cm_alphadot": -1.5 * arm / chord, "cg": 0.2}
    table = UAV | tail | {"longitudinal": {**UAV["longitudinal"], "Cm_q": -5.0 * arm / chord}}
    share = 1.0 - moved / arm
    reference = SixDof(table, 0.3)
    reference.entries |= {"CL_q": share * 5.0, "Cm_q": -share * 5.0 * arm / chord}
    model = from_derivatives(table | {"tail_arm": arm}).with_parameters(cg=0.3)
    assert_equal_rates(model, reference)


@pytest.mark.slow
def test_moving_the_center_of_gravity_gives_avls_file_about_the_new_center(folder):
    """AVL's file about x = 0.3 m, moved by cg to 0.375 m (by 0.1 chord), gives the A, static margin, elevator
    per g and c.g. of AVL's file about x = 0.375 m. Not moved, it gives another A.
    """
    models = []
    for place, x in (("300", 0.3), ("375", 0.375)):
        text = (ROOT / "examples/glider.toml").read_text()
        Path(f"{place}.st").write_text((HERE / f"glider_cg_{place}.st").read_text())
        text = text.replace("glider.st", f"{place}.st").replace("[0.3,", f"[{x},")
        Path(f"{place}.toml").write_text(text.replace("cg = 0.4", f"cg = {x / 0.75!r}"))
        models.append(tool.load_model(f"{place}.toml"))
    about_300, about_375 = models
    moved = about_300.with_parameters(cg=0.5)  # 0.375 m / 0.75 m
    points = [trim(each, free=("gamma",), thrust=0.0) for each in (moved, about_375)]
    found, expected = (linearize(point.model, point) for point in points)
    sizes = np.abs(expected.A).max(axis=1, keepdims=True)
    assert (np.abs(found.A - expected.A) < 2e-3 * sizes).all()
    not_moved = linearize(about_300, trim(about_300, free=("gamma",), thrust=0.0))
    assert (np.abs(not_moved.A - expected.A) > 2e-2 * sizes).any()
    for name in ("static margin", "elevator per g"):
        values = [point.sheet[name].value for point in points]
        assert values[0] == pytest.approx(values[1], rel=3e-3)
    x = [point.sheet["c.g. x"].value for point in points]
    assert x == pytest.approx([0.375, 0.375])
