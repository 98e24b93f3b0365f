"""Matrices in CSV files: plain, with names, and all in one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controller.game.csv_file import read_csv

A, B = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([[0.5], [1.0]])
PLAIN = "0,1\n-2,-3\n", ".5\n1e0\n"
NAMED = ",speed [ft/s],alpha [rad]\nspeed [ft/s],0,1\nalpha [rad],-2,-3\n", ",push\nspeed,0.5\nalpha,1\n"
HEADED = "speed,alpha\n0,1\n-2,-3\n", '"push"\n0.5\n1\n'
LONG = "matrix,row,column,value,unit\nA,x,x,0,\nA,x,y,1,\nA,y,x,-2,\nA,y,y,-3,\nB,x,u,0.5,\nB,y,u,1,\nX0,x,,68,\n"
STATES, INPUTS = {"states": ["speed", "alpha"]}, {"inputs": ["push"]}


def of(folder: Path, **texts: str) -> dict[str, Any]:
    for name, text in texts.items():
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    return read_csv(folder / f"{next(iter(texts))}.csv")


@pytest.mark.parametrize(
    ("texts", "names"),
    [
        (PLAIN, {}),
        (NAMED, {**STATES, "state_units": ["ft/s", "rad"], **INPUTS}),
        (HEADED, {**STATES, **INPUTS}),
        (("\ufeff" + PLAIN[0], PLAIN[1]), {}),
    ],
    ids=["plain", "named", "headed", "byte order mark"],
)
def test_a_plant_of_plain_files(texts: tuple[str, str], names: dict[str, list[str]], tmp_path: Path) -> None:
    found = of(tmp_path, A=texts[0], B=texts[1], Q="1,0\n0,1\n", delta="5\n")
    for name, known in (("A", A), ("B", B), ("Q", np.eye(2)), ("delta", [[5.0]])):
        np.testing.assert_array_equal(found.pop(name), known)
    assert found == names


def test_all_in_one(tmp_path: Path) -> None:
    found = of(tmp_path, plant=LONG)
    np.testing.assert_array_equal(found.pop("A"), A)
    np.testing.assert_array_equal(found.pop("B"), B)
    assert found == {"states": ["x", "y"], "inputs": ["u"]}


def test_units_of_the_states_are_those_of_the_columns_of_A(tmp_path: Path) -> None:
    unit = {"A,x,x": "(ft/s^2)/(ft/s)", "A,x,y": "(ft/s^2)/(rad)", "A,y,x": "(rad/s)/(ft/s)"}
    unit |= {"A,y,y": "(rad/s)/(rad)", "B,x,u": "(ft/s^2)/(lbf)", "B,y,u": "(rad/s)/(lbf)"}
    rows = "".join(f"{entry},1,{text}\n" for entry, text in unit.items())
    assert of(tmp_path, plant="matrix,row,column,value,unit\n" + rows)["state_units"] == ["ft/s", "rad"]


def test_a_critic_alone(tmp_path: Path) -> None:
    found = of(tmp_path, K="speed,alpha\n1,2\n", A=PLAIN[0])
    assert list(found) == ["K"]
    np.testing.assert_array_equal(found["K"], [[1.0, 2.0]])


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        ({"plant": PLAIN[0]}, "A.csv with B.csv beside it"),
        ({"B": PLAIN[1], "A": PLAIN[0]}, "A.csv with B.csv beside it"),
        ({"A": "0,1\n-2\n"}, "rows that differ in length"),
        ({"A": "x,y,z\n0,1\n-2,-3\n"}, "not one name for each column"),
        ({"A": "0,1\n-2,x\n"}, "A has an entry 'x'"),
        ({"A": "0,x\n-2,-3\n"}, "A has an entry 'x'"),
        ({"A": "0;1\n-2;-3\n"}, "A has its cells between semicolons or tabs; separate them by commas"),
        ({"K": "1\t2\n"}, "K has its cells between semicolons"),
        ({"A": ",x,y\ny,-2,-3\nx,0,1\n"}, "the columns of A are x, y and A has y, x; give one order"),
        ({"A": NAMED[0], "B": ",push\nalpha,1\nspeed,0.5\n"}, "the rows of B are alpha, speed and A has speed, alpha"),
        ({"plant": LONG.replace("A,x,x,0,\n", "").replace("A,y,x", "A,x,x,0,\nA,y,x")}, "the columns of A are y, x"),
        ({"plant": LONG.replace("A,x,y,1,\n", "")}, "A has 3 entries for 2 rows and 2 columns"),
        ({"plant": LONG + "A,x,x,9,\n"}, r"A\(x, x\) comes twice"),
        ({"plant": LONG + "A,x\n"}, "a row has 2 cells"),
    ],
)
def test_what_is_no_matrix_is_said(texts: dict[str, str], said: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=said):
        of(tmp_path, **texts)
