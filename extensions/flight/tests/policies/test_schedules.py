"""Gain schedules: files, units, and refusals."""

import re

import numpy as np
import pytest
from scipy.io import savemat

import hfa
from hfa import BadInputError, Model, Signal
from hfa_flight import GainSchedule, Scenario, Waveform, load_gain_schedule

FOOT, POUND = 0.3048, 4.4482216152605


def tank(x, u, p, w):
    """Return the rates of a tank: level' = push - level, rate' = level - rate."""
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


def gains_file(folder, **content):
    """Write the content of a gain file, .npz or with matlab=True .mat, and return its path."""
    path = folder / ("gains.mat" if content.pop("matlab", False) else "gains.npz")
    if path.suffix == ".mat":
        savemat(path, content)
    else:
        np.savez(path, **content)
    return path


#: A gain of 1 input x 2 states at each of three levels.
LEVELS = np.array([1.0, 2.0, 4.0])
K = np.arange(6.0).reshape(3, 1, 2) + 1.0


@pytest.mark.parametrize(
    "content",
    [{"K": K, "level": LEVELS}, {"K": np.moveaxis(K, 0, -1), "level": LEVELS, "matlab": True}],
    ids=["levels first", "levels last, of MATLAB"],
)
def test_a_table_is_linear_between_its_breakpoints_and_constant_beyond(tmp_path, content):
    """The tables of three levels, 1 input and 2 states are (3, 1, 2) and (1, 2, 3)."""
    schedule = load_gain_schedule(gains_file(tmp_path, **content), TANK)
    np.testing.assert_array_equal(schedule.gains, K)
    np.testing.assert_array_equal(schedule.breakpoints, LEVELS)
    np.testing.assert_allclose(schedule.table.at(3.0), (K[1] + K[2]) / 2.0)
    np.testing.assert_array_equal(schedule.table.at(9.0), K[2])


def test_gains_are_converted_from_the_units_of_their_file(tmp_path):
    """K in N per m and N per m/s, at levels in m, of a model in lbf, ft and ft/s."""
    metric = {"state_units": ["m", "m/s"], "input_units": ["N"]}
    single = load_gain_schedule(gains_file(tmp_path, K=K[0], **metric), TANK)
    np.testing.assert_allclose(single.gains[0], K[0] * FOOT / POUND)
    table = load_gain_schedule(gains_file(tmp_path, K=K, level=LEVELS * FOOT, **metric), TANK)
    np.testing.assert_allclose(table.breakpoints, LEVELS)
    np.testing.assert_allclose(table.gains, K * FOOT / POUND)


def test_a_gain_table_is_refused_beyond_its_ends_and_a_single_gain_is_not(tmp_path):
    """A single gain applies at all values of the schedule variable. A table covers its breakpoints: these
    are angles, which files have in degrees and the table in radians.
    """
    load_gain_schedule(gains_file(tmp_path, K=K[0]), TANK).refuse_beyond(-9.0, 9.0)
    levels = GainSchedule(LEVELS, K, TANK)
    levels.refuse_beyond(1.0 - 2e-9, 4.0 + 2e-9)  # by rounding, of a range of 3 ft
    for low, high in ((1.0 - 4e-9, 3.0), (2.0, 4.1)):
        with pytest.raises(BadInputError, match="the gains cover 1 ft to 4 ft"):
            levels.refuse_beyond(low, high)
    assert levels.file_breakpoints.tolist() == LEVELS.tolist()
    angles = gains_file(tmp_path, K=np.ones((2, 5, 6)), dihedral_deg=[10.0, 20.0])
    table = load_gain_schedule(angles, hfa.aircraft())
    assert table.breakpoints == pytest.approx(np.radians([10.0, 20.0]))
    assert table.file_breakpoints.tolist() == [10.0, 20.0]
    with pytest.raises(BadInputError, match="the gains cover 10 deg to 20 deg"):
        table.refuse_beyond(*np.radians([10.0, 20.1]))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"level": [1.0, 2.0]}, "K is missing"),
        ({"K": np.ones((2, 1))}, "K is 2 x 1; give a K of 1 x 2"),
        ({"K": np.ones((1, 2)), "dt": 0.1}, "a policy in steps of 0.1 s"),
        ({"K": np.ones((2, 1, 2))}, "level is missing"),
        ({"K": np.ones((1, 2)), "states": ["rate", "level"]}, "reorder"),
        ({"K": np.ones((1, 1, 2)), "level": [1.0]}, "fewer than two values"),
        ({"K": np.ones((2, 1, 2)), "level": [2.0, 1.0]}, "increasing order"),
        ({"K": [[[1.0, np.inf]], [[1.0, 2.0]]], "level": [1.0, 2.0]}, "give finite entries"),
        ({"K": [[[1.0, 1e308]], [[1.0, 2.0]]], "level": [1.0, 2.0]}, "K[0][0][1] is 1e+308"),
        ({"K": np.ones((2, 1, 3)), "level": [1.0, 2.0]}, "K has shape (2, 1, 3)"),
        (
            {"K": np.ones((2, 1, 2)), "level": [1.0, 2.0], "input_units": ["mol"]},
            "input 1 is in mol",
        ),
    ],
)
def test_wrong_gain_files_are_refused(tmp_path, content, said):
    """The tank has 1 input and 2 states, and is scheduled over its level."""
    with pytest.raises(BadInputError, match=re.escape(said)):
        load_gain_schedule(gains_file(tmp_path, **content), TANK)


def test_a_policy_with_a_reference_follows_no_other():
    """Tables of gains and `hfa.track` fly by their own reference, and refuse that of a scenario."""
    point = hfa.trim(TANK)
    table = GainSchedule(np.array([0.0, 1.0]), np.ones((2, 1, 2)), TANK)
    linear = hfa.linearize(TANK, point)
    tracking = hfa.track(linear, hfa.solve(hfa.game(linear, Q=np.ones(2), R=[1.0])), {"level": 0.1})
    up = Scenario(reference=Waveform(np.array([0.1, 0.0]), np.zeros(2)))
    for policy in (table, tracking):
        hfa.fly(TANK, point, policy, 0.1)
        with pytest.raises(BadInputError, match="follows a reference of its own"):
            hfa.fly(TANK, point, policy, 0.1, scenario=up)
