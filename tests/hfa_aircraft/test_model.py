"""What a declaration refuses, in one line, before anything is compiled or when it is."""

from __future__ import annotations

from typing import Any

import casadi as ca
import pytest

from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal
from hfa_support import BadInputError


def cart(**declared: Any) -> Model:
    """x' = v, v' = u; output position = x."""

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
        ({"trim": {"x": "0"}}, "trim imposes x = 0; give a number"),
        ({"trim": {"x": 0.0}, "replaced": {"x": "position"}}, "trim imposes the unknown"),
        ({"trim": {"height": 1.0}}, "trim imposes the unknown variable 'height'"),
        ({"states": {"x": Signal(nominal=-1.0)}}, "nominal and rate positive"),
    ],
)
def test_wrong_declarations_are_refused(declared: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        cart(**declared)


@pytest.mark.parametrize(
    ("rates", "outputs", "message"),
    [
        ({"v": ca.SX.ones(2)}, {}, "the rate of v has 2 entries"),
        ({}, {"position": ca.SX.ones(2)}, "the output of position has 2 entries"),
        ({"v": object()}, {}, "the rate of v is"),
        ({"v": ()}, {}, "the rate of v"),
    ],
)
def test_rates_and_outputs_are_single_numbers(
    rates: dict[str, Any], outputs: dict[str, Any], message: str
) -> None:
    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        return {"x": x.v, "v": u.force} | rates, {"position": x.x} | outputs

    with pytest.raises(BadInputError, match=message):
        cart(equations=equations).functions()


def test_a_model_is_short_at_the_prompt() -> None:
    assert repr(cart()) == "<Model cart: 2 states, 1 inputs, 1 outputs>"
