"""Reports of statements in which no two numbers, units or limits are equal."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from as_proved import WRITTEN, as_proved
from stored_certificates import read, stored

from hfa_aircraft.about import Source
from hfa_aircraft.march.ending import Outcome
from hfa_aircraft.model import Model, Signal
from hfa_flight.problem import flight_problem
from hfa_prove.check.region_squares import extents_of
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.problem import given_plant, plant_of, unknowns_of
from hfa_prove.report import (
    checked_report as checked_by_modes,
    game_report,
    proof_report,
)
from hfa_prove.report_cost import checked_bound_report, found_bound_report
from hfa_prove.report_region import checked_report, region_report
from hfa_prove.report_value import checked_value_report, found_value_report
from hfa_prove.results import schedule_data
from hfa_prove.search.cost import CostBound
from hfa_prove.search.obstacles import LevelSet, Obstacles
from hfa_prove.search.region_search import Region
from hfa_prove.statements.cost import CostStatement
from hfa_prove.statements.flight import StatedTrim
from hfa_prove.statements.game import Plant as PlantOfMatrices
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Plant
from hfa_prove.statements.region import RegionStatement, SquaresWitness
from hfa_prove.statements.schedule import FixedActuators, Run, UncertainActuators
from hfa_prove.statements.value import ValueStatement
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from trim.point.solve import trim

CRAFT = Model(
    "craft",
    {
        "place": Signal("m", 2.0, -7.0, 9.0),
        "pitch": Signal("rad", 0.3, -0.5, 0.8),
        "turn": Signal("rad/s", 0.7),
        "slope": Signal("rad", 1.0, -1.0, 1.25),
    },
    {"force": Signal("N", 1.0, -2.0, 3.0), "flap": Signal("rad", 0.5, -0.4, 0.6)},
    lambda x, u, p, w: (
        {"place": x.turn, "pitch": u.flap, "turn": u.force - p.lead, "slope": 0.0 * x.slope},
        {"load": x.place, "free": x.pitch},
    ),
    outputs={"load": Signal("kN"), "free": Signal("K")},
    parameters={"damping": Signal("1/s", start=0.5), "lead": Signal("rad", start=0.125)},
    linear=("place", "pitch", "turn"),
    trim={},
    source=Source("craft.py:CRAFT", "3" * 64),
)
STATES = ("place", "pitch", "turn")
#: Name -> value in the units of the model, and as printed.
TRIM = {"place": 4.5, "pitch": np.radians(3.0), "turn": np.radians(0.5)}
INPUTS = {"force": 1.25, "flap": np.radians(-2.0)}
HELD = {"slope": np.radians(7.0)}
VALUES = {**TRIM, **INPUTS, **HELD}
SHOWN = {
    "place": "4.5 m", "pitch": "3 deg", "turn": "0.5 deg/s",
    "force": "1.25 N", "flap": "-2 deg", "slope": "7 deg",
}  # fmt: skip
PARAMETERS = {"damping": 0.5, "lead": np.radians(8.0)}
LIMITS = {
    "place": (-7.0, 9.0), "pitch": (np.radians(-20.0), np.radians(40.0)),
    "turn": (-np.inf, np.radians(60.0)), "force": (-2.0, 3.0),
    "flap": (np.radians(-21.0), np.radians(31.0)), "load": (-11.0, 12.0),
}  # fmt: skip
ENDS = {
    "place": ("-7 m", "9 m"), "pitch": ("-20 deg", "40 deg"), "turn": ("-", "60 deg/s"),
    "force": ("-2 N", "3 N"), "flap": ("-21 deg", "31 deg"), "slope": ("-", "-"),
}  # fmt: skip
TERMS = ((1.5, (2, 0, 0)), (-0.25, (1, 1, 0)), (2.5, (0, 2, 0)), (3.5, (0, 0, 2)))
K = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
EXTENTS = {"place": (-0.71, 0.83), "pitch": (-0.11, 0.13), "turn": (-0.29, 0.23)}
M = np.array([[1.0, 0.5, 0.25], [0.0, 2.0, 0.75], [0.0, 0.0, 3.0]])
#: A deviation at an obstacle, and as printed.
PLACE = np.array([0.5, np.radians(-6.0), np.radians(9.0)])
AT = "place 0.5 m, pitch -6 deg, turn 9 deg/s"


def statement_of(
    *, disturbed: bool = False, curved: bool = False, moved: bool = False
) -> RegionStatement:
    gain = Gain(K, {"flap": ((0.75, (0, 1, 2)),)} if curved else {})
    gusts = {"gust": 2.5} if disturbed else {}
    model = CRAFT
    if disturbed:
        model = replace(CRAFT, disturbances={"gust": Signal("m/s")})
    loop = Loop(model, PARAMETERS, TRIM, INPUTS, HELD, LIMITS, gain, gusts)
    statement = RegionStatement.of_terms(loop, TERMS, 0.123456789, EXTENTS)
    about = {name: value + 0.001 for name, value in TRIM.items()}
    return replace(statement, equilibrium=about) if moved else statement


def region_of(statement: RegionStatement, prover: str, **changed: Any) -> Region:
    V = PolynomialFunction.of_terms(TERMS)
    starts = {Outcome.LEFT: (0.75, PLACE), Outcome.DIVERGED: (0.875, -PLACE)}
    obstacles = Obstacles((0.5, 2.0 * PLACE), starts, ("flap", "load"))
    level_set = LevelSet(V, statement.rho, np.eye(3))
    region = Region(
        statement, {"prover": prover}, 17, level_set, EXTENTS, "a test", cast(Any, None),
        obstacles=obstacles,
    )  # fmt: skip
    return replace(region, **changed)


def tables(report: Report) -> dict[str, Table]:
    """Return the tables of a report by the name of their first column."""
    return {part.header[0]: part for part in report.parts if isinstance(part, Table)}


def words(report: Report) -> str:
    """Return the text of a report in one line."""
    return " ".join(report.text(width=None).split())


def value_of(polynomial: str, values: Mapping[str, float]) -> float:
    """Return the value of a polynomial that is written as in a report, "+2 x^2 y -1 y"."""
    product = re.sub(r" (?=[a-z])", "*", polynomial.strip())
    return float(eval(product.replace("^", "**"), {}, dict(values)))


def number(cell: str) -> float:
    return float(cell.split()[0])


def assert_extents(rows: Sequence[tuple[Any, ...]], about: Mapping[str, str]) -> None:
    """Assert that printed extents contain the set, in the shown units and to six digits."""
    for (name, least, most, at, *ends), unit in zip(rows, ("m", "deg", "deg/s"), strict=True):
        low, high = (end if unit == "m" else np.degrees(end) for end in EXTENTS[name])
        assert number(least) <= low == pytest.approx(number(least), rel=2e-5)
        assert number(most) >= high == pytest.approx(number(most), rel=2e-5)
        assert {least.split()[1], most.split()[1]} == {unit}
        assert (at, tuple(ends)) == (about[name], ENDS[name])


@pytest.mark.parametrize("disturbed", [False, True])
@pytest.mark.parametrize("prover", ["boxes", "squares"])
def test_a_found_region_is_reported(prover: str, disturbed: bool) -> None:
    """Extents, obstacles with their distances, the polynomial V and the data are the region's."""
    statement = statement_of(disturbed=disturbed)
    report = region_report(region_of(statement, prover), "a test policy", "all effects")
    data, text = report.data, words(report)
    assert_extents(tables(report)["the set lies within"].rows, SHOWN)
    proved, *rows = tables(report)["level"].rows
    assert proved == ("proved", "0.123456", "1", "")
    levels = [0.5, 0.75, 0.875]
    assert [number(row[1]) for row in rows[:3]] == levels
    distances = np.sqrt(np.array(levels) / 0.123456789)
    assert [number(row[2]) for row in rows[:3]] == pytest.approx(distances, rel=5e-3)
    assert rows[1][3] == AT
    assert rows[3][1:] == ("none found", "", "")
    printed = re.search(r"V\(z\) = (.*?) Not covered", text)
    assert printed is not None
    z = dict(zip(STATES, PLACE, strict=True))
    V = sum(c * np.prod(PLACE ** np.array(powers)) for c, powers in TERMS)
    assert value_of(printed[1], z) == pytest.approx(V, rel=1e-12)
    assert data["trim"] == VALUES
    assert data["parameters"] == PARAMETERS
    assert data["state_units"] == ["m", "rad", "rad/s"]
    assert data["limits_that_bind"] == ["flap", "load"]
    assert data["decrease_fails_at"] == {
        "V": 0.5,
        "z": dict(zip(STATES, 2.0 * PLACE, strict=True)),
    }
    assert data["leaves_limits_at"] == {"V": 0.75, "z": z}
    assert data["lost_at"]["V"] == 0.875
    assert data["extents"] == {"place": 0.83, "pitch": 0.13, "turn": 0.29}
    assert "Limits that bind: flap, load. Origin of V: a test. Degree: 2." in text
    assert "V(z) <= 0.123456 stays there" in text
    assert "inputs saturated: force, flap. slope held at trim values." in text
    assert "Policy: a test policy." in text
    assert "without all effects" in text
    assert ("17 boxes" in text, "17 parts of the set" in text, "17 parts of V = rho" in text) == (
        prover == "boxes",
        prover == "squares" and not disturbed,
        prover == "squares" and disturbed,
    )
    assert ("every disturbance |gust| <= 2.5 m/s" in text) is disturbed
    assert ("converges to the trim" in text) is not disturbed
    assert ("all effects, disturbances" in text) is not disturbed
    assert ("delays, other disturbances" in text) is disturbed


def test_missing_obstacles_are_told_from_missing_simulations() -> None:
    """Without a found state, the report says whether none exists or the time ended."""
    for simulated in (True, False):
        none = Obstacles((np.inf, None), {}, (), simulated)
        region = region_of(statement_of(), "boxes", obstacles=none)
        report = region_report(replace(region, stopped="the time ended", others={"squares": "no"}))
        _, rise, *flights = tables(report)["level"].rows
        assert rise[1:] == ("none found", "", "")
        said = "none found" if simulated else "not simulated in the time"
        assert {row[1:] for row in flights} == {(said, "", "")}
        text = words(report)
        assert "Limits that bind: none." in text
        assert "Sums of squares: no." in text
        assert "No larger set is proved: the time ended." in text
        assert report.data["decrease_fails_at"] is None
        assert report.data["stopped"] == "the time ended"


def test_a_checked_region_is_reported() -> None:
    """The report contains trim, limits, gain, policy, parameters and equilibrium of the claim."""
    statement = statement_of(curved=True, moved=True)
    report = checked_report(as_proved(statement, sizes=(3, 4)), ["aircraft", "trim"], "a policy")
    text, data = words(report), report.data
    about = {"place": "4.501 m", "pitch": "3.0573 deg", "turn": "0.557296 deg/s"}
    assert_extents(tables(report)["the set lies within"].rows, about)
    rows = [(name, SHOWN[name], *ENDS[name]) for name in VALUES]
    assert list(tables(report)["trim"].rows) == rows
    gains = tables(report)["K"]
    assert gains.header[1:] == STATES
    assert [list(map(float, row[1:])) for row in gains.rows] == K.tolist()
    assert [row[0] for row in gains.rows] == ["force", "flap"]
    assert "Limits of outputs: load from -11 kN to 12 kN." in text
    assert "The policy of flap is -K z +0.75 pitch turn^2, then saturated." in text
    assert "Model: craft (SHA-256 of the file: 3333333333333333)." in text
    assert "Parameters: damping 0.5 1/s, lead 8 deg." in text
    assert "Equilibrium near place 4.501, pitch" in text
    assert "converges to the equilibrium;" in text
    assert "of the aircraft and trim in the certificate" in report.title
    assert "on 7 boxes. V is of degree 2." in text
    assert data["written"] == WRITTEN
    assert data["not_given"] == ["aircraft", "trim"]
    assert "The given policy agrees with it to 1e-09" in text
    assert "agrees" not in words(checked_report(as_proved(statement), ["policy"]))


@pytest.mark.parametrize("whole", [True, False])
def test_a_set_in_other_coordinates_is_printed_with_them(whole: bool) -> None:
    """W(y) and y = M z give the same V as the stored terms, whichever form is printed."""
    piece = Piece(M, Polynomial(3, TERMS), 0.5, whole)
    statement = replace(statement_of(), piece=piece)
    report = checked_report(as_proved(statement))
    table = tables(report)["M"]
    assert table.header[1:] == STATES
    assert np.array_equal(np.array([row[1:] for row in table.rows], float), M)
    text = words(report)
    printed = re.search(r"W\(y\) = (.*?), y = M z", text)
    assert printed is not None
    y = dict(zip(("y1", "y2", "y3"), M @ PLACE, strict=True))
    W = value_of(printed[1], y)
    assert pytest.approx(W, rel=1e-12) == sum(
        c * np.prod((M @ PLACE) ** np.array(powers)) for c, powers in TERMS
    )
    assert pytest.approx(W, rel=1e-12) == PLACE @ np.array(report.data["P"]) @ PLACE
    assert ("|y_i| < 1" in text) is not whole


def test_a_trim_of_the_user_agrees_within_a_tolerance() -> None:
    """Values may differ by 1e-6 of their nominal values, in each part of the trim."""
    plant = bound_of().plant
    stated = Plant(**{**vars(plant), "trim": TRIM, "limits": {}})
    given = given_plant(plant, "--aircraft", "plant.")
    for part, name in (("trim", "pitch"), ("trim", "place"), ("inputs", "flap")):
        for factor, agrees in ((0.9, True), (-0.9, True), (1.1, False), (-1.1, False)):
            moved = factor * 1e-6 * CRAFT.signals[name].nominal
            values = dict(getattr(stated, part))
            other = replace(stated, **{part: {**values, name: values[name] + moved}})
            assert given[f"plant.{part}"].same(getattr(other, part), values) is agrees


@pytest.mark.parametrize(
    ("A", "B", "nominal", "unknowns"),
    [
        ([[1.0, 1e9], [0.0, 1.0]], [[1.0], [1.0]], (1e9, 1.0, 1.0), (0, 1)),
        ([[1.0, 1e-9], [0.0, 1.0]], [[1.0], [1.0]], (1e-9, 1.0, 1.0), (0, 1)),
        ([[0.0, 0.0], [0.0, 2.0]], [[3.0], [0.0]], (1.0, 1.0, 1.0), (1, 2)),
        ([[0.0, 2.0], [0.0, 0.0]], [[0.0], [3.0]], (1.0, 1.0, 1.0), (1, 2)),
    ],
)
def test_unknowns_of_an_equilibrium_are_well_conditioned(
    A: Any, B: Any, nominal: tuple[float, ...], unknowns: tuple[int, ...]
) -> None:
    """In nominal values, the states are the unknowns unless their Jacobian is singular."""
    linear = SimpleNamespace(A=np.array(A), B=np.array(B))
    plant = SimpleNamespace(states=("a", "b"), nominal=np.array(nominal))
    assert unknowns_of(cast(Any, SimpleNamespace(linear=linear)), cast(Any, plant)) == unknowns


def test_limits_on_one_side_are_kept() -> None:
    """The limits of a bound contain those of the envelope and the inputs, if one end is finite."""
    model = Model(
        "half", {"x": Signal(max=1.5), "y": Signal()}, {"u": Signal(min=-2.5), "v": Signal()},
        lambda x, u, p, w: ({"x": u.u - x.x, "y": u.v - x.y}, {}), trim={"x": 0.0, "y": 0.0},
    )  # fmt: skip
    plant = plant_of(flight_problem(model, trim(model)))
    assert plant.limits == {"x": (-np.inf, 1.5), "u": (-2.5, np.inf)}


def test_extents_of_squares_are_those_of_the_checked_coordinates() -> None:
    """With T = diag(t), the extents are ±t, in place of those that the statement lists."""
    T = np.diag([2.0, 3.0, 5.0])
    witness = SquaresWitness(T, 4, cast(Any, None), (), (), ())
    report = checked_report(as_proved(statement_of(), witness))
    checked = extents_of(statement_of(), T)
    ends = [max(-low, high) for low, high in checked.values()]
    assert list(report.data["extents"].values()) == ends
    assert report.data["parts"] == 1
    assert "--prover squares" in words(report)
    ends = np.array(list(report.data["extents"].values()))
    assert np.all(ends >= np.sqrt(0.123456789 * np.diag(np.linalg.inv(report.data["P"]))))


def bound_of() -> CostStatement:
    plant = Plant(CRAFT, PARAMETERS, TRIM, INPUTS, HELD, LIMITS)
    still = {name: value + 0.25 for name, value in {**TRIM, **INPUTS}.items() if name != "pitch"}
    levels = (1.23456789, 2.25)
    pieces = tuple(Piece(level * M, Polynomial(3, TERMS), level) for level in levels)
    Q = np.diag([1.5, 2.5, 3.5])
    R = np.array([[4.0, 0.5], [0.5, 6.0]])
    return CostStatement(plant, {**still, "pitch": TRIM["pitch"]}, Q, R, pieces)


def test_bounds_of_the_cost_are_reported() -> None:
    """Each row of a found bound has the figures of its piece, and the limits those of the plant."""
    statement = bound_of()
    found = CostBound(
        statement, cast(Any, None), (11, 13), ((0.5, 1.5), (2.5, 3.5)),
        (0.25, 0.0), (0.75, np.nan), "the time ended",
    )  # fmt: skip
    report = found_bound_report(found)
    assert list(tables(report)["level"].rows) == [
        ("1.23456", "25.0%", "0.75", "11", "0.5 s", "1.5 s"),
        ("2.25", "0.0%", "-", "13", "2.5 s", "3.5 s"),
    ]
    assert "Share of the box: default initial conditions at which W is below" in words(report)
    assert "Further pieces: the time ended." in words(report)
    assert report.data["covered"] == [0.25, 0.0]
    assert [piece["boxes"] for piece in report.data["pieces"]] == [11, 13]
    assert "Further pieces" not in words(found_bound_report(replace(found, stopped="")))
    checked = checked_bound_report(as_proved(statement, sizes=(11, 13)), ["weights"])
    assert list(tables(checked)["level"].rows) == [("1.23456", "11"), ("2.25", "13")]
    at = {
        "place": "4.75 m", "pitch": "3 deg", "turn": "14.8239 deg/s", "force": "1.5 N",
        "flap": "12.3239 deg", "slope": "7 deg",
    }  # fmt: skip
    rows = [(name, SHOWN[name], at[name], *ENDS[name]) for name in VALUES]
    for each in (report, checked):
        assert list(tables(each)["flights within"].rows) == rows
        assert "from the trim. slope held at trim values." in words(each)
    text = words(checked)
    assert "Q: diagonal 1.5, 2.5, 3.5." in text
    assert "R: 4, 0.5; 0.5, 6." in text
    assert "of the weights in the certificate, without disturbances" in text
    assert "Parameters: damping 0.5 1/s, lead 8 deg." in text
    assert checked.data["trim"] == VALUES


def test_values_are_reported() -> None:
    """Degree, residual, rays, trim and weights are those of the claim."""
    content, _ = read(stored("value"))
    plant = Plant(CRAFT, PARAMETERS, TRIM, INPUTS, HELD, {})
    weights = replace(content.weights, E=np.array([[1.0, 0.5]]))
    statement = ValueStatement(plant, weights, 4, np.zeros(31), np.zeros((2, 19)), 2.5e-12)
    found = found_value_report(statement, 23)
    checked = checked_value_report(as_proved(statement, sizes=(20, 3)), ["value"])
    for report in (found, checked):
        assert "to degree 4, craft" in report.title
        assert "within 2.5e-12 of the sum of its terms (23 rays)" in words(report)
        assert (report.data["rays"], report.data["order"]) == (23, 4)
        assert report.data["residual"] == 2.5e-12
    text = words(checked)
    assert f"Trim: {', '.join(f'{name} {value}' for name, value in SHOWN.items())}." in text
    assert f"delta = {weights.delta:.10g}" in text
    assert "E = matrix 1 x 2, SHA-256" in text
    assert "written by hfa 1 on 2026-01-01: a test" in text


LOW, MIDDLE, HIGH = 15.0, 15.125, 15.25
FIRST, LAST = f"from {LOW:g} to {MIDDLE:g} deg", f"from {MIDDLE:g} to {HIGH:g} deg"
UNCERTAIN = UncertainActuators((1,) * 5, np.ones(5), (2.0, 9.0), (0.25, 0.75), 0.125)
FIXED = FixedActuators((2,) * 5, np.full(5, 0.5), np.full(5, 30.0), np.ones(5))


@pytest.mark.parametrize("actuators", [None, FIXED, UNCERTAIN])
@pytest.mark.parametrize("branches", [0, 1, 2])
@pytest.mark.parametrize("first", [(0, 0), (0, 1), (1, 3), (2, 2)])
def test_the_sentences_of_a_schedule_follow_from_its_numbers(
    first: tuple[int, int], branches: int, actuators: Any
) -> None:
    """Each sentence on a loop is present if, and only if, the numbers of the statement imply it."""
    original, _ = read(stored("schedule"))
    (stated,) = original.flight.trims
    trims = (stated, StatedTrim(HIGH, stated.unknowns))[:branches]
    statement = replace(
        original,
        flight=replace(original.flight, trims=trims, range=(LOW, HIGH)),
        loop=(Run(LOW, MIDDLE, 0, 0), Run(MIDDLE, HIGH, *first)),
        modes=(Run(LOW, MIDDLE, 1, 1), Run(MIDDLE, HIGH, 1, 4)),
        actuators=actuators,
        decay_rate=0.0123456789,
    )
    stable = first == (0, 0)
    refuted = first[0] > 0
    uncertain = actuators is UNCERTAIN
    data = schedule_data(statement, False)
    for part, boxes in (("loop", 7), ("modes", 9)):
        data[part]["boxes"] = boxes
    report = proof_report(statement, data)
    text = words(report)
    whole = stable and branches == 1
    verdict = "Refuted" if refuted else "Proved" if whole else "Left open"
    assert report.title.startswith(f"{verdict}: every dihedral from 15 to 15.25 deg")
    assert data["proved"] is whole
    assert data["dihedral_deg"] == [LOW, HIGH]
    counted = "2" if first == (2, 2) else "1 to 3"
    for sentence, expected in (
        (f"the loop has {counted} unstable modes at every angle {LAST}", refuted),
        (f"open: the loop {LAST}", first == (0, 1)),
        (f"open: the loop {FIRST}", False),
        ("the trim exists within its limits and", stable),
        ("A - B K is Hurwitz at every angle", stable and actuators is None),
        ("the loop through the actuators is stable", stable and actuators is not None),
        ("open: whether the trims from", branches != 1),
        ("decay rate where the loop is Hurwitz: 0.0123456 1/s", not uncertain),
        ("0 unstable modes at every", False),
        ("boxes: 7 for the loop, 9 for the aircraft's modes", True),
        ("for every actuator bandwidth from 2 to 9 rad/s", uncertain),
        ("effectiveness from 0.25 to 0.75 and delay up to 0.125 s", uncertain),
        ("requested for every actuator", uncertain and not stable),
        ("not covered: other actuators", uncertain),
        ("not covered: actuators outside the loop, delay", not uncertain),
        ("moves by at most", False),
        ("open: a moving dihedral", False),
    ):
        assert (sentence in text) is expected, sentence
    assert data.get("actuators") == (
        {"bandwidth": (2.0, 9.0), "effectiveness": (0.25, 0.75), "delay": 0.125}
        if uncertain
        else None
    )
    first_run = {"from_deg": LOW, "to_deg": MIDDLE}
    last_run = {"from_deg": MIDDLE, "to_deg": HIGH}
    known = [last_run | {"unstable": first[0]}] if first[0] == first[1] else []
    assert data["loop"]["proved"] == [first_run | {"unstable": 0}, *known]
    assert data["loop"]["open"] == ([last_run] if first == (0, 1) else [])
    assert data["refuted"] == ([last_run | {"unstable": first[0]}] if refuted else [])
    assert (data["one_branch"], data["decay_rate"]) == (branches == 1, 0.0123456789)
    title = checked_by_modes(as_proved(statement)).title
    assert title.startswith("Verified, proved:") is whole
    modes = tables(report)["aircraft A: dihedral, deg"]
    assert list(modes.rows) == [("15 to 15.125", "1"), ("15.125 to 15.25", "1 to 4")]
    assert data["modes"]["proved"] == [first_run | {"unstable": 1}]
    assert data["modes"]["open"] == [last_run | {"at_least": 1, "at_most": 4}]


def test_a_moving_schedule_is_claimed_or_open() -> None:
    """The rate is printed rounded down; without a proved rate a moving angle is open."""
    original, _ = read(stored("schedule"))
    original = replace(original, loop=(Run(LOW, HIGH, 0, 0),))
    for rate in (0.123456, None):
        statement = replace(original, scheduled_rate=rate)
        data = schedule_data(statement, True)
        report = proof_report(statement, data)
        text = words(report)
        assert report.title.startswith("Proved: every" if rate else "Left open: every")
        assert (data["proved"], data["dihedral_rate_deg_s"]) == (bool(rate), rate or 0.0)
        assert "dihedral_rate_deg_s" not in schedule_data(statement, False)
        low, high = statement.flight.range
        assert ("moves by at most 0.1234 deg/s, for any such motion" in text) is bool(rate)
        opened = f"open: a moving dihedral from {low:g} to {high:g} deg"
        assert (opened in text) is (rate is None)
        checked = words(checked_by_modes(as_proved(statement)))
        assert "open: a moving" not in checked
        assert ("moves by at most 0.1234" in checked) is bool(rate)


@pytest.mark.parametrize("loop", [(0, 0), (0, 2), (2, 2)])
@pytest.mark.parametrize("modes", [(1, 1), (1, 3)])
def test_the_sentences_of_a_game_follow_from_its_numbers(
    loop: tuple[int, int], modes: tuple[int, int]
) -> None:
    """Bounds of distances and of delta_min are rounded outwards, and each sentence is implied."""
    original, _ = read(stored("critic"))
    statement = replace(
        original,
        plant=PlantOfMatrices(np.diag([2.0, 3.0]), np.array([[0.0], [1.0]])),
        loop=loop,
        modes=modes,
        delta_min=(0.12345678908, 0.98765432101),
        distances={"W": (0.12345678, 0.12345678)},
        critic={"W": np.eye(2)},
        gain_of_value=False,
        decimals=True,
    )
    report = checked_by_modes(as_proved(statement))
    text = words(report)
    ((name, least, most),) = tables(report)["|X - X*| / |X*|, X* of the exact game"].rows
    assert (name, least, most) == ("W", "0.123456", "0.123457")
    for sentence, expected in (
        ("open: whether A - B K with the critic's K is Hurwitz", loop == (0, 2)),
        ("is not Hurwitz: 2 unstable", loop == (2, 2)),
        ("delta_min is above 0.123456789, at most 0.9876543211", True),
        ("A has 1 unstable modes", modes == (1, 1)),
        ("open: the number between them; A has 1 to 3 unstable modes", modes == (1, 3)),
        ("the critic's K is not the gain of its W", True),
        ("every number that rounds to the stored doubles", True),
        ("A = diag(2, 3)", True),
        ("B = matrix 2 x 1, SHA-256", True),
        ("critic's W = I", True),
        ("exact game, the plant of a file", True),
    ):
        assert (sentence in text) is expected, sentence
    alone = replace(statement, critic={"K": np.eye(2)})
    assert "the gain of its" not in words(checked_by_modes(as_proved(alone)))
    none = replace(statement, delta_min=None, decimals=False, gain_of_value=True)
    data = checked_by_modes(as_proved(none)).data
    assert "delta_min_above" not in data
    text = words(checked_by_modes(as_proved(none)))
    assert "rounds to the stored" not in text
    assert "the critic's K is the gain of its W, to within 1e-09" in text


SOLUTION: dict[str, Any] = {
    "statement": "solution", "proved": True, "closed_loop_hurwitz": False,
    "P": np.diag([2.0, 3.0]), "relative_radius": 1.23456e-9, "positive_definite": True,
    "worst_case_hurwitz": None, "delta_min_above": 4.0, "delta_min_at_most": 5.0,
    "unstable_modes_between": [1, 3],
}  # fmt: skip


def test_a_solution_is_reported() -> None:
    """Each row states the entry of the data that it is about; open entries are named so."""
    report = game_report(SOLUTION, ("x", "y"), "a game")
    rows = dict(tables(report)["statement"].rows)
    assert rows == {
        "the stabilizing solution exists and is unique": "open",
        "P is positive definite": "proved",
        "A - S P is Hurwitz": "open",
        "A - B K is Hurwitz": "refuted",
        "relative radius about the printed P": "1.24e-09",
        "delta_min": "above 4, at most 5",
        "relative width of the bracket": "0.2",
        "unstable modes of A": "1 to 3",
    }
    assert tables(report)["P"].header[1:] == ("x", "y")
    assert report.title == "Proved: the solution of the game of a game"
    missing = {"delta_min_above": None, "delta_min_at_most": None, "proved": False}
    report = game_report(SOLUTION | missing)
    rows = dict(tables(report)["statement"].rows)
    assert (rows["delta_min"], rows["relative width of the bracket"]) == ("open", "")
    assert report.title.startswith("Left open")
    assert [row[0] for row in tables(report)["P"].rows] == ["z1", "z2"]


@pytest.mark.parametrize(
    ("hurwitz", "title", "line"),
    [
        (True, "Proved: the gain of it stabilizes", "proved Hurwitz"),
        (False, "Refuted: the gain of it does not stabilize", "proved not Hurwitz"),
        (None, "Left open: whether the gain of it stabilizes", "open: a mode may lie on the axis"),
    ],
)
def test_a_critic_is_reported(hurwitz: bool | None, title: str, line: str) -> None:
    """The bounds of each distance are rounded outwards, and the verdict is that of the loop."""
    distances = {"P": {"at_least": 0.123456789, "at_most": 0.987654321}}
    data = {"statement": "critic", "closed_loop_hurwitz": hurwitz, "distances": distances}
    report = game_report(data, origin="a game", file="it")
    assert report.title.splitlines()[0] == title
    assert list(tables(report)["|X - X*| / |X*|"].rows) == [("P", "0.1234567", "0.9876544")]
    assert f"A - B K with this gain: {line}" in words(report)


def test_the_aircraft_of_a_schedule_is_described() -> None:
    """The report of a check states trims, limits, errors of parameters and the controller."""
    original, _ = read(stored("schedule"))
    (stated,) = original.flight.trims
    trims = tuple(StatedTrim(LOW + i / 8, stated.unknowns) for i in range(6))
    model = original.flight.model
    about = replace(model.about, names_schedule=False)
    model = replace(model, about=about, source=Source("", "4" * 64))
    eye = np.tile(np.eye(2), (2, 1, 1))
    controller = replace(
        original.controller,
        breakpoints=np.array([LOW, HIGH]),
        A=-eye,
        B=np.ones((2, 2, 6)),
        C=np.ones((2, 5, 2)),
        D=np.ones((2, 5, 6)),
    )
    parameters = dict(original.flight.parameters)
    first, second = list(parameters)[:2]
    flight = replace(original.flight, trims=trims, spread={first: 0.125, second: 0.5})
    for of_file in (False, True):
        flown = replace(flight, model=model, parameters={first: 0.25}) if of_file else flight
        statement = replace(original, flight=flown, controller=controller, actuators=FIXED)
        report = checked_by_modes(as_proved(statement, sizes=(2, 5)))
        text = words(report)
        describe = original.flight.model.describe
        for each in trims:
            listed = ", ".join(f"{name} {describe(name, v)}" for name, v in each.unknowns.items())
            assert f"trim at {each.breakpoint:.10g} deg: {listed}" in text
        assert "open: whether the trims from 15, 15.125, 15.25, 15.375 on are" in text
        assert "for all values of 2 parameters within these half-widths:" in text
        assert f"{first} {describe(first, 0.125)}, {second} {describe(second, 0.5)}" in text
        for name, (low, high) in flown.limits.items():
            assert f"{name} {describe(name, low)} to {describe(name, high)}" in text
        assert "controller: 2 breakpoints, 2 states, SHA-256" in text
        assert "actuators: order 2 2 2 2 2, damping 0.5 0.5 0.5 0.5 0.5, bandwidth 30" in text
        assert "boxes: 7" in text
        assert report.data["scheduled" if of_file else "dihedral_deg"] == (
            {"dihedral": [LOW, HIGH]} if of_file else [LOW, HIGH]
        )
        assert (f"files of SHA-256 {'4' * 16}, {first} 0.25" in text) is of_file
        assert ("published dynamics, parameters identified (" in text) is not of_file
        assert isinstance(report.data["parameters"], dict) is of_file
        assert ("parameter_hash" in report.data) is not of_file
        assert report.data["spread"] == {first: 0.125, second: 0.5}
        assert "measurements: " + ", ".join(controller.measurements) in text
    assert "for all values of" not in words(checked_by_modes(as_proved(original)))
    stable = replace(original, controller=controller, loop=(Run(LOW, HIGH, 0, 0),))
    data = schedule_data(stable, False)
    assert "the loop of aircraft and controller is stable" in words(proof_report(stable, data))
