"""Faulty declarations of a model, which are refused with a message of one line."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import pytest

from hfa import BadInputError, Model, Signal, trim


def cart(**declared: Any) -> Model:
    """Return the cart x' = v, v' = force with the output position = x.

    declared: arguments of `Model` that replace the usual ones
    """

    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        return {"x": x.v, "v": u.force}, {"position": x.x}

    settings: dict[str, Any] = {
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
        ({"replaced": {"y": "position"}}, "replaced names the unknown state 'y'"),
        ({"schedule": "position"}, "schedule is the unknown variable 'position'"),
        ({"trim": {"x": "0"}}, "trim imposes x = 0; give a finite number"),
        ({"trim": {"x": 0.0}, "replaced": {"x": "position"}}, "trim imposes the unknown"),
        ({"trim": {"height": 1.0}}, "trim imposes the unknown variable 'height'"),
        ({"states": {"x": Signal(nominal=-1.0)}}, "nominal and rate positive"),
        ({"states": {"x": Signal(rate=0.0)}}, "nominal and rate positive"),
        ({"states": {"x": Signal(start=math.inf)}}, "nominal, rate, start are"),
        ({"states": {"x": Signal(min=2.0, max=1.0)}}, "min 2 is above max 1"),
        ({"states": {"x": Signal(min=math.nan)}}, "min nan is above max"),
        ({"outputs": {"position": 1.0}}, "position is 1.0; give a Signal"),
        ({"outputs": ["position"]}, r"outputs is .*; give {name: Signal\(unit\)}"),
        ({"states": {}}, "cart declares no states"),
        ({"linear": "x"}, "linear is 'x'; give a tuple"),
        ({"steady": ("w",)}, "steady names the unknown state 'w'"),
        ({"states": {"x": Signal(3)}}, "x: the unit is 3; give the unit as text"),  # type: ignore[arg-type]
    ],
)
def test_wrong_declarations_are_refused(declared: dict[str, Any], message: str) -> None:
    """Each faulty declaration is refused with a message that names the fault."""
    with pytest.raises(BadInputError, match=message):
        cart(**declared)


@pytest.mark.parametrize(
    ("rates", "outputs", "message"),
    [
        ({"v": ca.SX.ones(2)}, {}, "the rate of v has 2 entries"),
        ({}, {"position": ca.SX.ones(2)}, "the output position has 2 entries"),
        ({"v": object()}, {}, "the rate of v is"),
        ({"v": ()}, {}, "the rate of v"),
    ],
)
def test_rates_and_outputs_are_single_numbers(
    rates: dict[str, Any], outputs: dict[str, Any], message: str
) -> None:
    """A rate or an output that is not a single number is refused with its name."""

    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        return {"x": x.v, "v": u.force} | rates, {"position": x.x} | outputs

    with pytest.raises(BadInputError, match=message):
        cart(equations=equations).functions()


@pytest.mark.parametrize("where", ["a rate", "an output", "a rate of MX"])
def test_a_users_symbol_in_equations_is_named(where: str) -> None:
    """Equations with a CasADi symbol of the user are refused with the name of the symbol."""
    stray = ca.SX.sym("stray")
    rate = stray if where == "a rate" else 0.0
    output = stray if where == "an output" else 0.0
    if where == "a rate of MX":
        rate = ca.Function("f", [stray], [stray**2])(stray)
    with pytest.raises(BadInputError, match="the equations use the symbol 'stray', which has no"):
        trim(
            cart(
                equations=lambda x, u, p, w: (
                    {"x": x.v, "v": u.force + rate},
                    {"position": x.x + output},
                )
            )
        )


def test_division_by_zero_returns_infinity() -> None:
    """Equations evaluated with numbers return inf for 1 / 0, as compiled equations do."""
    model = cart(
        equations=lambda x, u, p, w: ({"x": x.v, "v": u.force / x.x}, {"position": x.v / x.x})
    )
    assert model.outputs_at([0.0, 1.0], [1.0])["position"] == float("inf")
    assert model.rates_at([0.0, 1.0], [-1.0])["v"] == -float("inf")
    assert model.outputs_at([2.0, 1.0], [1.0])["position"] == 0.5
