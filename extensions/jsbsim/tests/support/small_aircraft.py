"""A small aircraft as an XML file, written by the tests."""

from pathlib import Path

METRICS = """<metrics>
 <wingarea unit="FT2"> 150 </wingarea> <wingspan unit="FT"> 30 </wingspan> <chord unit="FT"> 5 </chord>
 <location name="AERORP" unit="IN"> <x> 0 </x> <y> 0 </y> <z> 0 </z> </location>
</metrics>
<mass_balance>
 <ixx unit="SLUG*FT2"> 1000 </ixx> <iyy unit="SLUG*FT2"> 1200 </iyy> <izz unit="SLUG*FT2"> 2000 </izz>
 <emptywt unit="LBS"> 1500 </emptywt>
 <location name="CG" unit="IN"> <x> 0 </x> <y> 0 </y> <z> 0 </z> </location>
</mass_balance>"""
CONTROL = """<flight_control name="stick">
 <channel name="all">
  <pure_gain name="Elevator Gain">
   <input>fcs/elevator-cmd-norm</input> <gain>0.3</gain> <output>fcs/elevator-pos-rad</output>
  </pure_gain>
  <pure_gain name="Aileron Gain">
   <input>fcs/aileron-cmd-norm</input> <gain>0.3</gain> <output>fcs/left-aileron-pos-rad</output>
  </pure_gain>
  <pure_gain name="Rudder Gain">
   <input>fcs/rudder-cmd-norm</input> <gain>0.3</gain> <output>fcs/rudder-pos-rad</output>
  </pure_gain>
 </channel>
</flight_control>"""


def force(axis: str, *terms: str, head: str = "<p>aero/qbar-psf</p> <p>metrics/Sw-sqft</p>") -> str:
    """An axis whose force is dynamic pressure times area times the sum of the terms."""
    body = "".join(terms)
    product = f"<product> {head} <sum> {body} <v>0</v> </sum> </product>"
    return f'<axis name="{axis}"> <function> {product} </function> </axis>'


def slope(value: float, name: str) -> str:
    """value * property."""
    return f"<product> <v>{value}</v> <p>{name}</p> </product>"


_SPAN = "<p>aero/qbar-psf</p> <p>metrics/Sw-sqft</p> <p>metrics/bw-ft</p>"
_CHORD = "<p>aero/qbar-psf</p> <p>metrics/Sw-sqft</p> <p>metrics/cbarw-ft</p>"
LIFT = force("LIFT", slope(5.0, "aero/alpha-rad"))
REST = "".join(
    [
        force("DRAG", "<v>0.03</v>", slope(0.05, "aero/cl-squared")),
        force("SIDE", slope(-0.5, "aero/beta-rad")),
        force(
            "ROLL",
            slope(-0.1, "aero/beta-rad"),
            slope(-0.1, "velocities/p-aero-rad_sec"),
            slope(0.1, "fcs/left-aileron-pos-rad"),
            head=_SPAN,
        ),
        force(
            "PITCH",
            slope(-1.0, "aero/alpha-rad"),
            slope(-0.5, "velocities/q-aero-rad_sec"),
            slope(-1.0, "fcs/elevator-pos-rad"),
            head=_CHORD,
        ),
        force(
            "YAW",
            slope(0.1, "aero/beta-rad"),
            slope(-0.1, "velocities/r-aero-rad_sec"),
            slope(-0.1, "fcs/rudder-pos-rad"),
            head=_SPAN,
        ),
    ]
)


def glider(aerodynamics: str = LIFT + REST, control: str = CONTROL, more: str = "") -> str:
    """The text of a glider's file."""
    return (
        f'<?xml version="1.0"?>\n<fdm_config name="glider" version="2.0">\n{METRICS}\n{more}\n'
        f"{control}\n<aerodynamics>\n{aerodynamics}\n</aerodynamics>\n</fdm_config>\n"
    )


def written(folder: Path, text: str, name: str = "glider") -> str:
    """The path of an aircraft's file with this text."""
    path = folder / "aircraft" / name / f"{name}.xml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return str(path)
