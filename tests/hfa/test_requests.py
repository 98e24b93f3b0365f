"""What options say about trims, plants and games is what the public functions are given."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from cli import answer, assert_refused, hfa as command
from game_files import stored
from project import ROOT

import hfa
from hfa.options.conditions import listed_conditions

UAV = str(ROOT / "examples/uav.toml")
OF_UAV = ("--aircraft", UAV)
KNOT = 1852.0 / 3600.0
#: An aircraft of the user whose trims are exact: it keeps its speed at thrust = k speed.
OWN = """
from hfa import Model, Signal
X = {"speed": Signal("m/s", min=1.0, max=90.0, nominal=10.0), "angle": Signal("rad")}
U = {"thrust": Signal("N", min=0.0, max=500.0), "elevator": Signal("rad", min=-1.0, max=1.0)}
P = {"k": Signal("N s/m", start=2.0), "mass": Signal("kg", start=4.0), "lag": Signal("1", start=1.0)}
Y = {"power": Signal("W"), "weight": Signal("N")}

def equations(x, u, p, w):
    rates = {"speed": (u.thrust - p.k * x.speed) / p.mass, "angle": u.elevator - p.lag * x.angle}
    return rates, {"power": u.thrust * x.speed, "weight": 9.80665 * p.mass}

OWN = Model("own", X, U, equations, parameters=P, outputs=Y, trim={"speed": 30.0, "angle": 0.1},
            schedule=SCHEDULE)
"""


@pytest.fixture
def own(folder):
    """Write the user's aircraft, with its speed as scheduling variable, and return its option."""
    Path("own.py").write_text(OWN.replace("SCHEDULE", '"speed"'), "utf-8")
    return "--aircraft", "own.py:OWN"


#: Options of a trim -> speed, angle in degrees and thrust of the trim, and its parameters.
TRIMS = {
    "": (30.0, math.degrees(0.1), 60.0),
    "--at 20": (20.0, math.degrees(0.1), 40.0),
    "--hold speed=36km/h --hold angle=3": (10.0, 3.0, 20.0),
    "--at 20 --hold k=3": (20.0, math.degrees(0.1), 60.0, ("k", 3.0)),
    "--hold thrust=100 --free speed": (50.0, math.degrees(0.1), 100.0),
    "--free speed --at 20 --hold thrust=100 --start speed=45": (50.0, math.degrees(0.1), 100.0),
    "--hold thrust=90 --free k": (30.0, math.degrees(0.1), 90.0, ("k", 3.0)),
    "--limit elevator=-10:10": (30.0, math.degrees(0.1), 60.0),
    "--conditions c.csv --row slow": (15.0, 1.0, 30.0),
    "--conditions c.csv --row heavy --at 10": (10.0, math.degrees(0.1), 20.0, ("mass", 8.0)),
    "--conditions one.csv": (12.0, math.degrees(0.1), 24.0),
    "--conditions c.csv --row free --hold thrust=80": (40.0, math.degrees(0.1), 80.0),
}


@pytest.mark.parametrize("words", TRIMS)
def test_options_of_a_trim_are_its_condition(words, own):
    """Held values, the scheduling variable, freed variables and rows of a file are imposed; the
    provenance has the values that were set, and parameters that differ from the file.
    """
    Path("c.csv").write_text("name,speed,angle,mass,free\nslow,15,1,,\nheavy,,,8,\nfree,,,,speed\n")
    Path("one.csv").write_text("speed\n12\n")
    speed, angle, thrust, *changed = TRIMS[words]
    run = command("trim", *own, *words.split(), "--json")
    assert run.code == 0
    found = json.loads(run.out)
    point = (
        found["operating_point"]
        if "one.csv" not in words
        else found["sheets"][0]["operating_point"]
    )
    assert point["states"]["speed"] == pytest.approx(speed, rel=1e-9)
    assert math.degrees(point["states"]["angle"]) == pytest.approx(angle, rel=1e-9)
    assert point["inputs"]["thrust"] == pytest.approx(thrust, rel=1e-9)
    origin = found["provenance"]
    assert {name: each["value"] for name, each in origin["changed"].items()} == (
        {} if "--free k" in words else dict(changed)
    )
    if "elevator=" in words:
        assert origin["condition"]["limits"]["elevator"] == pytest.approx(np.radians([-10, 10]))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "trim --at 10,20 --row a",
            "--row names a condition of --conditions FILE; add this option",
        ),
        ("trim --dihedral 5", "--dihedral applies only to the HFA; own takes --at VALUE"),
        ("trim --at 5 --hold speed=6", "speed is given by both --at and --hold"),
        ("trim --at 5,6 --free speed", "speed is given by both --at and --free"),
        (
            "trim --conditions c.csv --hold speed=6",
            "give speed either in the file of --conditions or",
        ),
        (
            "trim --conditions c.csv --at 6",
            "give speed either in the file of --conditions or by --at",
        ),
        (
            "trim --conditions d.csv --hold k=1,2",
            "give k either as a column of d.csv or by an option",
        ),
        ("trim --conditions c.csv --row b", "c.csv has no condition 'b'; choose from slow, fast"),
        ("trim --conditions d.csv --row b", "d.csv has no condition 'b'; add a column name"),
        ("linearize --hold k=1,2", "--hold k has 2 values; give one (`hfa trim` and `hfa sweep`"),
        ("linearize --at 5:9:1", "--at has 5 values; give one"),
        (
            "solve --conditions c.csv --at 5",
            "--row is required for 2 conditions; choose from slow, fast",
        ),
        ("solve --conditions d.csv", "--row is required for 2 conditions; add a column name"),
        ("solve --at 5 --free k --hold thrust=1", "k is a parameter, which only `hfa trim`"),
        ("sweep --free speed --at 5,6", "speed is given by both --at and --free"),
        ("sweep --hold k=1,2 --free k", "k is both free and held; remove --free or --hold"),
        ("trim --mass a.mass", "'own.py:OWN' takes no mass"),
        ("trim --dynamics newton", "--dynamics applies only to the HFA; remove this option or"),
        ("trim --hold k=1:2:0.001", "1,001 points are asked for (maximum 100); give fewer"),
        ("trim --condition none.toml", "--condition"),
        ("trim --start none.json", "--start"),
        ("trim --servo 0", "--servo is '0'; give a finite number above 0"),
    ],
)
def test_options_that_contradict_each_other_are_refused(words, said, own):
    """The message has both options, or the option that does not apply, and what to give."""
    Path("c.csv").write_text("name,speed\nslow,15\nfast,60\n")
    Path("d.csv").write_text("speed\n15\n60\n")
    verb, *options = words.split()
    assert_refused(command(verb, *own, *options), 2, said)


def test_a_swept_list_has_the_values_of_its_options_in_each_row(own):
    """A parameter of an option is that of all conditions."""
    Path("c.csv").write_text("speed\n15\n60\n")
    found = answer("sweep", *own, "--conditions", "c.csv", "--hold", "k=3")
    assert sorted(map(sorted, found["values"])) == [[3.0, 15.0], [3.0, 60.0]]


# Files of conditions.


def model(folder):
    Path("own.py").write_text(OWN.replace("SCHEDULE", '"speed"'), "utf-8")
    return hfa.load_model("own.py:OWN")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("speed\n36 km/h\n", {"speed": 10.0}),
        ("Speed [km/h]\n36\n", {"speed": 10.0}),
        ("hold speed,k\n10,\n", {"speed": 10.0}),
        ("k,speed\n3,10\n", {"speed": 10.0, "k": 3.0}),
        ("angle [rad],S.P.E.E.D\n0.2,5\n", {"angle": 0.2, "speed": 5.0}),
        ("weight [N]\n98.0665\n", {"mass": 10.0}),
        ("weight [lbf],speed\n2,10\n", {"speed": 10.0, "mass": 2 * 0.45359237}),
        ("speed,results,nonsense\n10,trimmed,x\n", {"speed": 10.0}),
        ("speed_dot,angle_dot [deg/s]\n2,180\n", {"speed_dot": 2.0, "angle_dot": math.pi}),
    ],
)
def test_a_row_holds_its_cells_in_the_units_of_the_model(text, values, folder):
    """Names are found in capitals and with points; parameters come last; a weight is a mass."""
    aircraft = model(folder)
    Path("c.csv").write_text(text)
    (row,) = listed_conditions("c.csv", aircraft)
    assert [*row.values] == [*values]
    assert row.values == pytest.approx(values, rel=1e-12)


def test_an_airspeed_may_be_the_unit_of_a_speed(folder):
    """A speed in KCAS is the variable kcas, in knots."""
    Path("c.csv").write_text("speed [KCAS],mass\n60,14 kg\n")
    (row,) = listed_conditions("c.csv", hfa.load_model(UAV))
    assert row.values == {"kcas": 60.0, "mass": 14.0}


def test_a_row_frees_and_limits_variables(folder):
    """Names in a cell are separated by blanks, commas or semicolons; limits have units, class and
    category capitals. Angles without a unit are noted, as degrees.
    """
    aircraft = model(folder)
    Path("c.csv").write_text(
        "name,angle,free,limit,class,category\n"
        'a,0,"Speed, k","thrust=0:20;elevator=-10:1rad",2,c\nb,5,,,,\n'
    )
    with pytest.warns(UserWarning, match=r"c\.csv: angle without a unit, read in degrees"):
        first, second = listed_conditions("c.csv", aircraft)
    assert (first.name, first.free, first.in_degrees) == ("a", ("speed", "k"), ())
    assert first.limits["thrust"] == (0.0, 20.0)
    assert first.limits["elevator"] == pytest.approx((math.radians(-10.0), 1.0))
    assert (first.class_, first.category) == ("II-L", "C")
    assert second == ("b", {"angle": pytest.approx(math.radians(5.0))}, (), {}, second.where, ("angle",), "", "")  # fmt: skip
    assert second.where == "c.csv: row 3 (b)"
    assert second.airplane("IV", "A") == ("IV", "A")
    assert first.airplane("IV", "A") == ("II-L", "C")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name,speed\na,1\na,2\n", "c.csv: row 3 has the name of row 2, 'a'; rename one"),
        ("speed\n", "c.csv has no conditions; give a row of names"),
        ("sped\n1\n", "c.csv: row 1: the column is unknown: 'sped'; did you mean speed?"),
        ("speed\n=A1\n", "c.csv: row 2, column speed is the formula '=A1'; write its value"),
        ("name,speed\na,fast\n", "c.csv: row 2 (a), column speed is 'fast'; give a finite number"),
        ("weight [N],mass\n9,1\n", "c.csv: row 2: weight and mass are one; clear one of the cells"),
        ("speed,free\n1,speed\n", "c.csv: row 2: speed is both free and held; clear one of its"),
        ("speed,free\n1,angel\n", "c.csv: row 2, column free has the unknown variable 'angel'"),
        ("speed,limit\n1,thrust\n", "column limit is 'thrust'; give NAME=LOW:HIGH of a variable"),
        ("speed,limit\n1,k=0:1\n", "column limit is 'k=0:1'; give NAME=LOW:HIGH of a variable"),
        ("speed,limit\n1,thrust=1\n", "column limit is '1'; give LOW:HIGH"),
        ("speed,class\n1,V\n", "c.csv: row 2, column class is 'V'; choose from"),
        ("speed,category\n1,D\n", "c.csv: row 2, column category is 'D'; choose from a, b, c"),
    ],
)
def test_a_wrong_row_is_refused_with_its_place(text, said, folder):
    """The message has file, row, name of the condition and column."""
    aircraft = model(folder)
    Path("c.csv").write_text(text)
    with pytest.raises(hfa.BadInputError) as refused:
        listed_conditions("c.csv", aircraft)
    assert str(refused.value).startswith(said) or said in str(refused.value)


# Games.

PLANT = {"A": [[0.0, 1.0], [2.0, -0.3]], "B": [[0.0], [1.0]]}
COST = {"Q": np.diag([2.0, 1.0]), "R": np.array([[0.5]])}


def solved(game):
    return hfa.solve(game).K.tolist()


@pytest.mark.parametrize(
    ("words", "cost", "sources"),
    [
        ("--Q 2,1 --R .5", COST, ("given", "given", "default")),
        ("--Q x2=1,x1=2 --R .5 --delta inf", COST, ("given", "given", "given")),
        (
            "--sizes x1=.5,x2=1,u1=2",
            {"Q": np.diag([4.0, 1.0]), "R": [[0.25]]},
            ("sizes", "sizes", "default"),
        ),
        (
            "--Q 2,1 --R .5 --N 0.1;0.2",
            {**COST, "N": [[0.1], [0.2]]},
            ("given", "given", "default", "given"),
        ),
    ],
)
def test_weights_of_options_are_those_of_the_game(words, cost, sources, folder):
    """Diagonals in order or by name, sizes by 1/size², cross weights by rows; each has its source."""
    file = stored("plant.json", **PLANT)
    found = answer("solve", "--model", file, *words.split())
    game = hfa.Game(**{key: np.array(value) for key, value in PLANT.items()}, **cost)
    np.testing.assert_allclose(found["K"], solved(game), rtol=1e-9)
    np.testing.assert_array_equal(found["Q"], cost["Q"])
    assert ("N" in found) == ("N" in cost)
    gain = stored("K.npz", K=found["K"])
    judged = answer("verify", "--model", file, "--weights", gain, *words.split())
    assert judged["weights_from"] == dict(zip(("Q", "R", "delta", "N"), sources, strict=False))
    assert judged["ok"] is True
