"""Constructs for the dimensions, mass, tanks, engines and other sections of a JSBSim file."""

from constructs.jet import SLOTS, pitching, writing

_EMPTY = SLOTS["mass"]
_TURBINE = SLOTS["turbine"]
_SHARES = SLOTS["shares"]
_PLACE = '<location unit="IN"> <x> 20 </x> <y> -4 </y> <z> 6 </z> </location>'


def _mass(text, attributes=""):
    """Return the slots of a construct with this text in <mass_balance>."""
    return {"mass": f"{_EMPTY} {text}", "mass_attributes": attributes}


def _point(text):
    """Return the slots of a construct with a point mass."""
    return _mass(
        f'<pointmass name="load"> <weight unit="LBS"> 300 </weight> {_PLACE} {text} </pointmass>'
    )


def _tank(text):
    """Return the slots of a construct with this text in its tank."""
    return {"tank": f"{SLOTS['tank']} {text}"}


def _second_tank(text, kind="FUEL", feed="<feed>1</feed>"):
    """Return the slots of a construct with a second tank."""
    return {
        "engine": feed,
        "tanks": (
            f'<tank type="{kind}"> {_PLACE} <capacity unit="LBS"> 800 </capacity> {text} </tank>'
        ),
    }


def _turbine(text):
    """Return the slots of a construct with this text in its turbine."""
    return {"turbine": f"{_TURBINE} {text}"}


def _external(text):
    """Return the slots of a construct with external forces or moments."""
    return {"sections": f"<external_reactions> {text} </external_reactions>"}


_FORCE_PLACE = '<location unit="IN"> <x> 20 </x> <y> 0 </y> <z> 3 </z> </location>'
_DIRECTION = "<direction> <x>-1</x> <y>0</y> <z>0</z> </direction>"
_ROCKET = (
    '<rocket_engine> <isp>250</isp> <propflowmax unit="LBS/SEC"> 5 </propflowmax>'
    " <minthrottle>0.1</minthrottle> <maxthrottle>1</maxthrottle> {} </rocket_engine>"
)
_GRAIN = (
    '<grain_config type="CYLINDRICAL"> <length unit="IN"> 60 </length>'
    ' <bore_diameter unit="IN"> 4 </bore_diameter> </grain_config> <radius unit="IN"> 10 </radius>'
)
_ONE = "0 0.11\n 0.5 0.09\n 1 0.05\n 2 -0.02"
_TWO = "   10 30\n 0 0.1 0.14\n 0.5 0.09 0.13\n 1 0.05 0.1\n 2 -0.02 0.03"
_PISTON = "<maxhp> 200 </maxhp> <displacement> 360 </displacement>"


def driven(propeller="", data=_ONE, engine=_PISTON, kind="piston_engine"):
    """Return the slots, slot -> XML, of a jet in which a propeller replaces the jet engine.

    propeller: additional XML of the propeller
    data: rows of the propeller's tables
    engine: XML of the engine
    kind: element name of the engine
    """
    tables = "".join(
        f'<table name="{name}" type="internal"> <tableData> {data} </tableData> </table>'
        for name in ("C_THRUST", "C_POWER")
    )
    blades = f'<ixx> 1 </ixx> <diameter unit="FT"> 6 </diameter> {propeller} {tables}'
    return {
        "engine_kind": f"<{kind}> {engine} </{kind}>",
        "thruster": f'<propeller version="1.1"> {blades} </propeller>',
    }


_BLADES = (
    "<minpitch> 10 </minpitch> <maxpitch> 30 </maxpitch> <minrpm> 900 </minrpm>"
    " <maxrpm> 2500 </maxrpm> <constspeed> {} </constspeed>"
)
_POWER = (
    '<maxpower unit="HP"> 300 </maxpower> <idlen1> 60 </idlen1> <maxn1> 100 </maxn1>'
    ' <table name="EnginePowerRPM_N1" type="internal"> <tableData> 60 100\n 0 10 200\n'
    " 3000 20 300 </tableData> </table>"
    ' <table name="EnginePowerVC"> <independentVar>velocities/vc-kts</independentVar>'
    " <tableData> 0 1\n 300 1.1 </tableData> </table>"
    ' <table name="ITT_N1" type="internal"> <tableData> 0 1\n 0 1 1\n 1 1 1 </tableData> </table>'
    ' <table name="CombustionEfficiency_N1" type="internal"> <tableData> 0 1\n 1 1 </tableData>'
    " </table>"
)
_GEAR = (
    '<ground_reactions> <contact type="BOGEY" name="NOSE"> <location unit="IN"> <x> -50 </x>'
    " <y> 0 </y> <z> -40 </z> </location> <static_friction> 0.8 </static_friction>"
    " <dynamic_friction> 0.5 </dynamic_friction> <rolling_friction> 0.02 </rolling_friction>"
    ' <spring_coeff unit="LBS/FT"> 3000 </spring_coeff>'
    ' <damping_coeff unit="LBS/FT/SEC"> 300 </damping_coeff>'
    ' <max_steer unit="DEG"> 5 </max_steer> <brake_group>NONE</brake_group>'
    " <retractable>1</retractable> </contact> </ground_reactions>"
)

CONSTRUCTS = {
    "plain": {},
    "gear": {"sections": _GEAR},
    "gear position": {"sections": _GEAR, "pitch": pitching("gear/gear-pos-norm")},
    "gear above the ground": {"sections": _GEAR, "pitch": pitching("gear/unit/WOW")},
    "wing incidence": {
        "metrics": '<wing_incidence unit="DEG"> 3 </wing_incidence>',
        "pitch": pitching("aero/alpha-wing-rad"),
    },
    "reference point": {"reference": "<x> 4 </x> <y> 0 </y> <z> 2 </z>"},
    "inertia products": _mass('<ixz unit="SLUG*FT2"> 50 </ixz> <ixy unit="SLUG*FT2"> 20 </ixy>'),
    "inertia products, not negated": _mass(
        '<ixz unit="SLUG*FT2"> 50 </ixz> <iyz unit="SLUG*FT2"> 20 </iyz>',
        'negated_crossproduct_inertia="false"',
    ),
    "point mass": _point(""),
    "point mass with inertia": _point(
        '<ixx unit="SLUG*FT2"> 10 </ixx> <iyy unit="SLUG*FT2"> 5 </iyy>'
    ),
    **{
        f"point mass, {shape}": _point(
            f'<form shape="{shape}"> <radius unit="FT"> 1 </radius>'
            f' <length unit="FT"> 3 </length> </form>'
        )
        for shape in ("tube", "cylinder", "sphere", "ball", "cube")
    },
    "point mass in kg and m": _mass(
        '<pointmass name="a"> <weight unit="KG"> 100 </weight> <location unit="M"> <x> 0.4 </x>'
        " <y> 0 </y> <z> 0.1 </z> </location> </pointmass>"
    ),
    "tank with inertia factor": _tank(
        '<radius unit="IN"> 12 </radius> <inertia_factor> 0.5 </inertia_factor>'
    ),
    "tank, priority 0": _tank("<priority> 0 </priority>"),
    "tank, priority 2": _tank("<priority> 2 </priority>"),
    "tank, standpipe": _tank('<standpipe unit="LBS"> 20 </standpipe>'),
    "tank, unusable volume": _tank("<unusable-volume> 100 </unusable-volume>"),
    "tank, drain": _tank(
        '<drain_location unit="IN"> <x> 4 </x> <y> 6 </y> <z> -12 </z> </drain_location>'
    ),
    "tank, overfull": {"tank": '<contents unit="LBS"> 1500 </contents>'},
    "tank of grain": _second_tank(f'<contents unit="LBS"> 400 </contents> {_GRAIN}', feed=""),
    "second tank, oxidizer": _second_tank(
        '<contents unit="LBS"> 100 </contents>', "OXIDIZER", feed=""
    ),
    "tank without a feed": _second_tank('<contents unit="LBS"> 100 </contents>', feed=""),
    "feed of no tank": {"engine": "<feed>7</feed>"},
    "turbine without thrust at idle": {
        "shares": '<function name="MilThrust"> <v>0.9</v> </function>'
    },
    "turbine, spool": _turbine("<n1spinup> 8 </n1spinup> <n2spindown> 3 </n2spindown>"),
    "turbine, augmented 1": _turbine(
        '<maxthrust unit="LBS"> 3000 </maxthrust> <augmented> 1'
        " </augmented> <augmethod> 1 </augmethod>"
    ),
    "turbine, augmented 2": _turbine(
        '<maxthrust unit="LBS"> 3000 </maxthrust> <augmented> 1'
        " </augmented> <augmethod> 2 </augmethod>"
    ),
    "turbine, injection": _turbine(
        "<injected> 1 </injected> <injection-time> 30 </injection-time>"
        " <injection-N1-inc> 2 </injection-N1-inc>"
    )
    | {"shares": f'{_SHARES} <function name="Injection"> <v>1.2</v> </function>'},
    "turbine, spool function": {
        "shares": f'{_SHARES} <function name="N2SpoolUp"> <v>9</v> </function>'
    },
    "turbine, function of another name": {"shares": _SHARES.replace("Mil", "own/Mil")},
    "nozzle that a system turns back": {
        "thruster": '<nozzle> <area unit="FT2"> 0.1 </area> </nozzle>',
        **writing("propulsion/engine/reverser-angle-rad", 0.4),
    },
    "thruster, pointing": {
        "thruster_place": _PLACE + " <pointing> <x> 0.9 </x> <y> 0.1 </y> <z> 0 </z> </pointing>"
    },
    "thruster, orient": {
        "thruster_place": _PLACE
        + ' <orient unit="DEG"> <roll> 10 </roll> <pitch> 5 </pitch> <yaw> 3 </yaw> </orient>'
    },
    "nozzle": {"thruster": '<nozzle> <area unit="FT2"> 0.1 </area> </nozzle>'},
    "engine with a location": {"engine": _PLACE},
    "engine, orient of the mount": {"engine": '<orient unit="DEG"> <pitch> 9 </pitch> </orient>'},
    "engine, gimbal": {
        "channels": (
            '<channel name="g"> <pure_gain name="fcs/g"> <input>fcs/elevator-cmd-norm</input>'
            " <gain>0.1</gain> <output>propulsion/engine/pitch-angle-rad</output> </pure_gain>"
            " </channel>"
        )
    },
    "rocket": {"engine_kind": _ROCKET.format(""), "engine": "<feed>1</feed>"}
    | {"tanks": _second_tank('<contents unit="LBS"> 300 </contents>', "OXIDIZER")["tanks"]},
    "rocket, mixture ratio": {
        "engine_kind": _ROCKET.format("<mixtureratio> 2 </mixtureratio>"),
        "engine": "<feed>1</feed>",
        "tanks": _second_tank('<contents unit="LBS"> 300 </contents>', "OXIDIZER")["tanks"],
    },
    "rocket, flows": {
        "engine_kind": _ROCKET.format(
            '<slfuelflowmax unit="LBS/SEC"> 2 </slfuelflowmax>'
            ' <sloxiflowmax unit="LBS/SEC"> 3 </sloxiflowmax>'
        ),
        "engine": "<feed>1</feed>",
        "tanks": _second_tank('<contents unit="LBS"> 300 </contents>', "OXIDIZER")["tanks"],
    },
    "electric engine, direct": {
        "engine_kind": '<electric_engine> <power unit="WATTS"> 90000 </power> </electric_engine>'
    },
    "propeller": driven(),
    "propeller, factors": driven("<ct_factor> 1.1 </ct_factor> <cp_factor> 0.9 </cp_factor>"),
    "propeller, gear": driven("<gearratio> 1.5 </gearratio>"),
    "propeller, gear of 0": driven("<gearratio> 0 </gearratio>"),
    "propeller, blades": driven("<numblades> 3 </numblades>"),
    "propeller, sense and P-factor in its file": driven("<sense> -1 </sense>"),
    "propeller, table of two, fixed": driven("", _TWO),
    "propeller, governed": driven(_BLADES.format(1), _TWO),
    "propeller, fixed blades of constant speed": driven(
        "<minrpm> 900 </minrpm> <maxrpm> 2500 </maxrpm> <constspeed> 1 </constspeed>"
    ),
    "propeller, set by hand": driven(_BLADES.format(0), _TWO),
    "propeller, reverse pitch": driven(
        _BLADES.format(1) + "<reversepitch> -9 </reversepitch>", _TWO
    ),
    "propeller, Mach": driven(
        '<table name="CT_MACH" type="internal"> <tableData> 0 1\n 1 0.7 </tableData> </table>'
    ),
    "propeller, sense": driven()
    | {"thruster_place": SLOTS["thruster_place"] + "<sense> -1 </sense> <p_factor> 5 </p_factor>"},
    "piston, lag of the manifold": driven(
        "", _ONE, f"{_PISTON} <man-press-lag> 0.2 </man-press-lag>"
    ),
    "two turbines with functions of one name": {
        "propulsion": (
            '<engine> <turbine_engine> <milthrust unit="LBS"> 900 </milthrust> <function'
            ' name="IdleThrust"> <v>0.2</v> </function> <function name="MilThrust"> <v>0.7</v>'
            " </function> </turbine_engine> <feed>0</feed> <thruster> <location"
            ' unit="IN"> <x> 20 </x> <y> -9 </y> <z> 0 </z> </location> <direct/> </thruster>'
            " </engine>"
        )
    },
    "piston, friction set by a component": driven("", _ONE, _PISTON)
    | writing("propulsion/engine[0]/friction-hp", 3.0),
    "piston, oil pressure set by a component": driven("", _ONE, _PISTON)
    | writing("propulsion/engine[0]/oil-pressure-psi", 9.0),
    "piston, bore": driven("", _ONE, f"{_PISTON} <bore> 5 </bore> <cylinders> 4 </cylinders>"),
    "piston, consumption": driven("", _ONE, f"{_PISTON} <bsfc> 0.5 </bsfc>"),
    "piston, throttles": driven(
        "", _ONE, f"{_PISTON} <minthrottle> 0.2 </minthrottle> <maxthrottle> 0.9 </maxthrottle>"
    ),
    "piston, boost": driven(
        "",
        _ONE,
        f"{_PISTON} <numboostspeeds> 1 </numboostspeeds> <ratedboost1> 4 </ratedboost1>"
        " <ratedpower1> 200 </ratedpower1> <ratedrpm1> 2500 </ratedrpm1>"
        " <ratedaltitude1> 6000 </ratedaltitude1> <boost-loss-factor> 0.1 </boost-loss-factor>",
    ),
    "turboprop": driven(_BLADES.format(1), _TWO, _POWER, "turboprop_engine"),
    "turboprop, limiter of torque": driven(
        _BLADES.format(1), _TWO, f"{_POWER} <ielumaxtorque> 90 </ielumaxtorque>", "turboprop_engine"
    ),
    "turboprop without a power over speed": driven(
        _BLADES.format(1),
        _TWO,
        _POWER.replace("EnginePowerVC", "own/EnginePowerVC"),
        "turboprop_engine",
    ),
    "turboprop without a largest power": driven(
        _BLADES.format(1), _TWO, _POWER.replace("maxpower", "power"), "turboprop_engine"
    ),
    "electric engine": driven("", _ONE, '<power unit="WATTS"> 90000 </power>', "electric_engine"),
    "planet": {"sections": "<planet> <J2> 0 </J2> </planet>"},
    "external force": _external(
        f'<force name="push" frame="BODY"> {_FORCE_PLACE} {_DIRECTION} </force>'
    ),
    "external force of a function": _external(
        '<force name="push" frame="BODY"> <function> <product> <v>300</v> <p>aero/qbar-psf</p>'
        f" <v>0.01</v> </product> </function> {_FORCE_PLACE} {_DIRECTION} </force>"
    ),
    **{
        f"external force, frame {frame}": _external(
            f'<force name="push" frame="{frame}"> <function> <v>200</v> </function>'
            f" {_FORCE_PLACE} <direction> <x>1</x> <y>0.5</y> <z>0.2</z> </direction> </force>"
        )
        for frame in ("LOCAL", "WIND", "INERTIAL")
    },
    "external moment of a function": _external(
        '<moment name="twist" frame="BODY"> <function> <v>500</v> </function>'
        " <direction> <x>0</x> <y>1</y> <z>0</z> </direction> </moment>"
    ),
    "external moment of a direction that is set": _external(
        '<property value="-0.7">external_reactions/twist/m</property>'
        ' <moment name="twist"> <function> <v>500</v> </function> </moment>'
    ),
    "external force of a property": _external(
        '<property value="250">fcs/pull</property> <force name="push" frame="BODY">'
        f" <function> <p>fcs/pull</p> </function> {_FORCE_PLACE} {_DIRECTION} </force>"
    ),
    "external force of a magnitude that is set": _external(
        '<property value="200">external_reactions/push/magnitude</property>'
        f' <force name="push" frame="BODY"> {_FORCE_PLACE} {_DIRECTION} </force>'
    ),
    "external force by its magnitude": _external(
        f'<force name="push" frame="BODY"> {_FORCE_PLACE} {_DIRECTION} </force>'
    )
    | {
        "channels": (
            '<channel name="e"> <fcs_function name="fcs/e"> <function> <v>200</v> </function>'
            " <output>external_reactions/push/magnitude</output> </fcs_function> </channel>"
        )
    },
    "gas": {"sections": "<buoyant_forces> <gas_cell type='HELIUM'/> </buoyant_forces>"},
}
