"""One quick forgery for each clause of the checker of regions on boxes.

Each forgery is refused with the message of its clause.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from flint import arb
from proofs import Content, certificate, changed, decided

from hfa import aircraft
from hfa_aircraft.about import Domain, Source
from hfa_aircraft.model import Model, Signal
from hfa_prove.certificate import read_certificate, read_content, write_certificate
from hfa_prove.check.cover import Boxes, OpenBoxError
from hfa_prove.check.equilibrium import Equilibrium, check_near, check_root, equilibrium_near
from hfa_prove.check.region_boxes import Decrease, check_region
from hfa_prove.enclosure.balls import matrix
from hfa_prove.problem import given_plant
from hfa_prove.report import found_report
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Subject, digest_of, facts
from hfa_prove.statements.region import RegionStatement, RegionWitness
from hfa_prove.subject import Given, compare, within as relative_to
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.data_files import jsonable
from hfa_support.reporting.text import Table


def _tank(x: Any, u: Any, p: Any, w: Any) -> Any:
    """Equations of a tank with the states level, heat and slope, and the outputs load and peak.

    The level rises unless the valve drains the tank. The heat decays.
    """
    rates = {"level": p.inflow * x.level + u.valve, "heat": -x.heat, "slope": 0.0 * x.slope}
    off = (x.level - 0.0625) ** 2 + (x.heat - 0.0625) ** 2
    return rates, {"load": x.level + x.heat, "peak": 1.0 - 40.0 * off}


TANK = Model(
    "tank",
    {"level": Signal("m"), "heat": Signal("K"), "slope": Signal("rad", 1.0, -1.0, 1.0)},
    {"valve": Signal("m/s", 1.0, -1.0, 1.0)},
    _tank,
    outputs={"load": Signal("1", 1.0, -3.0, 3.0), "peak": Signal("1", 1.0, max=9.0)},
    parameters={"inflow": Signal("1/s", start=0.5)},
    linear=("level", "heat"),
    trim={"level": 0.0, "heat": 0.0, "slope": 0.25},
    source=Source("tank.py:TANK", "3" * 64),
)


def tank() -> Content:
    """Return a true certificate of the region level² + heat² <= 0.81."""
    limits = {
        "slope": (-1.0, 1.0),
        "valve": (-1.0, 1.0),
        "load": (-3.0, 3.0),
        "peak": (-np.inf, 9.0),
    }
    gain = Gain(np.array([[2.0, 0.0]]), {})
    at = {"level": 0.0, "heat": 0.0}
    loop = Loop(TANK, {"inflow": 0.5}, at, {"valve": 0.0}, {"slope": 0.25}, limits, gain)
    piece = Piece(np.eye(2), Polynomial(2, ((1.0, (2, 0)), (1.0, (0, 2)))), 0.81)
    statement = RegionStatement(loop, at, piece, dict.fromkeys(at, (-0.91, 0.91)))
    witness = {"multipliers": np.full((2, 2), 0.55).tolist(), "boxes": 2000}
    return certificate("region", statement, witness)


def checked(content: Content, model: Model = TANK) -> int:
    return check_region(*read_content(content, Subject(model)))


def _decrease(
    statement: RegionStatement, witness: RegionWitness, at: Equilibrium, piece: Piece | None = None
) -> Decrease:
    extents = np.array(list(statement.extents.values()))
    return Decrease(statement.loop, at, piece or statement.piece, extents, witness.multipliers)


def _windy(x: Any, u: Any, p: Any, w: Any) -> Any:
    rates, outputs = _tank(x, u, p, w)
    rates |= {"level": rates["level"] + w.wind, "heat": rates["heat"] + w.sun * x.heat}
    return rates, {**outputs, "load": outputs["load"] + w.sun - w.wind}


#: The tank with a wind on its level and load, and a sun on its heat and load.
WINDY = replace(
    TANK,
    equations=_windy,
    disturbances={"wind": Signal("m/s"), "sun": Signal("K/s")},
)


def windy(**sizes: float) -> Content:
    """Return a certificate that level² + heat² <= 0.81 is invariant under disturbances."""
    of_windy = {"statement__loop__model": facts(WINDY), "statement__loop__disturbances": sizes}
    return changed(tank(), witness__boxes=50_000, **of_windy)


def within(c: float, **limits: list[float]) -> dict[str, Any]:
    """Return the changes for the set level² + heat² <= c, and for other limits."""
    ends = {f"statement__loop__limits__{name}": pair for name, pair in limits.items()}
    return {"statement__piece__c": c, **ends}


def faces(c: float) -> dict[str, Any]:
    """Return the changes for a set that meets the faces of the cube if c >= 1."""
    return {
        **within(c),
        "statement__extents": {name: [-1.3, 1.3] for name in ("level", "heat")},
        "witness__multipliers": [[0.5, 0.5]] * 2,
        "witness__boxes": 2000,
    }


def tall(level: float) -> dict[str, Any]:
    """Return the changes for the set level² + 100 heat² <= `level`²."""
    return {
        "statement__piece__M": [[0.3, 0.0], [0.0, 0.3]],
        "statement__piece__W": [[1.0, [2, 0]], [100.0, [0, 2]]],
        "statement__piece__c": (0.3 * level) ** 2,
        "statement__extents": {"level": [-2.1, 2.1], "heat": [-0.3, 0.3]},
        "witness__multipliers": [[0.4, 0.4]] * 2,
    }


#: Changes for the same set in coordinates y = M z with an M that is not symmetric.
SHEARED: dict[str, Any] = {
    "statement__piece__M": [[0.8, 0.4], [0.0, 0.8]],
    "statement__piece__W": [[1.5625, [2, 0]], [-1.5625, [1, 1]], [1.953125, [0, 2]]],
}
#: Sizes of disturbances, changes of the certificate, and what is said if it is false.
#:
#: V' < 0 on the edge needs wind < 1.5 · 0.9 where the valve is free, and 1 - 0.5 · 0.9 = 0.55 where it
#: is saturated (0.45 - 1 + wind < 0), and sun < 1. In level² + heat² <= 0.1, within a third of the
#: trim, V' < 0 at the level -0.316 needs a valve above 0.1 + 0.158, the load is at least -0.447 - 0.1,
#: and a wind of 0.5 needs a level of 1/3. The load 0.9 √2 + sun - wind is within 1.5 for a sum of sizes
#: of 0.2. The level 2 is another equilibrium.
FALSE, OPEN = "does not hold at a point", "undecided"
BOUNDS: list[tuple[dict[str, float], dict[str, Any], str]] = [
    ({}, {}, ""),
    ({"wind": 0.5, "sun": 0.9}, {}, ""),
    ({"wind": 0.55 + 1e-9}, {}, FALSE),
    ({"sun": 1.0 + 1e-9}, {}, FALSE),
    ({"wind": 0.5, "sun": 0.9}, SHEARED, ""),
    ({"sun": 1.0 + 1e-9}, SHEARED, FALSE),
    ({"wind": 0.1}, within(0.1, valve=[-1.0, 0.26]), ""),
    ({"wind": 0.1}, within(0.1, valve=[-1.0, 0.25]), FALSE),
    ({"wind": 0.5}, within(0.1), FALSE),
    ({"sun": 0.1}, within(0.1, load=[-0.55, 3.0]), ""),
    ({"sun": 0.1}, within(0.1, load=[-0.54, 3.0]), FALSE),
    ({"sun": 0.1, "wind": 0.1}, within(0.81, load=[-1.5, 1.5]), ""),
    ({}, faces(1.0 - 2.0**-10), ""),
    ({}, faces(1.01), OPEN),
    ({}, tall(2.0 * (1.0 - 1e-6)), ""),
    ({}, tall(2.0 * (1.0 + 1e-12)), OPEN),
]


@pytest.mark.parametrize(("sizes", "changes", "said"), BOUNDS)
def test_claims_are_proved_up_to_their_bounds(
    sizes: dict[str, float], changes: dict[str, Any], said: str
) -> None:
    """A set, its limits and its disturbances are proved up to the values of closed forms."""
    content = changed(windy(**sizes) if sizes else tank(), **changes)
    with decided(not said, said):
        assert checked(content, WINDY if sizes else TANK) > 0


@pytest.mark.parametrize(("gain", "is_proved"), [(2.0, True), (0.4, False)])
def test_a_held_state_may_come_first(gain: float, is_proved: bool) -> None:
    """The rates are those of the moving states, also behind a held state: K = 0.4 is too little."""
    names = ("slope", "level", "heat")
    model = replace(TANK, states={name: TANK.states[name] for name in names})
    changes = {"statement__loop__model": facts(model), "statement__loop__policy__K": [[gain, 0.0]]}
    with decided(is_proved, "near the equil"):
        assert checked(changed(tank(), **changes), model) > 0


@pytest.mark.parametrize(
    ("limits", "is_read"),
    [
        ({"level": [-0.99, 0.94]}, True),
        ({"level": [-1.01, 0.94]}, False),
        ({"level": [-0.99, 0.96]}, False),
        ({}, False),
    ],
)
def test_limits_beyond_the_envelope_about_the_trim_are_refused(
    limits: dict[str, list[float]], is_read: bool
) -> None:
    """An envelope of levels from -4 to 3.8 slopes of the trim refuses wider limits, and none."""
    envelope = Domain(envelope=lambda x, p: {"level": (-4.0 * x.slope, 3.8 * x.slope)})
    content = changed(tank(), statement__loop__limits=lambda given: given | limits)
    with decided(is_read, "level beyond the model's"):
        assert checked(content, replace(TANK, domain=envelope)) > 0


GUST = ca.interpolant("gust", "linear", [[-0.5, 0.0, 0.2, 0.5]], [0.0, 0.0, 5.0, 0.0])
#: Functions of a disturbance that are 0 at 0 and, but for the parabola, at 0.5 and -0.5.
CURVED: dict[str, Callable[[Any], Any]] = {
    "a parabola": lambda sun: sun * sun,
    "a kink": lambda sun: ca.fmax(0.1 - ca.fabs(sun - 0.2), 0.0),
    "a jump": lambda sun: ca.if_else(sun > 0.1, ca.if_else(sun < 0.2, 5.0, 0.0), 0.0),
    "a table": GUST,
}


@pytest.mark.parametrize("part", ["rates", "outputs"])
@pytest.mark.parametrize("name", CURVED)
def test_curved_disturbances_are_refused(name: str, part: str) -> None:
    """A rate or an output that is not affine in a disturbance is refused by name."""

    def curved(x: Any, u: Any, p: Any, w: Any) -> Any:
        rates, outputs = _windy(x, u, p, w)
        off = CURVED[name](w.sun)
        if part == "rates":
            return {**rates, "heat": rates["heat"] + off}, outputs
        return rates, {**outputs, "load": outputs["load"] + off}

    model = replace(WINDY, equations=curved)
    content = changed(windy(sun=0.5), statement__loop__model=facts(model))
    with pytest.raises(BadInputError, match="not affine in sun"):
        checked(content, model)


def test_different_policies_have_different_digests() -> None:
    """Policies that differ in the last digit of a number or in the state have different digests.

    The number is a coefficient, or a value of a table. Tables are told apart where they are used.
    """
    z = ca.SX.sym("z", 2)
    near = np.nextafter(0.25, 1.0)
    tables = [ca.interpolant("u", "linear", [[0.0, 1.0]], [0.0, v]) for v in (0.25, near)]
    commands = [0.25 * z[0], near * z[0], 0.25 * z[1], *(table(z[0]) for table in tables)]
    commands += [tables[k](z[0]) - tables[1 - k](z[1]) for k in range(2)]
    policies = [ca.Function("u", [z], [command]) for command in commands]
    assert len({digest_of(policy) for policy in policies}) == 7


def test_deviations_contain_those_of_the_exact_inverse() -> None:
    """The models of z contain M⁻¹ y for M = diag(3, 7), whose inverse is not exact."""
    statement, witness = read_content(tank(), Subject(TANK))
    stretched = statement.piece._replace(M=np.diag([3.0, 7.0]))
    equilibrium = equilibrium_near(statement.loop, np.zeros(2))
    found = _decrease(statement, witness, equilibrium, stretched)
    linear, radius = found.symbols_on(Boxes(np.array([[0.375, 0.625]]), np.array([[3, 3]])))
    for i, (centre, factor) in enumerate(((0.375, 3), (0.625, 7))):
        value, *slopes = (Fraction(each) for each in linear[2 + i, :, 0].tolist())
        off = abs(value - Fraction(centre) / factor) + abs(sum(slopes) - Fraction(1, 8) / factor)
        assert 0 < off <= Fraction(float(radius[2 + i, 0]))


def test_the_error_of_the_equilibrium_is_included() -> None:
    """The decrease of V is proved for an exact equilibrium, but not for one known within 0.3."""
    statement, witness = read_content(tank(), Subject(TANK))
    exact, known = (Equilibrium(np.zeros(2), np.array([radius, 0.0])) for radius in (0.0, 0.3))
    assert _decrease(statement, witness, exact).proved(2000) > 0
    with pytest.raises(OpenBoxError, match="undecided"):
        _decrease(statement, witness, known).proved(2000)


def _coarse(x: Any, u: Any, p: Any, w: Any) -> Any:
    """Equations of a tank; in doubles, the root of (level + 1e17)² is 1e17 for small levels."""
    rates, outputs = _tank(x, u, p, w)
    level = ca.sqrt((x.level + 1e17) ** 2) - 1e17
    return rates | {"level": rates["level"] + level - x.level + 0.1}, outputs


def test_an_equilibrium_that_rounding_displaces_is_not_enclosed() -> None:
    """Newton's method in doubles ends at a level of 0.04 m; the exact root is 0.1 m / 1.5."""
    statement, _ = read_content(tank(), Subject(TANK))
    loop = replace(statement.loop, model=replace(TANK, equations=_coarse))
    with pytest.raises(NoSolutionError, match="no equilibrium is enclosed"):
        equilibrium_near(loop, np.zeros(2))


@pytest.mark.parametrize(
    ("radii", "is_proved"), [((2.0, 3.0), True), ((1.0, 3.0), False), ((2.0, 1.0), False)]
)
def test_a_root_is_claimed_only_within_the_radii(
    radii: tuple[float, float], is_proved: bool
) -> None:
    """The root of (w_1 + a w_2, w_2 + 1), |a| <= 0.3, is up to (0.3, 1) from the estimate 0."""
    residual, J = matrix([[0.0], [1.0]]), matrix([[1.0, 0.0], [0.0, 1.0]])
    J[0, 1] = arb(0, 0.3)
    with decided(is_proved, "not proved to exist"):
        check_root(residual, J, [arb(radius) for radius in radii])


def test_the_equilibrium_is_compared_in_nominal_values() -> None:
    """A stated equilibrium with an error of 2e-7 m is refused if the nominal value is 0.01 m.

    The tolerance is 1e-6 nominal values.
    """
    states = {**TANK.states, "level": Signal("m", 0.01)}
    changes = {"statement__equilibrium__level": 2e-7, "statement__loop__model__nominal__0": 0.01}
    with pytest.raises(NoSolutionError, match="differs from the stated"):
        checked(changed(tank(), **changes), replace(TANK, states=states))


@pytest.mark.parametrize(("radius", "is_near"), [(0.0, True), (0.2e-6, False)])
def test_an_equilibrium_is_near_with_all_of_its_enclosure(radius: float, is_near: bool) -> None:
    """The enclosure of an equilibrium is within 1e-6 nominal values of the stated one."""
    statement, _ = read_content(tank(), Subject(TANK))
    known = Equilibrium(np.array([0.9e-6, 0.0]), np.array([radius, 0.0]))
    with decided(is_near, "level at the equilibrium"):
        check_near(known, statement.loop, statement.equilibrium)


@pytest.mark.parametrize("ends", [(-0.9105, 9.0), (-9.0, 0.9105)])
def test_limits_are_proved_about_all_enclosed_equilibria(ends: tuple[float, float]) -> None:
    """Limits 0.9105 from the trim are proved to hold for an exactly known equilibrium.

    For an equilibrium known within 0.001, they are refused.
    """
    content = changed(tank(), statement__loop__limits__level=list(ends))
    statement, witness = read_content(content, Subject(TANK))
    _decrease(statement, witness, Equilibrium(np.zeros(2), np.zeros(2))).check_limits()
    about = Equilibrium(np.zeros(2), np.array([0.001, 0.0]))
    with pytest.raises(NoSolutionError, match="level is not proved to stay"):
        _decrease(statement, witness, about).check_limits()


_ABOUT = {"statement__loop__parameters__inflow": 0.8}
_GAIN = "statement__loop__policy__K"
_W = "statement__piece__W"
_LIMITS = "statement__loop__limits"
_MODEL = "statement__loop__model"
_LEVEL, _HEAT = [1.0, [2, 0]], [1.0, [0, 2]]
#: Changes of the certificate, and what the clause says that refuses it.
FORGED: list[tuple[dict[str, Any], str]] = [
    ({"statement__equilibrium__level": 1.1e-6}, "differs from the stated"),
    ({"statement__equilibrium__level": -1.1e-6}, "differs from the stated"),
    ({f"{_LIMITS}__peak": [-999.0, 0.96]}, FALSE),  # it is below its limit in the hole alone
    ({f"{_LIMITS}__load": [-3.0, 1.2]}, FALSE),
    ({f"{_LIMITS}__load": [-1.2, 3.0]}, FALSE),
    ({f"{_LIMITS}__load": [-4.0, 3.0]}, "load beyond"),
    ({f"{_LIMITS}__load": [-3.0, 4.0]}, "load beyond"),
    ({"statement__loop__held__slope": 1.5}, "slope has the constant value"),
    ({"statement__loop__held__slope": -1.5}, "slope has the constant value"),
    ({f"{_LIMITS}__level": [-9.0, 0.91]}, "level is not proved to stay"),
    ({f"{_LIMITS}__level": [-0.91, 9.0]}, "level is not proved to stay"),
    ({_LIMITS: {}}, "limits: "),
    ({_LIMITS: {"slope": [-1, 1], "valve": [-1, 1], "load": [-3, 3]}}, "limits: peak"),
    ({"statement__extents__level": [-0.91, 0.89]}, FALSE),
    ({"statement__extents__heat": [-0.89, 0.91]}, FALSE),
    ({_GAIN: [[-2.0, 0.0]]}, "near the equilibrium"),
    ({_GAIN: [[0.4, 0.0]]}, "near the equilibrium"),
    ({_GAIN: [[0.5 - 1e-9, 0.0]]}, "near the equilibrium"),
    ({_GAIN: [[0.5, 0.0]]}, "Jacobian is singular"),  # a line of equilibria
    ({"statement__loop__policy__terms": {"valve": [[9.0, [3, 0]]]}}, FALSE),
    *(
        (  # the valve saturates on one side of the trim
            _ABOUT
            | {"statement__loop__trim__level": level, "statement__equilibrium__level": level}
            | {"statement__loop__inputs__valve": -0.8 * level},
            FALSE,
        )
        for level in (0.5, -0.5)
    ),
    ({"statement__loop__parameters__inflow": 1.2}, FALSE),
    ({_W: [[4.0, [2, 0]], [-16.0, [4, 0]], [16.5, [6, 0]], _HEAT]}, FALSE),  # a second valley
    ({_W: [_LEVEL, _HEAT, [-0.9, [4, 0]]]}, FALSE),  # a hill
    ({_W: [_LEVEL, [-2.0, [1, 1]], _HEAT]}, "near the"),  # flat along a line
    ({_W: [_LEVEL, [-2.0 - 1e-9, [1, 1]], _HEAT]}, "near the"),
    ({_W: [[-1.0, [2, 0]], _HEAT]}, "near the"),
    ({_W: [_LEVEL, _HEAT, [0.01, [3, 0]]]}, "W 2"),  # a power times a coefficient that is rounded
    ({"statement__piece__M": [[1.0, 1.0], [1.0, 1.0]]}, "coordinates y = M z is singular"),
    ({"statement__loop__policy": "0" * 64}, "a policy in a file; give this file"),
    ({f"{_MODEL}__dynamics": "van der Pol"}, "with other equations"),
    ({f"{_MODEL}__equations": "0" * 64}, "with other equations"),
    ({f"{_MODEL}__nominal__0": 2.0}, "model: nominal"),
    ({f"{_MODEL}__state_units__0": "ft"}, "model: state_units"),
    ({"witness__boxes": 3}, "undecided after 3 boxes"),
    ({"claim": 1.0}, "unknown entry"),
]


@pytest.mark.parametrize(("changes", "said"), FORGED)
def test_each_clause_refuses_its_forgery(changes: dict[str, Any], said: str) -> None:
    """Each clause of the checker refuses the forgery that violates it."""
    made = tank()
    if "claim" in changes:
        made |= changes
    else:
        made = changed(made, **changes)
    with pytest.raises((NoSolutionError, BadInputError), match=said):
        checked(made)


def test_the_data_of_a_report_bound_the_set() -> None:
    """`rho`, `terms` and `M` give the proved set, from which all flights return.

    V = y_1² + y_2² - y_1⁴ / 4 with y = z / 2 is below rho = 0.7 for levels below 1.902, and again above
    3.52, where the valve no longer drains the tank: it does up to a level of 2.
    """
    W = [_LEVEL, _HEAT, [-0.25, [4, 0]]]
    content = changed(
        tank(),
        statement__piece={"M": [[0.5, 0.0], [0.0, 0.5]], "W": W, "c": 0.7},
        statement__extents={"level": [-1.95, 1.95], "heat": [-1.95, 1.95]},
        witness__multipliers=[[0.4, 0.4]] * 2,
    )
    assert checked(content) > 0
    statement, _ = read_content(content, Subject(TANK))
    data = json.loads(json.dumps(jsonable(found_report(statement, 1).data)))
    z = np.column_stack([np.linspace(-4.0, 4.0, 801), np.zeros(801)])
    V = sum(factor * np.prod(z ** np.array(powers), axis=1) for factor, powers in data["terms"])
    is_in = np.all(np.abs(z @ np.array(data["M"]).T) < 1.0, axis=1)
    is_below = data["rho"] >= V
    level = z[:, 0].copy()
    for _ in range(4000):
        level += 0.005 * (0.5 * level + np.clip(-2.0 * level, -1.0, 1.0))
    returns = np.abs(level) < 0.01
    assert (is_below & is_in).sum() == 381
    assert np.all(returns[is_below & is_in])
    assert not np.any(returns[is_below & ~is_in])
    assert np.any(is_below & ~is_in)


def test_ends_in_a_report_are_rounded_outward() -> None:
    """The table of a report contains the extents, of which it shows four digits."""
    extents = {"level": [-0.912345, 0.912345], "heat": [-0.95, 0.95]}
    content = changed(tank(), statement__extents=extents)
    statement, _ = read_content(content, Subject(TANK))
    table = next(part for part in found_report(statement, 1).parts if isinstance(part, Table))
    low, high = (float(cell.split()[0]) for cell in table.rows[0][1:3])
    assert -0.9124 <= low < -0.912345
    assert 0.912345 < high <= 0.9124


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('"c": 0.81', '"c": 0.75'),
        ('"boxes": 2000', '"boxes": 2001'),
        ('"date": "today"', '"date": "monday"'),
        ('"digest": "', '"digest": "0'),
        ('"kind": "region"', '"kind": "schedule", "kind": "region"'),
        ('"c": 0.81', '"c": 0.75, "c": 0.81'),
        ('"c": 0.81', '"c": 0.810'),
    ],
)
def test_a_certificate_that_was_edited_is_refused(before: str, after: str, tmp_path: Path) -> None:
    """An edit of any text of a file is refused: a value, a seal, a second entry, another digit."""
    path = tmp_path / "region.json"
    origin = {"version": "1", "command": "hfa prove region", "date": "today"}
    statement, witness = read_content(tank(), Subject(TANK))
    write_certificate(path, statement, witness, origin)
    assert read_certificate(path, Subject(TANK)).written == origin
    text = path.read_text()
    assert text.count(before) == 1
    path.write_text(text.replace(before, after))
    with pytest.raises(BadInputError, match="edited"):
        read_certificate(path, Subject(TANK))


def test_a_policy_receives_the_whole_trim() -> None:
    """The second argument of a policy contains all states, the inputs and the parameters in order."""
    z, at = ca.SX.sym("z", 2), ca.SX.sym("trim", 5)
    statement, _ = read_content(tank(), Subject(TANK))
    policy = ca.Function("u", [z, at], [ca.dot(10.0 ** np.arange(5), at)])
    numbers: Any = {"trim": {"level": 1.0, "heat": 2.0}, "inputs": {"valve": 4.0}}
    numbers |= {"held": {"slope": 3.0}, "parameters": {"inflow": 5.0}}
    loop = replace(statement.loop, policy=policy, **numbers)
    found = ca.Function("u", [z], [loop.deviations(z)])
    assert float(found(np.zeros(2))) == 54321.0


def test_inputs_saturate_at_each_limit_that_exists() -> None:
    """The command of a valve with a lower, an upper, both limits or none is that of `np.clip`."""
    statement, _ = read_content(tank(), Subject(TANK))
    at = {"level": 0.1, "heat": 0.0}
    x = ca.SX.sym("x", 2)
    levels = np.linspace(-2.0, 2.0, 9)
    for limits in ((-0.5, np.inf), (-np.inf, 0.75), (-0.5, 0.75), (-np.inf, np.inf)):
        loop = replace(statement.loop, limits={"valve": limits}, trim=at, inputs={"valve": 0.25})
        command = ca.Function("u", [x], [loop.commands(x)])
        found = np.array(command(np.vstack([levels, 0.0 * levels])))[0]
        assert found == pytest.approx(np.clip(0.25 - 2.0 * (levels - 0.1), *limits), abs=1e-15)


def test_different_equations_have_different_digests() -> None:
    """Models that differ in an operation, an output, a disturbance, a name or a trim variable have
    different digests.

    The name of a built-in aircraft is no digest.
    """

    def added(x: Any, u: Any, p: Any, w: Any) -> Any:
        rates, outputs = _tank(x, u, p, w)
        return rates | {"level": p.inflow + x.level + u.valve}, outputs

    def loaded(x: Any, u: Any, p: Any, w: Any) -> Any:
        rates, outputs = _tank(x, u, p, w)
        return rates, {**outputs, "load": x.level - x.heat}

    def renamed(x: Any, u: Any, p: Any, w: Any) -> Any:
        rates = {"level": p.inflow * x.level + u.tap, "heat": -x.heat, "slope": 0.0 * x.slope}
        return rates, _tank(x, SimpleNamespace(valve=u.tap), p, w)[1]

    models = [replace(TANK, equations=equations) for equations in (_tank, added, loaded)]
    models += [replace(TANK, equations=renamed, inputs={"tap": TANK.inputs["valve"]})]

    def gusty(x: Any, u: Any, p: Any, w: Any) -> Any:
        rates, outputs = _windy(x, u, p, w)
        return rates | {"level": rates["level"] + w.wind}, outputs

    models += [WINDY, replace(WINDY, equations=gusty)]
    models += [replace(TANK, replaced={"heat": "load"}, trim={"level": 0.0, "load": 0.0})]
    models += [replace(TANK, equations=added, name="published")]
    digests = [facts(model)["equations"] for model in models]
    assert len(set(digests[:-1])) == 7
    assert digests[-1] == digests[1]


def test_a_certificate_about_a_file_is_not_read_as_one_about_a_variant() -> None:
    """Without the file, the built-in aircraft of the same name is not the subject."""
    model = facts(aircraft()) | {"equations": "0" * 64}
    content = changed(tank(), statement__loop__model=model)
    with pytest.raises(BadInputError, match="give the aircraft file"):
        read_content(content, Subject())


def test_entries_of_the_certificate_are_exactly_the_users() -> None:
    """Fewer, further or other numbers than the user's are refused, above and below."""
    statement, _ = read_content(tank(), Subject(TANK))
    for valve, is_same in ((0.0, True), (0.1, False)):
        own_loop = replace(statement.loop, inputs={"valve": valve})
        with decided(is_same, "differs from the value"):
            compare(statement, given_plant(own_loop, "loop."))
    compare(statement, {"loop.parameters": Given({"inflow": 0.5})})
    for own in (
        {},
        {"inflow": 0.4},
        {"inflow": 0.6},
        {"other": 0.5},
        {"inflow": 0.5, "other": 0.5},
    ):
        with pytest.raises(NoSolutionError, match="differs from the value"):
            compare(statement, {"loop.parameters": Given(own)})
    for off in (1e-5, -1e-5):
        at = {"level": off, "heat": 0.0}
        for width, is_within in ((2e-5, True), (1e-6, False)):
            near = relative_to(dict.fromkeys(at, width))
            with decided(is_within, "level in the certificate differs"):
                compare(statement, {"loop.trim": Given(at, near)})


def _plane(rates: Any, M: np.ndarray, share: float = 1.0) -> Decrease:
    """Return the claim that a² + share b² decreases for rates(a, b), with y = M (a, b)."""
    model = Model(
        "plane",
        {"a": Signal(), "b": Signal()},
        {},
        lambda x, u, p, w: (dict(zip(("a", "b"), rates(x.a, x.b), strict=True)), {}),
        trim={},
    )
    still = {"a": 0.0, "b": 0.0}
    loop = Loop(model, {}, still, {}, {}, {}, Gain(np.zeros((0, 2)), {}))
    N = np.linalg.inv(M)
    V = N.T @ np.diag([1.0, share]) @ N
    terms = ((V[0, 0], (2, 0)), (2.0 * V[0, 1], (1, 1)), (V[1, 1], (0, 2)))
    W = Polynomial(2, tuple(term for term in terms if term[0]))
    ends, at = np.array([[-1.0, 1.0]] * 2), Equilibrium(np.zeros(2), np.zeros(2))
    return Decrease(loop, at, Piece(M, W, 0.5), ends, np.zeros((2, 2)))


@pytest.mark.parametrize(("less", "more"), [(6.62, 6.64), (-6.62, -6.64)])
def test_the_hole_ends_where_the_jacobian_is_no_longer_definite(less: float, more: float) -> None:
    """J + J' is definite on |a|, |b| <= h if c h < 0.8284 for b' = -b + c a b, and if c h < 2 for
    a' = -a + c b² / 2. For a² + b² / 4, a' = -a + c b needs c < 1.
    """
    for c, k in ((less, 3), (more, 4)):
        assert _plane(lambda a, b, c=c: (-a, -b + c * a * b), np.eye(2)).hole == k
        c *= 2.0 / 0.8284
        assert _plane(lambda a, b, c=c: (-a + 0.5 * c * b**2, -b), np.eye(2)).hole == k
    assert _plane(lambda a, b: (-a + 0.99 * b, -b), np.eye(2), 0.25).hole == 1
    with pytest.raises(NoSolutionError, match="not proved near the equilibrium"):
        _ = _plane(lambda a, b: (-a + 1.01 * b, -b), np.eye(2), 0.25).hole


def test_rates_with_a_jump_are_not_proved_across_it() -> None:
    """The Jacobian of a' = -a + [a > 0.1] is -1 on both sides of the jump."""
    claim = _plane(lambda a, b: (-a + ca.if_else(a > 0.1, 1.0, 0.0), -b), np.eye(2))
    assert claim.hole == 4
