"""Users' models: the F-16 of Stevens and Lewis and other published aircraft, and faulty files."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from cli import assert_refused, hfa
from own_models import F16, GTM, trimmed

from hfa import Model, Signal, linearize, trim
from trim import TrimError, release, usual_condition

#: Stevens and Lewis, table 3.6-3: xcg, held variables, imposed rates, and the printed alpha, beta
#: (rad), throttle, elevator, aileron and rudder (deg).
TRIMS = [
    (0.35, {}, {}, (0.03691, 0.0, 0.1385, -0.7588, 0.0, 0.0)),
    (0.38, {}, {}, (0.03544, 0.0, 0.1325, -0.0559, 0.0, 0.0)),
    (0.30, {"turn_rate": 0.3}, {}, (0.2485, 4.8e-4, 0.8499, -6.256, 0.09889, -0.4218)),
    (0.30, {}, {"pitch": 0.3}, (0.3006, 4.1e-5, 1.023, -7.082, -6.2e-4, 0.01655)),
]
#: Stevens and Lewis, example 3.7-1 and section 4: modes at 502 ft/s with xcg 0.3.
MODES = {
    "short period": -1.2039 + 1.4922j,
    "phugoid": -0.0087 + 0.0739j,
    "dutch roll": -0.4399 + 3.220j,
    "spiral": -0.0128,
    "roll": -3.601,
}


@pytest.mark.parametrize(("xcg", "hold", "rates", "printed"), TRIMS)
def test_trims_of_the_f16_equal_the_books(xcg, hold, rates, printed):
    """Trims of the F-16 equal those printed by Stevens and Lewis, in straight flight and in
    turns.
    """
    point = trimmed(F16.with_parameters(xcg=xcg), hold, rates)
    computed = [
        point.values[name]
        for name in ("alpha", "beta", "throttle", "elevator", "aileron", "rudder")
    ]
    np.testing.assert_allclose(computed, printed, rtol=6e-4, atol=6e-5)


def test_a_turn_at_a_load_factor_is_to_the_right():
    """A level turn at n = 2 has the bank 60 deg and ω = g tan φ / V = 6.36 deg/s, both above 0."""
    point = trim(F16, load_factor=2.0, free="turn_rate")
    assert point["turn_rate"] == pytest.approx(32.17 * 3**0.5 / 502.0, rel=1e-3)
    assert point["roll"] > 1.0


def test_modes_of_the_f16_equal_the_books():
    """Modes of the F-16 equal those printed by Stevens and Lewis."""
    model = F16.with_parameters(xcg=0.3)
    computed = {mode.name: mode.eigenvalue for mode in linearize(model, trimmed(model)).modes}
    for name, printed in MODES.items():
        half_digit = 6e-4 if name == "dutch roll" else 1e-4  # printed with fewer digits
        assert computed[name] == pytest.approx(printed, abs=half_digit), name


def test_the_gtm_has_the_published_trim():
    """The trim of the GTM agrees with the published values within 1 %. The load factor is 1.

    Its modes are the short period and the phugoid.
    """
    point = trimmed(GTM)
    computed = [point.values[name] for name in ("alpha", "elevator", "throttle")]
    np.testing.assert_allclose(computed, [0.04924, 0.04892, 14.33], rtol=0.01)
    assert GTM.outputs_at(point.states, point.inputs)["load_factor"] == pytest.approx(
        1.0, abs=1e-12
    )
    assert [mode.name for mode in linearize(GTM, point).modes] == ["short period", "phugoid"]


def test_further_initial_points_cross_a_flat_region():
    """The throttle, which begins at 0.1, has no effect below one half: another initial point finds
    the trim of 60 m/s, at 0.5 + 1e-3 60² / 40 = 0.59.

    The report says that the search from the default point failed. The error on a speed without a trim
    counts the other initial points. The position "at", which is in no equation, keeps its start value.
    """

    def engine(x, u, p, w):
        return {"speed": ca.fmax(0, u.throttle - 0.5) * 40 - 1e-3 * x.speed**2, "at": x.speed}, {}

    flat = Model(
        name="sled",
        states={"speed": Signal("m/s", 10.0), "at": Signal("m", 100.0)},
        inputs={"throttle": Signal(min=0.0, max=1.0, start=0.1)},
        equations=engine,
        steady=("speed",),
        trim={"speed": 60.0},
    )
    point = trim(flat, usual_condition(flat))
    assert point.inputs.throttle == pytest.approx(0.59, rel=1e-9)
    assert point.initial_point > 0
    assert trim(flat, start={"at": 7.0})["at"] == point["at"]  # not 7, but the declared start
    said = " ".join(str(point).split())
    assert "Not from the default initial point" in said
    assert "other initial points failed too" not in said
    with pytest.raises(TrimError, match=r"\d other initial points failed too"):
        trim(flat, release(usual_condition(flat), hold={"speed": 200.0}))


@pytest.mark.parametrize(
    ("kind", "name"), [("states", "alpha"), ("inputs", "elevator"), ("outputs", "gamma")]
)
def test_a_trim_does_not_depend_on_nominal_values(kind, name):
    """A nominal value that is wrong by a factor of 1,000 changes neither the trim nor the nonsmooth points
    of the linear model.
    """
    reference = trimmed(F16)
    signals = getattr(F16, kind)
    wrong = signals[name]._replace(nominal=1e3 * signals[name].nominal, rate=None)
    model = replace(F16, **{kind: {**signals, name: wrong}})
    point = trimmed(model)
    np.testing.assert_allclose(point.states, reference.states, atol=1e-8)
    np.testing.assert_allclose(point.inputs, reference.inputs, atol=1e-8)
    found, expected = (linearize(*each) for each in ((model, point), (F16, reference)))
    assert found.nonsmooth_points == expected.nonsmooth_points


FAULTS = {
    "x = (1": "SyntaxError in line 1: '(' was never closed; correct the file",
    "A = 3": "A is 3, not a Model; define a Model",
    "B = 3": "A does not exist; define a Model",
    "1 / 0": "ZeroDivisionError: division by zero; correct the file",
    "import hfa as s; A = s.Model('a', {'x': s.Signal()}, {'x': s.Signal()}, print)": (
        "x is declared twice"
    ),
}


@pytest.mark.parametrize(("text", "words"), FAULTS.items())
def test_a_wrong_model_file_is_refused(text, words, tmp_path):
    """A mistake in a model file is refused by one line that names the file."""
    path = tmp_path / "own.py"
    path.write_text(text)
    assert_refused(hfa("trim", "--aircraft", f"{path}:A"), 2, f"{path}: ", words)
