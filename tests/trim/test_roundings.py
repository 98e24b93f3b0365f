"""What counts as rounding depends on no unit, and not on a stiff part of the model."""

import casadi as ca
import numpy as np
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


def test_a_value_is_compared_with_the_table_in_any_unit():
    """The sheet shows the speed 10 m/s of a trim "from the table's" if that of the table
    (`Domain.reference`) is 20 m/s, and not if it is 10 m/s; also if the unit of length is 1e9 m (`meter` = 1e-9 units).
    """
    for meter in (1.0, 1e-9):
        domain = Domain(reference={"speed": 20.0 * meter})
        assert "speed from the table's" in str(trim(cart(meter=meter, domain=domain)).report())
        domain = Domain(reference={"speed": 10.0 * meter})
        assert "speed from the table's" not in str(trim(cart(meter=meter, domain=domain)).report())


def test_the_end_of_a_range_is_inside_in_the_sheet_and_in_the_notes():
    """A speed one rounding beyond the range of validity, 5 to 10 m/s, is inside; one millionth beyond it is
    not. The sheet and the notes agree.
    """
    model = cart(domain=Domain(range={"speed": (5.0, 10.0, "the tests")}))
    for speed, inside in ((np.nextafter(10.0, 11.0), True), (10.00001, False)):
        point = trim(model, speed=float(speed))
        assert ("OUTSIDE" not in str(point.report())) == inside
        assert (not any("beyond the tests" in note for note in point.warnings)) == inside


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


def test_columns_of_eigenvalues_do_not_depend_on_the_unit_of_time():
    """A sweep of random plants has the same columns of eigenvalues with times in s and in 2^-45 s, whose
    rates are multiplied by 2^-45.
    """
    names = ("a", "b", "c", "d")
    random = np.random.default_rng(3)
    for _ in range(2):
        ends = random.normal(size=(2, 4, 4))  # A at s = 0 and at s = 1

        def swept(seconds, ends=ends):
            def equations(x, u, p, w):
                rows = ca.DM(ends[0]) + ca.DM(ends[1] - ends[0]) * p.s
                rates = seconds * rows @ ca.vertcat(*x) + u.force
                return dict(zip(names, ca.vertsplit(rates), strict=True)), {}

            signals = dict.fromkeys(names, Signal())
            model = Model("plant", signals, {"force": Signal()}, equations, {"s": Signal()})
            return sweep(model, s=[0.0, 0.5, 1.0]).eigenvalues / seconds

        np.testing.assert_allclose(swept(2.0**-45), swept(1.0), rtol=1e-9)
