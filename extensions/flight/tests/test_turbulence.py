"""Turbulence of MIL-F-8785C: spectra, scales, and its effect on the aircraft."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import welch
from tolerances import SAME_FORMULA

import hfa
from hfa.main import main
from hfa_aircraft.loading import load_model
from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.turbulence import AirFilter, Turbulence, TurbulentAir, scales_and_intensities
from hfa_flight.scenario import Scenario, Uncertainty
from hfa_support.errors import BadInputError

V, SPAN = 150.0, 36.0
EVERY = {name: {name: 1.0} for name in "uvwpqr"}


def air_of(spectrum: str, altitude: float = 500.0, **changes) -> TurbulentAir:
    """Return moderate turbulence at the speed V = 150 ft/s.

    changes: fields that differ
    """
    given = Turbulence("moderate", altitude, SPAN, spectrum)
    scales = scales_and_intensities("moderate", altitude, spectrum)
    air = TurbulentAir(given, *scales, altitude, 1.0, V, 0.02, 10, 1, EVERY)
    return replace(air, **changes)


def specified(spectrum: str, air: TurbulentAir, omega: np.ndarray) -> np.ndarray:
    """Return the specified one-sided power spectra of the six gust components per rad/s, (6, N).

    Source: MIL-F-8785C, 3.7.1.1, 3.7.1.2 and 3.7.5.

    omega: frequencies, rad/s, (N,)
    """
    (L_u, L_v, L_w), (s_u, s_v, s_w) = air.lengths, air.intensities
    Omega = omega / V
    if spectrum == "dryden":

        def along(L, s):
            return s**2 * 2 * L / np.pi / (1 + (L * Omega) ** 2)

        def across(L, s):
            return s**2 * L / np.pi * (1 + 3 * (L * Omega) ** 2) / (1 + (L * Omega) ** 2) ** 2
    else:

        def along(L, s):
            return s**2 * 2 * L / np.pi / (1 + (1.339 * L * Omega) ** 2) ** (5 / 6)

        def across(L, s):
            a = (1.339 * L * Omega) ** 2
            return s**2 * L / np.pi * (1 + 8 / 3 * a) / (1 + a) ** (11 / 6)

    v, w = across(L_v, s_v), across(L_w, s_w)
    rolling = s_w**2 / L_w * 0.8 * (np.pi * L_w / (4 * SPAN)) ** (1 / 3)
    rolling = rolling / (1 + (4 * SPAN * Omega / np.pi) ** 2)
    pitching = Omega**2 * w / (1 + (4 * SPAN * Omega / np.pi) ** 2)
    yawing = Omega**2 * v / (1 + (3 * SPAN * Omega / np.pi) ** 2)
    return np.array([along(L_u, s_u), v, w, rolling, pitching, yawing]) / V


@pytest.mark.parametrize(("spectrum", "error"), [("dryden", SAME_FORMULA), ("karman", 0.017)])
@pytest.mark.parametrize("altitude", [60.0, 500.0, 1500.0, 20e3])
def test_filters_have_the_specified_spectra(spectrum, error, altitude) -> None:
    """The filters have the specified spectra up to ωL/V = 1000.

    Dryden's filters agree within rounding and von Karman's within 1.7 %.
    """
    air = air_of(spectrum, altitude)
    made = AirFilter.of(air)
    longest = max(air.lengths) / V
    omega = np.logspace(-3, 3, 200) / longest
    unit = np.eye(len(made.A))
    H = np.array([made.C @ np.linalg.solve(1j * w * unit - made.A, made.B) for w in omega])
    power = (np.abs(H) ** 2).sum(axis=2).T
    np.testing.assert_allclose(power, specified(spectrum, air, omega), rtol=error)


@pytest.mark.parametrize("spectrum", ["dryden", "karman"])
def test_variances_are_integrals_of_the_spectra(spectrum) -> None:
    """The variances of the filters are the integrals of the specified spectra.

    For u, v and w, the integrals are the squared intensities. The variances of the von Karman
    filters deviate by up to 1.5 % (u, v, w) and 2.5 % (p, q, r).
    """
    air = air_of(spectrum)
    made = AirFilter.of(air)
    variances = np.diag(made.C @ made.covariance @ made.C.T)
    close = 1e-6 if spectrum == "dryden" else 0.015
    np.testing.assert_allclose(variances[:3], np.square(air.intensities), rtol=close)
    for row in (3, 4, 5):
        ends = [0.0, *np.logspace(-3, 6, 10)]
        integral = sum(
            quad(lambda w, row=row: specified(spectrum, air, np.array([w]))[row, 0], *pair)[0]
            for pair in itertools.pairwise(ends)
        )
        assert variances[row] == pytest.approx(integral, rel=1e-4 if close < 1e-3 else 0.025)


def test_random_turbulence_has_the_specified_spectrum() -> None:
    """Twenty minutes of random turbulence at 50 Hz have the specified variances and spectra.

    The variances agree within 15 %, and the power in three bands within 15 %. The reference spectrum
    is folded at 25 Hz.
    """
    air = air_of("dryden", 500.0, ticks=60_000)
    components = AirFilter.of(air).drawn(air.ticks, seed=7)
    made = AirFilter.of(air)
    variances = np.diag(made.C @ made.covariance @ made.C.T)
    assert components.var(axis=0) == pytest.approx(variances, rel=0.15)
    frequency, power = welch(components.T, 50.0, nperseg=4096)
    omega = 2 * np.pi * frequency
    folds = np.arange(-20, 21)[:, None] * 2 * np.pi * 50.0
    folded = sum(specified("dryden", air, np.abs(omega + fold)) for fold in folds)
    for low, high in ((0.2, 1.0), (1.0, 5.0), (5.0, 20.0)):
        band = (frequency >= low) & (frequency < high)
        ratio = power[:, band].mean(axis=1) / (2 * np.pi * folded[:, band]).mean(axis=1)
        np.testing.assert_allclose(ratio, 1.0, atol=0.15)


@pytest.mark.parametrize("spectrum", ["dryden", "karman"])
def test_pitch_and_yaw_gusts_follow_the_gradients(spectrum) -> None:
    """The transfer functions of the gust rates q from w and r from v are as specified.

    q / w = (s/V) / (1 + 4b/(πV) s) and r / v = -(s/V) / (1 + 3b/(πV) s) at three frequencies.
    """
    made = AirFilter.of(air_of(spectrum))
    for w in (0.1, 3.0, 100.0):
        H = made.C @ np.linalg.solve(1j * w * np.eye(len(made.A)) - made.A, made.B)
        s = 1j * w
        pitching = s / V / (1 + 4 * SPAN / (np.pi * V) * s)
        yawing = -s / V / (1 + 3 * SPAN / (np.pi * V) * s)
        assert H[4, 2] / H[2, 2] == pytest.approx(pitching, rel=1e-9)
        assert H[5, 1] / H[1, 1] == pytest.approx(yawing, rel=1e-9)


def test_scales_and_intensities_equal_the_specification() -> None:
    """Scales and intensities of turbulence are those of the specification.

    At low altitude, the formulas with 30 kn at 20 ft apply. At high altitude, Figure 7 applies. In
    between, both are interpolated linearly. Altitudes without turbulence are refused.
    """
    low = scales_and_intensities("moderate", 500.0, "dryden")
    assert low.lengths == pytest.approx((944.657, 944.657, 500.0), rel=1e-4)
    assert low.intensities == pytest.approx((6.2596, 6.2596, 5.0634), rel=1e-4)
    assert scales_and_intensities("severe", 15e3, "karman") == ((2500.0,) * 3, (22.1,) * 3)
    middle = scales_and_intensities("light", 1500.0, "dryden")
    assert middle.lengths == (1375.0,) * 3
    at_2000 = np.interp(2000.0, [1750.0, 3750.0], [6.9, 7.4])
    assert middle.intensities == pytest.approx((0.5 * (2.53172 + at_2000),) * 3, rel=1e-5)
    for altitude, said in (
        (5.0, "covers only 10 to 80000"),
        (9e4, "covers only"),
        (60e3, "no light"),
    ):
        with pytest.raises(BadInputError, match=said):
            scales_and_intensities("light", altitude, "dryden")


#: MIL-F-8785C, Figure 7: altitude, 1000 ft, and intensities light, moderate and severe, ft/s.
FIGURE_7 = """
2.75 7.15 10.1 20.3
3.75 7.4 10.6 23
7.5 6.7 10.1 23.6
11.25 5.65 9.05 22.85
15 4.6 8 22.1
20 3.65 7.3 21.05
25 2.7 6.6 20
30 1.55 5.8 18
35 .4 5 16
40 .2 4.6 15.55
45 0 4.2 15.1
50 0 3.45 13.6
55 0 2.7 12.1
60 0 1.35 10
65 0 0 7.9
70 0 0 7.05
75 0 0 6.2
80 0 0 5.1
"""


def test_intensities_at_altitude_are_those_of_figure_7() -> None:
    """At the points of the figure and in the middle between them."""
    for line in FIGURE_7.strip().splitlines():
        altitude, *known = map(float, line.split())
        for level, intensity in zip(("light", "moderate", "severe"), known, strict=True):
            if intensity:
                found = scales_and_intensities(level, 1e3 * altitude, "dryden")
                assert found == ((1750.0,) * 3, pytest.approx((intensity,) * 3)), line
            else:
                with pytest.raises(BadInputError, match=f"no {level}"):
                    scales_and_intensities(level, 1e3 * altitude, "dryden")


def test_rates_in_moving_air_equal_still_air() -> None:
    """In moving and turning air, the rates equal those in still air at the same relative motion.

    The acceleration differs only by the rotation of the axes.
    """
    model = load_model("examples/uav.toml")
    gusty = in_gusts(model)
    x = np.array([33.0, 0.05, 0.03, 0.1, -0.2, 0.15, 0.3, 0.1, 0.0, 100.0])
    wind = np.array([2.0, -1.5, 0.7])
    turning = np.array([0.03, -0.02, 0.04])
    u = np.array([20.0, -0.05, 0.02, 0.01])
    ground = _velocity(x)
    through = ground - _rotation(x).T @ wind
    seen = x.copy()
    seen[0] = np.linalg.norm(through)
    seen[1:3] = np.arctan2(through[2], through[0]), np.arcsin(through[1] / seen[0])
    seen[3:6] += turning
    rates = _rates(gusty, x, u, [wind[0], wind[1], -wind[2], *turning])
    still = _rates(model, seen, u, [])
    step = 1e-6
    change = (_velocity(x + step * rates) - _velocity(x - step * rates)) / (2 * step)
    expected = (_velocity(seen + step * still) - _velocity(seen - step * still)) / (2 * step)
    omega = x[3:6]
    expected += np.cross(omega + turning, through) - np.cross(omega, ground)
    np.testing.assert_allclose(change, expected, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(rates[3:6], still[3:6], rtol=SAME_FORMULA)
    np.testing.assert_allclose(rates[6:], _rates(model, x, u, [])[6:], rtol=SAME_FORMULA)


def _rates(model, x, u, w):
    """Return the rates X' of a model as numbers."""
    import casadi as ca

    vectors = [[ca.SX(value) for value in vector] for vector in (x, u, model.p)]
    return np.array(ca.DM(model.layout.expressions(vectors, (), w)[0])).ravel()


def _velocity(x):
    """Return the velocity of an aircraft in body axes, (3,), computed from its state."""
    alpha, beta = x[1], x[2]
    along = np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)
    return x[0] * np.array(along)


def _rotation(x):
    """Return the rotation matrix from body to level axes at a state, (3, 3)."""
    roll, pitch = x[6], x[7]
    c, s = np.cos(roll), np.sin(roll)
    by_roll = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    c, s = np.cos(pitch), np.sin(pitch)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ by_roll


def test_gust_rates_act_as_angular_rates() -> None:
    """Gust rates p, q and r change the angular accelerations as angular rates of the aircraft do.

    The rates of the attitude angles do not change.
    """
    model = load_model("examples/uav.toml")
    gusty = in_gusts(model)
    point = hfa.trim(model)
    x, u = np.array(point.states), np.array(point.inputs)
    size = 1e-5
    still = _rates(model, x, u, [])
    for place in range(3):
        gust = np.zeros(6)
        gust[3 + place] = size
        turned = x.copy()
        turned[3 + place] += size
        by_gust = _rates(gusty, x, u, gust) - still
        by_turning = _rates(model, turned, u, []) - still
        np.testing.assert_allclose(by_gust[3:6], by_turning[3:6], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(by_gust[6:9], 0.0, atol=1e-15)
        assert abs(by_turning[6:9]).max() > 0.5 * size


def test_disturbances_of_a_flight_equal_the_random_ones() -> None:
    """The disturbances during a flight equal the random ones at the ticks, in the model's units.

    The linear prediction includes the disturbances. The report names the components without effect.
    """
    model = load_model("examples/gtm.py:GTM")
    point = hfa.trim(model)
    scenario = Scenario(
        duration=2.0, uncertainty=Uncertainty(turbulence=Turbulence("light", 100.0))
    )
    drawn = scenario.drawn(4, 0, point)
    flight = hfa.fly(model, point, scenario=drawn)
    assert drawn.gust.names == ("gust_forward", "updraft")
    for column, name in enumerate(drawn.gust.names):
        at_ticks = flight.flight.winds[name][:: drawn.steps_per_tick]
        np.testing.assert_allclose(at_ticks, drawn.gust.values[:201, column], atol=1e-12)
    sigma = 0.1 * 15 * 1852 / 3600
    assert drawn.gust.intensities[2] * 0.3048 == pytest.approx(sigma)
    assert flight.largest_difference_from_linear["alpha"] < 0.1 * flight.largest_deviation["alpha"]
    assert "turbulence without v, p, r: the equations have no such motion" in flight.title()
    assert "turbulence without q: the wing span is missing" in flight.title()


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        (
            "fly --turbulence light",
            "turbulence requires an explicit altitude, not the default of 40000 ft",
        ),
        ("fly --turbulence calm:3", "give LEVEL[:ALTITUDE[:SPAN]] with light, moderate, severe"),
        (
            "fly --turbulence 3:1750",
            "is '3:1750'; give LEVEL[:ALTITUDE[:SPAN]]",
        ),
        ("fly --turbulence own:3", "or own:SIGMA:SCALE[:SPAN]"),
        ("fly --turbulence light:-3", "is '-3'; give a finite number above 0"),
        ("fly --turbulence light:90000", "MIL-F-8785C covers only 10 to 80000 ft"),
        ("fly --aircraft examples/gtm.py:GTM --turbulence severe", "GTM has no state altitude"),
        ("fly --aircraft examples/pendulum.py:PENDULUM --turbulence light:9", "has no speed"),
    ],
)
def test_unusable_turbulence_options_are_refused(typed, said, capsys) -> None:
    """Missing or wrong values of --turbulence, and aircraft without the required states, are
    refused.
    """
    assert main(typed.split()) == 2
    assert said in capsys.readouterr().err


def test_a_users_turbulence_intensity_is_applied(capsys) -> None:
    """A user's turbulence intensity applies to u, v and w in the model's units.

    If a span is given, p, q and r are included. An altitude is refused in addition to an intensity.
    """
    typed = "fly --aircraft examples/uav.toml --turbulence own:2:300:2.9 --duration 0.1 --law none"
    main(typed.split())
    said = " ".join(capsys.readouterr().out.split())
    assert "of your own intensity (Dryden): u, v, w, p, q, r; intensity 2 m/s, scale 300 m" in said
    model = load_model("examples/uav.toml")
    air = Turbulence((2.0, 300.0), span=2.9).air(hfa.trim(model), 0.02, 10, 0)
    found = AirFilter.of(air)
    spread = np.sqrt(np.diag(found.C @ found.covariance @ found.C.T))
    np.testing.assert_allclose(0.3048 * spread[:3], 2.0, rtol=1e-9)
    in_feet = replace(air, turbulence=replace(air.turbulence, span=2.9 / 0.3048), feet=1.0)
    np.testing.assert_allclose(AirFilter.of(in_feet).C, found.C)
    np.testing.assert_allclose(AirFilter.of(in_feet).A, found.A)
    np.testing.assert_allclose(np.diag(air.factors), [*[0.3048] * 2, -0.3048, 1.0, 1.0, 1.0])
    for make, said in (
        (lambda: Turbulence((2.0, 300.0), 100.0), "does not depend on altitude; remove"),
        (lambda: Turbulence("mild", 100.0), "the level of turbulence is 'mild'"),
        (lambda: Turbulence("light", 100.0, spectrum="own"), "give dryden or karman"),
        (lambda: Turbulence("light", -100.0), "the altitude of turbulence is -100"),
        (lambda: Turbulence("light", 100.0, 0.0), "the span of turbulence is 0"),
        (lambda: Turbulence((0.0, 300.0)), "the intensity of turbulence is 0"),
        (lambda: Turbulence((2.0, np.nan)), "the scale of turbulence is nan"),
    ):
        with pytest.raises(BadInputError, match=said):
            make()


def test_a_level_is_that_of_its_altitude_in_feet() -> None:
    """Without an altitude, that of the trim applies, unless it is the default of the model."""
    model = load_model("examples/uav.toml")
    at_60 = hfa.trim(model, hold={"altitude": 60.0})
    air = Turbulence("light", span=2.9).air(at_60, 0.02, 10, 0)
    known = scales_and_intensities("light", 60.0 / 0.3048, "dryden")
    assert (air.lengths, air.intensities) == (known.lengths, known.intensities)
    assert air.altitude == air.trimmed_at == pytest.approx(60.0 / 0.3048)
    assert air.speed == pytest.approx(at_60.states.speed / 0.3048)
    given = Turbulence("light", 30.0).air(at_60, 0.02, 10, 0)
    assert given.altitude == pytest.approx(30.0 / 0.3048)
    assert set(given.taken) == set("uvw")
    with pytest.raises(BadInputError, match="requires an explicit altitude"):
        Turbulence("light").air(hfa.trim(model), 0.02, 10, 0)


def test_turbulence_uses_the_held_altitude(capsys) -> None:
    """A turbulence level without an altitude uses the altitude of --hold. The report states the
    altitude.
    """
    typed = "fly --aircraft examples/uav.toml --hold altitude=60 --turbulence karman-light::3"
    short = ("--law", "none", "--duration", "0.1")
    main([*typed.split(), *short])
    said = " ".join(capsys.readouterr().out.split())
    assert "light turbulence of MIL-F-8785C (von Karman) at 60 m: u, v, w, p, q, r;" in said
    main(["fly", "--turbulence", "light:500", *short])
    said = " ".join(capsys.readouterr().out.split())
    assert "at 500 ft (the trim is at 40,000 ft): u, w;" in said
