"""`--units si`: physics holds in the numbers that are written, dimensionless results stay, units are given."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import answer, assert_refused, hfa

from hfa_support.reporting import unit_system as units

FOOT = 0.3048
COMMANDS = {
    "trim": ("trim", "--dihedral", "12"),
    "linearize": ("linearize", "--dihedral", "12", "--outputs", "vertical_acceleration,alpha"),
    "solve": ("solve", "--dihedral", "12"),
    "sweep": ("sweep", "--dihedral", "10", "--hold", "speed=18.288,20.7264"),
    "validate": ("validate",),
}
ENGLISH = ("ft", "lbf", "slug")


def physics(data: dict[str, Any]) -> dict[str, float]:
    """What must be 1, of a trim: laws of physics between its own numbers."""
    about, loads, states = data["performance"], data["loads"], data["operating_point"]["states"]
    pressure = 0.5 * about["density"] * states["speed"] ** 2
    force = pressure * about["wing_area"]
    return {
        "dynamic pressure": about["dynamic_pressure"] / pressure,
        "lift coefficient": loads["lift"] / (force * about["lift_coefficient"]),
        "Mach number": states["speed"] / (about["speed_of_sound"] * about["mach"]),
        # T = 288.15 K - 6.5 K/km h up to 11 km, isothermal above: the speed of sound of the standard atmosphere, m/s.
        "speed of sound": about["speed_of_sound"] / 295.07,
        "gravity": about["weight"] / (3 * 9.326 * 14.5939029 * 32.2 * FOOT),
    }


def test_the_laws_of_physics_hold_in_si() -> None:
    for name, value in physics(answer(*COMMANDS["trim"], "--units", "si")).items():
        assert value == pytest.approx(1.0, abs=1e-4), name


@pytest.mark.parametrize("unit", ENGLISH)
def test_a_wrong_factor_is_seen(monkeypatch: pytest.MonkeyPatch, unit: str) -> None:
    name, factor = units._SI[unit]
    monkeypatch.setitem(units._SI, unit, (name, 1.001 * factor))
    wrong = [each for each in physics(answer(*COMMANDS["trim"], "--units", "si")).values() if abs(each - 1) > 1e-4]
    assert wrong


def test_matrices_are_similar() -> None:
    """A_si = T A T⁻¹, and so for all others, with T from the units in the same file."""
    before, after = answer(*COMMANDS["linearize"]), answer(*COMMANDS["linearize"], "--units", "si")
    T = np.diag([FOOT if unit.startswith("ft") else 1.0 for unit in before["state_units"]])
    Y = np.diag([FOOT if unit.startswith("ft") else 1.0 for unit in before["output_units"]])
    inverse = np.linalg.inv(T)
    for name, left, right in (
        ("A", T, inverse),
        ("A_band", T, inverse),
        ("B", T, np.eye(5)),
        ("C", Y, inverse),
        ("D", Y, np.eye(5)),
        ("E", T, np.eye(7) / FOOT),
        ("F", Y, np.eye(7) / FOOT),
    ):
        np.testing.assert_allclose(after[name], left @ np.array(before[name]) @ right, rtol=1e-14, err_msg=name)
    assert (after["state_units"][0], after["output_units"], after["disturbance_units"]) == (
        "m/s",
        ["m/s^2", "rad"],
        ["m/s"] * 7,
    )
    assert after["state_offsets"][0] == pytest.approx(68 * FOOT, rel=1e-15)
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(after["A"])), np.sort_complex(np.linalg.eigvals(before["A"])), rtol=1e-11
    )
    assert after["modes"] == before["modes"]


def test_the_solution_is_that_of_the_game_in_si() -> None:
    """u = -K x is the same input and x'Px the same cost; what has no unit stays."""
    before, after = answer(*COMMANDS["solve"]), answer(*COMMANDS["solve"], "--units", "si")
    x = np.array([7.0, 0.1, 0.1, 0.1, 0.1, 0.1])
    x_si = x * [FOOT, 1, 1, 1, 1, 1]
    np.testing.assert_allclose(np.array(after["K"]) @ x_si, np.array(before["K"]) @ x, rtol=1e-12)
    assert x_si @ np.array(after["P"]) @ x_si == pytest.approx(x @ np.array(before["P"]) @ x, rel=1e-12)
    for name in ("delta", "delta_min", "certificate", "loop_margins", "closed_loop_eigenvalues"):
        assert after[name] == before[name]


def test_what_was_written_in_si_is_read(tmp_path: Path) -> None:
    for suffix in ("json", "npz", "mat"):
        plant = str(tmp_path / f"plant.{suffix}")
        assert hfa("linearize", "--dihedral", "12", "--units", "si", "-o", plant).code == 0
        found = answer("solve", "--model", plant)
        assert (found["states"][0], found["state_units"][:2]) == ("speed", ["m/s", "rad"])
    point = str(tmp_path / "plant.json")
    started = answer("trim", "--dihedral", "12", "--start", point)["operating_point"]["states"]
    assert started["speed"] == 68.0
    data = json.loads(Path(point).read_text("utf-8"))
    data["operating_point"]["state_units"]["speed"] = "km/h"
    Path(point).write_text(json.dumps(data), encoding="utf-8")
    assert_refused(hfa("trim", "--dihedral", "12", "--start", point), 2, "is in km/h, not in ft/s or m/s")


def test_the_trim_that_was_printed_can_be_typed() -> None:
    """A flight in m and m/s: what --units si prints, typed again, is the same trim; in feet it is another."""
    words = ("trim", "--dihedral", "10", "--units", "si", "--free", "alpha")
    first = answer(*words, "--hold", "altitude=12000", "--hold", "speed=21")["operating_point"]["states"]
    assert (first["altitude"], first["speed"]) == pytest.approx((12000.0, 21.0))
    again = answer(*words, "--hold", f"altitude={first['altitude']!r}", "--hold", f"speed={first['speed']!r}")
    assert again["operating_point"]["states"] == pytest.approx(first, rel=1e-12, abs=1e-12)
    english = answer(
        "trim", "--dihedral", "10", "--hold", f"altitude={12000 / FOOT!r}", "--hold", f"speed={21 / FOOT!r}", *words[5:]
    )
    assert english["operating_point"]["states"]["alpha"] == pytest.approx(first["alpha"], rel=1e-9)
    beyond = hfa(*words, "--hold", "altitude=30000")
    assert beyond.code != 0  # m; feet would be within the limits
