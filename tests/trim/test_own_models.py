"""A user's own models: the F-16 of Stevens and Lewis as printed, and what is wrong with a file in one line."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from hfa_support import BadInputError, Model, Signal
from trim import find_operating_point, linearize, release
from trim.linear.linear_model import LinearModel
from trim.point.condition import usual_condition
from trim.point.operating_point import OperatingPoint

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
from f16 import F16

#: Stevens and Lewis, table 3.6-3: xcg, what is held, rates, alpha, beta, throttle, elevator, aileron, rudder.
TRIMS = [
    (0.35, {}, {}, (0.03691, 0.0, 0.1385, -0.7588, 0.0, 0.0)),
    (0.30, {}, {}, (0.03936, 0.0, 0.1485, -1.931, 0.0, 0.0)),
    (0.38, {}, {}, (0.03544, 0.0, 0.1325, -0.0559, 0.0, 0.0)),
    (0.30, {"turn_rate": 0.3}, {}, (0.2485, 4.8e-4, 0.8499, -6.256, 0.0989, -0.4218)),
    (0.30, {}, {"pitch": 0.3}, (0.3006, 4.1e-5, 1.023, -7.082, -6.2e-4, 0.01655)),
]
#: The same, example 3.7-1 and section 4: modes at 502 ft/s with xcg .3.
MODES = {
    "short period": -1.2039 + 1.4922j,
    "phugoid": -0.0087 + 0.0739j,
    "dutch roll": -0.4399 + 3.220j,
    "spiral": -0.0128,
    "roll": -3.601,
}


def trimmed(
    model: Model, hold: dict[str, float] | None = None, rates: dict[str, float] | None = None
) -> OperatingPoint:
    usual = usual_condition(model)
    # The pull-up takes more than full throttle in the book.
    condition = release(usual, hold=hold, limits={"throttle": (0.0, 1.1), "power": (0.0, 120.0)} if rates else {})
    return find_operating_point(model, replace(condition, rates={**(usual.rates or {}), **(rates or {})}))


def linear(model: Model, point: OperatingPoint) -> LinearModel:
    return linearize(model, point)


@pytest.mark.parametrize(("xcg", "hold", "rates", "printed"), TRIMS)
def test_trims_of_the_book(
    xcg: float, hold: dict[str, float], rates: dict[str, float], printed: tuple[float, ...]
) -> None:
    point = trimmed(F16.with_parameters(xcg=xcg), hold, rates)
    found = [point.values[each] for each in ("alpha", "beta", "throttle", "elevator", "aileron", "rudder")]
    np.testing.assert_allclose(found, printed, rtol=6e-4, atol=6e-5)


def test_modes_of_the_book() -> None:
    model = F16.with_parameters(xcg=0.3)
    found = {mode.name: mode.eigenvalue for mode in linear(model, trimmed(model)).modes}
    for name, printed in MODES.items():
        assert found[name] == pytest.approx(printed, abs=1e-3), name


def test_rates_of_the_book() -> None:
    """Table 3.5-2; the roll acceleration differs from the printed one by 2e-4, pitch and yaw by 1e-4."""
    x = [500, 0.5, -0.2, -1, 1, -1, 0.7, -0.8, 0.9, 1000, 900, 10000, 90]
    printed = [-75.23724, -0.8813491, -0.4759990, 2.505734, 0.3250820, 2.145926, 12.62679, 0.9649671, 0.5809759]
    printed += [342.4439, -266.7707, 248.1241, -58.68999]
    found = F16.with_parameters(xcg=0.4).at(x, [0.9, 20, -15, -20]).f
    np.testing.assert_allclose(found, printed, rtol=3e-4)


def test_python_control_agrees() -> None:
    import control

    model = F16.with_parameters(xcg=0.3)
    point, nlsys = trimmed(model), model.to_control()
    peer = control.linearize(nlsys, np.array(point.states), np.array(point.inputs))
    own = linearize(model, point, full=True)
    np.testing.assert_allclose(peer.A, own.A, rtol=1e-4, atol=2e-3)
    np.testing.assert_allclose(peer.B, own.B, rtol=1e-4, atol=2e-3)


def simple(equations: object, **more: object) -> Model:
    declared = {"states": {"x": Signal(start=0.5), "v": Signal()}, "inputs": {"u": Signal()}, "trim": {"x": 0.0}}
    return Model(name="cart", equations=equations, **{**declared, **more})  # type: ignore[arg-type]


def cart(x, u, p, w):
    return {"x": x.v, "v": u.u - ca.sign(x.x) * 35 * ca.fabs(x.x)}, {}


def test_a_kink_is_reported_with_both_slopes() -> None:
    model = linear(simple(cart), trimmed(simple(cart)))
    assert model.kinks == ("kink: A(v, x) is 0, but the slopes below and above are -35 and -35",)
    assert model.kinks[0] in model.report().notes


def test_a_smooth_model_has_no_kinks() -> None:
    model = F16.with_parameters(xcg=0.3)
    point = trimmed(model, {"speed": 550.0, "altitude": 1000.0})
    assert not [each for each in linear(model, point).kinks if "A(" in each]


@pytest.mark.parametrize(
    ("equations", "words"),
    [
        (lambda x, u, p, w: ({"x": x.v}, {}), "the equations return no rate of v; add it"),
        (lambda x, u, p, w: ({"x": x.v, "v": u.u, "q": 0}, {}), "return the undeclared rate 'q'; choose from x, v"),
        (lambda x, u, p, w: ({"x": x.v, "v": u.gas}, {}), "the equations fail (AttributeError: "),
        (lambda x, u, p, w: ({"x": x.v, "v": u.u + ca.sqrt(x.x - 1)}, {}), "the rate of v is not a number at 0 x, "),
    ],
)
def test_wrong_equations_are_said_in_one_line(equations: object, words: str) -> None:
    with pytest.raises(BadInputError) as caught:
        trimmed(simple(equations))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
