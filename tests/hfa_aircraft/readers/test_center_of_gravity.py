"""Other centers of gravity, compared with own equations in numpy with all rates."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from project import ROOT
from six_dof import SixDof

from hfa import BadInputError, Model, from_derivatives, linearize, trim

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
PLACES = (0.20, 0.28, 0.35)


def assert_equal_flights(model: Model, own: SixDof, **held: float) -> None:
    """Compare a trim, its figures and its modes with the own equations."""
    point = trim(model, **held)
    roll = point["roll"]
    expected = own.trim(
        point["speed"], point["altitude"], held.get("gamma", 0.0), point["turn_rate"]
    )
    sheet = point.sheet
    names = ("load factor", "L/D", "static margin", "calibrated airspeed")
    found = [point["alpha"], point["pitch"], roll, point["thrust"], point["elevator"]]
    found += [sheet[name].value for name in names]
    assert found == pytest.approx(list(expected[:-1]), rel=1e-4, abs=2e-6)
    modes = np.sort_complex(np.linalg.eigvals(linearize(model, point).A))
    assert modes == pytest.approx(expected.modes, rel=2e-4, abs=1e-5)


@pytest.mark.parametrize(
    "held",
    [
        {"speed": 28.0, "gamma": 0.1, "cg": 0.28},
        *(
            pytest.param({**held, "cg": cg}, marks=pytest.mark.slow)
            for held in (
                {},
                {"turn_rate": 0.2},
                {"speed": 45.0, "altitude": 2500.0},
                {"gamma": -0.1},
            )
            for cg in PLACES
        ),
    ],
)
def test_flights_at_another_center_equal_own_equations(held: dict[str, float]) -> None:
    """Trims, figures and modes at three places, level, in climbs and in turns, equal r x F."""
    cg = held.pop("cg")
    model = from_derivatives(TABLE).with_parameters(cg=cg)
    assert_equal_flights(model, SixDof(TABLE, cg), **held)


def test_rates_equal_own_equations() -> None:
    """The rates of a spinning, banked, slipping aircraft equal those of the own equations."""
    table = TABLE | {"CL_alphadot": 60.0}  # much lift by the rate of alpha
    model, own = from_derivatives(table).with_parameters(cg=0.28), SixDof(table, 0.28)
    x = dict(
        zip(model.states, [38.0, 0.15, -0.6, 0.4, -0.3, 0.5, 0.7, -0.4, 0.3, 900.0], strict=True)
    )
    u = np.array([25.0, 0.2, -0.1, 0.15])
    found = model.rates_at(list(x.values()), u)
    (speed, alpha, beta), (roll, pitch) = list(x.values())[:3], (x["roll"], x["pitch"])
    in_plane = speed * np.cos(beta)
    velocity = np.array([in_plane * np.cos(alpha), speed * np.sin(beta), in_plane * np.sin(alpha)])
    spin = [x["roll_rate"], x["pitch_rate"], x["yaw_rate"]]
    f = own.rates(np.array([*velocity, *spin, roll, pitch]), u, x["altitude"])
    along = velocity @ f[:3] / speed
    down = np.array([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])
    expected = [
        along,
        (velocity[0] * f[2] - velocity[2] * f[0]) / in_plane**2,
        (speed * f[1] - velocity[1] * along) / (speed * in_plane),
        *f[3:],
        (spin[1] * np.sin(roll) + spin[2] * np.cos(roll)) / np.cos(pitch),
        -velocity @ down,
    ]
    assert list(found.values()) == pytest.approx(expected, rel=1e-4)


def test_a_tail_arm_scales_the_damping() -> None:
    """With lift by rates at a tail, C_mq = -C_Lq l/c, the modes are those of the moved tail."""
    arm, chord, moved = 0.9, 0.18994, 0.1 * 0.18994
    tail = {"CL_q": 5.0, "CL_alphadot": 1.5, "Cm_alphadot": -1.5 * arm / chord, "cg": 0.2}
    table = UAV | tail | {"longitudinal": {**UAV["longitudinal"], "Cm_q": -5.0 * arm / chord}}
    share = 1.0 - moved / arm  # of the speed of the tail at the same pitch rate
    own = SixDof(table, 0.3)
    own.of |= {"CL_q": share * 5.0, "Cm_q": -share * 5.0 * arm / chord}
    assert_equal_flights(from_derivatives(table | {"tail_arm": arm}).with_parameters(cg=0.3), own)


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
