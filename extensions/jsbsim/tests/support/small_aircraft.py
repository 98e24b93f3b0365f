"""XML files of a small glider for the tests, made of parts of the small jet."""

import importlib.util

import pytest
from constructs.jet import AIR, SURFACES, coefficient, slope

needs_jsbsim = pytest.mark.skipif(
    importlib.util.find_spec("jsbsim") is None, reason="JSBSim is not installed"
)

METRICS = """<metrics>
 <wingarea unit="FT2"> 150 </wingarea> <wingspan unit="FT"> 30 </wingspan> <chord unit="FT"> 5 </chord>
 <location name="AERORP" unit="IN"> <x> 0 </x> <y> 0 </y> <z> 0 </z> </location>
</metrics>
<mass_balance>
 <ixx unit="SLUG*FT2"> 1000 </ixx> <iyy unit="SLUG*FT2"> 1200 </iyy> <izz unit="SLUG*FT2"> 2000 </izz>
 <emptywt unit="LBS"> 1500 </emptywt>
 <location name="CG" unit="IN"> <x> 0 </x> <y> 0 </y> <z> 0 </z> </location>
</mass_balance>"""
CONTROL = f'<flight_control name="stick">\n{SURFACES}</flight_control>'


def force(axis, *terms, length=""):
    """Return an XML <axis> whose value is dynamic pressure times area times the sum of the terms.

    length: property of a length by which the value of a moment is multiplied
    """
    return f'<axis name="{axis}"> {coefficient(*terms, length=length)} </axis>'


LIFT = force("LIFT", slope(5.0, "aero/alpha-rad"))
PITCH = force(
    "PITCH",
    slope(-1.0, "aero/alpha-rad"),
    slope(-0.5, "velocities/q-aero-rad_sec"),
    slope(-1.0, "fcs/elevator-pos-rad"),
    length="cbarw-ft",
)
REST = force("DRAG", "<v>0.03</v>", slope(0.05, "aero/cl-squared")) + PITCH
REST += "".join(f'<axis name="{name}"> {AIR[name]} </axis>' for name in ("SIDE", "ROLL", "YAW"))


def glider(aerodynamics=LIFT + REST, control=CONTROL, more=""):
    """Return the XML text of a glider.

    aerodynamics, control: content of these sections
    more: further sections
    """
    return (
        f'<?xml version="1.0"?>\n<fdm_config name="glider" version="2.0">\n{METRICS}\n{more}\n'
        f"{control}\n<aerodynamics>\n{aerodynamics}\n</aerodynamics>\n</fdm_config>\n"
    )


def written(folder, text, name="glider"):
    """Write an aircraft file with this text and return its path."""
    path = folder / "aircraft" / name / f"{name}.xml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return str(path)


def with_elevator(component):
    """Return the text of the glider with another component in place of the elevator's gain."""
    start = CONTROL.index('  <pure_gain name="Elevator')
    end = CONTROL.index('  <pure_gain name="Aileron')
    return glider(control=CONTROL[:start] + component + CONTROL[end:])
