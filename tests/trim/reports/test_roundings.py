"""What counts as rounding depends on no unit, and not on a stiff part of the model."""

import pytest

from hfa import Model, Signal, linearize, sweep, trim
from hfa.extend import Domain


def first_lines(report):
    return str(report).partition("\n\n")[0].split("\n")


def cart(newton=1.0, meter=1.0, domain=None):
    """Return v' = F - .02 v, with a height that changes nothing.

    newton, meter: numbers of 1 N and 1 m in the units of the model
    """
    return Model(
        "cart",
        {"speed": Signal("m/s", 10.0 * meter)},
        {"height": Signal("m", 1e4), "thrust": Signal("N", newton)},
        lambda x, u, p, w: ({"speed": u.thrust / newton * meter - 0.02 * x.speed}, {}),
        trim={"speed": 10.0 * meter, "height": 0.0},
        schedule="height",
        domain=domain or Domain(),
    )


def test_a_growth_beside_a_stiff_state_is_unstable():
    """A pendulum with λ = 0.5 1/s doubles in 1.39 s, however fast the valve beside it is."""
    pendulum = Model(
        "pendulum",
        {"angle": Signal("rad"), "rate": Signal("rad/s"), "valve": Signal()},
        {"force": Signal("N")},
        lambda x, u, p, w: (
            {
                "angle": x.rate,
                "rate": 0.25 * x.angle + 0.01 * x.valve,
                "valve": 1e9 * (u.force - x.valve),
            },
            {},
        ),
    )
    found = first_lines(linearize(pendulum, trim(pendulum)).report())
    assert "unstable: mode 2 (2x in 1.39 s)" in found


@pytest.mark.parametrize("newton", [1.0, 1e-13])
def test_an_input_of_any_unit_is_named_with_its_value(newton):
    """The thrust at 10 m/s, 0.2 N, is not left out as a rounding, in the trim and in a sweep, also if the
    unit of force is 1e13 N (`newton` = 1e-13 units).
    """
    model = cart(newton)
    assert f"thrust {0.2 * newton:.3g} N" in first_lines(trim(model).report())[-1]
    assert "thrust N" in str(sweep(model, speed=[10.0, 12.0]).report())


def test_another_trim_is_named_however_near_it_is():
    """Of the two trims, 1 and 1.00095 m/s, the report of the first one names the second."""
    model = Model(
        "folded",
        {"speed": Signal("m/s")},
        {"thrust": Signal("N")},
        lambda x, u, p, w: ({"speed": (x.speed - 1.0) * (x.speed - 1.00095)}, {}),
        trim={"thrust": 0.0},
    )
    assert "Another trim exists: speed 1.00095 m/s" in str(trim(model, free="speed").report())
