"""Trims of JSBSim's aircraft, and the reasons reported if no trim exists."""

import re

import pytest
from cli import assert_refused, hfa as run
from small_aircraft import glider, needs_jsbsim, written

from hfa import BadInputError, linearize, load_model, trim


@needs_jsbsim
def test_a_calibrated_airspeed_has_its_impact_pressure():
    """The impact pressure of a speed at 20,000 ft is that of its calibrated airspeed at sea level.

    Source: the formulas of Saint-Venant and Rayleigh, below and above Mach 1.
    """

    def ratio(mach):
        """Return impact pressure over static pressure."""
        if mach < 1.0:
            return (1.0 + 0.2 * mach**2) ** 3.5 - 1.0
        return 166.92158 * mach**7 / (7.0 * mach**2 - 1.0) ** 2.5 - 1.0

    model = load_model("jsbsim:f16")
    at = {name: signal.start for name, signal in model.states.items()}
    inputs = [signal.start for signal in model.inputs.values()]
    for mach in (0.5, 2.0):
        at |= {"altitude": 20000.0, "speed": mach * 1036.93}
        found = model.outputs_at(list(at.values()), inputs)
        assert found["mach"] == pytest.approx(mach, rel=1e-4)
        # Pressures of the standard atmosphere at sea level and at 20,000 ft, lb/ft^2, and speeds of
        # sound, 1116.45 and 1036.93 ft/s.
        impact = 2116.22 * ratio(found["kcas"] * 1.6878099 / 1116.45)
        assert impact == pytest.approx(973.27 * ratio(mach), rel=2e-4)


@needs_jsbsim
def test_the_linear_model_contains_the_propeller_mode():
    """The propeller has a mode beside those of the airframe. Its eigenvalue is the slope of the
    propeller's acceleration with its speed, within 2 %.
    """
    model = load_model("jsbsim:c172p")
    point = trim(model, kcas=90.0, altitude=5000.0)
    modes = {mode.name: mode.eigenvalue for mode in linearize(model, point).modes}
    airframe = {"phugoid", "dutch roll", "short period", "roll", "spiral"}
    assert modes.keys() == airframe | {"propeller 0"}
    ahead, behind = (
        model.rates_at(point.states._replace(rpm0=point.states.rpm0 + step), point.inputs)["rpm0"]
        for step in (0.1, -0.1)
    )
    assert modes["propeller 0"] == pytest.approx((ahead - behind) / 0.2, rel=0.02)


@needs_jsbsim
def test_a_governed_propeller_trims_at_lowest_blade_angle():
    """At 110 kt, the governor of the Cessna 182 holds 2400 rpm. At 60 kt, with the blades at their
    lowest angle, the propeller turns slower.
    """
    model = load_model("jsbsim:c182")
    fast = trim(model, kcas=110.0, altitude=5000.0)
    slow = trim(model, kcas=60.0, altitude=1000.0)
    assert fast.states.rpm0 == pytest.approx(2400.0)
    assert slow.states.rpm0 < 2400.0
    assert slow.states.blade0 == pytest.approx(model.states["blade0"].min, abs=1e-9)


@needs_jsbsim
@pytest.mark.parametrize(
    ("name", "held", "reason"),
    [
        (
            "f104",  # its afterburner
            {"kcas": 250.0, "altitude": 20000.0},
            r"at throttle 0\.99 the thrust jumps from 2 lbf too small to 48\d\d lbf too large \(5181 lbf",
        ),
        ("sgs126", {"kcas": 50.0, "gamma": -1.0}, r"speed, which .* \(gamma -2\.307\d* deg\)"),
        pytest.param(
            "mk82",
            {"kcas": 200.0, "altitude": 5000.0},
            "no free input changes pitch_rate",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "fokker50",
            {"kcas": 130.0, "altitude": 5000.0},
            r"at full throttle the thrust is 10\d\d lbf too small \(11\d\d lbf from 2 x 14\d hp\)",
            marks=pytest.mark.slow,
        ),
        (
            "C130",
            {"kcas": 160.0, "altitude": 8000.0},
            r"4 x 13 hp\) .*; check: t56 is a turbine engine on a propeller; its thrust is interpreted",
        ),
    ],
)
def test_missing_trims_are_explained(name, held, reason):
    """The line on a condition without a trim states its physical reason, such as missing thrust."""
    message = explained_failure(f"jsbsim:{name}", **held)
    assert re.search(f"no trim: .*{reason}", message)


def explained_failure(aircraft, *options, **held):
    """Return the line on standard error, with reasons, for a condition without a trim.

    held: imposed values
    """
    words = [word for name, value in held.items() for word in ("--hold", f"{name}={value}")]
    done = run("trim", "--aircraft", aircraft, *words, *options)
    assert done.code == 1
    (line,) = done.err.strip().splitlines()
    return line


@needs_jsbsim
def test_an_empty_tank_is_noted():
    """The tank of the X-15 is empty in its file: a warning says so, and the trim is a steep glide."""
    model = load_model("jsbsim:X15")
    assert any("tank of" in text and "the trim is a glide" in text for text in model.warnings)
    point = trim(model)
    assert (point["throttle"], point["thrust"]) == (0.0, 0.0)
    assert point["gamma"] < -0.1


@pytest.mark.parametrize(
    ("speed", "reason"),
    [
        pytest.param(15.0, r"the greatest lift is 3 % of the weight", marks=pytest.mark.slow),
        (60.0, r"the pitching moment is not balanced at either end of elevator: -31\.2"),
    ],
)
def test_missing_lift_is_explained(speed, reason, tmp_path):
    """At 15 ft/s, the greatest lift of the glider is below its weight. At 60 ft/s it is above the weight,
    but the elevator cannot balance the pitching moment at the alpha that this lift requires: its
    coefficient -alpha - elevator is 0 up to alpha 17 deg (.3 rad).
    """
    aircraft = written(tmp_path, glider())
    assert re.search(reason, explained_failure(aircraft, "--units", "si", speed=0.3048 * speed))


def test_aircraft_are_found_by_name_in_the_folder_of_jsbsim(monkeypatch, tmp_path):
    """An aircraft in the folder $JSBSIM_ROOT is read by its name. JSBSim's name vc-kts is accepted for its
    signal kcas.

    A folder without aircraft is refused; an unknown name is refused with those that exist.
    """
    monkeypatch.setenv("JSBSIM_ROOT", str(tmp_path))
    with pytest.raises(BadInputError, match="which contains no folder named aircraft"):
        load_model("jsbsim:737")
    written(tmp_path, glider())
    with pytest.raises(BadInputError, match="JSBSim has no aircraft '737'; choose from glider"):
        load_model("jsbsim:737")
    with pytest.raises(BadInputError, match="'Glyder'; did you mean glider"):
        load_model("jsbsim:Glyder")
    model = load_model("jsbsim:glider")
    assert (model.name, model.about.aliases["vc-kts"]) == ("glider", "kcas")


@needs_jsbsim
def test_a_lever_is_a_share_of_its_travel_or_an_angle():
    """The flaps of the Cessna 172 are at 30 deg for the lever at 1, and may be given as an angle.

    The sheet of a trim has the position of the lever, and the angle in a note.
    """
    plane = load_model("jsbsim:c172p")
    assert plane.number("flap", "10 deg") == pytest.approx(1.0 / 3.0, rel=1e-12)
    assert plane.with_parameters(flap="30 deg").parameters["flap"].start == 1.0  # not beyond it
    extended = plane.with_parameters(flap="10 deg")
    row = trim(extended).sheet["flap"]
    assert row.value == pytest.approx(1.0 / 3.0, rel=1e-12)
    assert row.note.startswith("10 of 30 deg")


@needs_jsbsim
@pytest.mark.parametrize(
    ("aircraft", "held", "said"),
    [
        ("737", "flap=15", "flap is 15; give at most 1"),
        ("737", "flap=15deg", "give a number without a unit from 0 to 1"),
        ("737", "pitch_trim=-2", "pitch_trim is -2; give at least -1"),
        ("c172p", "flap=20", "give at most 1, or an angle: flap=30deg"),
        ("c172p", "tank0=1e6", "tank0 is 1e+06 lbf; give at most 185 lbf"),
        ("c172p", "engine0=2", "engine0 is 2; give at most 1"),
        ("c182", "feather0=-1", "feather0 is -1; give at least 0"),
    ],
)
def test_a_parameter_beyond_its_limits_is_refused(aircraft, held, said):
    """`hfa trim --hold NAME=VALUE` beyond a limit has exit code 2, and names the limit."""
    assert_refused(run("trim", "--aircraft", f"jsbsim:{aircraft}", "--hold", held), 2, said)
