"""Usual spellings of units in tables of derivatives, on the command line and in flight records."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import hfa as run
from project import ROOT

import hfa
from hfa.options.argument_types import quantity
from hfa_identify.faults import _UNITS
from hfa_identify.records import read_record
from hfa_support.units import conversion

UAV = str(ROOT / "examples" / "uav.toml")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("speed = 35.0", 'speed = "68.0346 kt"'),
        ("speed = 35.0", 'speed = "68.0346 knots"'),
        ("speed = 35.0", 'speed = "6889.76 ft/min"'),
        ("CL_alpha = 3.45", 'CL_alpha = "3.45 1/rad"'),
        ("CL_alpha = 3.45", 'CL_alpha = "0.0602139 1/deg"'),
    ],
)
def test_units_of_an_entry_of_a_table(old: str, new: str, tmp_path: Path) -> None:
    """Each entry of a table may have its own unit. The trim is that of the table in SI units."""
    text = Path(UAV).read_text()
    assert old in text
    path = tmp_path / "uav.toml"
    path.write_text(text.replace(old, new))
    found = hfa.trim(hfa.load_model(str(path))).states
    np.testing.assert_allclose(found, hfa.trim(hfa.load_model(UAV)).states, rtol=1e-4, atol=1e-6)


def test_units_of_a_held_value() -> None:
    """--hold accepts a value with a unit: each text is 30 m/s."""
    model = hfa.load_model(UAV)
    for typed in (
        *("58.3153kt", "58.3153 knots", "108km/h", "5905.51ft/min"),
        *("3e1", "+30.", "3.0E+1 m/s", ".3e2"),
    ):
        assert quantity(model, "speed", typed) == pytest.approx(30.0, rel=1e-4), typed
    result = run("trim", "--aircraft", UAV, "--hold", "speed=58.3153kt", "--json")
    assert result.code == 0, result.err
    states = json.loads(result.out)["operating_point"]["states"]
    assert states["speed"] == pytest.approx(30.0, rel=1e-4)


def test_units_in_which_a_column_is_suspected() -> None:
    """The factor of each suspected unit is that of the conversion to this unit."""
    known = [
        (factor, conversion(unit, text.removeprefix("is in ")))
        for unit, faults in _UNITS.items()
        for factor, text in faults.items()
    ]
    factors, expected = zip(*[each for each in known if each[1] is not None], strict=True)
    assert len(factors) >= 8
    np.testing.assert_allclose(factors, expected, rtol=1e-5)


#: Times, s, angles of attack, rad, and speeds, m/s, of a record.
TIME = 0.02 * np.arange(12)
ALPHA = 0.1 + 0.01 * np.arange(12)
SPEED = 30.0 + np.arange(12)


def read_as_written(folder: Path, head: str, columns: list[np.ndarray], separator: str) -> None:
    """Write the columns with this first row, and compare the record that is read with them."""
    path = folder / "record.csv"
    rows = [separator.join(f"{value:.9g}" for value in row) for row in np.transpose(columns)]
    decimal = "," if separator == ";" else "."
    text = "\n".join([head, *(row.replace(".", decimal) for row in rows)])
    path.write_text(text, encoding="utf-8")
    model = hfa.load_model(UAV)
    record = read_record(str(path), model, dict.fromkeys(model.inputs, 0.0))
    np.testing.assert_allclose(record.time, TIME, atol=1e-9)
    np.testing.assert_allclose(record.measured["alpha"], ALPHA, rtol=1e-6)
    np.testing.assert_allclose(record.measured["speed"], SPEED, rtol=1e-6)


@pytest.mark.parametrize(
    ("head", "factors", "separator"),
    [
        ("time,alpha [°],speed", (1.0, np.degrees(1.0), 1.0), ","),
        ("time,alpha [degrees],speed", (1.0, np.degrees(1.0), 1.0), ","),
        ("time,alpha,speed [kt]", (1.0, 1.0, 1.0 / 0.514444444), ","),
        ("time,alpha,speed [kn]", (1.0, 1.0, 1.0 / 0.514444444), ","),
        ("time,alpha,speed [km/h]", (1.0, 1.0, 3.6), ","),
        ("time [ms],alpha,speed", (1e3, 1.0, 1.0), ","),
        ("time [us],alpha,speed", (1e6, 1.0, 1.0), ","),
        ("time;alpha;speed", (1.0, 1.0, 1.0), ";"),
        ("time\talpha\tspeed", (1.0, 1.0, 1.0), "\t"),
    ],
)
def test_units_and_separators_of_a_record(
    head: str, factors: tuple[float, float, float], separator: str, tmp_path: Path
) -> None:
    """Columns of a record are converted from usual units, and usual separators are recognized."""
    columns = [each * factor for each, factor in zip((TIME, ALPHA, SPEED), factors, strict=True)]
    read_as_written(tmp_path, head, columns, separator)


def test_units_of_a_record_that_are_read(tmp_path: Path) -> None:
    """A record in deg and with commas is read."""
    read_as_written(tmp_path, "time,alpha [deg],speed", [TIME, np.degrees(ALPHA), SPEED], ",")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_ms,alpha\n0,0.1", r'unknown column .time_ms.; write "time \[ms\]"'),
        ("time,speed_kt\n0,30", r'unknown column .speed_kt.; write "speed \[kt\]"'),
        ("time\talpha\n0,02\t0,1", "row 2: time is '0,02'; give a decimal point, or separate"),
        (
            "time,alpha\n0,02,0,1",
            "row 2 has 4 cells.*separate cells by ; if the decimal is a comma",
        ),
        ("time;alpha\n0,02;0.1", "contains decimal commas and points"),
        ("time,alpha\ns,deg", r'row 2: time is .s.; .*units follow names, as in "alpha \[deg\]"'),
    ],
)
def test_what_a_record_does_not_say_is_refused(text: str, message: str, tmp_path: Path) -> None:
    """A unit outside the brackets and an unclear decimal are refused with what to write."""
    path = tmp_path / "record.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(hfa.BadInputError, match=message):
        read_record(str(path), hfa.load_model(UAV), {})
