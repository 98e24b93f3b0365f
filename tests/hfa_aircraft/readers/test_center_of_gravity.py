"""Other centers of gravity, compared with equations of the tests in numpy and with AVL at both places."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from project import ROOT

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


#: Tail arm, m, and chord of UAV, m; all lift by rates acts at the tail: C_mq = -C_Lq l/c.
ARM, CHORD = 0.9, 0.18994
TAIL = {"CL_q": 5.0, "CL_alphadot": 1.5, "Cm_alphadot": -1.5 * ARM / CHORD, "cg": 0.2}
TAIL |= {"longitudinal": {**UAV["longitudinal"], "Cm_q": -5.0 * ARM / CHORD}, "tail_arm": ARM}


@pytest.mark.parametrize(
    ("number", "table", "moved"),
    [
        (0, TABLE | {"CL_alphadot": 0.0}, {"cg": 0.2}),
        (1, TABLE | {"CL_alphadot": 60.0}, {"cg": 0.28, "isa": 15.0}),
        (2, TABLE | {"CL_alphadot": 0.0}, {"cg": 0.35}),
        (3, TABLE, {"cg": 0.3, "isa": -20.0}),
        (4, UAV | TAIL, {"cg": 0.3}),
    ],
)
def test_rates_at_another_center_of_gravity_equal_independent_equations(number, table, moved):
    """The rates of a spinning, banked, slipping aircraft, and without lift by the rate of alpha also loads
    and load factor, are those in `six_dof.json`, of equations in NumPy that sum the forces of the
    table at its point and move them to the center by r x F (`six_dof.py` of commit 199915ecb).

    With a tail arm l, a center Δ behind that of the table reduces the speed of the tail at the same
    pitch rate, and thus the lift C_Lq, by the factor 1 - Δ/l.
    """
    expected = json.loads((HERE / "six_dof.json").read_text("utf-8"))[number]
    model = from_derivatives(table).with_parameters(**moved)
    # speed, alpha, beta, three rates, roll, pitch, yaw, altitude; thrust and surfaces
    at = [38.0, 0.15, -0.6, 0.4, -0.3, 0.5, 0.7, -0.4, 0.3, 900.0], [25.0, 0.2, -0.1, 0.15]
    assert [*model.rates_at(*at).values()] == pytest.approx(expected["rates"], rel=1e-4)
    outputs = expected["outputs"]
    assert model.outputs_at(*at, [*outputs]) == pytest.approx(outputs, rel=1e-4)


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
