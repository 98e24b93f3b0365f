"""`--units si`: physics holds in the numbers that are written; in every command what has a unit of
length, mass or force changes by its factor and nothing else does."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import answer, assert_refused, hfa

from hfa_support import units

FOOT, POUND_FORCE, SLUG = 0.3048, 4.4482216152605, 14.593902937206364
TRIM = ("trim", "--dihedral", "12")
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
        # T = 288.15 K - 6.5 K/km h up to 11 km, isothermal above: the speed of sound of the
        # standard atmosphere, m/s.
        "speed of sound": about["speed_of_sound"] / 295.07,
        "gravity": about["weight"] / (3 * 9.326 * 14.5939029 * 32.2 * FOOT),
    }


def test_the_laws_of_physics_hold_in_si() -> None:
    for name, value in physics(answer(*TRIM, "--units", "si")).items():
        assert value == pytest.approx(1.0, abs=1e-4), name


@pytest.mark.parametrize("unit", ENGLISH)
def test_a_wrong_factor_is_seen(monkeypatch: pytest.MonkeyPatch, unit: str) -> None:
    name, factor = units._SI[unit]
    monkeypatch.setitem(units._SI, unit, (name, 1.001 * factor))
    wrong = [
        each for each in physics(answer(*TRIM, "--units", "si")).values() if abs(each - 1) > 1e-4
    ]
    assert wrong


def test_matrices_are_similar() -> None:
    """A_si = T A T⁻¹, and so for all others, with T from the units in the same file."""
    words = ("linearize", "--dihedral", "12", "--outputs", "vertical_acceleration,alpha")
    before, after = answer(*words), answer(*words, "--units", "si")
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
        expected = left @ np.array(before[name]) @ right
        rounding = 1e-13 * np.abs(expected).max()
        np.testing.assert_allclose(after[name], expected, rtol=0, atol=rounding, err_msg=name)
    assert (after["state_units"][0], after["output_units"], after["disturbance_units"]) == (
        "m/s",
        ["m/s^2", "rad"],
        ["m/s"] * 7,
    )
    assert after["state_offsets"][0] == pytest.approx(68 * FOOT, rel=1e-15)
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(after["A"])),
        np.sort_complex(np.linalg.eigvals(before["A"])),
        rtol=1e-11,
    )
    assert [mode["name"] for mode in after["modes"]] == [mode["name"] for mode in before["modes"]]


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
    assert_refused(
        hfa("trim", "--dihedral", "12", "--start", point), 2, "is in km/h, not in ft/s or m/s"
    )


def test_the_trim_that_was_printed_can_be_typed() -> None:
    """A flight in m and m/s: what --units si prints, typed again, is the same trim; in feet it is
    another."""
    words = ("trim", "--dihedral", "10", "--units", "si", "--free", "alpha")
    first = answer(*words, "--hold", "altitude=12000", "--hold", "speed=21")["operating_point"][
        "states"
    ]
    assert (first["altitude"], first["speed"]) == pytest.approx((12000.0, 21.0))
    again = answer(
        *words, "--hold", f"altitude={first['altitude']!r}", "--hold", f"speed={first['speed']!r}"
    )
    assert again["operating_point"]["states"] == pytest.approx(first, rel=1e-12, abs=1e-12)
    english = answer(
        "trim",
        "--dihedral",
        "10",
        "--hold",
        f"altitude={12000 / FOOT!r}",
        "--hold",
        f"speed={21 / FOOT!r}",
        *words[5:],
    )
    assert english["operating_point"]["states"]["alpha"] == pytest.approx(first["alpha"], rel=1e-9)
    beyond = hfa(*words, "--hold", "altitude=30000")
    assert beyond.code != 0  # m; feet would be within the limits


AT = ("--dihedral", "12")
<<<<<<< HEAD
FLIGHT = ("--law", "exact", "--duration", "0.5")
#: A short run of every command that has the option.
RUNS: dict[str, tuple[str, ...]] = {
    "trim": AT,
    "linearize": (*AT, "--outputs", "vertical_acceleration,alpha"),
    "sweep": ("--dihedral", "10,12", "--hold", "speed=60ft,68ft"),
    "solve": (*AT, "--design", SIMVFA["simvfa-1"], "--delta", "inf"),
    "learn": AT,
    "verify": AT,
    "design": ("--design", "servo", "--dihedral", "5,10"),
    "fly": (*AT, *FLIGHT, "--gust", "200ft:5ft", "--command", "speed=0:0.01ft"),
    "fly --samples 2": (*AT, *FLIGHT, "--turbulence", "3ft:200ft"),
    "report": (*AT, "--sweep", "10,12"),
}
#: The same of a model of the user, whose units are its own.
NAVION = ("--aircraft", f"{ROOT / 'examples' / 'navion.py'}:NAVION", "--law", "exact")
OWN: dict[str, tuple[str, ...]] = {
    "fly": (
        *NAVION,
        "--initial",
        "speed=5ft",
        "--duration",
        "1",
        "--actuators",
        "0.1:60",
        "-o",
        "{}.json",
    ),
    "fly --samples 2": (*NAVION, "--duration", "1", "--initial", "speed=5ft"),
}
LONG = ("report", "design", "learn", "fly --samples 2")
#: What a number with a unit may be multiplied with: of lengths and their squares, of forces,
#: moments, masses.
FACTORS = (
    *(FOOT**power for power in (1, -1, 2, -2)),
    *(POUND_FORCE, POUND_FORCE * FOOT, POUND_FORCE / FOOT**2, SLUG, SLUG / FOOT**3),
)
#: What has no unit of length, mass or force, by a name on the way to it.
STAYS = re.compile(
    r"eigenvalues|margin_at|disk|phase|delta|certificate|checks|modes|participation|graded|rel_error|excitation|starts"
    r"|singular|entries|structures|regeneration|coupling|meaning|alpha|(?<!inertia_)pitch(?!ing)|dihedral|aileron|elevator"
    r"|throttle$|times?$|share_beyond|angle_of_attack|frequency"
)
#: Names whose numbers all are in ft or ft/s, apart from tables of shares and of errors of a
#: prediction.
MOVES = re.compile(r"(?<!participation)(?<!errors)(?<!scaled_residuals)\.(speed|altitude)(\.\d+)?$")
MATRIX = re.compile(r"\b(A|A_band|B|B_band|P|P_exact|K|K_exact|gains)((?:\.\d+)+)$")


def power_of_feet(path: str) -> int | None:
    """Of an entry of a matrix of the six states, whose first is the speed."""
    found = MATRIX.search(path)
    if found is None or "regeneration" in path:
        return None
    row, column = (int(place) == 0 for place in found[2].split(".")[-2:])
    return {"A": row - column, "B": int(row), "P": -row - column, "K": -column, "g": -column}[
        found[1][0]
    ]


def complaints(command: str, before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """Numbers that are wrongly in SI, and numbers that are wrongly not."""
    found = []
    for (path, value), (other, said) in zip(leaves(before), leaves(after), strict=True):
        if path.startswith(".provenance"):
            continue
        if (
            isinstance(value, str)
            and "regeneration" not in path
            and re.search(r"\b(ft|slug|lbf)\b", said)
        ):
            found.append(f"{path} says {said!r}")
        if path != other or isinstance(value, (str, bool)) or value is None or value == 0.0:
            continue
        ratio, power = said / value, None if command in ("solve", "design") else power_of_feet(path)
        if power is not None or (MOVES.search(path) and "regeneration" not in path):
            expected = (FOOT ** (1 if power is None else power),)
        else:
            expected = (
                (1.0,)
                if STAYS.search(path) and not re.search(r"edges|speeds", path)
                else (1.0, *FACTORS)
            )
        if not any(abs(ratio / each - 1.0) < 1e-12 for each in expected):
            found.append(f"{path}: {value} and {said}")
    return found


def typed(words: tuple[str, ...], system: str) -> tuple[str, ...]:
    """The words with each length, as in 5ft, in the units of the system, whose name takes the place
    of {}."""
    factor = FOOT if system == "si" else 1.0
    in_system = (
        re.sub(r"([\d.]+)ft\b", lambda found: repr(float(found[1]) * factor), word)
        for word in words
    )
    in_system = (word.replace("{}", system) for word in in_system)
    return (*in_system, "--units", system)


def test_every_command_is_here() -> None:
    with_units = {name for name in COMMANDS if "units" in command_named(name).request.declared()}
    assert {name.partition(" ")[0] for name in RUNS} == with_units


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in RUNS]
)
def test_what_has_a_unit_changes_and_nothing_else(name: str) -> None:
    before, after = (
        answer(*typed((*name.split(), *RUNS[name]), system)) for system in ("english", "si")
    )
    assert (before.pop("units"), after.pop("units")) == ("english", "si")
    assert before != after
    assert not complaints(name, before, after)


@pytest.mark.parametrize(
    ("name", "moved"),
    [
        ("fly", "final history.states scenario.initial"),
        ("fly --samples 2", "peak_error effort rms_error"),
    ],
)
def test_what_a_model_declares_in_feet_and_pounds_changes_and_nothing_else(
    name: str, moved: str
) -> None:
    before, after = (
        answer(*typed((*name.split(), *OWN[name]), system)) for system in ("english", "si")
    )
    if "-o" in OWN[name]:  # with its history
        before, after = (
            json.loads(Path(f"{system}.json").read_text("utf-8")) for system in ("english", "si")
        )
    # The gains are of an elevator in rad and a throttle in lbf, and their table is over the speed.
    wrong = [
        each
        for each in complaints(name, before, after)
        if not re.match(r"\.(policy|schedule)\.", each)
    ]
    assert not wrong
    changed = dict(leaves(before)).items() ^ dict(leaves(after)).items()
    assert all(any(f".{each}" in path for path, _ in changed) for each in moved.split())
=======
FLIGHT = ("fly", *AT, "--law", "exact", "--duration", "0.5")
>>>>>>> 8c5b9631 (Units: the model is converted, not the report; the declaration of a model in four files)


@pytest.mark.parametrize(
    "words",
    [
        (*FLIGHT, "--gust", "60:1.5", "--command", "speed=0:0.003", "--picture"),
        pytest.param(("trim", *AT, "--picture"), marks=pytest.mark.slow),
    ],
    ids=lambda words: words[0],
)
def test_text_and_pictures_say_no_feet(words: tuple[str, ...], tmp_path: Path) -> None:
    """Matplotlib repeats each text of an .svg as a comment."""
    picture = tmp_path / "p.svg"
    result = hfa(*words, str(picture), "--units", "si")
    assert result.code == 0, result.err
    drawn = re.findall(r"<!-- (.*) -->", picture.read_text("utf-8"))
    assert any(re.search(r"\bm(/s)?\b", text) for text in drawn)
    texts = [*drawn, *result.out.split("\nhfa 0.")[0].split("\n")]
    assert not [text for text in texts if re.search(r"\b(ft|slug|lbf)\b", text)]


def test_a_flight_in_metres_is_the_flight_in_feet() -> None:
    feet = answer(*FLIGHT, "--gust", "200:5")
    metres = answer(*FLIGHT, "--gust", f"{200 * FOOT!r}:{5 * FOOT!r}", "--units", "si")
    assert metres["final"]["speed"] == pytest.approx(feet["final"]["speed"] * FOOT, rel=1e-9)
    assert metres["final"]["alpha"] == pytest.approx(feet["final"]["alpha"], rel=1e-7, abs=1e-12)


@pytest.mark.parametrize("suffix", ["npz", pytest.param("mat", marks=pytest.mark.slow)])
def test_a_critic_in_other_units_is_the_same_critic(suffix: str, tmp_path: Path) -> None:
    """P, K and plants written in m are right on plants in ft, and the other way round."""
    files = {}
    for system in ("english", "si"):
        for command in ("solve", "linearize"):
            files[command, system] = str(tmp_path / f"{command}-{system}.{suffix}")
            assert hfa(command, *AT, "--units", system, "-o", files[command, system]).code == 0
    assert hfa("verify", *AT, "--weights", files["solve", "si"]).code == 0
    for system in ("english", "si"):
        result = hfa(
            "verify", "--model", files["linearize", "si"], "--weights", files["solve", system]
        )
        assert result.code == 0, (result.out, result.err)
