"""Gain schedules and scheduled controllers: files, units, and refusals."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_models import exact_gain
from scipy.io import savemat

import hfa
from hfa import BadInputError, Model, Signal
from hfa_aircraft import in_si
from hfa_flight import (
    GainSchedule,
    ScheduledController,
    load_controller,
    load_gain_schedule,
    save_controller,
)

FOOT, POUND = 0.3048, 4.4482216152605


def tank(x, u, p, w):
    return {"level": -x.level + u.push, "rate": x.level - x.rate}, {}


#: Plant in ft, ft/s and lbf, scheduled on its level.
TANK = Model(
    "tank",
    {"level": Signal("ft"), "rate": Signal("ft/s")},
    {"push": Signal("lbf")},
    tank,
    trim={"level": 0.5},
    schedule="level",
)


def controller(**changed: Any) -> ScheduledController:
    """Return a controller of one state at two levels, with different numbers in all matrices."""
    rng = np.random.default_rng(3)
    shapes = {"A": (1, 1), "B": (1, 3), "C": (1, 1), "D": (1, 3), "W": (1, 1)}
    rows = [{"level": level, "checks": [{"ok": True}]} for level in (2.0, 5.0)]
    given = {
        **{name: rng.standard_normal((2, *shape)) for name, shape in shapes.items()},
        "name": "small",
        "feedback": "output",
        "breakpoints": np.array([2.0, 5.0]),
        "states": ("level_integral",),
        "measurements": ("rate", "push_position"),
        "commands": ("level_command",),
        "inputs": ("push",),
        "trim_states": np.array([[2.0, 1.0], [5.0, 3.0]]),
        "trim_inputs": np.array([[4.0], [6.0]]),
        "about": {"angles": rows},
    }
    return ScheduledController(**(given | changed), model=TANK)


def test_units_do_not_change_what_a_controller_does(tmp_path: Path) -> None:
    """In SI, states, measurements, commands and inputs convert, also by a file and back."""
    english, model = controller(), in_si(TANK)
    save_controller(tmp_path / "english.npz", english)
    si = load_controller(tmp_path / "english.npz", model)
    x, u = np.array([3.0]), np.array([0.7])
    y = np.array([0.2, 5.0, -1.5])  # ft/s, lbf, ft
    to_si = np.array([FOOT, POUND, FOOT])
    for at in (2.0, 3.1, 5.0):
        A, B, C, D = english.at(at)
        A_si, B_si, C_si, D_si = si.at(at * FOOT)
        assert A_si @ (x * FOOT) + B_si @ (y * to_si) == pytest.approx((A @ x + B @ y) * FOOT)
        assert C_si @ (x * FOOT) + D_si @ (y * to_si) == pytest.approx((C @ x + D @ y) * POUND)
    assert si.W[0] @ (u * POUND) == pytest.approx(english.W[0] @ u * FOOT)
    assert si.trim_states == pytest.approx(english.trim_states * FOOT)
    assert si.trim_inputs == pytest.approx(english.trim_inputs * POUND)
    assert [row["level"] for row in si.about["angles"]] == pytest.approx([2 * FOOT, 5 * FOOT])
    for name, saved in (("english.npz", english), ("si.npz", si)):
        save_controller(tmp_path / name, saved)
        for wanted, expected in ((TANK, english), (model, si)):
            found = load_controller(tmp_path / name, wanted)
            for part in (*"ABCDW", "breakpoints", "trim_states", "trim_inputs"):
                assert getattr(found, part) == pytest.approx(getattr(expected, part), rel=1e-14)
    english.refuse_other(TANK, 2.0, 5.0)
    for beyond in ((1.9, 5.0), (2.0, 5.1)):
        with pytest.raises(BadInputError, match="covers level 2 to 5 ft"):
            english.refuse_other(TANK, *beyond)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"states": ("a b",)}, "use letters, digits and _"),
        ({"states": ("2a",)}, "use letters, digits and _"),
        ({"name": "a\nb"}, "use printable characters"),
        ({"command_filter": (1.0, 0.0)}, "command_filter is invalid"),
        ({"command_filter": (np.inf, 1.0)}, "command_filter is invalid"),
        ({"breakpoints": np.array([5.0, 5.0])}, "does not increase"),
        ({"trim_inputs": np.array([[4.0], [np.nan]])}, "trim_inputs has an entry that is not fin"),
        ({"measurements": ("rate", "depth")}, "unknown measurement 'depth'"),
        ({"commands": ("push_command",)}, "unknown command 'push_command'"),
        ({"inputs": ("level",)}, "unknown input 'level'"),
    ],
)
def test_wrong_parts_of_a_controller_are_refused(changed: dict[str, Any], said: str) -> None:
    with pytest.raises(BadInputError, match=re.escape(said)):
        controller(**changed)


def test_names_that_differ_in_capitals_are_refused() -> None:
    """C and MATLAB would take x and X for one variable."""
    two = {name: np.ones((2, *shape)) for name, shape in
           {"A": (2, 2), "B": (2, 3), "C": (1, 2), "D": (1, 3), "W": (2, 1)}.items()}  # fmt: skip
    controller(**two, states=("x", "y"))
    with pytest.raises(BadInputError, match="differ only in capitals"):
        controller(**two, states=("x", "X"))


def gains_file(folder: Path, **content: Any) -> Path:
    path = folder / ("gains.mat" if content.pop("matlab", False) else "gains.npz")
    if path.suffix == ".mat":
        savemat(path, content)
    else:
        np.savez(path, **content)
    return path


def test_gain_files_of_each_layout_are_read(tmp_path: Path) -> None:
    """One gain, a table with the value first, and one with the value last, in the file's units."""
    K = np.arange(6.0).reshape(3, 1, 2) + 1.0
    levels = np.array([1.0, 2.0, 4.0])
    for content in (
        {"K": K, "level": levels},
        {"K": np.moveaxis(K, 0, -1), "level": levels, "matlab": True},
    ):
        schedule = load_gain_schedule(gains_file(tmp_path, **content), TANK)
        np.testing.assert_array_equal(schedule.gains, K)
        np.testing.assert_array_equal(schedule.breakpoints, levels)
        np.testing.assert_allclose(schedule.table.at(3.0), (K[1] + K[2]) / 2.0)
        np.testing.assert_array_equal(schedule.table.at(9.0), K[2])
    square = np.arange(8.0).reshape(2, 2, 2)
    both = Model("two", TANK.states, {"push": Signal("lbf"), "pull": Signal("lbf")},
                 lambda x, u, p, w: ({"level": u.push, "rate": u.pull}, {}),
                 trim={"level": 0.5}, schedule="level")  # fmt: skip
    found = load_gain_schedule(gains_file(tmp_path, K=square, level=[1.0, 2.0]), both)
    np.testing.assert_array_equal(found.gains, square)  # the value is first if both would fit
    one = load_gain_schedule(gains_file(tmp_path, K=K[0], state_units=["m", "m/s"]), TANK)
    np.testing.assert_allclose(one.gains[0], K[0] * FOOT)
    one.refuse_beyond(-9.0, 9.0)
    model = hfa.aircraft()
    K15 = exact_gain(15.0)
    angles = {"K": np.stack([K15, 2.0 * K15]), "dihedral_deg": [10.0, 20.0]}
    of_angles = load_gain_schedule(gains_file(tmp_path, **angles), model)
    assert of_angles.breakpoints == pytest.approx(np.radians([10.0, 20.0]))
    assert of_angles.file_breakpoints.tolist() == [10.0, 20.0]
    of_angles.refuse_beyond(*np.radians([10.0, 20.0]))
    for beyond in ((9.9, 20.0), (10.0, 20.1)):
        with pytest.raises(BadInputError, match="the gains cover 10 deg to 20 deg"):
            of_angles.refuse_beyond(*np.radians(beyond))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"level": [1.0, 2.0]}, "K is missing"),
        ({"K": np.ones((2, 1))}, "K is 2 x 1; give a K of 1 x 2"),
        ({"K": np.ones((1, 2)), "dt": 0.1}, "a policy in steps of 0.1 s"),
        ({"K": np.ones((2, 1, 2))}, "level is missing"),
        ({"K": np.ones((1, 1, 2)), "level": [1.0]}, "fewer than two values"),
        ({"K": np.ones((2, 1, 2)), "level": [2.0, 1.0]}, "increasing order"),
        ({"K": np.ones((2, 1, 2)), "level": [1.0, np.nan]}, "not finite"),
        ({"K": [[[1.0, np.inf]], [[1.0, 2.0]]], "level": [1.0, 2.0]}, "not finite"),
        ({"K": np.ones((2, 1, 1)), "level": [1.0, 2.0]}, "K has shape (2, 1, 1)"),
        ({"K": np.ones((2, 1, 3)), "level": [1.0, 2.0]}, "K has shape (2, 1, 3)"),
        ({"K": np.ones((3, 1, 2)), "level": [1.0, 2.0]}, "K has shape (3, 1, 2)"),
        (
            {"K": np.ones((2, 1, 2)), "level": [1.0, 2.0], "state_units": ["m", "m/s"]},
            "convert K to ft, ft/s",
        ),
    ],
)
def test_wrong_gain_files_are_refused(tmp_path: Path, content: Any, said: str) -> None:
    with pytest.raises(BadInputError, match=re.escape(said)):
        load_gain_schedule(gains_file(tmp_path, **content), TANK)


def test_a_controller_without_states_is_the_schedule_of_its_gains() -> None:
    """u = D (x - X0) of a controller without states is u = -K (x - X0) of a gain schedule."""
    gains = np.array([[[1.0, 2.0]], [[3.0, 4.0]]])
    empty = {"A": np.zeros((2, 0, 0)), "B": np.zeros((2, 0, 2)), "C": np.zeros((2, 1, 0))}
    plain = controller(
        **empty, D=-gains, W=np.zeros((2, 0, 1)), states=(), measurements=TANK.linear, commands=()
    )
    schedule = plain.gain_schedule()
    assert isinstance(schedule, GainSchedule)
    np.testing.assert_array_equal(schedule.gains, gains)
    np.testing.assert_array_equal(schedule.breakpoints, [2.0, 5.0])
    assert controller().gain_schedule() is None
    assert replace(plain, measurements=TANK.linear[::-1]).gain_schedule() is None
    assert replace(plain, commands=("level_command",), B=np.zeros((2, 0, 3)),
                   D=np.zeros((2, 1, 3))).gain_schedule() is None  # fmt: skip


def test_gains_of_inputs_in_another_order_go_to_their_rows() -> None:
    model = hfa.aircraft()
    K = exact_gain(15.0)
    m, n = K.shape
    reordered = ScheduledController(
        *("gains", "state", np.array([0.26]), np.zeros((1, 0, 0)), np.zeros((1, 0, n))),
        *(np.zeros((1, m, 0)), -K[None, ::-1], np.zeros((1, 0, m)), (), model.linear, ()),
        *(tuple(model.inputs)[::-1], np.zeros((1, len(model.states))), np.zeros((1, m))),
        model=model,
    )
    schedule = reordered.gain_schedule()
    assert schedule is not None
    np.testing.assert_array_equal(schedule.gains[0], K)
