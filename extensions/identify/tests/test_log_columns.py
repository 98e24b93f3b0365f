"""Columns of a log whose messages are given, so that pyulog is not needed."""

from __future__ import annotations

import sys
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from project import ROOT
from scipy.spatial.transform import Rotation

import hfa
from hfa_identify.minima import _alike
from hfa_identify.plan import _shapes
from hfa_identify.ulog import ulog_columns

UAV = hfa.load_model(str(ROOT / "examples" / "uav.toml"))
BEGIN = 5_000_000
STAMPS = BEGIN + 20_000 * np.arange(100)
ANGLES = np.random.default_rng(4).uniform(-1.2, 1.2, (20, 3))


def messages() -> list[Any]:
    """Rates at 50 Hz, the attitude at 10 Hz 3 ms later, and two steps of a servo."""
    x, y, z, w = Rotation.from_euler("ZYX", ANGLES[:, ::-1]).as_quat().T
    attitude = {f"q[{place}]": each for place, each in enumerate((w, x, y, z))}
    rates = {"timestamp": STAMPS, "xyz[0]": np.arange(100.0), "xyz[1]": -np.arange(100.0)}
    servo = {
        "timestamp": np.array([BEGIN + 100_000, BEGIN + 1_000_000]),
        "u": np.array([0.5, -1.0]),
    }
    return [
        SimpleNamespace(name="rates", multi_id=1, data=rates),
        SimpleNamespace(
            name="attitude", multi_id=0, data={"timestamp": STAMPS[::5] + 3_000, **attitude}
        ),
        SimpleNamespace(name="servo", multi_id=0, data=servo),
    ]


@pytest.fixture
def columns(folder: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    def read(table: str) -> dict[str, np.ndarray]:
        (folder / "c.toml").write_text(table)
        (folder / "a.ulg").write_bytes(b"")
        return ulog_columns(folder / "a.ulg", folder / "c.toml", UAV)

    log = SimpleNamespace(data_list=messages(), start_timestamp=BEGIN)
    monkeypatch.setitem(sys.modules, "pyulog", SimpleNamespace(ULog=lambda file: log))
    return read


TABLE = """
[columns]
roll = "attitude.roll"
pitch = "attitude.pitch"
roll_rate = { field = "rates.xyz[0]", instance = 1, scale = 2.0, offset = -3.0 }
elevator = { field = "servo.u", scale = 0.4 }
"""


def test_columns_have_the_times_of_the_densest_message(columns: Any) -> None:
    """Angles of the quaternion at the nearest time, inputs held, each times scale plus offset."""
    found = columns(TABLE)
    t = found["time"]
    np.testing.assert_allclose(t, 0.02 * np.arange(100), atol=1e-9)
    np.testing.assert_allclose(found["roll_rate"], 2.0 * np.arange(100) - 3.0)
    for name, angles in (("roll", ANGLES[:, 0]), ("pitch", ANGLES[:, 1])):
        np.testing.assert_allclose(found[name][::5], angles, atol=1e-9)
        assert np.isnan(np.delete(found[name], np.s_[::5])).all()
    held = np.where(t < 0.0999, np.nan, np.where(t < 0.9999, 0.2, -0.4))
    np.testing.assert_allclose(found["elevator"], held)


def test_a_part_of_the_flight_begins_at_zero(columns: Any) -> None:
    found = columns(TABLE + "[flight]\nbegin = 0.5\nend = 1.001\n")
    np.testing.assert_allclose(found["time"], 0.02 * np.arange(26), atol=1e-9)
    assert found["roll_rate"][0] == 2.0 * 25 - 3.0
    np.testing.assert_allclose(found["pitch"][::5], ANGLES[5:11, 1])
    assert found["elevator"][[24, 25]].tolist() == pytest.approx([0.2, -0.4])


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ("[colums]\n", "unknown key 'colums'"),
        ("[columns]\n", "has no .columns."),
        ("[columns]\nroll = 'attitude'", "roll is .'field': 'attitude'"),
        ("[columns]\nroll = { field = 'attitude.roll', skale = 2 }", "unknown key 'skale'"),
        ("[columns]\nroll = { field = 'attitude.roll', scale = 'x' }", "scale of roll is 'x'"),
        ("[columns]\nroll = 'altitude.roll'", "no message 'altitude'"),
        ("[columns]\nroll_rate = 'rates.xyz[0]'", "rates has no instance 0"),
        ("[columns]\nroll = 'servo.roll'", "servo has no field"),
        ("[columns]\nroll = 'servo.v'", "servo has no field 'v'"),
        ("[columns]\nelevator = 'servo.u'", "no column of a measured state or output"),
        (TABLE + "[flight]\nbegin = 9.0", "contains no samples; give times within the log, 0.0 to 2.0"),
        (TABLE + "[flight]\nstart = 1.0", "unknown key 'start'"),
        (TABLE + "[flight]\nend = 'x'", "give a number of seconds"),
    ],
)  # fmt: skip
def test_a_wrong_table_is_refused(columns: Any, table: str, said: str) -> None:
    with pytest.raises(hfa.BadInputError, match=said):
        columns(table)
    with pytest.raises(hfa.BadInputError, match="requires a file that defines the columns"):
        ulog_columns(ROOT / "a.ulg", None, UAV)


def test_maneuvers_have_their_pulses() -> None:
    """A doublet of 1, -1 and a 3-2-1-1 of whole pulses, and a sum of sines between -1 and 1."""
    t = np.arange(0.0, 20.0, 0.05)
    for kind, unit, shape in _shapes(t):
        assert np.abs(shape).max() == 1.0
        if kind == "multisine":
            assert unit == t[-1]
            spectrum = np.abs(np.fft.rfft(shape[:-1]))
            assert (spectrum[1:25] > 0.3 * spectrum.max()).all()
            assert spectrum[30:].max() < 0.05 * spectrum.max()
            continue
        changes = np.flatnonzero(np.diff(shape))
        lengths = {"doublet": [1, 1], "3-2-1-1": [3, 2, 1, 1]}[kind]
        np.testing.assert_allclose(np.diff(changes) * 0.05, unit * np.array(lengths), atol=0.051)
        signs = [shape[(one + other) // 2 + 1] for one, other in pairwise(changes)]
        assert signs == [1.0, -1.0, 1.0, -1.0][: len(lengths)]
        assert shape[0] == shape[-1] == 0.0


def test_second_minima_are_deep_between_higher_values() -> None:
    """The first minimum is nearest to 1; a second one counts below half of the ridge between."""
    multiples = np.linspace(-2.0, 3.0, 11)
    different = np.array([9.0, 2.0, 8.0, 6.0, 3.9, 5.0, 0.0, 4.0, 3.0, 7.0, 9.0])
    found = list(_alike(multiples, different))
    assert found == [
        (-1.5, pytest.approx(2.0 / 8.0)),
    ]
    deeper = different.copy()
    deeper[8] = 1.9
    assert list(_alike(multiples, deeper))[1:] == [(2.0, pytest.approx(1.9 / 4.0))]
