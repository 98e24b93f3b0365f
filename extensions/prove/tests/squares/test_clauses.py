"""One quick forgery for each clause of the checker of regions.

Each forgery is refused with the message of its clause.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flint import arb, arb_series, ctx
from pendulum_regions import read_and_check

from hfa_aircraft.about import Domain
from hfa_aircraft.model import Model, Signal
from hfa_prove.certificate import read_statement
from hfa_prove.check.loop_on_ball import LoopOnBall
from hfa_prove.check.positivity import check_positive
from hfa_prove.check.region_squares import _check_extents, check_parts, extents_of, limits_of
from hfa_prove.enclosure.polynomial import Polynomial, key_of
from hfa_prove.enclosure.series import TaylorOnBall
from hfa_prove.fields import Fields, Malformed, Rejected
from hfa_prove.statements.evidence import Evidence, Square
from hfa_prove.statements.loop import FREE, HIGHEST, LOWEST, Gain, Loop
from hfa_prove.statements.plant import Subject, limits_hold, model_limits
from hfa_prove.statements.region import RegionStatement, _read_parts
from hfa_support.errors import BadInputError

Content = dict[str, Any]


# V' = 0.


def _oscillator(x: Any, u: Any, p: Any, w: Any) -> Any:
    """Equations of the oscillator x' = y, y' = -x, whose trajectories are circles."""
    return {"x": x.y, "y": -x.x}, {}


OSCILLATOR = Model("oscillator", {"x": Signal(), "y": Signal()}, {}, _oscillator, trim={})


def _square(low: int, high: int, diagonal: list[float]) -> Content:
    return {"degrees": [low, high], "gram": np.diag(diagonal).tolist()}


def circle(smallest: float) -> Content:
    """Return a forged certificate. It claims that x² + y² <= 3 converges to 0 for the oscillator.

    smallest: factor in smallest |y|², the multiplier of V <= 3. Its terms of degree 4 are positive.
        Its terms of degree 2 are within the rounding error of V' = 0 in rotated coordinates.
    """
    inside = _square(0, 1, [5e-5, 5e-5, 5e-5]) | {
        "multipliers": {"outside": _square(0, 0, [1.0001])}
    }
    decrease = _square(2, 2, [smallest] * 3) | {
        "multipliers": {"level": _square(1, 1, [smallest] * 2)}
    }
    trim = {"x": 0.0, "y": 0.0}
    loop = Loop(OSCILLATOR, {}, trim, {}, {}, {}, Gain(np.zeros((0, 2))))
    terms = ((1.0, (2, 0)), (1.0, (0, 2)))
    statement = RegionStatement.of_terms(loop, terms, 3.0, {"x": (-2.0, 2.0), "y": (-2.0, 2.0)})
    witness = {
        "prover": "squares",
        "T": [[1.04, -1.39], [1.39, 1.04]],
        "order": 4,
        "inside": inside,
        "parts": [{"inputs": [], "evidence": decrease}],
        "empty": [],
        "extents": {},
    }
    return {"kind": "region", "statement": statement.content(), "witness": witness}


@pytest.mark.parametrize("smallest", [1e-70, 1e-60, 1e-12])
def test_a_coefficient_near_zero_is_not_zero(smallest: float) -> None:
    """A coefficient of V' that is known only within a ball about 0 is not accepted as exactly 0."""
    with pytest.raises(Rejected, match="a term of the polynomial is missing"):
        read_and_check(circle(smallest), OSCILLATOR)


# A sink, by hand: x' = -x, y' = -y, V = x² + y² <= 3.


def _sink(x: Any, u: Any, p: Any, w: Any) -> Any:
    return {"x": -x.x, "y": -x.y, "z": 0.0 * x.z}, {"sum": x.x + x.y}


SINK = Model(
    "sink",
    {"x": Signal(), "y": Signal(), "z": Signal(min=-1.0, max=1.0)},
    {},
    _sink,
    outputs={"sum": Signal()},
    linear=("x", "y"),
    trim={"z": 0.5},
)
SCALE = 1.7322


def _end(side: str) -> Content:
    """Return evidence that 1.735 ± SCALE y_1 > 0 for V <= 3.

    The polynomial is 0.87 (1 - V / 3) plus a square form.

    side: "low" for the plus sign, "high" for the minus sign
    """
    gram = np.diag([1.735 - 0.87, 0.87 * SCALE**2 / 3.0, 0.87 * SCALE**2 / 3.0])
    gram[0, 1] = gram[1, 0] = (SCALE if side == "low" else -SCALE) / 2.0
    return {
        "degrees": [0, 1],
        "gram": gram.tolist(),
        "multipliers": {"level": _square(0, 0, [0.87])},
    }


def sink() -> Content:
    """Return a true certificate of the region x² + y² <= 3."""
    inside = _square(0, 1, [5e-5, 5e-5, 5e-5]) | {
        "multipliers": {"outside": _square(0, 0, [1.0001])}
    }
    decrease = _square(1, 1, [2.0 * SCALE**2 / 3.0] * 2) | {"multipliers": {}}
    limits = {"z": (-1.0, 1.0)}
    loop = Loop(SINK, {}, {"x": 0.0, "y": 0.0}, {}, {"z": 0.5}, limits, Gain(np.zeros((0, 2))))
    terms = ((1.0, (2, 0)), (1.0, (0, 2)))
    ends = {"x": (-1.735, 1.735), "y": (-2.0, 2.0)}
    witness = {
        "prover": "squares",
        "T": [[SCALE, 0.0], [0.0, SCALE]],
        "order": 3,
        "inside": inside,
        "parts": [{"inputs": [], "evidence": decrease}],
        "empty": [],
        "extents": {"x": {"low": _end("low"), "high": _end("high")}},
    }
    statement = RegionStatement.of_terms(loop, terms, 3.0, ends).content()
    return {"kind": "region", "statement": statement, "witness": witness}


def test_the_true_certificate_is_accepted() -> None:
    """The certificate from which the forgeries are made is accepted, with one part."""
    assert read_and_check(sink(), SINK) == 1


def in_coordinates(*factors: float) -> Content:
    """Return the certificate of `sink` with V in y_i = factor_i z_i, for the part with |y_i| < 1.

    factors: powers of 2, so that the coefficients of V are exact
    """
    content = sink()
    piece = content["statement"]["piece"]
    piece["M"] = np.diag(factors).tolist()
    piece["W"] = [
        [value / float(np.prod(np.power(factors, powers))), powers] for value, powers in piece["W"]
    ]
    piece["whole"] = False
    return content


@pytest.mark.parametrize(
    ("factors", "is_in_cube"),
    [((0.5, 0.5), True), ((1.0, 1.0), False), ((0.5, 2.0), False), ((2.0, 0.5), False)],
)
def test_squares_and_boxes_agree_on_one_statement(
    factors: tuple[float, float], is_in_cube: bool
) -> None:
    """The region x² + y² <= 3 in |y_i| < 1, y_i = factor_i z_i, is proved by both kinds of evidence.

    With a larger factor, the set exceeds the cube, and both kinds are refused.
    """
    content = in_coordinates(*factors)
    boxes = {"prover": "boxes", "multipliers": [[0.3, 0.3]] * 2, "boxes": 10_000}
    for witness in (content["witness"], boxes):
        made = copy.deepcopy(content | {"witness": witness})
        if is_in_cube:
            assert read_and_check(made, SINK) > 0
        else:
            with pytest.raises(Rejected):
                read_and_check(made, SINK)


def test_extents_do_not_depend_on_coordinates() -> None:
    """The extents of an ellipsoid are those of z, in whatever coordinates V is stated."""
    found = []
    for content in (sink(), in_coordinates(0.5, 0.5)):
        statement = read_statement("region", content["statement"], Subject(SINK))
        found.append(extents_of(statement, np.eye(2)))
    assert found[0] == found[1]


def _low_by_the_evidence_of_high(content: Content) -> None:
    content["statement"]["extents"]["x"] = [-1.0, 1.735]
    pair = content["witness"]["extents"]["x"]
    pair["low"] = pair["high"]


def _high_by_the_evidence_of_low(content: Content) -> None:
    content["statement"]["extents"]["x"] = [-1.735, 1.0]
    pair = content["witness"]["extents"]["x"]
    pair["high"] = pair["low"]


def _small_ball(content: Content) -> None:
    """Change the certificate to a proof of V' < 0 in a ball that does not contain the set.

    The evidence that V > 0 beyond the ball is true.
    """
    content["witness"]["T"] = [[0.5, 0.0], [0.0, 0.5]]
    content["witness"]["inside"] = _square(0, 1, [0.05, 0.03, 0.03]) | {
        "multipliers": {"outside": _square(0, 0, [0.05])}
    }
    gram = [[0.5 / 3.0, 0.0], [0.0, 0.5 / 3.0]]
    content["witness"]["parts"][0]["evidence"]["gram"] = gram


def _empty_set_claimed(content: Content) -> None:
    """Change the certificate to claim that the set is empty.

    The evidence shows that 1 is positive. It should show that -1 is positive.
    """
    content["witness"]["parts"] = []
    evidence = _square(0, 0, [1.0]) | {"multipliers": {}}
    content["witness"]["empty"] = [{"inputs": [], "evidence": evidence}]


def _put(value: Any, *path: Any) -> Callable[[Content], None]:
    def change(content: Content) -> None:
        holder: Any = content
        for key in path[:-1]:
            holder = holder[key]
        holder[path[-1]] = value

    return change


_INSIDE = ("witness", "inside")

#: Name of the forgery -> change of the certificate, and message of the clause that refuses it.
FORGED: dict[str, tuple[Callable[[Content], None], str]] = {
    "low end": (_low_by_the_evidence_of_high, "x low"),
    "high end": (_high_by_the_evidence_of_low, "x high"),
    "an end without evidence": (
        _put([-1.0, 1.0], "statement", "extents", "y"),
        "may exceed the bounds on y",
    ),
    "ball too small": (_small_ball, "inside"),
    "lower limit of a state": (
        _put([-1.0, 9.0], "statement", "loop", "limits", "x"),
        "x is not proved to stay",
    ),
    "upper limit of a state": (
        _put([-9.0, 1.0], "statement", "loop", "limits", "x"),
        "x is not proved to stay",
    ),
    "held above its limits": (
        _put({"z": 1.5}, "statement", "loop", "held"),
        "z has the constant value",
    ),
    "held below its limits": (
        _put({"z": -1.5}, "statement", "loop", "held"),
        "z has the constant value",
    ),
    "lower limit of an output": (
        _put([-1.0, 9.0], "statement", "loop", "limits", "sum"),
        "sum is not proved to stay",
    ),
    "upper limit of an output": (
        _put([-9.0, 1.0], "statement", "loop", "limits", "sum"),
        "sum is not proved to stay",
    ),
    "another equilibrium": (
        _put({"x": 1e-5, "y": 0.0}, "statement", "equilibrium"),
        "x at the equilibrium differs",
    ),
    "coordinates in a plane": (
        _put([[SCALE, SCALE], [SCALE, SCALE]], "witness", "T"),
        "not proved invertible",
    ),
    "a set said to be empty": (_empty_set_claimed, "empty"),
    "no part": (_put([], "witness", "parts"), "do not cover"),
}


@pytest.mark.parametrize("name", FORGED)
def test_each_clause_refuses_its_forgery(name: str) -> None:
    """Each clause of the checker refuses the forgery that violates it."""
    change, message = FORGED[name]
    made = copy.deepcopy(sink())
    change(made)
    with pytest.raises((Rejected, Malformed), match=message):
        read_and_check(made, SINK)


# Sums of squares of one variable.


def _polynomial(*coefficients: float) -> Polynomial:
    """Return the polynomial c_0 + c_1 y + c_2 y² ... of one variable."""
    return Polynomial([{power: arb(c)} for power, c in enumerate(coefficients)])


def _gram(low: int, high: int, rows: list[list[float]]) -> Square:
    return Square(low, high, np.array(rows))


def test_a_multiplier_that_is_not_positive_is_refused() -> None:
    """A negative multiplier is refused.

    With the multiplier -1, y² - 0.5 = -1 (1 - y²) + 0.5 would be positive for 1 - y² >= 0.
    """
    evidence = Evidence(_gram(0, 0, [[0.5]]), {"ball": _gram(0, 0, [[-1.0]])})
    with pytest.raises(Rejected, match="Gram matrix"):
        check_positive("a test", _polynomial(-0.5, 0.0, 1.0), BALL_OF_ONE, evidence, 1)


def test_the_residual_of_the_identity_is_divided() -> None:
    """The residual of the identity is divided among the Gram entries of the same monomial.

    With the basis (1, y, y²) and the identity as the Gram matrix, 1 + 1.5 y + y² + y⁴ is proved
    positive, and 1 + 2.2 y + y² + y⁴ is not.
    """
    evidence = Evidence(_gram(0, 2, np.eye(3).tolist()), {})
    check_positive("a test", _polynomial(1.0, 1.5, 1.0, 0.0, 1.0), {}, evidence, 1)
    with pytest.raises(Rejected, match="not proved positive"):
        check_positive("a test", _polynomial(1.0, 2.2, 1.0, 0.0, 1.0), {}, evidence, 1)


BALL_OF_ONE = {"ball": _polynomial(1.0, 0.0, -1.0)}


def test_omitted_terms_reduce_the_lower_bound() -> None:
    """The lower bound of degree 2 of a function is reduced by the omitted terms and the remainder.

    Their norms are subtracted. The function is y² - 3 y⁴ with the remainder 2 |y|⁵.
    """
    taylor = TaylorOnBall(4, _polynomial(0.0, 0.0, 1.0, 0.0, -3.0), arb(2))
    (_, _, square) = taylor.lowest(1, 2).parts
    assert square[2] <= 1.0 - 3.0 - 2.0


# The loop.


def _driven(x: Any, u: Any, p: Any, w: Any) -> Any:
    """Equations x' = x - u + w, with an output that exceeds its limit only at w near 0."""
    return {"x": x.x - u.u + w.w}, {"bump": 0.1 * x.x + 1.0 - w.w**2}


DRIVEN = Model(
    "driven",
    {"x": Signal()},
    {"u": Signal(min=-1.0, max=1.0)},
    _driven,
    disturbances={"w": Signal()},
    outputs={"bump": Signal(max=0.5)},
    trim={},
)


def _loop(K: float = 2.0, u: float = 0.0, sizes: dict[str, float] | None = None) -> Loop:
    limits = {"u": (-1.0, 1.0), "bump": (-9.0, 0.5)}
    at = {"x": u}
    return Loop(DRIVEN, {}, at, {"u": u}, {}, limits, Gain(np.array([[-K]])), sizes or {})


def _on_unit_ball(loop: Loop) -> LoopOnBall:
    """Return a loop with one state in the coordinate y = z, with V = z²."""
    statement = RegionStatement.of_terms(loop, ((1.0, (2,)),), 1.0, {})
    return LoopOnBall(statement, np.array([[1.0]]), 3)


#: Policy 2 x + 0.5 x².
CURVED = Gain(np.array([[-2.0]]), {"u": ((0.5, (2,)),)})


def test_an_equilibrium_at_an_input_limit_is_refused() -> None:
    """An equilibrium with an input at its lower or upper limit is refused."""
    for u in (-1.0, 1.0):
        with pytest.raises(Rejected, match="no equilibrium is enclosed"):
            _on_unit_ball(_loop(u=u))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_equilibrium_with_a_saturated_input_is_refused(side: float) -> None:
    """x' = x - u with u = ±1 at the limit rests at x = ±1, beyond which the command is ±1.5."""
    loop = replace(_loop(K=0.5, u=side), trim={"x": 2.0 * side}, inputs={"u": 2.0 * side})
    terms = ((1.0, (2,)),)
    statement = RegionStatement.of_terms(loop, terms, 1.0, {"x": (-1.0, 1.0)})
    statement = replace(statement, equilibrium={"x": side})
    with pytest.raises(Rejected, match="u is not proved to be within its limits"):
        LoopOnBall(statement, np.array([[1.0]]), 3)


def test_equilibria_that_are_not_isolated_are_refused() -> None:
    """x' = x - u with u = x is refused, because every x is an equilibrium."""
    with pytest.raises((Rejected, ZeroDivisionError)):
        _on_unit_ball(_loop(K=1.0))


@pytest.mark.parametrize(
    ("ends", "reached"), [((-0.1, 9.0), (True, False)), ((-9.0, 2.25), (False, True))]
)
def test_each_input_limit_is_decided_separately(
    ends: tuple[float, float], reached: tuple[bool, bool]
) -> None:
    """Whether an input can reach its limit is decided for the lower and upper limit separately.

    u = 2 x + 0.5 x² changes by up to 2.5 in the ball.
    """
    loop = replace(_loop(), limits={"u": ends}, policy=CURVED)
    region = _on_unit_ball(loop)
    assert region.reaches("u") == reached


@pytest.mark.parametrize("ends", [(-0.1, 9.0), (-9.0, 2.25)])
def test_each_reached_limit_needs_a_part(ends: tuple[float, float]) -> None:
    """Parts with a free input alone are refused if the input may reach one of its limits."""
    region = _on_unit_ball(replace(_loop(), limits={"u": ends}, policy=CURVED))
    with pytest.raises(Rejected, match="do not cover"):
        check_parts(region, [{"u": FREE}])


def test_policies_act_on_deviations_from_the_trim() -> None:
    """A policy acts on deviations from the trim, not from the equilibrium.

    At the equilibrium 2e-7, u = 2 z + 0.5 z² with z = x - 1e-7 has a slope above 2.
    """
    loop = replace(_loop(), trim={"x": 1e-7}, policy=CURVED, limits={})
    region = _on_unit_ball(loop)
    (slope,) = region.command("u").parts[1].values()
    assert slope > 2


@pytest.mark.parametrize("size", [0.0, -0.1])
def test_a_disturbance_without_positive_size_is_refused(size: float) -> None:
    """A disturbance whose size is not positive is refused.

    Under a negative size every set would be invariant.
    """
    extents = {"x": (-1.0, 1.0)}
    statement = RegionStatement.of_terms(_loop(sizes={"w": 1.0}), ((1.0, (2,)),), 1.0, extents)
    stated = statement.content()
    assert read_statement("region", stated, Subject(DRIVEN)).loop.disturbances == {"w": 1.0}
    with pytest.raises(Malformed, match="disturbances: w"):
        read_statement(
            "region",
            stated | {"loop": stated["loop"] | {"disturbances": {"w": size}}},
            Subject(DRIVEN),
        )


def test_disturbances_inside_their_range_are_refused() -> None:
    """A part of a proof is accepted if its disturbance is at an end of the range.

    A part whose disturbance is free is refused.
    """
    statement = RegionStatement.of_terms(_loop(sizes={"w": 1.0}), ((1.0, (2,)),), 1.0, {})
    evidence = _square(1, 1, [1.0]) | {"multipliers": {}}
    for done, is_valid in ((["free", "low"], True), (["low", "free"], False)):
        entries = Fields("witness", {"parts": [{"inputs": done, "evidence": evidence}]})
        refused = pytest.raises(Malformed, match=r"invalid entry: .*inputs")
        with nullcontext() if is_valid else refused:
            _read_parts(entries, "parts", statement, ("free", LOWEST, HIGHEST))


def test_outputs_are_checked_between_ends_of_disturbances() -> None:
    """An output that exceeds its limit only between the ends of the disturbance is refused."""
    loop = _on_unit_ball(_loop(sizes={"w": 1.0}))
    with pytest.raises(Rejected, match="bump is not proved to stay"):
        loop.rates({"u": "free", "w": HIGHEST})


def test_a_saturated_rate_keeps_its_center() -> None:
    """If the input u is at its limit, the rate x' at y = 0 is not 0, and the checker retains it."""
    loop = replace(_loop(), limits={"u": (-1.0, 1.0)})
    ball = _on_unit_ball(loop)
    for side, rate in ((LOWEST, 1.0), (HIGHEST, -1.0)):
        assert ball.rates({"u": side})[0].center.contains(arb(rate))
    assert ball.rates({"u": "free"})[0].center == 0


def test_rates_not_affine_in_disturbance_are_refused() -> None:
    """Rates that are not affine in the disturbance are refused.

    For such rates, the worst case may be between the ends of the disturbance's range.
    """

    def curved(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"x": -x.x + 1.0 - w.w**2}, {}

    model = Model("curved", {"x": Signal()}, {}, curved, disturbances={"w": Signal()}, trim={})
    loop = Loop(model, {}, {"x": 1.0}, {}, {}, {}, Gain(np.zeros((0, 1))), {"w": 1.0})
    with pytest.raises(BadInputError, match="not affine in w"):
        _on_unit_ball(loop)


@pytest.mark.parametrize("stated", [(-2.0, 2.0), (-1.0, 3.0)])
def test_stated_limits_may_be_narrower(stated: tuple[float, float]) -> None:
    """Limits in a statement may be narrower than those of the model.

    The name of a wider limit is returned.
    """
    own = {"x": (-1.0, 2.0)}
    assert limits_hold({"x": (-0.5, 1.5)}, own, ()) is None
    assert limits_hold({"x": stated}, own, ()) == "x"


def test_an_envelope_limits_states_about_the_trim() -> None:
    """The limits of a model with an envelope are those of the envelope at the trim."""
    domain = Domain(envelope=lambda x, p: {"x": (x.x - 0.5, x.x + 0.5)})
    own = model_limits(replace(DRIVEN, domain=domain), {"x": 2.0}, {})
    assert own["x"] == (1.5, 2.5)
    assert limits_hold({"x": (1.5, 2.6)}, own, ()) == "x"


def test_quartic_extents_are_at_most_the_balls() -> None:
    """The extents of a quartic set are the stated extents, or those of the ball if smaller.

    The ball has radius 2.
    """
    loop = read_statement("region", sink()["statement"], Subject(SINK)).loop
    terms = ((1.0, (4, 0)), (1.0, (0, 2)))
    statement = RegionStatement.of_terms(loop, terms, 3.0, {"x": (-1.5, 9.0), "y": (-9.0, 1.5)})
    found = extents_of(statement, 2.0 * np.eye(2))
    assert found == {"x": (-1.5, pytest.approx(2.0)), "y": (pytest.approx(-2.0), 1.5)}


def test_extents_of_an_ellipsoid_are_rounded_outward() -> None:
    """Extents of an ellipsoid are rounded outward: the extent sqrt(3) is not rounded down."""
    statement = read_statement("region", sink()["statement"], Subject(SINK))
    low, high = extents_of(statement, np.eye(2))["x"]
    assert Fraction(high) ** 2 > 3
    assert Fraction(low) ** 2 > 3


def test_an_irrational_equilibrium_is_enclosed() -> None:
    """The equilibrium sqrt(2) of x' = 2 - x² is enclosed, although 192 bits cannot represent it."""
    model = Model("root", {"x": Signal()}, {}, lambda x, u, p, w: ({"x": 2.0 - x.x**2}, {}))
    loop = Loop(model, {}, {"x": 2.0**0.5}, {}, {}, {}, Gain(np.zeros((0, 1))))
    (found,) = _on_unit_ball(loop).x
    with ctx.workprec(400):
        assert found.contains(arb(2).sqrt())


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("extent", [0.6, 0.7])
def test_state_limits_are_checked_about_the_equilibrium(extent: float, sign: float) -> None:
    """State limits are checked about the equilibrium, not about 0.

    A state at ±0.35 that deviates by 0.7 exceeds the limit ±1.
    """
    ends = sorted((-0.5 * sign, extent * sign))
    claim = SimpleNamespace(
        extents={"x": ends}, loop=SimpleNamespace(limits={"x": (-1.0, 1.0)}, held={})
    )
    loop = SimpleNamespace(statement=claim, x=[arb(0.35 * sign)], reach=lambda index: arb(0.5))
    if extent > 0.65:
        with pytest.raises(Rejected, match="x is not proved to stay within its limits"):
            _check_extents(loop, {}, {})
    else:
        _check_extents(loop, {}, {})


# A loop of two states in turned coordinates, compared with formulas in doubles.


def _glider(x: Any, u: Any, p: Any, w: Any) -> Any:
    """Equations of a model with two states, one input and one disturbance."""
    rates = {
        "a": -x.a + 0.5 * x.b * x.b + 0.3 * u.u,
        "b": x.a - 0.4 * x.b + u.u + 0.2 * x.a * u.u + w.w,
    }
    return rates, {}


GLIDER = Model(
    "glider",
    {"a": Signal(), "b": Signal()},
    {"u": Signal(min=-0.3, max=0.5)},
    _glider,
    disturbances={"w": Signal()},
    trim={},
)
GLIDER_T = np.array([[0.8, -0.5], [0.4, 0.9]])


def _glider_loop(M: np.ndarray | None = None) -> LoopOnBall:
    """Return the loop of the glider with V in the coordinates M z, z by default."""
    loop = Loop(
        GLIDER,
        {},
        {"a": 0.0, "b": 0.0},
        {"u": 0.0},
        {},
        {"u": (-0.3, 0.5)},
        Gain(np.array([[0.2, 0.6]]), {"u": ((0.1, (2, 0)), (-0.3, (1, 2)))}),
        {"w": 0.05},
    )
    terms = ((1.0, (2, 0)), (0.4, (1, 1)), (1.5, (0, 2)), (0.2, (3, 1)))
    statement = RegionStatement.of_terms(loop, terms, 2.0, {})
    if M is not None:
        statement = replace(statement, piece=statement.piece._replace(M=M))
    return LoopOnBall(statement, GLIDER_T, 5)


def _commanded(z: np.ndarray) -> np.ndarray:
    a, b = z.T
    return -0.2 * a - 0.6 * b + 0.1 * a**2 - 0.3 * a * b**2


def _values(polynomial: Polynomial, y: np.ndarray) -> np.ndarray:
    """Return the values of a polynomial at points y (N, 2), in doubles."""
    total = np.zeros(len(y))
    for key, _, coefficient in polynomial.terms():
        total += float(coefficient) * y[:, 0] ** (key & 255) * y[:, 1] ** (key >> 8)
    return total


def _ball_points() -> np.ndarray:
    y = np.random.default_rng(4).uniform(-1.0, 1.0, (400, 2))
    return y[np.linalg.norm(y, axis=1) < 1.0]


@pytest.mark.parametrize("M", [np.eye(2), np.array([[1.0, 0.5], [-0.25, 0.75]])])
@pytest.mark.parametrize("side", [LOWEST, HIGHEST])
@pytest.mark.parametrize("what", ["free", LOWEST, HIGHEST])
def test_the_bound_of_decrease_is_below_samples(what: str, side: str, M: np.ndarray) -> None:
    """The lower bound of -V' / rho is below the value by formulas at random points of the ball.

    For degree 6, the difference near the center is below 1e-3.
    """
    y = _ball_points()
    z = y @ GLIDER_T.T
    a, b = z.T
    u = {"free": _commanded(z), LOWEST: -0.3, HIGHEST: 0.5}[what]
    w = -0.05 if side == LOWEST else 0.05
    da = -a + 0.5 * b**2 + 0.3 * u
    db = a - 0.4 * b + u + 0.2 * a * u + w
    p, q = M @ z.T
    slope_a, slope_b = M.T @ [2.0 * p + 0.4 * q + 0.6 * p**2 * q, 0.4 * p + 3.0 * q + 0.2 * p**3]
    decrease = -(slope_a * da + slope_b * db) / 2.0
    found = _glider_loop(M).decrease({"u": what, "w": side})
    for degree in (2, 4, 6):
        away = decrease - _values(found.lowest(2, degree), y)
        assert np.all(away >= -1e-12)
    near = np.linalg.norm(y, axis=1) < 0.3
    assert np.all(away[near] < 1e-3)


def test_the_extent_of_ball_is_the_row_length() -> None:
    """The largest deviation z_i in the unit ball of y is the length of row i of T, for z = T y."""
    loop = _glider_loop()
    for index, length in enumerate(np.linalg.norm(GLIDER_T, axis=1)):
        assert float(loop.reach(index)) == pytest.approx(length, rel=1e-14)


def test_constraints_of_parts_describe_the_input() -> None:
    """The constraints of a part of a proof hold exactly where the input is free or saturated as
    stated.
    """
    y = _ball_points()
    command = _commanded(y @ GLIDER_T.T)
    loop = _glider_loop()
    stated = {"free": (command > -0.3) & (command < 0.5), LOWEST: command <= -0.3}
    stated[HIGHEST] = command >= 0.5
    for what, expected in stated.items():
        constraints = limits_of(loop, {"u": what})
        holds = np.all([_values(each, y) >= 0.0 for each in constraints.values()], axis=0)
        assert np.array_equal(holds, expected)
        assert expected.any()


@pytest.mark.parametrize("missing", range(6))
def test_a_missing_part_is_refused(missing: int) -> None:
    """Without one of the parts, the claim is refused."""
    loop = _glider_loop()
    parts = [{"u": u, "w": w} for u in ("free", LOWEST, HIGHEST) for w in (LOWEST, HIGHEST)]
    check_parts(loop, parts)
    with pytest.raises(Rejected, match="do not cover"):
        check_parts(loop, [part for i, part in enumerate(parts) if i != missing])


def test_the_remainders_of_a_product_multiply() -> None:
    """The remainder of a product of enclosures includes the product of their remainders.

    Each factor is known only to be within |y|² of 0.
    """
    unknown = TaylorOnBall(1, Polynomial([{}]), arb(1))
    assert (unknown * unknown).remainder >= 1
    assert (unknown * -2).remainder >= 2


def test_a_function_of_a_remainder_has_a_remainder() -> None:
    """The remainder of a function includes the effect of the remainder of its argument.

    The exponential of a value within |y|² of 0 reaches e at |y| = 1.
    """
    unknown = TaylorOnBall(1, Polynomial([{}]), arb(1))
    found = unknown.through(arb_series.exp)
    assert found.center + found.remainder >= arb(1).exp()


@pytest.mark.parametrize(("power", "largest"), [(1, 0.5), (2, 0.25), (3, 0.125)])
def test_norms_of_products_exceed_their_largest_values(power: int, largest: float) -> None:
    """The norm of (y_1 y_2)^k is at least its largest value 2^-k on the unit circle."""
    parts: list[dict[int, arb]] = [{} for _ in range(2 * power)]
    product = Polynomial([*parts, {key_of((power, power)): arb(1)}])
    assert product.norms()[2 * power] >= largest
