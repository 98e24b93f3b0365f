"""Users' models: the F-16 of Stevens and Lewis and other published aircraft, and faulty files."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cli import assert_refused, hfa
from own_models import F16, GTM, NAVION, navion, trimmed

from hfa import BadInputError, Model, Signal, linearize, sweep, trim
from trim import TrimError, release, trim_points, trim_report, usual_condition

#: Stevens and Lewis, table 3.6-3: xcg, held variables, rates, alpha, beta, throttle, elevator,
#: aileron, rudder.
TRIMS = [
    (0.35, {}, {}, (0.03691, 0.0, 0.1385, -0.7588, 0.0, 0.0)),
    (0.30, {}, {}, (0.03936, 0.0, 0.1485, -1.931, 0.0, 0.0)),
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
def test_trims_of_the_f16_equal_the_books(
    xcg: float, hold: dict[str, float], rates: dict[str, float], printed: tuple[float, ...]
) -> None:
    """Trims of the F-16 equal those printed by Stevens and Lewis, in straight flight and in
    turns.
    """
    point = trimmed(F16.with_parameters(xcg=xcg), hold, rates)
    computed = [
        point.values[name]
        for name in ("alpha", "beta", "throttle", "elevator", "aileron", "rudder")
    ]
    np.testing.assert_allclose(computed, printed, rtol=6e-4, atol=6e-5)


def test_no_row_with_free_states_depends_on_others() -> None:
    """The result of a sweep point with free states has the same bits alone and with other
    points.
    """
    speeds = np.linspace(200.0, 700.0, 300)[:, None]
    whole = trim_points(F16, ("speed",), speeds)
    for rows in (slice(7, 8), slice(100, 140)):
        part = trim_points(F16, ("speed",), speeds[rows])
        np.testing.assert_array_equal(part.states, whole.states[rows])
        np.testing.assert_array_equal(part.A, whole.A[rows])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("states", "alpha"),
        ("inputs", "elevator"),
        pytest.param("outputs", "gamma", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize(
    "factor", [*(pytest.param(factor, marks=pytest.mark.slow) for factor in (0.01, 5.0)), 100.0]
)
def test_the_search_is_independent_of_declared_scales(kind: str, name: str, factor: float) -> None:
    """With a wrong nominal value of a state, the trim of a slow flight is found.

    A sweep converges without searches for single trims.
    """
    signals = getattr(F16, kind)
    scaled = signals[name]._replace(nominal=factor * signals[name].nominal)
    model = replace(F16, **{kind: {**signals, name: scaled}})
    alpha = trimmed(F16, {"speed": 130.0}).states.alpha
    assert trimmed(model, {"speed": 130.0}).states.alpha == pytest.approx(alpha, abs=1e-6)
    speeds = np.linspace(130.0, 700.0, 300)[:, None]
    points = trim_points(model, ("speed",), speeds)
    assert (points.status == 0).all()
    assert not points.one_by_one.any()


def test_imbalances_that_do_not_matter_are_not_named() -> None:
    """The error on a failed trim does not name rates that are unbalanced only by rounding.

    At 110 ft/s the F-16 cannot be trimmed, and the residuals of its roll equations are rounding.
    """
    with pytest.raises(TrimError) as refusal:
        trimmed(F16, {"speed": 110.0})
    assert "speed by" in str(refusal.value)
    assert "roll" not in str(refusal.value)


def test_modes_of_the_f16_equal_the_books() -> None:
    """Modes of the F-16 equal those printed by Stevens and Lewis."""
    model = F16.with_parameters(xcg=0.3)
    computed = {mode.name: mode.eigenvalue for mode in linearize(model, trimmed(model)).modes}
    for name, printed in MODES.items():
        assert computed[name] == pytest.approx(
            printed, abs=6e-4 if name == "dutch roll" else 1e-4
        ), name


def test_modes_of_the_navion_agree_with_nelson(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modes of the Navion agree with Nelson, examples 4.3 and 5.2, except for the spiral.

    With the coefficients of the examples (no C_Lq, N_beta 4.49 instead of 4.55) all modes agree.
    """
    printed = {
        "short period": -2.51 + 2.59j,
        "phugoid": -0.0171 + 0.213j,
        "dutch roll": -0.487 + 2.335j,
    }
    printed |= {"roll": -8.435, "spiral": -0.00877}

    def off() -> dict[str, float]:
        same = replace(
            NAVION, equations=lambda *vectors: navion.equations(*vectors)
        )  # to compile it again
        computed = {mode.name: mode.eigenvalue for mode in linearize(same, trimmed(same)).modes}
        return {name: abs(computed[name] - value) / abs(value) for name, value in printed.items()}

    assert {name for name, error in off().items() if error > 0.011} == {"spiral"}
    # The examples use other coefficients than the book's table.
    monkeypatch.setattr(navion, "C_LQ", 0.0)
    monkeypatch.setattr(navion, "C_NBETA", 0.0701)
    assert max(off().values()) <= 0.005


def test_the_gtm_has_the_published_trim() -> None:
    """The trim of the GTM agrees with the published values within 1 %. The load factor is 1."""
    point = trimmed(GTM)
    computed = [point.values[name] for name in ("alpha", "elevator", "throttle")]
    np.testing.assert_allclose(computed, [0.04924, 0.04892, 14.33], rtol=0.01)
    assert GTM.outputs_at(point.states, point.inputs)["load_factor"] == pytest.approx(
        1.0, abs=1e-12
    )
    assert [mode.name for mode in linearize(GTM, point).modes] == ["short period", "phugoid"]


def test_rates_of_the_f16_agree_with_the_book() -> None:
    """The rates of the F-16 agree with Table 3.5-2 of Stevens and Lewis."""
    x = [500, 0.5, -0.2, -1, 1, -1, 0.7, -0.8, 0.9, 1000, 900, 10000, 90]
    printed = [
        -75.23724,
        -0.8813491,
        -0.4759990,
        2.505734,
        0.3250820,
        2.145926,
        12.62679,
        0.9649671,
        0.5809759,
    ]
    printed += [342.4439, -266.7707, 248.1241, -58.68999]
    computed = F16.with_parameters(xcg=0.4).at(x, [0.9, 20, -15, -20]).f
    np.testing.assert_allclose(computed, printed, rtol=8e-6)


def test_a_second_trim_of_equal_throttle_is_named() -> None:
    """If two speeds have the same throttle, the report of one trim names the other trim.

    The report also names an initial point from which the other trim is found.
    """
    usual = usual_condition(F16)
    condition = release(usual, free=("speed",), hold={"throttle": 0.2})
    front = trim(F16, condition)
    (back,) = front.report().data["search"]["other_trims"]
    assert front.states.speed > 500 > 300 > back["speed"]
    for speed in (front.states.speed, back["speed"]):
        begun = trim(F16, release(usual, hold={"speed": speed}))
        assert begun.inputs.throttle == pytest.approx(0.2, rel=1e-9)
    words = ("trim", *OWN, "--free", "speed", "--hold", "throttle=0.2")
    message = re.search(
        rf"Another trim exists: speed {back['speed']:.6g} ft/s, .*; the initial point (\S+) leads to it",
        " ".join(hfa(*words).out.split()),
    )
    assert message
    data = json.loads(hfa(*words, "--start", message[1], "--json").out)
    assert data["operating_point"]["states"]["speed"] == pytest.approx(back["speed"], rel=1e-9)
    assert data["search"]["other_trims"][0]["speed"] == pytest.approx(front.states.speed, rel=1e-9)


def test_swept_turns_equal_single_trims() -> None:
    """A sweep of turns equals single trims.

    The bank angle increases with the turn rate and is below 90 deg.
    """
    rates = np.linspace(0.0, 0.25, 26)
    swept = sweep(F16, {"turn_rate": rates})
    bank = swept.states[:, list(F16.states).index("roll")]
    assert swept.trimmed.all()
    assert (np.diff(bank) > 0).all()
    assert bank[-1] < np.pi / 2
    for i in (5, 20):
        np.testing.assert_allclose(
            trimmed(F16, {"turn_rate": rates[i]}).states, swept.states[i], atol=1e-10
        )
        np.testing.assert_array_equal(
            sweep(F16, {"turn_rate": rates[i : i + 1]}).states[0], swept.states[i]
        )


def test_further_initial_guesses_cross_a_flat_region() -> None:
    """Further initial guesses find a trim beyond a region in which the throttle has no effect.

    The throttle has no effect below one half.
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
    assert point.started > 0
    assert (
        "other initial points failed too"
        not in trim_report(flat, usual_condition(flat), point).text()
    )
    with pytest.raises(TrimError, match=r"\d other initial points failed too"):
        trim(flat, release(usual_condition(flat), hold={"speed": 200.0}))


def simple(equations: object, **more: object) -> Model:
    declared = {
        "states": {"x": Signal(start=0.5), "v": Signal()},
        "inputs": {"u": Signal()},
        "trim": {"x": 0.0},
    }
    return Model(name="cart", equations=equations, **{**declared, **more})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("states", ("alpha",)),
        ("inputs", ("elevator",)),
        pytest.param("states", F16.steady, marks=pytest.mark.slow),
        pytest.param("inputs", F16.inputs, marks=pytest.mark.slow),
    ],
)
def test_a_wrong_nominal_gives_no_false_result(kind: str, names: Iterable[str]) -> None:
    """A nominal value that is wrong by a factor of 1,000 changes neither the trim nor the kinks."""
    reference = trimmed(F16)
    kinks = linearize(F16, reference).kinks
    signals = getattr(F16, kind)
    for name in names:
        wrong = signals[name]._replace(nominal=signals[name].nominal * 1e3, rate=None)
        model = replace(F16, **{kind: {**signals, name: wrong}})
        point = trimmed(model)
        np.testing.assert_allclose(point.states, reference.states, atol=1e-8, err_msg=name)
        np.testing.assert_allclose(point.inputs, reference.inputs, atol=1e-8, err_msg=name)
        assert linearize(model, point).kinks == kinks


@pytest.mark.parametrize(
    ("equations", "words"),
    [
        (lambda x, u, p, w: ({"x": x.v}, {}), "the equations return no rate of v"),
        (
            lambda x, u, p, w: ({"x": x.v, "v": u.u, "q": 0}, {}),
            "return the undeclared rate of 'q'; choose from x, v",
        ),
        (
            lambda x, u, p, w: ({"x": x.v, "v": u.gas}, {}),
            "use an undeclared name of inputs, 'gas'; choose from u",
        ),
        (
            lambda x, u, p, w: ({"x": x.v, "v": u.u + ca.sqrt(x.x - 1)}, {}),
            "the rate of v is not a number at 0 x, ",
        ),
        (
            lambda x, u, p, w: ({"x": x.v, "v": u.u + math.sin(x.x)}, {}),
            "use CasADi's functions (ca.sin), not math's",
        ),
        (
            lambda x, u, p, w: ({"x": x.v, "v": u.u if x.x > 0 else 0}, {}),
            "use ca.if_else instead of if",
        ),
        (lambda x, u, p, w: ({"x": x.v, "v": np.fft.fft([u.u, x.x])}, {}), "the equations fail ("),
        (
            lambda x, u, p, w: ({"x": x.v, "v": ca.floor(u.u) + x.x}, {}),
            "cart: all derivatives with respect to u are 0, because u is discrete; ",
        ),
        (
            lambda x, u, p, w: ({"x": ca.if_else(x.v > 1, 1, 0), "v": u.u}, {}),
            "because v is discrete",
        ),
        (
            lambda x, u, p, w: ({"x": x.v, "v": u.u}, {}, {"z": x.x}),
            "for algebraic equations, solve for the unknowns",
        ),
        (
            lambda x, u, p, w: ([x.v, u.u], {}),
            "return two dicts, rates by state and outputs by name",
        ),
    ],
)
def test_wrong_equations_are_refused_in_one_line(equations: object, words: str) -> None:
    """Equations that fail at a trim are refused by one line."""
    with pytest.raises(BadInputError) as caught:
        trimmed(simple(equations))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


FAULTS = {
    "x = (1": "SyntaxError in line 1: '(' was never closed; correct the file",
    "A = 3": "A is 3, not a Model; define a Model",
    "B = 3": "A does not exist; define a Model",
    "1 / 0": "ZeroDivisionError: division by zero; correct the file",
    "import hfa as s; A = s.Model('a', {'x': s.Signal(nominal=0)}, {}, None)": (
        "nominal and rate positive"
    ),
    "import hfa as s; A = s.Model('a', {'x': s.Signal()}, {'x': s.Signal()}, None)": (
        "x is declared twice"
    ),
}


@pytest.mark.parametrize(("text", "words"), FAULTS.items())
def test_a_wrong_model_file_is_refused(text: str, words: str, tmp_path: Path) -> None:
    """A mistake in a model file is refused by one line that names the file."""
    path = tmp_path / "own.py"
    path.write_text(text)
    assert_refused(hfa("trim", "--aircraft", f"{path}:A"), 2, f"{path}: ", words)


OWN = ("--aircraft", "examples/f16.py:F16")


@pytest.mark.slow
def test_commands_accept_a_users_model(tmp_path: Path) -> None:
    """The commands trim, linearize, sweep and solve accept the F-16 and the names of its variables.

    The commands refuse options that apply only to the flexible aircraft.
    """
    assert_refused(hfa("trim", *OWN, "--dihedral", "5"), 2, "unknown option --dihedral")
    saved = tmp_path / "point.json"
    picture = tmp_path / "point.svg"
    turning = ("--hold", "xcg=0.3", "--hold", "turn_rate=17.188734")
    done = hfa("trim", *OWN, *turning, "-o", str(saved), "--picture", str(picture))
    assert done.code == 0
    assert "elevator" in picture.read_text("utf-8")
    assert re.search(r"^elevator +-6\.25588 +deg +free", done.out, re.M)
    again = json.loads(
        hfa("linearize", *OWN, "--hold", "xcg=0.3", "--start", str(saved), "--json").out
    )
    assert {mode["name"] for mode in again["modes"]} == {*MODES, "engine"}
    assert again["state_units"][1:3] == ["rad", "rad"]
    assert "dihedral_deg" not in again
    assert again["provenance"]["model"].startswith("examples/f16.py:F16 (SHA-256 ")
    store = str(tmp_path / "sweep.zarr")
    held = ("--hold", "speed=400:600:200", "--hold", "xcg=.3,.35")
    swept = json.loads(hfa("sweep", *OWN, *held, "-o", store, "--json").out)
    assert swept["counts"]["trimmed"] == 4
    solved = hfa("solve", *OWN, "--hold", "xcg=0.3")
    assert (solved.code, "FAIL" in solved.out) == (0, False)
