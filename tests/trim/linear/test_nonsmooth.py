"""A and B at a nonsmooth point of the equations.

A nonsmooth point is the knot of a table, |x|, sign, min, max or a comparison.
"""

import math
from pathlib import Path

import casadi as ca
import pytest
from cli import hfa

from hfa import Model, Signal, linearize, sweep, trim
from trim import usual_condition

TABLE = ca.interpolant("table", "linear", [[-1.0, 0.0, 1.0]], [1.0, 0.0, 3.0])
_SYMBOL = ca.SX.sym("x")
CALLED = ca.Function("called", [_SYMBOL], [ca.fabs(_SYMBOL)], {"never_inline": True})
#: Force over position with its slopes below and above x = 0.
FORCES = {
    "interpolant": (TABLE, -1.0, 3.0),
    "pw_lin": (lambda x: ca.pw_lin(x, [-1.0, 0.0, 1.0], [1.0, 0.0, 3.0]), -1.0, 3.0),
    "function that is called": (CALLED, -1.0, 1.0),
    "curved": (lambda x: ca.fabs(x) + 40.0 * x**2 * (0.45 - x), -1.0, 1.0),
    "if_else": (lambda x: ca.if_else(x > 0, 3 * x, x), 1.0, 3.0),
    "second order": (lambda x: ca.if_else(x**2 > 0, 3 * x, x), 3.0, 3.0),
    # CasADi's derivative is 0 at 0.
    "sign": (lambda x: 35 * ca.sign(x) * ca.fabs(x), 35.0, 35.0),
}


def cart(force):
    """Return x' = v, v' = u + force(x): A[1, 0] is the slope of the force."""
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
def test_a_nonsmooth_point_has_the_mean_slope_of_both_sides(name):
    """At x = 0, A has the mean slope of both sides, and a note names both; at x = 0.3, it has the slope
    above, without a note.
    """
    force, below, above = FORCES[name]
    model = at(cart(force), 0.0)
    assert model.A[1, 0] == pytest.approx((below + above) / 2.0, abs=1e-8)
    (note,) = model.nonsmooth_points
    assert note.startswith(
        f"nonsmooth point: A(v, x) is {below:.5g} below and {above:.5g} above the trim"
    )
    assert note in model.report().notes
    away = at(cart(force), 0.3)
    assert (away.A[1, 0], away.nonsmooth_points) == (pytest.approx(above, abs=1e-12), ())


def test_a_curved_force_is_smooth():
    """The force sin 30 x, beside a call whose inside is not visible, has its slope and no note."""
    model = at(cart(lambda x: CALLED(x - 9.0) + ca.sin(30.0 * x)), 0.05)
    assert model.A[1, 0] == pytest.approx(30.0 * math.cos(1.5) - 1.0, abs=1e-9)
    assert model.nonsmooth_points == ()


def test_a_nonsmooth_input_is_an_entry_of_B():
    """v' = |u| - v has the slopes -1 and 1 by u at u = 0, where the note names B."""
    states, inputs = {"v": Signal()}, {"u": Signal()}
    valve = Model(
        "valve", states, inputs, lambda x, u, p, w: ({"v": ca.fabs(u.u) - x.v}, {}), trim={"u": 0.0}
    )
    linear = linearize(valve, trim(valve))
    (note,) = linear.nonsmooth_points
    assert note.startswith("nonsmooth point: B(v, u) is -1 below and 1 above the trim")
    assert (linear.A[0, 0], linear.B[0, 0]) == (-1.0, 0.0)


def test_a_jump_is_named_and_keeps_its_slope():
    """A note names the jump of ± sign(x) + 2 x at 0, and A contains the slope 2 without the jump."""
    for jump in (1.0, -1.0):
        model = at(cart(lambda x, jump=jump: jump * ca.sign(x) + 2 * x), 0.0)
        assert model.A[1, 0] == 2.0
        assert model.nonsmooth_points == (
            "jump: the rate of v jumps as x passes its value; A(v, x) is 2, without the jump",
        )


NONSMOOTH = 9


def swept():
    return sweep(cart(TABLE), {"x": [-0.5, *[0.0] * NONSMOOTH, 0.5]})


def test_each_point_of_a_sweep_has_its_own_slope():
    """The slope is -1 below x = 0, 3 above, and the mean 1 at each of the 9 points at 0; the note names
    the first of these and counts all.
    """
    result = swept()
    assert result.A[:, 1, 0] == pytest.approx([-1.0, *[1.0] * NONSMOOTH, 3.0], abs=1e-8)
    assert list(result.nonsmooth_points) == list(range(1, NONSMOOTH + 1))
    (note,) = result.report().notes
    assert note.endswith("(9 of 11 points, the first at 0)")


SOURCE = """
import casadi as ca
from hfa import Model, Signal

def equations(x, u, p, w):
    return {"x": x.v, "v": u.u + ca.pw_lin(x.x, [-1.0, 0.0, 1.0], [1.0, 0.0, 3.0])}, {}

CART = Model(
    name="cart",
    equations=equations,
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
def test_every_command_names_a_nonsmooth_point_once(command, tmp_path, monkeypatch):
    """Commands that use a linear model, or a gain from one, name its nonsmooth point in one line."""
    monkeypatch.chdir(tmp_path)
    Path("cart.py").write_text(SOURCE, "utf-8")
    name, *options = command.split()
    done = hfa(name, "--aircraft", "cart.py:CART", *options)
    assert (done.out + done.err).count(
        "nonsmooth point: A(v, x) is -1 below and 3 above the trim"
    ) == 1
