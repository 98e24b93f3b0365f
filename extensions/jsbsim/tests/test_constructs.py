"""Small jets that contain one unusual construct each, compared with JSBSim.

Either the model agrees with JSBSim, a note reports the difference, or the file is refused.
"""

import importlib.util
import json

import pytest

from hfa_jsbsim.accounting import DATA as ELEMENTS
from hfa_jsbsim.catalog import DATA as PROPERTIES, access
from studies.jsbsim.constructs import judge as judging
from studies.jsbsim.constructs.judge import ALL, compare_constructs, unused_slots

needs_jsbsim = pytest.mark.skipif(
    importlib.util.find_spec("jsbsim") is None, reason="JSBSim is not installed"
)
#: Constructs that an earlier reader ignored without a note.
QUICK = (
    "airframe: plain",
    "airframe: tank of grain",
    "airframe: external force of a function",
    "control: channel, execute 0",
    "control: sensor, quantization",
    "control: integrator of a rate",
    "functions: hysteresis limits, stalled",
    "properties: writes a point mass",
    "properties: writes atmosphere/wind-north-fps",
    "properties: reads simulation/frame",
    "properties: writes atmosphere/override/density",
    "control: gain, input of another tree",
    "control: property set twice",
    "control: second flight control",
    "control: gain, clip exchanged",
    "control: failure, zero",
    "control: switch, tab in a condition",
    "control: switch, test without value",
    "control: deadband, negative width",
    "control: function in ground_reactions",
    "functions: ln of a negative number",
    "functions: sqrt of a negative number",
    "functions: not of a small number",
    "functions: interpolate1d, unsorted",
    "functions: axes AXIAL and NORMAL",
    "functions: axes X, Y, Z, stability frame",
    "functions: moments, wind frame",
    "functions: force at the center of gravity",
    "airframe: turbine, function of another name",
    "airframe: propeller, fixed blades of constant speed",
    "airframe: propeller, fixed blades of a set angle",
    "airframe: nozzle that a system turns back",
    "airframe: turboprop without a power over speed",
    "airframe: turboprop without a largest power",
    "airframe: external moment of a direction that is set",
    "control: gain, input number",
    "control: lead lag, a coefficient missing",
    "control: integrator without a gain",
    "control: kinematic without times",
    "functions: atan2 of minus zero",
    "functions: value in another alphabet",
    "functions: table of rows over a further axis",
)


@needs_jsbsim
def test_unusual_constructs_agree_are_noted_or_are_refused(tmp_path):
    """Each unusual construct agrees with JSBSim, is reported in a note, or is refused.

    The test lists the expected verdict for each construct.
    """
    verdicts = {
        each.name.split(": ")[1]: each.verdict for each in compare_constructs(list(QUICK), tmp_path)
    }
    assert verdicts == {
        "plain": "agrees",
        "tank of grain": "agrees",
        "external force of a function": "agrees",
        "channel, execute 0": "agrees",
        "sensor, quantization": "refused",
        "integrator of a rate": "noted",
        "hysteresis limits, stalled": "agrees",
        "writes a point mass": "agrees",
        "writes atmosphere/wind-north-fps": "agrees",
        "reads simulation/frame": "refused",
        "writes atmosphere/override/density": "refused",
        "gain, input of another tree": "agrees",
        "property set twice": "agrees",
        "second flight control": "agrees",
        "gain, clip exchanged": "agrees",
        "failure, zero": "refused",
        "switch, tab in a condition": "refused",
        "switch, test without value": "refused",
        "deadband, negative width": "agrees",
        "function in ground_reactions": "agrees",
        "ln of a negative number": "agrees",
        "sqrt of a negative number": "agrees",
        "not of a small number": "agrees",
        "interpolate1d, unsorted": "agrees",
        "axes AXIAL and NORMAL": "agrees",
        "axes X, Y, Z, stability frame": "agrees",
        "moments, wind frame": "agrees",
        "force at the center of gravity": "agrees",
        "turbine, function of another name": "refused",
        "propeller, fixed blades of constant speed": "agrees",
        "propeller, fixed blades of a set angle": "agrees",
        "nozzle that a system turns back": "refused",
        "turboprop without a power over speed": "refused",
        "turboprop without a largest power": "refused",
        "external moment of a direction that is set": "agrees",
        "gain, input number": "refused",
        "lead lag, a coefficient missing": "refused",
        "integrator without a gain": "refused",
        "kinematic without times": "refused",
        "atan2 of minus zero": "refused",
        "value in another alphabet": "refused",
        "table of rows over a further axis": "refused",
    }


@needs_jsbsim
@pytest.mark.slow
def test_no_difference_remains_unreported(tmp_path):
    """None of at least 400 constructs differs from JSBSim without a note or a refusal.

    At least 290 constructs agree.
    """
    judgements = compare_constructs(list(ALL), tmp_path)
    wrong = [each for each in judgements if each.verdict in ("silent", "traceback")]
    assert not wrong
    assert len(judgements) >= 400
    assert sum(each.verdict == "agrees" for each in judgements) >= 290


@needs_jsbsim
def test_an_unreported_difference_is_detected(tmp_path, monkeypatch):
    """The comparison detects a reader that ignores a construct without a note (planted error)."""
    # Planted error: a reader that ignores the construct.
    monkeypatch.setattr(judging, "read_model", lambda path: read_without_its_construct(tmp_path))
    (judgement,) = compare_constructs(["functions: force at the center of gravity"], tmp_path)
    assert judgement.verdict == "silent"


def read_without_its_construct(folder):
    """Return the model of the plain jet instead of that in the folder, as a faulty reader would."""
    from hfa_jsbsim.reader import read_model

    path = folder / "aircraft" / "other" / "other.xml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(judging.jet({}))
    return read_model(str(path))


def test_every_placeholder_of_the_jet_is_used():
    """Every placeholder in the text of the jet is used by at least one construct."""
    assert not unused_slots()


def test_catalogs_list_jsbsim_properties_and_elements():
    """The catalogs list which properties can be read and set, and which elements JSBSim reads."""
    assert access("inertia/pointmass-weight-lbs[3]") == "RW"
    assert access("velocities/vc-kts") == "R"
    assert access("my/own") == ""
    by_hand = json.loads(ELEMENTS.read_text())
    assert "emptywt" in by_hand["elements"]["mass_balance"]["read"]
    assert by_hand["jsbsim"] == json.loads(PROPERTIES.read_text())["jsbsim"]
