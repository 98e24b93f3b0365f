"""Faulty declarations of a model, which are refused with a message of one line."""

import math

import casadi as ca
import numpy as np
import pytest
from cli import refused

from hfa import BadInputError, Model, Signal, trim
from hfa.extend import Domain


def cart(**declared):
    """Return the cart x' = v, v' = force with the output position = x.

    declared: arguments of `Model` that replace the usual ones
    """

    def equations(x, u, p, w):
        return {"x": x.v, "v": u.force}, {"position": x.x}

    settings = {
        "name": "cart",
        "states": {"x": Signal("m"), "v": Signal("m/s")},
        "inputs": {"force": Signal("N")},
        "equations": equations,
        "outputs": {"position": Signal("m")},
    }
    return Model(**(settings | declared))


@pytest.mark.parametrize(
    ("declared", "message"),
    [
        ({"inputs": {"lambda": Signal()}}, "'lambda' in inputs is not an identifier"),
        ({"inputs": {"x": Signal()}}, "x is declared twice"),
        ({"modes": {"slow": ("x", "w")}}, "modes names the unknown state 'w'"),
        ({"modes": {"slow": "x"}}, "modes 'slow' is 'x'; give a tuple of names"),
        ({"replaced": {"x": ()}}, r"replaced names the unknown output \(\); choose from position"),
        ({"schedule": "position"}, "schedule is the unknown variable 'position'"),
        ({"trim": {"x": "0"}}, "trim imposes x = 0; give a finite number"),
        ({"trim": {"height": 1.0}}, "trim imposes the unknown variable 'height'"),
        ({"states": {"x": Signal(nominal=-1.0)}}, "nominal and rate positive"),
        ({"states": {"x": Signal(start=math.inf)}}, "nominal, rate, start are"),
        ({"states": {"x": Signal(min=2.0, max=1.0)}}, "min 2 is above max 1"),
        ({"states": {"x": Signal(min=1j)}}, r"min, max is \(1j, inf\); give two numbers"),
        ({"outputs": {"position": 1.0}}, "position is 1.0; give a Signal"),
        ({"states": {}}, "cart declares no states"),
        ({"linear": "x"}, "linear is of type str; give a list of texts"),
        ({"states": {"x": Signal(3)}}, "x: the unit is 3; give the unit as text"),
        ({"domain": None}, "Model: domain is of type NoneType; give a Domain"),
        ({"domain": Domain({"x": (0.0, 1.0)})}, r"range of x is .*; give \(lowest, highest, so"),
        ({"domain": Domain({"q": (0.0, 1.0, "")})}, "domain.range names the unknown signal 'q'"),
        ({"states": {"x": Signal(full="20")}}, "x: full is .*; give an angle of at least 0"),
    ],
)
def test_wrong_declarations_are_refused(declared, message):
    """Each faulty declaration is refused with a message that names the fault."""
    with pytest.raises(BadInputError, match=message):
        cart(**declared)


STRAY = ca.SX.sym("stray")
#: Words of the message -> faulty equations of the cart: a function of x and u that returns the rate
#: of v, or (rates, outputs).
EQUATIONS = {
    "the equations return no rate of v": lambda x, u: ({"x": x.v}, {"position": x.x}),
    "undeclared rate of 'q'; choose from x, v": lambda x, u: ({"x": x.v, "v": u.force, "q": 0}, {}),
    "undeclared name of inputs, 'gas'; choose from force": lambda x, u: u.gas,
    "the rate of v is not a number at 0 m x, ": lambda x, u: u.force + ca.sqrt(x.x - 1),
    "use CasADi's functions (ca.sin), not math's": lambda x, u: u.force + math.sin(x.x),
    "use ca.if_else instead of if": lambda x, u: u.force if x.x > 0 else 0,
    "the equations fail (": lambda x, u: np.fft.fft([u.force, x.x]),
    "all derivatives with respect to force are 0, because force is discrete": lambda x, u: (
        ca.floor(u.force) + x.x
    ),
    "because v is discrete": lambda x, u: (
        {"x": ca.if_else(x.v > 1, 1, 0), "v": u.force}, {"position": x.x}
    ),
    "for algebraic equations, solve for": lambda x, u: ({"x": x.v, "v": u.force}, {}, {"z": x.x}),
    "return two dicts, rates by state and outputs by name": lambda x, u: ([x.v, u.force], {}),
    "the rate of v has 2 entries": lambda x, u: ca.SX.ones(2),
    "the rate of v is": lambda x, u: object(),
    "the equations use the symbol 'stray', which has no": lambda x, u: u.force + STRAY,
}  # fmt: skip


@pytest.mark.parametrize("message", EQUATIONS)
def test_wrong_equations_are_refused(message):
    """Equations of the cart that fail at a trim are refused in one line that names the fault.

    `EQUATIONS` has, for each message, a function that returns the rate of v or (rates, outputs).
    """

    def equations(x, u, p, w):
        found = EQUATIONS[message](x, u)
        is_complete = isinstance(found, tuple)
        return found if is_complete else ({"x": x.v, "v": found}, {"position": x.x})

    assert message in refused(lambda: trim(cart(equations=equations, trim={"x": 0.0})))


def test_division_by_zero_returns_infinity():
    """Equations evaluated with numbers return inf for 1 / 0 and -inf for -1 / 0, as CasADi does.

    Numbers of Python would raise ZeroDivisionError.
    """
    model = cart(
        equations=lambda x, u, p, w: ({"x": x.v, "v": u.force / x.x}, {"position": x.v / x.x})
    )
    assert model.outputs_at([0.0, 1.0], [1.0])["position"] == float("inf")
    assert model.rates_at([0.0, 1.0], [-1.0])["v"] == -float("inf")
    assert model.outputs_at([2.0, 1.0], [1.0])["position"] == 0.5
