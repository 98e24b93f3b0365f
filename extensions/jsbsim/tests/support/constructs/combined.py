"""Constructs that resemble real files, in which several parts depend on each other."""

from __future__ import annotations

from constructs.airframe import CONSTRUCTS as AIRFRAME
from constructs.jet import coefficient, component, function, pitching, slope

_ELEVATOR = "fcs/elevator-cmd-norm"
_AILERON = "fcs/aileron-cmd-norm"
_FLAP = "fcs/flap-cmd-norm"
_GAIN = '<pure_gain name="{}"> <input>{}</input> <gain>{}</gain> </pure_gain>'
_PLACE = '<location unit="IN"> <x> 20 </x> <y> -4 </y> <z> 6 </z> </location>'


def _system(text: str, kind: str = "system", name: str = "own") -> str:
    return f'<{kind} name="{name}"> <channel name="a"> {text} </channel> </{kind}>'


def _read(name: str, **slots: str) -> dict[str, str]:
    return {"pitch": pitching(name)} | slots


def _switch(tests: str, default: str = "0.1") -> dict[str, str]:
    text = f'<switch name="fcs/probe"> <default value="{default}"/> {tests} </switch>'
    return component(text)


def _table(axes: str, data: str) -> str:
    return f"<table> {axes} {data} </table>"


def _axis(name: str, lookup: str = "") -> str:
    kind = f' lookup="{lookup}"' if lookup else ""
    return f"<independentVar{kind}>{name}</independentVar>"


_ROWS = "-1 0.2\n 0 0.5\n 1 0.1"
_GRID = "   -1  0  2\n -1 0.1 0.2 0.4\n 0 0.3 0.1 0.5\n 1 0.2 0.6 0.3"
_CUBE = (
    f'<tableData breakPoint="-1"> {_GRID} </tableData>'
    '<tableData breakPoint="0.2">    -1  1\n -0.5 0.2 0.7\n 0.5 0.4 0.1 </tableData>'
    '<tableData breakPoint="1">    -1  0  2\n -1 0.4 0.3 0.2\n 0 0.1 0.5 0.5\n 1 0.7 0.6 0.1'
    " </tableData>"
)
_THREE = _axis("aero/alpha-rad", "row") + _axis(_FLAP, "column")
_FORCE_PLACE = '<location unit="IN"> <x> 20 </x> <y> 5 </y> <z> 3 </z> </location>'
_DIRECTION = "<direction> <x>-1</x> <y>0.2</y> <z>0.1</z> </direction>"


def _outside(text: str, **slots: str) -> dict[str, str]:
    return {"sections": f"<external_reactions> {text} </external_reactions>"} | slots


def _force(function_text: str, frame: str = "BODY", name: str = "push") -> str:
    return (
        f'<force name="{name}" frame="{frame}"> <function> {function_text} </function>'
        f" {_FORCE_PLACE} {_DIRECTION} </force>"
    )


def _of_engine(base: str, **slots: str) -> dict[str, str]:
    return AIRFRAME[base] | slots


def _channels(text: str, **slots: str) -> dict[str, str]:
    return {"channels": f'<channel name="construct"> {text} </channel>'} | slots


_SIGNS = {
    "table over a minus property": function(
        _table(_axis("-aero/alpha-rad"), f"<tableData> {_ROWS} </tableData>")
    ),
    "table of two over minus properties": function(
        _table(
            _axis("-aero/alpha-rad", "row") + _axis(f"-{_FLAP}", "column"),
            f"<tableData> {_GRID} </tableData>",
        )
    ),
    "scheduled gain over a minus property": component(
        f'<scheduled_gain name="fcs/probe"> <input>-{_ELEVATOR}</input> <gain>-0.5</gain>'
        + _table(_axis("-velocities/mach"), f"<tableData> {_ROWS} </tableData>")
        + "</scheduled_gain>"
    ),
    "clip by a minus property": component(
        f'<pure_gain name="fcs/probe"> <input>{_ELEVATOR}</input> <gain>2</gain>'
        f" <clipto> <min>-{_FLAP}</min> <max>{_FLAP}</max> </clipto> </pure_gain>"
    ),
    "gain by a minus property": component(
        f'<pure_gain name="fcs/probe"><input>-{_ELEVATOR}</input><gain>-{_FLAP}</gain> </pure_gain>'
    ),
    "switch to a minus property": _switch(f'<test value="-{_ELEVATOR}"> {_FLAP} gt 0.5 </test>'),
    "switch from a minus default": _switch(
        f'<test value="0.2"> {_FLAP} gt 2 </test>', f"-{_AILERON}"
    ),
    "pid by minus properties": component(
        f'<pid name="fcs/probe"> <input>-{_ELEVATOR}</input> <kp>-{_FLAP}</kp> </pid>'
    ),
    "summer of many signs": component(
        f'<summer name="fcs/probe"> <input>-{_ELEVATOR}</input> <input>{_AILERON}</input>'
        f" <input>-{_FLAP}</input> <bias>-0.2</bias> <clipto> <min>-0.7</min> <max>0.4</max>"
        " </clipto> </summer>"
    ),
    "function of minus properties": function(
        f"<sum><p>-{_ELEVATOR}</p><product> <p>-aero/beta-rad</p> <p>-{_FLAP}</p> </product> </sum>"
    ),
}
_SWITCHES = {
    "or within and": _switch(
        f'<test logic="AND" value="0.7"> {_FLAP} gt 0.1 <test logic="OR"> {_ELEVATOR} gt 0.2'
        f"\n {_AILERON} lt 0 </test> </test>"
    ),
    "and within or": _switch(
        f'<test logic="OR" value="0.7"> {_FLAP} gt 0.9 <test logic="AND"> {_ELEVATOR} gt -0.5'
        f"\n {_AILERON} lt 0.5 </test> </test>"
    ),
    "three levels": _switch(
        f'<test logic="AND" value="{_ELEVATOR}"><test logic="OR"> {_FLAP} gt 0.9 <test logic="AND">'
        f" {_ELEVATOR} ge -0.9\n velocities/mach lt 1 </test> </test> </test>"
    ),
    "second test holds": _switch(
        f'<test value="0.3"> {_FLAP} gt 5 </test> <test value="{_AILERON}"> {_FLAP} gt 0 </test>'
        f' <test value="0.9"> {_FLAP} gt 0.1 </test>'
    ),
    "of a switch": _channels(
        f'<switch name="fcs/first"> <default value="0"/> <test value="1"> {_FLAP} ge 0.5 </test>'
        f' </switch> <switch name="fcs/probe"> <default value="{_ELEVATOR}"/>'
        f' <test value="-{_ELEVATOR}"> fcs/first == 1 </test> </switch>',
        pitch=pitching("fcs/probe"),
    ),
    "of alpha and an altitude": _switch(
        '<test logic="AND" value="0.6"> aero/alpha-deg ge 2\n position/h-sl-ft lt 20000\n'
        " attitude/phi-rad ne 0 </test>"
    ),
    "words in capitals": _switch(
        f'<test logic="OR" value="0.6"> {_FLAP} GT 2\n {_FLAP} LE 1 </test>'
    ),
}
_CHANNELS = {
    "reads what comes later": _channels(
        '<pure_gain name="fcs/probe"> <input>fcs/later</input> <gain>0.5</gain> </pure_gain>'
        + _GAIN.format("fcs/later", _ELEVATOR, 0.7),
        pitch=pitching("fcs/probe"),
    ),
    "autopilot before the control": _read(
        "fcs/probe",
        sections=_system(_GAIN.format("ap/cmd", "attitude/phi-rad", -0.4), "autopilot"),
        channels=f'<channel name="b"> <summer name="fcs/probe"> <input>ap/cmd</input>'
        f" <input>{_AILERON}</input> </summer> </channel>",
    ),
    "autopilot that holds a pitch": _read(
        "ap/elevator",
        sections=_system(
            '<summer name="ap/error"><input>-attitude/theta-rad</input> <bias>0.05</bias> </summer>'
            ' <pid name="ap/pid"> <input>ap/error</input> <kp>0.8</kp> </pid>'
            ' <pure_gain name="ap/elevator"> <input>ap/pid</input> <gain>-1</gain>'
            " <clipto> <min>-0.3</min> <max>0.3</max> </clipto> </pure_gain>",
            "autopilot",
        ),
    ),
    "rate damper by qbar": component(
        '<fcs_function name="fcs/probe"> <input>velocities/q-rad_sec</input> <function> <quotient>'
        " <v>20</v> <sum> <v>1</v> <p>aero/qbar-psf</p> </sum> </quotient> </function>"
        " </fcs_function>"
    ),
    "two systems in each other": _read(
        "one/c",
        sections=_system(_GAIN.format("one/b", "one/a", 0.5), name="second")
        + _system(_GAIN.format("one/c", "one/b", 0.5), name="third"),
        head="",
        channels=f'<channel name="b"> {_GAIN.format("one/a", _ELEVATOR, 2)} </channel>',
    ),
    "channel that an own property runs": {
        "control": '<property value="1">fcs/on</property>',
        "channels": f'<channel name="b"'
        f' execute="fcs/on">{_GAIN.format("fcs/probe", _ELEVATOR, 0.6)}'
        " </channel>",
        "pitch": pitching("fcs/probe"),
    },
    "distributor, exclusive": component(
        f'<distributor name="d" type="exclusive"> <case> <test> {_FLAP} gt 0.1 </test>'
        ' <property value="0.4"> fcs/probe </property> </case> <case>'
        ' <property value="0.1"> fcs/probe </property> </case> </distributor>'
    )
    | {"control": "<property>fcs/probe</property>"},
    "deadband behind a gain": _channels(
        _GAIN.format("fcs/first", _ELEVATOR, 1.5)
        + '<deadband name="fcs/probe"> <input>fcs/first</input> <width>0.4</width> <gain>0.8</gain>'
        " </deadband>",
        pitch=pitching("fcs/probe"),
    ),
    "surface scale behind a summer": _channels(
        f'<summer name="fcs/first"> <input>{_ELEVATOR}</input> <input>{_FLAP}</input> </summer>'
        '<aerosurface_scale name="fcs/probe"> <input>fcs/first</input> <domain> <min>-2</min>'
        " <max>1</max> </domain> <range> <min>-0.3</min> <max>0.5</max> </range>"
        " </aerosurface_scale>",
        pitch=pitching("fcs/probe"),
    ),
    "kinematic of three detents": component(
        f'<kinematic name="fcs/probe"> <input>{_FLAP}</input> <traverse> <setting>'
        " <position>0</position> <time>0</time> </setting> <setting> <position>0.2</position>"
        " <time>1</time> </setting> <setting> <position>0.8</position> <time>2</time> </setting>"
        " </traverse> </kinematic>"
    ),
    "filters in a row": _channels(
        f'<lag_filter name="fcs/first"> <input>{_ELEVATOR}</input> <c1>8</c1> </lag_filter>'
        '<lead_lag_filter name="fcs/probe"> <input>fcs/first</input> <c1>1</c1> <c2>6</c2>'
        " <c3>1</c3> <c4>4</c4> </lead_lag_filter>",
        pitch=pitching("fcs/probe"),
    ),
    "sensor before a gain": _channels(
        '<sensor name="fcs/first"> <input>aero/alpha-rad</input> <gain>2</gain> <bias>0.01</bias>'
        " <lag>20</lag> </sensor>" + _GAIN.format("fcs/probe", "fcs/first", 0.5),
        pitch=pitching("fcs/probe"),
    ),
    "accelerometer": component(
        '<accelerometer name="fcs/probe"> <axis>Z</axis> <location unit="IN"> <x>10</x> <y>0</y>'
        " <z>0</z> </location> </accelerometer>"
    ),
    "gyro": component('<gyro name="fcs/probe"> <axis>Y</axis> </gyro>'),
    "component named with capitals": _channels(
        f'<pure_gain name="Nose Down Cmd"><input>{_ELEVATOR}</input> <gain>0.5</gain> </pure_gain>',
        pitch=pitching("fcs/nose-down-cmd"),
    ),
}
_FUNCTIONS = {
    "table of three, other breakpoints": function(
        _table(_THREE + _axis(_ELEVATOR, "table"), _CUBE)
    ),
    "table of three in a sum": function(
        f"<sum> <product> <v>0.5</v> {_table(_THREE + _axis('velocities/mach', 'table'), _CUBE)}"
        f" </product> <abs> <p>{_ELEVATOR}</p> </abs> </sum>"
    ),
    "table of three over minus the stick": function(
        _table(_THREE + _axis(f"-{_ELEVATOR}", "table"), _CUBE)
    ),
    "function of a function": {
        "air": '<function name="aero/one"> <product> <p>aero/two</p> <v>0.5</v> </product>'
        ' </function> <function name="aero/two"> <sum> <p>aero/beta-rad</p> <v>0.2</v> </sum>'
        " </function>",
        "pitch": pitching("aero/one"),
    },
    "function of a component and an engine": {
        "channels": f'<channel name="b"> {_GAIN.format("fcs/probe", _ELEVATOR, 0.6)} </channel>',
        "air": '<function name="aero/one"> <product> <p>fcs/probe</p> <quotient>'
        " <p>propulsion/engine/thrust-lbs</p> <v>1000</v> </quotient> </product> </function>",
        "pitch": pitching("aero/one"),
    },
    "lift of the wing by alphadot": function(
        slope(2.0, "aero/alphadot-rad_sec").replace("<v>2.0</v>", "<v>2.0</v> <p>aero/ci2vel</p>")
    ),
    "drag of the lift squared": {
        "lift": coefficient("<v>0.01</v>"),
        "pitch": coefficient(slope(0.02, "aero/cl-squared"), length="cbarw-ft"),
    },
    "ground effect": function(
        _table(_axis("aero/h_b-mac-ft"), "<tableData> 0 0.5\n 1 0.9\n 100 1\n 500 1.2 </tableData>")
    ),
    "ifthen within ifthen": function(
        f"<ifthen> <gt> <p>{_FLAP}</p> <v>0.5</v> </gt> <ifthen> <lt> <p>{_ELEVATOR}</p> <v>0</v>"
        f" </lt> <v>0.2</v> <p>{_ELEVATOR}</p> </ifthen> <p>{_AILERON}</p> </ifthen>"
    ),
    "switch function": function(
        f"<switch> <product> <v>2.5</v> <p>{_FLAP}</p> </product> <v>0.1</v> <p>{_ELEVATOR}</p>"
        " <v>0.4</v> </switch>"
    ),
    "interpolate1d of properties": function(
        f"<interpolate1d> <p>aero/alpha-deg</p> <v>0</v> <p>{_ELEVATOR}</p> <v>5</v> <v>0.4</v>"
        f" <v>20</v> <p>{_FLAP}</p> </interpolate1d>"
    ),
    "sines of degrees": function(
        "<product> <sin> <toradians> <p>aero/alpha-deg</p> </toradians> </sin> <cos>"
        " <p>attitude/phi-rad</p> </cos> </product>"
    ),
    "random": function("<random/>"),
    "local flow of the tail": function(
        "<atan2> <sum> <p>velocities/w-aero-fps</p> <product> <p>velocities/q-aero-rad_sec</p>"
        " <v>15</v> </product> </sum> <p>velocities/u-aero-fps</p> </atan2>"
    ),
}
_ENGINES = {
    "rocket, specific impulse of a function": _of_engine(
        "rocket, mixture ratio",
        engine_kind="<rocket_engine> <isp> <function> <sum> <v>200</v> <product> <v>20</v>"
        " <p>atmosphere/sigma</p> </product> </sum> </function> </isp>"
        ' <propflowmax unit="LBS/SEC"> 5 </propflowmax> <minthrottle>0.1</minthrottle>'
        " <maxthrottle>1</maxthrottle> </rocket_engine>",
    ),
    "rocket in a nozzle": _of_engine(
        "rocket", thruster='<nozzle name="n"> <area unit="FT2"> 0.2 </area> </nozzle>'
    ),
    "electric engine, governed": _of_engine(
        "propeller, governed",
        engine_kind='<electric_engine> <power unit="WATTS"> 90000 </power> </electric_engine>',
    ),
    "governed propeller, lever by a system": _of_engine(
        "propeller, governed",
        channels=f'<channel name="b"> <pure_gain name="w"> <input>{_FLAP}</input> <gain>0.9</gain>'
        " <output>fcs/advance-pos-norm</output> </pure_gain> </channel>",
    ),
    "propeller, blades by a system": _of_engine(
        "propeller, set by hand",
        channels=f'<channel name="b"> <fcs_function name="w"> <function> <sum> <v>15</v> <product>'
        f" <v>8</v> <p>{_FLAP}</p> </product> </sum> </function>"
        " <output>propulsion/engine/blade-angle</output> </fcs_function> </channel>",
    ),
    "moment of the slipstream": _of_engine(
        "propeller", pitch=coefficient(slope(0.001, "propulsion/engine/prop-induced-velocity_fps"))
    ),
    "moment of the power": _of_engine(
        "propeller", pitch=coefficient(slope(0.0005, "propulsion/engine/power-hp"))
    ),
    "thrust that a system turns": {
        "channels": f'<channel name="b"> <pure_gain name="w"> <input>{_ELEVATOR}</input>'
        " <gain>0.2</gain><output>propulsion/engine/pitch-angle-rad</output></pure_gain> </channel>"
    },
    "bleed by a flap": {
        "channels": f'<channel name="b"> <pure_gain name="w"> <input>{_FLAP}</input>'
        " <gain>0.1</gain> <output>propulsion/engine/bleed-factor</output> </pure_gain> </channel>"
    },
    "tank that drains": {
        "channels": '<channel name="b"> <fcs_function name="w"> <function> <v>-1</v> </function>'
        " <output>propulsion/tank/external-flow-rate-pps</output> </fcs_function> </channel>"
    },
    "two tanks and a center of gravity": _of_engine(
        "second tank, priority 2", pitch=pitching("inertia/cg-x-in")
    ),
    "load that a flap drops": {
        "mass": f'<emptywt unit="LBS">3000</emptywt><pointmass name="load"><weight unit="LBS"> 300'
        f" </weight> {_PLACE} </pointmass>",
        "channels": f'<channel name="b"> <switch name="w"> <default value="300"/> <test value="0">'
        f" {_FLAP} gt 0.5 </test><output>inertia/pointmass-weight-lbs</output></switch> </channel>",
    },
}
_OUTSIDE = {
    "force of a parachute": _outside(
        _force("<product> <p>aero/qbar-psf</p> <v>5</v> </product>", "WIND")
    ),
    "two forces of two frames": _outside(
        _force("<v>200</v>", "LOCAL", "one") + _force(f"<p>{_FLAP}</p>", "BODY", "two")
    ),
    "force of a channel": _outside(
        _force("<product> <v>300</v> <p>fcs/probe</p> </product>"),
        channels=f'<channel name="b"> {_GAIN.format("fcs/probe", _ELEVATOR, 0.6)} </channel>',
    ),
    "force with a table": _outside(
        _force(_table(_axis("aero/alpha-rad"), "<tableData> -1 100\n 0 200\n 1 400 </tableData>"))
    ),
    "force read by a coefficient": _outside(
        _force("<v>100</v>"), pitch=coefficient(slope(0.001, "forces/fbx-external-lbs"))
    ),
    "gas cell": {
        "sections": '<buoyant_forces><gas_cell type="HELIUM"><location unit="IN"> <x>0</x> <y>0</y>'
        ' <z>0</z> </location> <x_radius unit="FT"> 5 </x_radius> <y_radius unit="FT"> 5'
        ' </y_radius> <z_radius unit="FT"> 5 </z_radius> <max_overpressure unit="PSI"> 1'
        " </max_overpressure> <fullness> 0.5 </fullness> </gas_cell> </buoyant_forces>"
    },
}
CONSTRUCTS: dict[str, dict[str, str]] = {
    f"{kind}: {name}": slots
    for kind, group in (
        ("signs", _SIGNS),
        ("switch", _SWITCHES),
        ("channels", _CHANNELS),
        ("functions", _FUNCTIONS),
        ("engines", _ENGINES),
        ("outside", _OUTSIDE),
    )
    for name, slots in group.items()
}
