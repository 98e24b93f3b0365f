"""A file of conditions: each row is its own trim, and the file that comes out runs again."""

import csv
import dataclasses
import json
import math
import re
import tomllib

import numpy as np
import pytest
from cli import answer, assert_refused, hfa as command
from project import ROOT
from standard_airspeeds import KNOT, air, calibrated

import hfa
from hfa.options.conditions import listed_conditions

#: Conditions of every kind. "weak" has too little thrust; "stall" exceeds CL_max = 1, which the
#: fixture `uav` adds; "planted" has a product of inertia that no rigid body has.
CONDITIONS = """# book 12, revision B
name,speed [m/s],KCAS [KT],mach,altitude [m],gamma,load_factor,thrust,beta,mass [lbm],Ixz,free,limit
cruise,35,,,100,0,,,,,,,
by KCAS,,60,,1000,0,,,,,,,
by Mach,,,0.1,FL30,0,,,,,,,
in knots,70 kt,,,100,,,,,,,,
climb full thrust,30,,,100,,,60,,,,gamma,
glide,25,,,100,,,0,,,,gamma,
turn,35,,,100,,1.3,,,,,turn_rate,
pull-up,35,,,100,,1.5,,,,,pitch_dot,
sideslip,35,,,100,,,,3,,,,
slip,35,,,100,,,,0.051 rad,,,,
heavy,35,,,100,,,,,40,,,elevator=-10:10;thrust=0:50
weak,35,,,100,,,,,,,,thrust=0:5
stall,18.5,,,100,,,,,,,,
planted,35,,,100,,,,,,1.19,,
too slow,8,,,100,,,,,,,,
"""
#: Results other than "trimmed".
RESULTS = {
    "weak": "no trim",
    "stall": "stalled",
    "planted": "with a warning",
    "too slow": "no trim",
}


#: The aircraft without the CL_max of the fixture `uav`.
UAV = ("--aircraft", f"{ROOT}/examples/uav.toml")


@pytest.fixture(scope="module")
def trim(uav):
    """Return the function that runs a command, `hfa trim` by default, with a file of conditions."""
    return lambda file, *options, verb="trim": command(
        verb, "--aircraft", uav, "--conditions", str(file), "-q", *options
    )


@pytest.fixture(scope="module")
def book(trim, tmp_path_factory):
    """Return a folder with `CONDITIONS`, the table of their trims (matrix.csv), and what is printed
    (listed.txt); few.csv has only the rows "stall" and "planted".
    """
    path = tmp_path_factory.mktemp("matrix")
    (path / "conditions.csv").write_text(CONDITIONS, "utf-8")
    run = trim(path / "conditions.csv", "-o", str(path / "matrix.csv"))
    assert run.code == 1, run.err
    first = run.out.partition("\n")[0]
    assert first == "11 of 15 conditions are trimmed, 1 stalled, 1 with a warning, 2 without a trim"
    (path / "listed.txt").write_text(run.out, "utf-8")
    (path / "few.csv").write_text(few("stall", "planted"), "utf-8")
    return path


def few(*names):
    """Return the text of a file with some of the conditions."""
    rows = CONDITIONS.splitlines(keepends=True)
    return "".join(row for row in rows if row.partition(",")[0] in ("name", *names))


def rows_of(path):
    """Return name of the condition -> cells by heading."""
    return {row["name"]: row for row in csv.DictReader(path.read_text("utf-8").splitlines())}


def test_each_row_balances(book):
    """The accelerations at the cells of each trim of the table are 0 within 1e-5 of 1.5 g; only the pitch
    angle of the pull-up changes. The calibrated airspeed is that of the standard atmosphere.

    Rows without a trim, and one with a warning, are not compared.
    """
    uav = hfa.load_model(UAV[1])
    for name, cells in rows_of(book / "matrix.csv").items():
        assert cells["results"] == RESULTS.get(name, "trimmed")
        if cells["results"] in ("no trim", "with a warning"):
            continue
        model = uav.with_parameters(mass="40 lbm") if name == "heavy" else uav
        typed = re.findall(r"^(\w+) \[(.+)\]=(.+)$", "\n".join(map("=".join, cells.items())), re.M)
        names = (*model.states, *model.inputs)
        at = {key: model.number(key, f"{cell} {unit}") for key, unit, cell in typed if key in names}
        x, u = ([at.get(key, 0.0) for key in group] for group in (model.states, model.inputs))
        rates = model.rates_at(x, u)
        del rates["yaw"], rates["altitude"]
        if name == "pull-up":
            del rates["pitch"]
            assert float(cells["load_factor"]) == pytest.approx(1.5)
        np.testing.assert_allclose([*rates.values()], 0.0, atol=1e-5 * 9.81 * 1.5, err_msg=name)
        knots = calibrated(at["speed"], air(at["altitude"]))
        assert float(cells["calibrated airspeed [kt]"]) == pytest.approx(knots, rel=1e-5)


def test_a_written_table_of_trims_is_a_file_of_conditions_with_the_same_trims(book, trim):
    """A written file is a file of conditions, by its columns before `results`: its trims have the
    same cells, except for the command. A cell of 0.051 rad stays so: no double in degrees is equal.

    The condition "weak" is left out, because the search for its trim takes longest.
    """
    lines = (book / "matrix.csv").read_text("utf-8").splitlines(keepends=True)
    given, written = book / "given.csv", book / "again.csv"
    given.write_text("".join(line for line in lines if not line.startswith("weak")), "utf-8")
    assert trim(given, "-o", str(written)).code == 1  # "too slow" has no trim
    first, again = rows_of(given), rows_of(written)
    del first["cruise"]["about"], again["cruise"]["about"]  # the command
    assert first == again
    assert first["sideslip"]["hold beta [deg]"] == "3.0"
    assert first["slip"]["hold beta [deg]"] == "0.051 rad"


def test_stall_warning_and_missing_trim_are_cells_of_the_table_and_entries_of_json(book, trim):
    """The row of each condition has the sentence on its stall, warning or missing trim, and the JSON
    of its sheet has the same sentence on stall or warning.
    """
    cells = rows_of(book / "matrix.csv")
    assert "CL_max" in cells["stall"]["stalled"]
    assert "principal moment" in cells["planted"]["warnings"]
    assert "thrust at maximum" in cells["weak"]["failure"]
    run = trim(book / "few.csv", "--json")
    sheets = {sheet["name"]: sheet for sheet in json.loads(run.out)["sheets"]}
    for name, entry in (("stall", "stalled"), ("planted", "warnings")):
        assert sheets[name]["sheet"][entry]["value"] == cells[name][entry]
        assert "results" not in sheets[name]["sheet"]


def test_kcas_and_mach_give_the_altitude_of_their_crossover(tmp_path):
    """With KCAS and Mach number held and the altitude free, the speed found has both in the standard
    atmosphere at the altitude found (`air`, `calibrated`). A sweep finds the same altitudes.

    Headings may have capitals, and a unit may be KCAS. Two airspeeds that no altitude has in common
    are refused.
    """
    path = tmp_path / "climb.csv"
    path.write_text("Name,Speed [KCAS],MACH,Free\na,60,0.1,Altitude\nb,60 KCAS,0.2,altitude\n")
    crossovers = []
    own = answer("trim", *UAV, "--hold", "kcas=60", "--hold", "speed=33", "--free", "altitude")
    around = air(own["operating_point"]["states"]["altitude"])
    assert calibrated(33.0, around) == pytest.approx(60.0, rel=1e-5)
    for name, mach in (("a", 0.1), ("b", 0.2)):
        run = answer("trim", *UAV, "--conditions", str(path), "--row", name)
        states = run["operating_point"]["states"]
        around = air(states["altitude"])
        assert states["speed"] == pytest.approx(mach * around.sound, rel=1e-5)
        assert calibrated(states["speed"], around) == pytest.approx(60.0, rel=1e-5)
        crossovers.append(states["altitude"])
    at_60_kcas = (*UAV, "--hold", "kcas=60", "--free", "altitude", "--hold")
    swept = answer("sweep", *at_60_kcas, "mach=0.1,0.2")["operating_states"]
    assert [row[-1] for row in swept] == pytest.approx(crossovers, rel=1e-9)  # the last is altitude
    assert_refused(command("trim", *at_60_kcas, "mach=0.02"), 2, "do not give one altitude")


def test_the_file_of_one_sheet_is_its_condition(trim, uav, tmp_path):
    """The CSV file of one trim states what was typed, with angles in degrees, and has the same trim
    as a file of conditions. The file of this trim in Python states the same.
    """
    typed = "--hold load_factor=1.2 --free turn_rate --limit elevator=-9:9 --hold mass=14 -o"
    paths = [tmp_path / name for name in ("one.csv", "again.csv", "python.csv")]
    command("trim", "--aircraft", uav, *typed.split(), str(paths[0]))
    trim(paths[0], "-o", str(paths[1]))
    model = hfa.load_model(uav).with_parameters(mass=14.0)
    condition = hfa.trim(model, load_factor=1.2, free="turn_rate").trim_problem.asked
    condition = dataclasses.replace(
        condition, limits={"elevator": (-math.radians(9), math.radians(9))}
    )
    hfa.trim(model, condition).save(paths[2])
    sheets = [list(csv.DictReader(path.read_text("utf-8").splitlines())) for path in paths]
    for (cells,) in sheets:
        assert float(cells["hold load_factor"]) == 1.2
        assert cells["limit"] == "elevator=-9.0:9.0"
        assert cells["free"] == "turn_rate"
        assert float(cells["mass [kg]"]) == float(cells["hold mass [kg]"]) == 14.0
        assert float(cells["turn_rate [deg/s]"]) > 0.0
        assert float(cells["roll [deg]"]) == pytest.approx(
            float(sheets[0][0]["roll [deg]"]), rel=1e-9
        )


#: Text of a file of conditions that `hfa trim` refuses, and a part of the message.
REFUSED_BY_TRIM = [
    ("name,speed\n", "has no conditions"),
    ("name,speed\na,3x\n", "row 2 (a), column speed is '3x'; give a finite number"),
    ("name,speed\na,30,1\n", "row 2 has 3 cells, but row 1 has 2"),
    ("name,speed\na\n", "row 2 has 1 cells, but row 1 has 2"),
    ("name,speed\na,=B1\n", "row 2 (a), column speed is the formula '=B1'; write"),
    ("name,speed\na,30\nb,31\na,32\n", "row 4 has the name of row 2, 'a'"),
    ("name,speed\na,8\n", "conditions.csv: row 2 (a): speed is 8 m/s; give a value"),
    ("name,speed,cg\na,30,0.3\n", "row 1: Aerosonde has no center of gravity; add the line"),
    ("speed,V,speed\n30,1,30\n", "row 1 has speed twice"),
    ("name,speed,free\na,30,alfa\n", "row 2 (a), column free has the unknown variable"),
    ("name,speed,free\na,30,speed\n", "row 2 (a): speed is both free and held"),
    ("name,limit\na,thrust=5\n", "row 2 (a), column limit is '5'; give LOW:HIGH"),
    ("name,limit\na,5\n", "column limit is '5'; give NAME=LOW:HIGH"),
]
#: The same of other commands and with an option: command, option, text, message.
REFUSED = [
    ("trim", "--hold=speed=30", "name,speed\na,30\n", "give speed either in the file"),
    ("solve", "", "name,speed\na,30\nb,35\n", "--row is required for 2 conditions; choose from"),
    ("linearize", "--row=c", "name,speed\na,30\nb,35\n", "has no condition 'c'"),
    ("sweep", "", "name,speed,free\na,30,\nb,35,gamma\n", "`hfa trim --conditions FILE`"),
    *(("trim", "", *each) for each in REFUSED_BY_TRIM),
]


@pytest.mark.parametrize(("verb", "option", "text", "said"), REFUSED)
def test_a_wrong_file_is_refused(verb, option, text, said, tmp_path):
    """A wrong file of conditions is refused in one line with the row, condition or column."""
    path = tmp_path / "conditions.csv"
    path.write_text(text, "utf-8")
    words = (verb, *UAV, "--conditions", str(path))
    assert_refused(command(*words, *filter(None, [option])), 2, said)


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("bank", "--hold roll=ANGLE --free turn_rate"),
        ("phi", "--hold roll=ANGLE --free turn_rate"),
        ("n", "did you mean load_factor?"),
        ("V", "did you mean speed?"),
        ("IAS", "did you mean kcas?"),
    ],
)
def test_a_usual_word_is_refused_with_the_name_of_the_model(word, said, tmp_path):
    """A word that is no name of the model, but usual for one, is refused in --hold and as a heading,
    with the name or the options to use.
    """
    path = tmp_path / "conditions.csv"
    path.write_text(f"{word}\n30\n", "utf-8")
    assert_refused(command("trim", *UAV, "--hold", f"{word}=30"), 2, said)
    assert_refused(command("trim", *UAV, "--conditions", str(path)), 2, "row 1", said)


def test_a_center_of_gravity_is_a_share_in_percent(tmp_path):
    """28 in the column "c.g. [%]" is cg = 0.28 chords. Headings may have capitals, flight levels (30 is
    3000 ft) and knots. "30 lb" and "2,000 lbs" are masses, 0.45359237 kg each pound. Empty columns
    and rows are left out.
    """
    table = tomllib.loads((ROOT / "examples/uav.toml").read_text("utf-8"))
    model = hfa.from_derivatives({**table, "cg": 0.25})
    path = tmp_path / "conditions.csv"
    text = 'c.g. [%],Altitude [FL],speed [KT],mass,,\n28,30,70,30 lb,,\n,3 feet,70,"2,000 lbs",,\n,,,,,\n'
    path.write_text(text, "utf-8")
    row, other = listed_conditions(path, model)
    assert [row.values["cg"], row.values["mass"]] == pytest.approx([0.28, 30.0 * 0.45359237])
    assert other.values["mass"] == pytest.approx(2000.0 * 0.45359237)
    assert other.values["altitude"] == pytest.approx(3.0 * 0.3048)
    assert row.values["speed"] == pytest.approx(70.0 * KNOT)
    assert row.values["altitude"] == pytest.approx(914.4, rel=1e-3)  # 3000 ft


def test_class_category_and_weight_are_columns(tmp_path):
    """Levels follow class and category of a row, in both commands, and a weight is the mass of the row."""
    path = tmp_path / "rows.csv"
    path.write_text("name,speed [m/s],category,class,weight [N]\na,25,,,\nb,25,c,1,150\n", "utf-8")
    sheets = answer("trim", *UAV, "--conditions", str(path))["sheets"]
    rows = [data["sheet"] for data in sheets]
    assert [row["flight phase category"]["value"] for row in rows] == ["B", "C"]
    assert rows[1]["mass"]["value"] == pytest.approx(150.0 / 9.80665)
    levels = hfa.conditions(hfa.load_model(UAV[1]), path).levels
    qualities = ("short period damping", "short period frequency", "CAP", "n/alpha")
    for row, of_modes in zip(rows, levels, strict=True):
        worst = max(row[name].get("level", 0) for name in qualities)
        assert of_modes["short period"] == worst


@pytest.mark.parametrize(
    ("cells", "words"),
    [(",x,", "category is 'x'"), ("5,,", "class is '5'"), (",,-1", "mass is -0.10")],
)
def test_a_wrong_class_category_or_weight_is_refused(cells, words, tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text(f"speed [m/s],class,category,weight [N]\n25,{cells}\n", "utf-8")
    assert_refused(command("trim", *UAV, "--conditions", str(path)), 2, words)
