"""Other centers of gravity, compared with own equations in numpy with all rates."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from project import ROOT
from six_dof import GRAVITY, SixDof, air

from hfa import BadInputError, Model, from_derivatives

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


def assert_equal_rates(model: Model, own: SixDof) -> None:
    """Compare the rates of a spinning, banked, slipping aircraft with those of the own equations.

    Without lift by the rate of alpha, its loads are compared, too.
    """
    x = [38.0, 0.15, -0.6, 0.4, -0.3, 0.5, 0.7, -0.4, 0.3, 900.0]
    u = np.array([25.0, 0.2, -0.1, 0.15])
    speed, alpha, beta, *spin, roll, pitch, _, altitude = x
    in_plane = speed * np.cos(beta)
    velocity = np.array([in_plane * np.cos(alpha), speed * np.sin(beta), in_plane * np.sin(alpha)])
    f = own.rates(np.array([*velocity, *spin, roll, pitch]), u, altitude)
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
    if own.get("CL_alphadot"):
        return
    at = air(altitude, own.warmer)
    force, _, lift, drag, moment = own.loads(np.array([alpha, beta, speed]), np.array(spin), u, at)
    normal = (force[0] * np.sin(alpha) - force[2] * np.cos(alpha)) / (own.of["mass"] * GRAVITY)
    pressed = 0.5 * at.density * speed**2 * own.of["wing_area"]
    names = ("lift", "drag", "pitching_moment", "load_factor", "turn_rate")
    assert model.outputs_at(x, u, names) == pytest.approx(
        dict(zip(names, (pressed * lift, pressed * drag, moment, normal, turning), strict=True)),
        rel=1e-4,
    )


@pytest.mark.parametrize(
    ("cg", "warmer", "lag"), [(0.2, 0.0, 0.0), (0.28, 15.0, 60.0), (0.35, 0.0, 0.0)]
)
def test_rates_at_another_center_equal_own_equations(cg: float, warmer: float, lag: float) -> None:
    """Rates and loads at three places equal r x F, also in warm air and with lift by alphadot."""
    table = TABLE | {"CL_alphadot": lag}
    model = from_derivatives(table).with_parameters(cg=cg, isa=warmer)
    assert_equal_rates(model, SixDof(table, cg, warmer))


def test_a_tail_arm_scales_the_damping() -> None:
    """With lift by rates at a tail, C_mq = -C_Lq l/c, the rates are those of the moved tail."""
    arm, chord, moved = 0.9, 0.18994, 0.1 * 0.18994
    tail = {"CL_q": 5.0, "CL_alphadot": 1.5, "Cm_alphadot": -1.5 * arm / chord, "cg": 0.2}
    table = UAV | tail | {"longitudinal": {**UAV["longitudinal"], "Cm_q": -5.0 * arm / chord}}
    share = 1.0 - moved / arm  # of the speed of the tail at the same pitch rate
    own = SixDof(table, 0.3)
    own.of |= {"CL_q": share * 5.0, "Cm_q": -share * 5.0 * arm / chord}
    model = from_derivatives(table | {"tail_arm": arm}).with_parameters(cg=0.3)
    assert_equal_rates(model, own)


def test_the_sheet_repeats_configuration_words(folder: Path) -> None:
    """--hold cg=0.28, and the words of flap and gear, are on the sheet and in its data."""
    text = (ROOT / "examples/uav.toml").read_text()
    Path("uav.toml").write_text('cg = 0.25\nflap = "20 deg, slotted"\ngear = "down"\n' + text)
    run = hfa("trim", "--aircraft", "uav.toml", "--hold", "cg=0.28", "--json")
    found = json.loads(run.out)["sheet"]
    assert (found["c.g."]["value"], found["c.g."]["unit"]) == (0.28, "chord")
    assert (found["flap"]["value"], found["gear"]["value"]) == ("20 deg, slotted", "down")


def test_a_center_that_is_not_finite_is_refused() -> None:
    """A value of the parameter that is not finite is refused in one line."""
    model = from_derivatives(UAV | {"cg": 0.25})
    for value in (float("nan"), float("inf")):
        with pytest.raises(BadInputError, match=f"cg is {value}; give a finite number"):
            model.with_parameters(cg=value)
    assert_refused(
        hfa("trim", "--aircraft", str(ROOT / "examples/uav.toml"), "--hold", "cg=0.3"), 2, "cg"
    )
