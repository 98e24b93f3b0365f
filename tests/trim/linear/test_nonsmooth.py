"""A and B at a nonsmooth point of the equations.

A nonsmooth point is the knot of a table, |x|, sign, min, max or a comparison.
"""

from pathlib import Path

import casadi as ca
import pytest
from cli import hfa

from hfa import Model, Signal, TrimCondition, linearize, sweep, trim
from hfa.paper import level_flight
from trim import usual_condition

TABLE = ca.interpolant("table", "linear", [[-1.0, 0.0, 1.0]], [1.0, 0.0, 3.0])
_SYMBOL = ca.SX.sym("x")
CALLED = ca.Function("called", [_SYMBOL], [ca.fabs(_SYMBOL)], {"never_inline": True})
#: Force over position with its slopes below and above x = 0.
FORCES = {
    "interpolant": (TABLE, -1.0, 3.0),
    "pw_lin": (lambda x: ca.pw_lin(x, [-1.0, 0.0, 1.0], [1.0, 0.0, 3.0]), -1.0, 3.0),
    "function that is called": (CALLED, -1.0, 1.0),
    "if_else": (lambda x: ca.if_else(x > 0, 3 * x, x), 1.0, 3.0),
    # CasADi's derivative is 0 at 0.
    "sign": (lambda x: 35 * ca.sign(x) * ca.fabs(x), 35.0, 35.0),
}


def cart(force):
    return Model(
        name="cart",
        equations=lambda x, u, p, w: ({"x": x.v, "v": u.u + force(x.x)}, {}),
        states={"x": Signal(start=0.5), "v": Signal()},
        inputs={"u": Signal()},
        trim={"x": 0.0},
    )


def at(model, x):
    return linearize(model, trim(model, usual_condition(model).at(hold={"x": x})))


@pytest.mark.parametrize("name", FORCES)
def test_a_kink_has_the_mean_slope_of_both_sides(name):
    """At a nonsmooth point, A has the mean slope of both sides, as a central difference, and a note names both."""
    force, below, above = FORCES[name]
    model = at(cart(force), 0.0)
    assert model.A[1, 0] == pytest.approx((below + above) / 2.0, abs=1e-12)
    (note,) = model.nonsmooth_points
    assert note.startswith(
        f"nonsmooth point: A(v, x) is {below:.5g} below and {above:.5g} above the trim"
    )
    assert note in model.report().notes
    away = at(cart(force), 0.3)
    assert (away.A[1, 0], away.nonsmooth_points) == (pytest.approx(above, abs=1e-12), ())


def test_a_jump_is_named_and_keeps_its_slope():
    """A note names a jump of the equations, such as dry friction. A contains the slope without
    the jump.
    """
    for jump in (1.0, -1.0):
        model = at(cart(lambda x, jump=jump: jump * ca.sign(x) + 2 * x), 0.0)
        assert model.A[1, 0] == 2.0
        assert model.nonsmooth_points == (
            "jump: the rate of v jumps as x passes its value; A(v, x) is 2, without the jump",
        )


NONSMOOTH = 9


def swept():
    return sweep(cart(TABLE), {"x": [-0.5, *[0.0] * NONSMOOTH, 0.5]})


def test_each_point_of_a_sweep_has_the_slopes_of_its_own_nonsmooth_points():
    """A sweep has one slope at each nonsmooth point, and its note names the first and counts all."""
    result = swept()
    assert result.A[:, 1, 0] == pytest.approx([-1.0, *[1.0] * NONSMOOTH, 3.0], abs=1e-8)
    assert list(result.nonsmooth_points) == list(range(1, NONSMOOTH + 1))
    (note,) = result.report().notes
    assert note.endswith("(9 of 11 points, the first at 0)")


def test_kinks_of_a_sweep_in_chunks_are_those_of_its_points(monkeypatch):
    whole = swept()
    monkeypatch.setattr("trim.sweeps.sweep.CHUNK", 4)
    assert swept() == whole


def test_several_kinks_at_one_point_have_their_own_slopes():
    """Each term of v' = table(x) + max(v - 1/2, 5 (v - 1/2)) + min(u, 2 u) has its mean slope.

    A note names each nonsmooth point.
    """

    def equations(x, u, p, w):
        lag = x.v - 0.5
        force = TABLE(x.x) + ca.fmax(lag, 5.0 * lag) + ca.fmin(u.u, 2.0 * u.u)
        return {"x": x.v, "v": force}, {}

    states = {"x": Signal(nominal=20.0), "v": Signal(nominal=0.3)}
    model = Model("switched", states, {"u": Signal(nominal=7.0)}, equations, trim={"x": 0.0})
    rates = {"x": 0.5, "v": 0.0}
    condition = TrimCondition(model, {"x": 0.0, "v": 0.5}, rates)
    (point,) = sweep(model, {"x": [0.0]}, condition=condition)
    assert [list(point.A[1]), list(point.B[1])] == [
        pytest.approx([1.0, 3.0], abs=1e-9),  # means of -1 and 3, and of 1 and 5
        pytest.approx([1.5], abs=1e-9),  # of 1 and 2
    ]
    assert [note.split()[2] for note in point.nonsmooth_points] == ["A(v,", "A(v,", "B(v,"]


def test_the_kink_of_the_atmosphere_is_reported(published_aircraft):
    """A model of the flexible aircraft has a nonsmooth point at 11 km, where the temperature stops falling.

    At 40,000 ft the model has no nonsmooth point.
    """
    tropopause = 11_000.0 / (1 - 11_000.0 / 6_356_766.0) / 0.3048  # ft
    nonsmooth_points = []
    for altitude in (tropopause, 40_000.0):
        point = trim(published_aircraft, level_flight(0.1, altitude=altitude))
        nonsmooth_points.append(linearize(published_aircraft, point, full=True).nonsmooth_points)
    assert "A(speed, altitude)" in " ".join(nonsmooth_points[0])
    assert nonsmooth_points[1] == ()


SOURCE = """
import casadi as ca
from hfa import Model, Signal

TABLE = ca.interpolant("table", "linear", [[-1.0, 0.0, 1.0]], [1.0, 0.0, 3.0])
CART = Model(
    name="cart",
    equations=lambda x, u, p, w: ({"x": x.v, "v": u.u + FORCE(x.x)}, {}),
    states={"x": Signal(min=-1, max=1), "v": Signal(min=-5, max=5)},
    inputs={"u": Signal(min=-9, max=9)},
    trim={"x": 0.0},
)
"""


@pytest.mark.parametrize(
    "command",
    [
        "linearize",
        "solve --Q 1,1 --R 1 --delta inf",
        "export --Q 1,1 --R 1 --delta inf -o folder",
    ],
)
def test_every_command_names_a_kink(command, tmp_path, monkeypatch):
    """Every command that uses a linear model, or a gain from one, names the nonsmooth point of the model once."""
    monkeypatch.chdir(tmp_path)
    source = SOURCE.replace("FORCE", "(lambda x: ca.pw_lin(x, [-1.0, 0.0, 1.0], [1.0, 0.0, 3.0]))")
    Path("cart.py").write_text(source, "utf-8")
    name, *options = command.split()
    done = hfa(name, "--aircraft", "cart.py:CART", *options)
    assert (done.out + done.err).count(
        "nonsmooth point: A(v, x) is -1 below and 3 above the trim"
    ) == 1
