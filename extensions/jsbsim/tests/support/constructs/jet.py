"""The file of a small JSBSim jet, in which a construct replaces some slots.

A construct is a dictionary slot -> XML.
"""

#: Slot -> its content in the plain jet.
SLOTS = {
    "head": "",
    "metrics": "",
    "reference": "<x> 0 </x> <y> 0 </y> <z> 0 </z>",
    "mass_attributes": "",
    "mass": '<emptywt unit="LBS"> 3000 </emptywt>',
    "propulsion": "",
    "engine": "",
    "turbine": '<milthrust unit="LBS"> 2000 </milthrust> <idlen1>30</idlen1> <maxn1>100</maxn1>',
    "shares": (
        '<function name="IdleThrust"> <v>0.05</v> </function>'
        ' <function name="MilThrust"> <v>0.9</v> </function>'
    ),
    "engine_kind": "",
    "thruster": "<direct/>",
    "thruster_place": (
        '<location unit="IN"> <x> 10 </x> <y> 3 </y> <z> 5 </z> </location>'
        ' <orient unit="DEG"> <roll> 0 </roll> <pitch> 2 </pitch> <yaw> 0 </yaw> </orient>'
    ),
    "tank": '<contents unit="LBS"> 500 </contents>',
    "tanks": "",
    "control": "",
    "channels": "",
    "air": "",
    "axes": "",
    "lift": "",
    "pitch": "",
    "lift_axis": 'name="LIFT"',
    "drag_axis": 'name="DRAG"',
    "side_axis": 'name="SIDE"',
    "moment_frame": "",
    "wheels": "",
    "sections": "",
}
_ENGINE = "<turbine_engine> {turbine} {shares} </turbine_engine>"
#: The channel that moves the surfaces.
SURFACES = """ <channel name="surfaces">
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
"""
_JET = """<?xml version="1.0"?>
<fdm_config name="jet" version="2.0">
{head}
<metrics>
 <wingarea unit="FT2"> 150 </wingarea> <wingspan unit="FT"> 30 </wingspan>
 <chord unit="FT"> 5 </chord>
 <location name="AERORP" unit="IN"> {reference} </location>
 {metrics}
</metrics>
<mass_balance {mass_attributes}>
 <ixx unit="SLUG*FT2"> 1000 </ixx> <iyy unit="SLUG*FT2"> 1200 </iyy>
 <izz unit="SLUG*FT2"> 2000 </izz>
 <location name="CG" unit="IN"> <x> 1 </x> <y> 0.5 </y> <z> 2 </z> </location>
 {mass}
</mass_balance>
<ground_reactions> {wheels} </ground_reactions>
<propulsion>
 {propulsion}
 <engine>
  {engine_kind}
  <feed>0</feed>
  {engine}
  <thruster> {thruster_place} {thruster} </thruster>
 </engine>
 <tank type="FUEL">
  <location unit="IN"> <x> 4 </x> <y> 6 </y> <z> -3 </z> </location>
  <capacity unit="LBS"> 1000 </capacity>
  {tank}
 </tank>
 {tanks}
</propulsion>
<flight_control name="FCS">
 {control}
{SURFACES} {channels}
</flight_control>
{sections}
<aerodynamics>
 {air}
 {axes}
 <axis {lift_axis}> {lift} {LIFT} </axis>
 <axis {drag_axis}> {DRAG} </axis>
 <axis {side_axis}> {SIDE} </axis>
 <axis name="ROLL"{moment_frame}> {ROLL} </axis>
 <axis name="PITCH"{moment_frame}> {pitch} {PITCH} </axis>
 <axis name="YAW"{moment_frame}> {YAW} </axis>
</aerodynamics>
</fdm_config>
"""


def coefficient(*terms, length=""):
    """Return the XML of the function q S length (sum of the terms).

    Without `length`, the XML is that of q S (sum of the terms).

    terms: XML of each term
    length: property of the reference length without "metrics/", such as cbarw-ft
    """
    arm = f"<p>metrics/{length}</p>" if length else ""
    body = "".join(terms)
    size = f"<p>aero/qbar-psf</p> <p>metrics/Sw-sqft</p> {arm}"
    return f"<function> <product> {size} <sum> <v>0</v> {body} </sum> </product> </function>"


def slope(value, name):
    """Return the XML of the product of a number and a property."""
    return f"<product> <v>{value}</v> <p>{name}</p> </product>"


#: Axis -> its function.
AIR = {
    "LIFT": coefficient("<v>0.3</v>", slope(5.0, "aero/alpha-rad")),
    "DRAG": coefficient("<v>0.03</v>", slope(0.5, "aero/alpha-rad")),
    "SIDE": coefficient(slope(-0.5, "aero/beta-rad")),
    "ROLL": coefficient(
        slope(-0.1, "aero/beta-rad"),
        slope(-0.1, "velocities/p-aero-rad_sec"),
        slope(0.1, "fcs/left-aileron-pos-rad"),
        length="bw-ft",
    ),
    "PITCH": coefficient(
        slope(-0.5, "aero/alpha-rad"),
        slope(-0.5, "velocities/q-aero-rad_sec"),
        slope(-1.0, "fcs/elevator-pos-rad"),
        length="cbarw-ft",
    ),
    "YAW": coefficient(
        slope(0.1, "aero/beta-rad"),
        slope(-0.1, "velocities/r-aero-rad_sec"),
        slope(-0.1, "fcs/rudder-pos-rad"),
        length="bw-ft",
    ),
}


def jet(slots):
    """Return the XML file of the jet, with the content of some slots replaced."""
    filled = SLOTS | {"engine_kind": _ENGINE} | dict(slots)
    filled["engine_kind"] = filled["engine_kind"].format(**filled)
    return _JET.format(**filled, **AIR, SURFACES=SURFACES)


def component(text, name="fcs/probe"):
    """Return a construct with a component in a channel, which affects the pitching moment.

    text: XML of the component
    name: property on which the pitching moment depends
    """
    return {
        "channels": f'<channel name="construct"> {text} </channel>',
        "pitch": pitching(name),
    }


def pitching(name):
    """Return the XML of a pitching moment proportional to a property."""
    return coefficient(slope(0.1, name), length="cbarw-ft")


def function(text):
    """Return a construct with a pitching moment proportional to a function.

    text: XML of the function
    """
    return {"pitch": coefficient(f"<product> <v>0.1</v> {text} </product>", length="cbarw-ft")}


def reading(name, scale=1.0):
    """Return a construct with a pitching moment proportional to a property.

    scale: typical magnitude of the property
    """
    return {"pitch": coefficient(slope(0.1 / scale, name), length="cbarw-ft")}


def writing(name, value, more=""):
    """Return a construct with a component that writes a number to a property of JSBSim.

    more: further XML in the channel
    """
    text = f'<fcs_function name="w"> <function> <v>{value}</v> </function>'
    output = f"<output>{name}</output> </fcs_function>"
    return {"channels": f'<channel name="construct"> {text} {output} {more} </channel>'}
