"""Small jets that contain one unusual construct each, compared with JSBSim.

Either the model agrees with JSBSim, a note reports the difference, or the file is refused.
"""

import importlib.util
import json

import pytest

from hfa_jsbsim.accounting import DATA as ELEMENTS
from hfa_jsbsim.catalog import DATA as PROPERTIES, access
from studies.jsbsim.constructs import judge as judging
from studies.jsbsim.constructs.judge import ALL, compare_constructs

needs_jsbsim = pytest.mark.skipif(
    importlib.util.find_spec("jsbsim") is None, reason="JSBSim is not installed"
)
#: Constructs of each kind -> verdict of the comparison.
QUICK = {
    "airframe: plain": "agrees",
    "airframe: external force of a function": "agrees",
    "airframe: external force, frame LOCAL": "agrees",
    "airframe: propeller, Mach": "agrees",
    "control: channel, execute 0": "agrees",
    "control: sensor, quantization": "refused",
    "control: integrator of a rate": "noted",
    "control: angle": "agrees",
    "control: distributor, exclusive tests": "agrees",
    "control: distributor without a value": "refused",
    "properties: writes a point mass": "agrees",
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
}


@needs_jsbsim
def test_unusual_constructs_agree_are_noted_or_are_refused(tmp_path):
    """Each unusual construct agrees with JSBSim, is reported in a note, or is refused."""
    judged = compare_constructs(list(QUICK), tmp_path)
    assert {each.name: each.verdict for each in judged} == QUICK


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


def test_catalogs_list_jsbsim_properties_and_elements():
    """The catalogs list which properties can be read and set, and which elements JSBSim reads."""
    assert access("inertia/pointmass-weight-lbs[3]") == "RW"
    assert access("velocities/vc-kts") == "R"
    assert access("my/own") == ""
    by_hand = json.loads(ELEMENTS.read_text())
    assert "emptywt" in by_hand["elements"]["mass_balance"]["read"]
    assert by_hand["jsbsim"] == json.loads(PROPERTIES.read_text())["jsbsim"]
