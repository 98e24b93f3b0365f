"""Other centers of gravity, compared with own equations in numpy and with AVL at both places."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from project import ROOT
from six_dof import SixDof

import hfa as tool
from hfa import BadInputError, Model, from_derivatives, linearize, trim

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


def test_a_tail_arm_scales_the_damping() -> None:
    """With lift by rates at a tail, C_mq = -C_Lq l/c, the modes are those of the moved tail."""
    arm, chord, moved = 0.9, 0.18994, 0.1 * 0.18994
    tail = {"CL_q": 5.0, "CL_alphadot": 1.5, "Cm_alphadot": -1.5 * arm / chord, "cg": 0.2}
    table = UAV | tail | {"longitudinal": {**UAV["longitudinal"], "Cm_q": -5.0 * arm / chord}}
    share = 1.0 - moved / arm  # of the speed of the tail at the same pitch rate
    own = SixDof(table, 0.3)
    own.of |= {"CL_q": share * 5.0, "Cm_q": -share * 5.0 * arm / chord}
    assert_equal_flights(from_derivatives(table | {"tail_arm": arm}).with_parameters(cg=0.3), own)


@pytest.mark.slow
def test_avl_at_two_centers_is_one_aircraft(folder: Path) -> None:
    """A file about 0.3 moved by 0.1 chord has the matrices and the sheet of a file about 0.375."""
    models = []
    for place, x in (("300", 0.3), ("375", 0.375)):
        text = (ROOT / "examples/glider.toml").read_text()
        Path(f"{place}.st").write_text((HERE / f"glider_cg_{place}.st").read_text())
        text = text.replace("glider.st", f"{place}.st").replace("[0.3,", f"[{x},")
        Path(f"{place}.toml").write_text(text.replace("cg = 0.4 ", f"cg = {x / 0.75!r} "))
        models.append(tool.load_model(f"{place}.toml"))
    ahead, behind = models
    moved = ahead.with_parameters(cg=0.5)
    points = [trim(each, free=("gamma",), thrust=0.0) for each in (moved, behind)]
    found, expected = (linearize(point.model, point) for point in points)
    sizes = np.abs(expected.A).max(axis=1, keepdims=True)
    assert (np.abs(found.A - expected.A) < 2e-3 * sizes).all()
    kept = linearize(ahead, trim(ahead, free=("gamma",), thrust=0.0))
    assert (np.abs(kept.A - expected.A) > 2e-2 * sizes).any()
    for name in ("static margin", "elevator per g"):
        values = [point.sheet[name].value for point in points]
        assert values[0] == pytest.approx(values[1], rel=3e-3)
    x = [point.sheet["c.g. x"].value for point in points]
    assert x == pytest.approx([0.375, 0.375])


def test_the_center_does_not_depend_on_units() -> None:
    """A table in ft, slug and lbf has the same flights at the same cg."""
    metric = from_derivatives(TABLE | {"tail_arm": 0.9})
    in_feet = {
        "units": "english",
        "wing_area": "0.55 m^2", "span": "2.8956 m", "chord": "0.18994 m", "mass": "13.5 kg",
        "speed": "35 m/s", "altitude": "100 m", "thrust_height": "0.05 m", "tail_arm": "0.9 m",
        "thrust": ["0 N", "60 N"],
        **{name: f"{UAV['mass'][name]} kg m^2" for name in ("Ixx", "Iyy", "Izz", "Ixz")},
    }  # fmt: skip
    inner = ("geometry", "mass", "condition")
    rest = {name: each for name, each in TABLE.items() if name not in (*inner, *in_feet)}
    english = from_derivatives(rest | in_feet)
    eigenvalues = []
    for model in (metric, english):
        there = model.with_parameters(cg=0.33)
        eigenvalues.append(np.sort_complex(np.linalg.eigvals(linearize(there, trim(there)).A)))
    assert eigenvalues[0] == pytest.approx(eigenvalues[1], rel=1e-6, abs=1e-9)


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
