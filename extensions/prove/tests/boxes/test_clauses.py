"""One quick forgery for each clause of the checker of regions on boxes.

Each forgery is refused with the message of its clause.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from flint import arb

from hfa import aircraft
from hfa_aircraft.about import Domain, Source
from hfa_aircraft.model import Model, Signal
from hfa_prove.certificate import SCHEMA, read_certificate, read_content, write_certificate
from hfa_prove.check.cover import Boxes, OpenBoxError, RefutedError
from hfa_prove.check.equilibrium import Equilibrium, check_root, equilibrium_near
from hfa_prove.check.region_boxes import Decrease, check_region
from hfa_prove.enclosure.balls import matrix
from hfa_prove.problem import given_plant
from hfa_prove.report import found_report
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Subject, digest_of, facts
from hfa_prove.statements.region import RegionStatement, RegionWitness
from hfa_prove.subject import Given, compare, within
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.data_files import jsonable
from hfa_support.reporting.text import Table

Content = dict[str, Any]


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
    loop = Loop(
        TANK,
        {"inflow": 0.5},
        at,
        {"valve": 0.0},
        {"slope": 0.25},
        limits,
        gain,
    )
    piece = Piece(np.eye(2), Polynomial(2, ((1.0, (2, 0)), (1.0, (0, 2)))), 0.81)
    statement = RegionStatement(loop, at, piece, dict.fromkeys(at, (-0.91, 0.91)))
    return {
        **{"schema": SCHEMA, "toolchain": "", "digest": "", "provenance": {}, "checksum": ""},
        "kind": "region",
        "statement": statement.content(),
        "witness": {
            "multipliers": np.full((2, 2), 0.55).tolist(),
            "boxes": 2000,
        },
    }


def checked(content: Content) -> int:
    return check_region(*read_content(content, Subject(TANK)))


def _decrease(
    statement: RegionStatement, witness: RegionWitness, at: Equilibrium, piece: Piece | None = None
) -> Decrease:
    extents = np.array(list(statement.extents.values()))
    return Decrease(statement.loop, at, piece or statement.piece, extents, witness.multipliers)


def test_the_true_certificate_is_accepted() -> None:
    """The certificate from which the forgeries are made is accepted."""
    assert 0 < checked(tank()) < 1000


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
    content = tank()
    loop = content["statement"]["loop"]
    loop["model"] = facts(WINDY)
    loop["disturbances"] = sizes
    content["witness"]["boxes"] = 50_000
    return content


def windy_checked(content: Content, model: Model = WINDY) -> int:
    return check_region(*read_content(content, Subject(model)))


def test_a_set_is_invariant_under_the_largest_disturbance_only() -> None:
    """V' < 0 on the edge needs wind < 1.5 · 0.9 where the valve is free, and 1 - 0.5 · 0.9 = 0.55
    where it is saturated (0.45 - 1 + wind < 0), and sun < 1.
    """
    assert windy_checked(windy(wind=0.5, sun=0.9)) > 0
    for sizes in ({"wind": 0.55 + 1e-9}, {"sun": 1.0 + 1e-9}):
        with pytest.raises(RefutedError):
            windy_checked(windy(**sizes))


def test_a_held_state_may_come_first() -> None:
    """The rates are those of the moving states, also behind a held state: K = 0.4 is too little."""
    names = ("slope", "level", "heat")
    model = replace(TANK, states={name: TANK.states[name] for name in names})
    for gain, is_proved in ((2.0, True), (0.4, False)):
        content = tank()
        loop = content["statement"]["loop"]
        loop["model"] = facts(model)
        loop["policy"]["K"] = [[gain, 0.0]]
        with nullcontext() if is_proved else pytest.raises(NoSolutionError, match="near the equil"):
            assert check_region(*read_content(content, Subject(model))) > 0


@pytest.mark.parametrize(
    ("sizes", "name", "ends", "is_proved"),
    [
        ({"wind": 0.1}, "valve", [-1.0, 0.26], True),
        ({"wind": 0.1}, "valve", [-1.0, 0.25], False),
        ({"wind": 0.1}, "valve", [-0.25, 1.0], False),
        ({"wind": 0.5}, "valve", [-1.0, 1.0], False),
        ({"sun": 0.1}, "load", [-0.55, 3.0], True),
        ({"sun": 0.1}, "load", [-0.54, 3.0], False),
        ({"sun": 0.1}, "load", [-3.0, 0.54], False),
    ],
)
def test_claims_hold_near_the_trim(
    sizes: dict[str, float], name: str, ends: list[float], is_proved: bool
) -> None:
    """In level² + heat² <= 0.1, within a third of the trim, each claim is tested for each end of
    the disturbance.

    V' < 0 at the level -0.316 needs a valve above 0.1 + 0.158. The load is at least -0.447 - 0.1. A
    wind of 0.5 needs a level of 1/3.
    """
    content = windy(**sizes)
    content["statement"]["piece"]["c"] = 0.1
    content["statement"]["loop"]["limits"][name] = ends
    with nullcontext() if is_proved else pytest.raises(RefutedError):
        assert windy_checked(content) > 0


def test_limits_hold_under_every_disturbance() -> None:
    """The load 0.9 √2 + sun - wind is within a limit of 1.5 alone, for a sum of sizes of 0.2.

    Of two disturbances, those of opposite signs act most.
    """
    cases = [
        (1.5, {"sun": 0.1, "wind": 0.1}, True),
        (1.45, {"sun": 0.1, "wind": 0.1}, False),
        (1.45, {"sun": 0.2}, False),
    ]
    for limit, sizes, is_proved in cases:
        for ends in ([-limit, 3.0], [-3.0, limit]):
            content = windy(**sizes)
            content["statement"]["loop"]["limits"]["load"] = ends
            if is_proved:
                assert windy_checked(content) > 0
                continue
            with pytest.raises(RefutedError):
                windy_checked(content)


@pytest.mark.parametrize("wind", [0.0, 0.01])
def test_a_set_ends_before_the_faces(wind: float) -> None:
    """A set is refused that extends beyond the cube, although V decreases in all of the cube.

    The set {W <= c} meets the faces for c >= 1.
    """
    content = windy(wind=wind) if wind else tank()
    check = windy_checked if wind else checked
    content["statement"]["extents"] = {"level": [-1.3, 1.3], "heat": [-1.3, 1.3]}
    content["witness"] |= {"multipliers": [[0.5, 0.5]] * 2, "boxes": 2000}
    content["statement"]["piece"]["c"] = 1.0 - 2.0**-10
    assert check(content) > 0
    content["statement"]["piece"]["c"] = 1.01
    with pytest.raises(OpenBoxError, match="undecided"):
        check(content)


def test_an_equilibrium_at_the_edge_is_refused() -> None:
    """The level 2 is another equilibrium: a set is proved that ends before it, and no larger one."""
    content = tank()
    _tall(2.0 * (1.0 - 1e-6))(content)
    assert checked(content) > 0
    _tall(2.0 * (1.0 + 1e-12))(content)
    with pytest.raises(OpenBoxError, match="undecided"):
        checked(content)


def test_limits_beyond_the_envelope_about_the_trim_are_refused() -> None:
    """An envelope of levels from -4 to 3.8 slopes of the trim refuses wider limits, and none."""
    envelope = Domain(envelope=lambda x, p: {"level": (-4.0 * x.slope, 3.8 * x.slope)})
    model = replace(TANK, domain=envelope)
    for limits, is_read in (
        ({"level": [-0.99, 0.94]}, True),
        ({"level": [-1.01, 0.94]}, False),
        ({"level": [-0.99, 0.96]}, False),
        ({}, False),
    ):
        content = tank()
        content["statement"]["loop"]["limits"] |= limits
        if is_read:
            assert check_region(*read_content(content, Subject(model))) > 0
            continue
        with pytest.raises(NoSolutionError, match="level beyond the model's"):
            read_content(content, Subject(model))


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
    content = windy(sun=0.5)
    content["statement"]["loop"]["model"] = facts(model)
    with pytest.raises(BadInputError, match="not affine in sun"):
        windy_checked(content, model)


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


def test_the_hole_has_the_expected_half_width() -> None:
    """The hole around the equilibrium, where the Jacobian proves the decrease of V, ends at 0.25.

    The command contains the sixth power of the level, and the level increases above 0.4, so that the
    decrease outside the hole is refuted.
    """
    content = tank()
    content["statement"]["loop"]["policy"]["terms"] = {"valve": [[146.0, [6, 0]]]}
    statement, witness = read_content(content, Subject(TANK))
    equilibrium = equilibrium_near(statement.loop, np.zeros(2))
    found = _decrease(statement, witness, equilibrium)
    assert found.hole == 2
    with pytest.raises(RefutedError):
        found.proved(2000)


def test_rotated_coordinates_do_not_shrink_the_hole() -> None:
    """In coordinates turned by 45 deg, the hole around the equilibrium still has the half-width
    0.25.

    The valve saturates at a level of 0.5. The corners of the next larger hole exceed this level.
    """
    statement, witness = read_content(tank(), Subject(TANK))
    side = 0.5**0.5
    turned = statement.piece._replace(M=np.array([[side, side], [-side, side]]))
    equilibrium = equilibrium_near(statement.loop, np.zeros(2))
    found = _decrease(statement, witness, equilibrium, turned)
    assert found.hole == 2


@pytest.mark.parametrize(("radius", "k"), [(0.24, 2), (0.26, 3), (0.37, 3), (0.38, 4)])
def test_a_less_accurate_equilibrium_shrinks_the_hole(radius: float, k: int) -> None:
    """The hole |level| <= 2^-k is free of the saturation at the level 0.5 if 2^-k + radius < 0.5."""
    statement, witness = read_content(tank(), Subject(TANK))
    known = Equilibrium(np.zeros(2), np.array([radius, 0.0]))
    assert _decrease(statement, witness, known).hole == k


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
    with (
        nullcontext() if is_proved else pytest.raises(NoSolutionError, match="not proved to exist")
    ):
        check_root(residual, J, [arb(radius) for radius in radii])


def test_the_equilibrium_is_compared_in_nominal_values() -> None:
    """A stated equilibrium with an error of 2e-7 m is refused if the nominal value is 0.01 m.

    The tolerance is 1e-6 nominal values.
    """
    states = {**TANK.states, "level": Signal("m", 0.01)}
    content = tank()
    content["statement"]["equilibrium"]["level"] = 2e-7
    content["statement"]["loop"]["model"]["nominal"][0] = 0.01
    with pytest.raises(NoSolutionError, match="differs from the stated"):
        check_region(*read_content(content, Subject(replace(TANK, states=states))))


@pytest.mark.parametrize("ends", [(-0.9105, 9.0), (-9.0, 0.9105)])
def test_limits_are_proved_about_all_enclosed_equilibria(ends: tuple[float, float]) -> None:
    """Limits 0.9105 from the trim are proved to hold for an exactly known equilibrium.

    For an equilibrium known within 0.001, they are refused.
    """
    content = tank()
    content["statement"]["loop"]["limits"]["level"] = list(ends)
    statement, witness = read_content(content, Subject(TANK))
    _decrease(statement, witness, Equilibrium(np.zeros(2), np.zeros(2))).check_limits()
    about = Equilibrium(np.zeros(2), np.array([0.001, 0.0]))
    with pytest.raises(NoSolutionError, match="level is not proved to stay"):
        _decrease(statement, witness, about).check_limits()


def _put(value: Any, *path: Any) -> Callable[[Content], None]:
    """Return a change that replaces an entry of the statement by a value.

    value: the new value, or a function old value -> new value
    path: keys of the entry
    """

    def change(content: Content) -> None:
        holder: Any = content["statement"]
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = value(holder[path[-1]]) if callable(value) else value

    return change


def _about(level: float) -> Callable[[Content], None]:
    """Return a function that moves the trim of a certificate to another level, with more inflow.

    The valve then saturates on one side.
    """

    def change(content: Content) -> None:
        claim = content["statement"]
        loop = claim["loop"]
        loop["trim"]["level"] = claim["equilibrium"]["level"] = level
        loop["parameters"]["inflow"] = 0.8
        loop["inputs"]["valve"] = -0.8 * level

    return change


def _tall(level: float) -> Callable[[Content], None]:
    """Return a function that states the set level² + 100 heat² <= `level`²."""

    def change(content: Content) -> None:
        c = (0.3 * level) ** 2
        W = [[1.0, [2, 0]], [100.0, [0, 2]]]
        content["statement"]["piece"] |= {"M": [[0.3, 0.0], [0.0, 0.3]], "W": W, "c": c}
        content["statement"]["extents"] = {"level": [-2.1, 2.1], "heat": [-0.3, 0.3]}
        content["witness"]["multipliers"] = [[0.4, 0.4]] * 2

    return change


def _left_out(name: str) -> Callable[[Content], None]:
    return lambda content: content["statement"]["loop"]["limits"].pop(name)


def _witness(**entries: Any) -> Callable[[Content], None]:
    return lambda content: content["witness"].update(entries)


#: Words of a clause that is false at a point, which a proof that runs out of boxes does not say.
FALSE = "does not hold at a point"

#: Name of the forgery -> change of the certificate, and message of the clause that refuses it.
FORGED: dict[str, tuple[Callable[[Content], None], str]] = {
    "equilibrium": (_put(1.1e-6, "equilibrium", "level"), "differs from the stated"),
    "peak in the hole": (_put([-999.0, 0.96], "loop", "limits", "peak"), FALSE),
    "output above its limit": (_put([-3.0, 1.2], "loop", "limits", "load"), FALSE),
    "output below its limit": (_put([-1.2, 3.0], "loop", "limits", "load"), FALSE),
    "held above its limits": (_put({"slope": 1.5}, "loop", "held"), "slope has the constant value"),
    "held below its limits": (
        _put({"slope": -1.5}, "loop", "held"),
        "slope has the constant value",
    ),
    "state above its limit": (
        _put([-9.0, 0.9], "loop", "limits", "level"),
        "level is not proved to stay",
    ),
    "state below its limit": (
        _put([-0.9, 9.0], "loop", "limits", "level"),
        "level is not proved to stay",
    ),
    "extent as far as a limit": (
        _put([-9.0, 0.91], "loop", "limits", "level"),
        "level is not proved to stay",
    ),
    "extent as low as a limit": (
        _put([-0.91, 9.0], "loop", "limits", "level"),
        "level is not proved to stay",
    ),
    "extent above": (_put([-0.91, 0.89], "extents", "level"), FALSE),
    "extent below": (_put([-0.89, 0.91], "extents", "heat"), FALSE),
    "gain of the other sign": (_put([[-2.0, 0.0]], "loop", "policy", "K"), "near the equilibrium"),
    "a gain of nothing": (_put([[0.4, 0.0]], "loop", "policy", "K"), "near the equilibrium"),
    "terms that fill": (_put({"valve": [[9.0, [3, 0]]]}, "loop", "policy", "terms"), FALSE),
    "a valve that cannot open more": (_about(0.5), FALSE),
    "a valve that cannot close more": (_about(-0.5), FALSE),
    "more inflow": (_put({"inflow": 1.2}, "loop", "parameters"), FALSE),
    "a line of equilibria": (_put([[0.5, 0.0]], "loop", "policy", "K"), "Jacobian is singular"),
    "unstable by a hair": (_put([[0.5 - 1e-9, 0.0]], "loop", "policy", "K"), "near the"),
    "W with a second valley": (
        _put([[4.0, [2, 0]], [-16.0, [4, 0]], [16.5, [6, 0]], [1.0, [0, 2]]], "piece", "W"),
        FALSE,
    ),
    "W with a hill": (
        _put([[1.0, [2, 0]], [1.0, [0, 2]], [-0.9, [4, 0]]], "piece", "W"),
        FALSE,
    ),
    "W flat along a line": (
        _put([[1.0, [2, 0]], [-2.0, [1, 1]], [1.0, [0, 2]]], "piece", "W"),
        "near the",
    ),
    "W indefinite by a hair": (
        _put([[1.0, [2, 0]], [-2.0 - 1e-9, [1, 1]], [1.0, [0, 2]]], "piece", "W"),
        "near the",
    ),
    "a monomial twice": (
        _put([[0.5, [2, 0]], [0.5, [2, 0]], [1.0, [0, 2]]], "piece", "W"),
        "statement: piece: W",
    ),
    "a power times a coefficient that is rounded": (
        _put([[1.0, [2, 0]], [1.0, [0, 2]], [0.01, [3, 0]]], "piece", "W"),
        "W 2",
    ),
    "W negative": (_put([[-1.0, [2, 0]], [1.0, [0, 2]]], "piece", "W"), "near the"),
    "coordinates in a line": (
        _put([[1.0, 1.0], [1.0, 1.0]], "piece", "M"),
        "coordinates y = M z is singular",
    ),
    "limits of an output wider": (_put([-4.0, 3.0], "loop", "limits", "load"), "load beyond"),
    "upper limit wider": (_put([-3.0, 4.0], "loop", "limits", "load"), "load beyond"),
    "a negative multiplier": (_witness(multipliers=[[0.55, 0.55], [0.55, -0.55]]), "multipliers"),
    **{
        f"no limits of the {name}": (_left_out(name), f"limits: {name}")
        for name in ("slope", "valve", "load", "peak")
    },
    "all limits left out": (_put({}, "loop", "limits"), "limits: "),
    "no policy": (_put("0" * 64, "loop", "policy"), "a policy in a file; give this file"),
    "another model": (_put("van der Pol", "loop", "model", "dynamics"), "with other equations"),
    "another nominal value": (_put(2.0, "loop", "model", "nominal", 0), "model: nominal"),
    "another unit": (_put("ft", "loop", "model", "state_units", 0), "model: state_units"),
    "another file": (_put("0" * 64, "loop", "model", "equations"), "with other equations"),
    "a whole number that no double equals": (
        _put(2**53 + 1, "loop", "parameters", "inflow"),
        "parameters: inflow",
    ),
    "few boxes": (_witness(boxes=3), "undecided after 3 boxes"),
    "a claim beside the statement": (lambda content: content.update(claim=1.0), "unknown entry"),
    "a claim in the witness": (_witness(claim=1.0), "unknown entry"),
    "a claim about the set": (_put(1.0, "piece", "claim"), "unknown entry"),
    "an extent of no state": (_put([-1.0, 1.0], "extents", "slope"), "unknown entry"),
    "terms of no input": (_put({"pump": [[1.0, [3, 0]]]}, "loop", "policy", "terms"), "unknown"),
    "a fact of the model": (_put("m", "loop", "model", "length_unit"), "unknown entry"),
}


@pytest.mark.parametrize("name", FORGED)
def test_each_clause_refuses_its_forgery(name: str) -> None:
    """Each clause of the checker refuses the forgery that violates it."""
    change, message = FORGED[name]
    made = copy.deepcopy(tank())
    change(made)
    with pytest.raises((NoSolutionError, BadInputError), match=message):
        checked(made)


def test_the_data_of_a_report_bound_the_set() -> None:
    """`rho`, `terms` and `M` give the proved set, from which all flights return.

    V = y_1² + y_2² - y_1⁴ / 4 with y = z / 2 is below rho = 0.7 for levels below 1.902, and again above
    3.52, where the valve no longer drains the tank: it does up to a level of 2.
    """
    content = tank()
    W = [[1.0, [2, 0]], [1.0, [0, 2]], [-0.25, [4, 0]]]
    content["statement"]["piece"] = {"M": [[0.5, 0.0], [0.0, 0.5]], "W": W, "c": 0.7}
    content["statement"]["extents"] = {"level": [-1.95, 1.95], "heat": [-1.95, 1.95]}
    content["witness"]["multipliers"] = [[0.4, 0.4]] * 2
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
    content = tank()
    content["statement"]["extents"] = {"level": [-0.912345, 0.912345], "heat": [-0.95, 0.95]}
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
    write_certificate(path, statement, witness.content(), origin)
    assert read_certificate(path, Subject(TANK)).written == origin
    text = path.read_text()
    assert text.count(before) == 1
    path.write_text(text.replace(before, after))
    with pytest.raises(BadInputError, match="edited"):
        read_certificate(path, Subject(TANK))


NAN = float("nan")
#: Path of an entry, what its message contains, and values that it must not have.
WRONG: list[tuple[tuple[Any, ...], str, list[Any]]] = [
    (("kind",), "kind", ["motion", None, ["region"]]),
    (("statement", "piece", "c"), "piece: c", [0.0, -0.81, NAN, True, "0.81", [0.81], None]),
    (
        ("statement", "piece", "M"),
        "piece: M",
        [[[1.0]], [[1.0, 0.0], [0.0]], [[1.0, 0.0]] * 3, [[1.0, 0.0, 0.0]] * 2, 1.0, [["1", 0.0]]],
    ),
    (("statement", "piece", "W"), "piece: W", [[], {}, None]),
    (
        ("statement", "piece", "W", 0),
        "piece: W 0",
        [[1.0], [1.0, [2, 0], 1.0], {}]
        + [[value, [2, 0]] for value in (True, "1", None, NAN, np.inf, -np.inf, 1.1e300, [1.0])]
        + [[1.0, [2]], [1.0, [2, 0, 0]], [1.0, [3, -1]], [1.0, [2.0, 0]], [1.0, [True, 1]]]
        + [[1.0, [13, 0]], [1.0, [1, 0]], [1.0, [0, 0]], [1.0, "20"], [1.0, None]],
    ),
    (
        ("statement", "extents", "level"),
        "extents",
        [[0.1, 0.91], [-0.91, -0.1], [0.91, -0.91], [-0.91], [-0.91, 0.91, 1.0], None, [NAN, 0.91]],
    ),
    (("statement", "extents"), "extents: heat", [{"level": [-0.91, 0.91]}]),
    (
        ("statement", "equilibrium"),
        "equilibrium",
        [{"level": 0.0}, {"level": 0.0, "heat": 0.0, "slope": 0.0}, {}, [0.0, 0.0]],
    ),
    (
        ("statement", "loop", "limits", "load"),
        "limits: load",
        [[-3.0], [-3.0, 3.0, 3.0], [2.0, -2.0], [1.0, 1.0], None, ["-3", 3.0], [-3.0, NAN]],
    ),
    (("statement", "loop", "limits"), "limits: wind", [{"wind": [-1.0, 1.0]}]),
    (("statement", "loop", "disturbances", "wind"), "wind", [0.0, -0.1, True, NAN, None]),
    (("statement", "loop", "disturbances"), "rain", [{"rain": 0.1}]),
    (("statement", "loop", "parameters"), "parameters", [{}, {"inflow": 0.5, "outflow": 0.5}]),
    (("statement", "loop", "held"), "held", [{}, {"slope": 0.25, "level": 0.0}]),
    (
        ("statement", "loop", "policy", "K"),
        "K",
        [[[2.0]], [[2.0, 0.0]] * 2, [2.0, 0.0], [[NAN, 0.0]], [[True, 0.0]]],
    ),
    (("statement", "loop", "policy"), "policy", [1.0, None, [2.0, 0.0]]),
    (
        ("statement", "loop", "policy", "terms"),
        "terms: valve",
        [{"valve": []}, {"valve": [[1.0, [13, 0]]]}, {"valve": [[1.0, [1, 0]]]}],
    ),
    (("statement", "loop", "model", "nominal", 0), "nominal", [True, 2.0, "1"]),
    *(
        (("statement", "loop", "model", fact), f"model: {fact} ", [value])
        for fact, value in (
            ("states", ["heat", "level"]),
            ("steady", ["level"]),
            ("schedule", "inflow"),
            ("schedule_unit", "m"),
            ("state_units", ["K", "m"]),
            ("input_units", ["ft/s"]),
            ("disturbance_units", ["m/s", "m/s"]),
        )
    ),
    (
        ("witness", "multipliers"),
        "multipliers",
        [[[0.55, 0.55]], [[0.55]] * 2, [[0.55, -0.1]] * 2, [[NAN, 0.55]] * 2],
    ),
    (("witness", "boxes"), "boxes", [True, -1, 1.5, 10**8 + 1, "2000", None]),
]


@pytest.mark.parametrize(("path", "message", "values"), WRONG)
def test_wrong_entries_are_refused(path: tuple[Any, ...], message: str, values: list[Any]) -> None:
    """An entry of another type, shape or range than its own is refused by its name."""
    for value in values:
        made = windy(wind=0.1)
        holder: Any = made
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = value
        with pytest.raises(NoSolutionError, match=f"invalid entry: .*{message}"):
            read_content(made, Subject(WINDY))


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
    content = tank()
    content["statement"]["loop"]["model"] = facts(aircraft()) | {"equations": "0" * 64}
    with pytest.raises(BadInputError, match="give the aircraft file"):
        read_content(content, Subject())


@pytest.mark.parametrize(
    "own",
    [
        {"parameters": {"inflow": 0.6}},
        {"trim": {"level": 0.1, "heat": 0.0}},
        {"inputs": {"valve": 0.1}},
        {"held": {"slope": 0.3}},
        {"limits": {"valve": (-0.5, 0.5)}},
        {"policy": Gain(np.array([[2.1, 0.0]]), {})},
        {"policy": Gain(np.array([[2.0, 0.0]]), {"valve": ((1.0, (2, 0)),)})},
    ],
)
def test_every_entry_of_the_loop_is_compared(own: dict[str, Any]) -> None:
    """A loop of the user that differs in one entry is refused."""
    statement, _ = read_content(tank(), Subject(TANK))
    assert compare(statement, given_plant(statement.loop, "--own", "loop.")) == []
    with pytest.raises(NoSolutionError, match="differs from the value of --own"):
        compare(statement, given_plant(replace(statement.loop, **own), "--own", "loop."))


@pytest.mark.parametrize("off", [1e-5, -1e-5])
def test_a_trim_is_compared_on_both_sides(off: float) -> None:
    """A stated trim above or below the user's is refused."""
    statement, _ = read_content(tank(), Subject(TANK))
    own = {"level": off, "heat": 0.0}
    wide, narrow = (within(dict.fromkeys(own, width)) for width in (2e-5, 1e-6))
    compare(statement, {"loop.trim": Given(own, "--hold", wide)})
    with pytest.raises(NoSolutionError, match="level in the certificate differs"):
        compare(statement, {"loop.trim": Given(own, "--hold", narrow)})


@pytest.mark.parametrize(
    "own", [{}, {"inflow": 0.4}, {"outflow": 0.5}, {"inflow": 0.5, "outflow": 0.5}]
)
def test_entries_of_the_certificate_are_exactly_the_users(own: dict[str, float]) -> None:
    """A certificate with fewer, further or other parameters than the user's is refused."""
    statement, _ = read_content(tank(), Subject(TANK))
    compare(statement, {"loop.parameters": Given({"inflow": 0.5}, "--parameters")})
    with pytest.raises(NoSolutionError, match="differs from the value of --parameters"):
        compare(statement, {"loop.parameters": Given(own, "--parameters")})


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


def test_skewed_coordinates_do_not_shrink_the_hole() -> None:
    """With y = M z, J + J' is definite for |y_i| 33 c < 0.8284, as the Taylor models keep z = M⁻¹ y."""
    M = np.array([[1.0, 32.0], [0.0, 1.0]])
    assert _plane(lambda a, b: (-a, -b + 6.62 * a * b), M).hole <= 9


def test_rates_with_a_jump_are_not_proved_across_it() -> None:
    """The Jacobian of a' = -a + [a > 0.1] is -1 on both sides of the jump."""
    claim = _plane(lambda a, b: (-a + ca.if_else(a > 0.1, 1.0, 0.0), -b), np.eye(2))
    assert claim.hole == 4
