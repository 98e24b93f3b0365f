"""Small jets that contain one unusual construct each, compared with JSBSim.

Either the model agrees with JSBSim, a note reports the difference, or the file is refused.
"""

import pytest
from constructs import judge as judging
from constructs.judge import ALL, compare_constructs
from small_aircraft import needs_jsbsim

import hfa

#: Constructs -> verdict of the comparison; all others are compared in the slow test.
QUICK = {
    "airframe: external force, frame LOCAL": "agrees",
    "control: integrator of a rate": "agrees",
    "airframe: propeller, Mach": "agrees",
    "airframe: propeller, sense": "agrees",
    "airframe: nozzle": "agrees",
    "airframe: tank, drain": "agrees",
    "airframe: tank, priority 0": "agrees",
    "control: aerosurface scale, domain": "agrees",
    "control: channel, execute 0": "agrees",
    "control: distributor": "refused",
    "control: gain, clip exchanged": "agrees",
    "control: latch": "agrees",
    "control: latch by its own test": "agrees",
    "control: loop that settles": "agrees",
    "control: loop that toggles": "noted",
    "control: switch by a constant": "agrees",
    "control: switch, two tests": "agrees",
    "functions: moments, stability frame": "agrees",
    "functions: nq": "agrees",
    "functions: table of three": "agrees",
    "functions: toradians": "agrees",
    "properties: reads fcs/elevator-pos-deg": "agrees",
    "properties: reads velocities/psidot-rad_sec": "agrees",
    "airframe: two turbines with functions of one name": "agrees",
    "airframe: piston, friction set by a component": "agrees",
    "airframe: piston, oil pressure set by a component": "agrees",
    "control: kinematic, falling detents": "refused",
    "functions: value nan": "refused",
    "airframe: inertia products, not negated": "agrees",
}


@needs_jsbsim
def test_unusual_constructs_agree_are_noted_or_are_refused(tmp_path):
    """Of a jet with one unusual construct, the accelerations agree with JSBSim, or a note reports
    the construct, or the file is refused, as listed in `QUICK`.
    """
    judged = compare_constructs(list(QUICK), tmp_path)
    assert {each.name: each.verdict for each in judged} == QUICK


@needs_jsbsim
@pytest.mark.slow
def test_no_difference_remains_unreported(tmp_path):
    """No construct has the verdict "silent", a difference from JSBSim without a note, or "traceback", an
    unexpected error. At least 70 % agree.
    """
    verdicts = [each.verdict for each in compare_constructs(list(ALL), tmp_path)]
    assert not {"silent", "traceback"} & {*verdicts}
    assert verdicts.count("agrees") >= 0.7 * len(ALL)


@needs_jsbsim
def test_an_unreported_difference_is_detected(tmp_path, monkeypatch):
    """The comparison gives the verdict "silent" if the reader ignores a construct without a note, as the
    planted one does: it returns the model of the jet without the construct.
    """
    monkeypatch.setattr(judging, "read_model", lambda path: read_without_its_construct(tmp_path))
    (judgement,) = compare_constructs(["functions: force at the center of gravity"], tmp_path)
    assert judgement.verdict == "silent"


def read_without_its_construct(folder):
    """Return the model of the plain jet instead of that in the folder, as a faulty reader would."""
    path = folder / "aircraft" / "other" / "other.xml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(judging.jet({}))
    return hfa.load_model(str(path))
