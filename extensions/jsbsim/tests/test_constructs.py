"""Small jets that contain one unusual construct each, compared with JSBSim.

Either the model agrees with JSBSim, a note reports the difference, or the file is refused.
"""

import importlib.util

import pytest
from constructs import judge as judging
from constructs.judge import ALL, compare_constructs

import hfa

needs_jsbsim = pytest.mark.skipif(
    importlib.util.find_spec("jsbsim") is None, reason="JSBSim is not installed"
)
#: Constructs -> verdict of the comparison; those of `MORE` are compared in the slow tests.
QUICK = {
    "airframe: external force, frame LOCAL": "agrees",
    "control: integrator of a rate": "noted",
    "control: kinematic": "agrees",
    "functions: table beyond its end": "agrees",
    "properties: writes a point mass": "agrees",
    "control: sensor, quantization": "refused",
    "control: kinematic, falling detents": "refused",
    "functions: value nan": "refused",
}
MORE = {
    "airframe: plain": "agrees",
    "airframe: external force of a function": "agrees",
    "airframe: propeller, Mach": "agrees",
    "control: channel, execute 0": "agrees",
    "control: angle": "agrees",
    "control: distributor, exclusive tests": "agrees",
    "control: distributor without a value": "refused",
    "properties: writes atmosphere/override/density": "refused",
    "control: second flight control": "agrees",
    "control: failure, zero": "refused",
    "functions: interpolate1d, unsorted": "agrees",
    "functions: axes X, Y, Z, stability frame": "agrees",
    "functions: force at the center of gravity": "agrees",
    "airframe: propeller, fixed blades of a set angle": "agrees",
    "airframe: turboprop without a largest power": "refused",
    "control: lead lag, a coefficient missing": "refused",
    "functions: atan2 of minus zero": "refused",
    "functions: unknown operation": "refused",
    "functions: value of two lines": "refused",
    "functions: table unsorted": "refused",
    "airframe: tank, overfull": "refused",
    "airframe: point mass, cube": "refused",
    "control: pid, kp and ki of a rate": "noted",
    "control: pid, trigger": "noted",
    "control: pid, standard with ki": "noted",
    "control: switch, number before the sign": "refused",
    "control: lag filter that stays": "refused",
    "control: gain, empty": "refused",
    "control: switch, tab in a condition": "refused",
}
MORE |= dict.fromkeys(
    [
        "functions: pow",
        "functions: fmod",
        "functions: ifthen",
        "functions: table of three",
        "functions: rounded",
        "airframe: tank with radius",
        "airframe: inertia in kg m2",
        "control: lag filter",
        "control: washout filter",
        "control: aerosurface scale, domain",
        "control: switch, two tests",
        "control: gyro",
    ],
    "agrees",
)
MORE |= dict.fromkeys(
    [
        "functions: sum",
        "functions: product",
        "functions: difference",
        "functions: quotient",
        "functions: avg",
        "functions: min",
        "functions: max",
        "functions: atan2",
        "functions: lt",
        "functions: ge",
        "functions: eq",
        "functions: nq",
        "functions: and",
        "functions: or",
        "functions: abs",
        "functions: asin",
        "functions: acos",
        "functions: atan",
        "functions: exp",
        "functions: ln",
        "functions: log2",
        "functions: log10",
        "functions: floor",
        "functions: ceil",
        "functions: integer",
        "functions: fraction",
        "functions: sign",
        "functions: toradians",
        "functions: todegrees",
        "functions: not",
        "functions: pi",
        "functions: switch function",
        "functions: interpolate1d",
        "functions: table of rows",
        "functions: table of two",
        "combined: functions: table of three, other breakpoints",
        "airframe: point mass, tube",
        "airframe: point mass, cylinder",
        "airframe: point mass, sphere",
        "airframe: point mass, ball",
        "airframe: point mass with inertia",
        "airframe: point mass in kg and m",
        "airframe: tank with inertia factor",
        "airframe: tank of grain",
        "airframe: tank, unusable volume",
        "airframe: tank, fuel",
        "airframe: tank, drain",
        "airframe: weight in kg",
        "airframe: turbine in newtons",
        "control: lag filter of a rate",
        "control: lead lag filter",
        "control: second order filter",
        "control: washout of the stick",
        "control: pid, pvdot",
        "control: sensor, bias and gain",
        "control: summer, bias",
        "control: gain of a property",
        "control: deadband",
        "control: deadband, gain",
        "control: kinematic, middle detent",
        "control: scheduled gain, gain",
        "control: aerosurface scale, not centered",
        "control: switch, OR",
        "control: switch, no default",
        "control: actuator, bias",
        "control: actuator, deadband",
        "control: function of an input",
    ],
    "agrees",
)


@needs_jsbsim
def test_unusual_constructs_agree_are_noted_or_are_refused(tmp_path):
    """Each unusual construct agrees with JSBSim, is reported in a note, or is refused."""
    judged = compare_constructs(list(QUICK), tmp_path)
    assert {each.name: each.verdict for each in judged} == QUICK


@needs_jsbsim
@pytest.mark.slow
def test_no_difference_remains_unreported(tmp_path):
    """None of at least 400 constructs differs from JSBSim without a note or a refusal.

    At least 290 constructs agree, those of `MORE` among them.
    """
    verdicts = {each.name: each.verdict for each in compare_constructs(list(ALL), tmp_path)}
    assert not {"silent", "traceback"} & {*verdicts.values()}
    assert verdicts.items() >= (QUICK | MORE).items()
    assert len(verdicts) >= 400
    assert list(verdicts.values()).count("agrees") >= 290


@needs_jsbsim
def test_an_unreported_difference_is_detected(tmp_path, monkeypatch):
    """The comparison detects a reader that ignores a construct without a note (planted error)."""
    # Planted error: a reader that ignores the construct.
    monkeypatch.setattr(judging, "read_model", lambda path: read_without_its_construct(tmp_path))
    (judgement,) = compare_constructs(["functions: force at the center of gravity"], tmp_path)
    assert judgement.verdict == "silent"


def read_without_its_construct(folder):
    """Return the model of the plain jet instead of that in the folder, as a faulty reader would."""
    path = folder / "aircraft" / "other" / "other.xml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(judging.jet({}))
    return hfa.load_model(str(path))
