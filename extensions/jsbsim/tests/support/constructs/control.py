"""Constructs of the flight control system."""

from constructs.jet import component, pitching

_Q = "velocities/q-rad_sec"
_STICK = "fcs/elevator-cmd-norm"
_OUT = "<output>fcs/probe</output>"


def _of(kind, inside, source=_STICK, attributes=""):
    """Return the slots of a construct with a component of one input."""
    text = f'<{kind} name="fcs/c" {attributes}> <input>{source}</input> {inside} {_OUT} </{kind}>'
    return component(text)


def _clip(low, high, attributes=""):
    """Return the XML of the limits of a component."""
    return f"<clipto {attributes}> <min>{low}</min> <max>{high}</max> </clipto>"


def _g(value):
    """Return the XML of a user-defined property `fcs/g` with this value."""
    return f'<property value="{value}">fcs/g</property>'


_TAKES_G = _of("pure_gain", "<gain>fcs/g</gain>")


def _switch(test, default='<default value="0.2"/>'):
    """Return the slots of a construct with a <switch>."""
    return component(f'<switch name="fcs/c"> {default} {test} {_OUT} </switch>')


def _failure(kind, failure, value):
    """Return the slots of a construct in which a component fails."""
    ends = _clip(-0.5, 0.5)
    probe = f'<{kind} name="fcs/c"> <input>{_STICK}</input> {ends} {_OUT} </{kind}>'
    writer = f'<fcs_function name="fcs/w"> <function> <v>{value}</v> </function>'
    writer += f" <output>fcs/c/malfunction/{failure}</output> </fcs_function>"
    return component(f"{writer} {probe}")


def _channel(attributes, head=""):
    """Return the slots of a construct with a pitch damper in a channel of the control system."""
    damper = f'<pure_gain name="d"> <input>{_Q}</input> <gain>9</gain> {_OUT} </pure_gain>'
    channel = f'<channel name="damper" {attributes}> {damper} </channel>'
    return {"control": head, "channels": channel, "pitch": pitching("fcs/probe")}


_CYCLIC = _clip(-0.5, 0.5, 'type="cyclic"')
_TRAVERSE = (
    "<traverse> <setting> <position>0</position> <time>0</time> </setting>"
    " <setting> <position>20</position> <time>1</time> </setting> </traverse>"
)
_TABLE = (
    "<table> <independentVar>aero/alpha-rad</independentVar>"
    " <tableData> -1 2\n 0 1\n 1 3\n </tableData> </table>"
)
_TEST = '<test value="0.7"> velocities/vc-kts {} 1 </test>'
_PROBE = {"control": "<property>fcs/probe</property>"}
_SENSOR_INPUT = "velocities/r-rad_sec"

CONSTRUCTS = {
    "gain": _of("pure_gain", "<gain>0.5</gain>"),
    "gain of a property": _of("pure_gain", "<gain>aero/alpha-rad</gain>"),
    "gain of a minus property": _of("pure_gain", "<gain>-aero/alpha-rad</gain>"),
    "gain without gain": _of("pure_gain", ""),
    "gain, input number": _of("pure_gain", "<gain>2</gain>", "0.25"),
    "gain, clip": _of("pure_gain", f"<gain>2</gain> {_clip(-0.2, 0.3)}"),
    "gain, half a clip": _of("pure_gain", "<gain>2</gain> <clipto> <max>0.1</max> </clipto>"),
    "gain, clip by properties": _of(
        "pure_gain", "<clipto> <min>-aero/alpha-rad</min> <max>aero/alpha-rad</max> </clipto>"
    ),
    "gain, cyclic clip": _of("pure_gain", f"<gain>4</gain> {_CYCLIC}"),
    "gain, clip exchanged": _of("pure_gain", f"<gain>2</gain> {_clip(0.3, -0.2)}"),
    "gain, clip exchanged by a property": _of(
        "pure_gain", "<clipto> <min>aero/alpha-rad</min> <max>aero/beta-rad</max> </clipto>"
    ),
    "failure, zero": _failure("actuator", "fail_zero", 1.0),
    "failure by a property": {
        **_of("actuator", _clip(-0.5, 0.5)),
        "control": '<property value="1">fcs/c/malfunction/fail_zero</property>',
    },
    "switch, tab in a condition": _switch('<test value="0.7"> velocities/vc-kts\tgt 1 </test>'),
    "deadband, width of a property": _of("deadband", "<width>aero/beta-rad</width>"),
    "function in ground_reactions": {
        "wheels": (
            '<function name="gear/k"> <product> <v>2</v> <p>aero/alpha-rad</p> </product>'
            " </function>"
        ),
        "pitch": pitching("gear/k"),
    },
    "property in ground_reactions": {
        "wheels": '<property value="0.3">gear/k</property>',
        "pitch": pitching("gear/k"),
    },
    "gain, delay": _of("pure_gain", "<gain>2</gain> <delay>0.2</delay>"),
    "two outputs": component(
        f'<pure_gain name="fcs/c"> <input>{_STICK}</input> <output>fcs/a</output> {_OUT}'
        " </pure_gain>"
    ),
    "name with blanks": component(
        f'<pure_gain name="My Own Gain"> <input>{_STICK}</input> <gain>2</gain> </pure_gain>',
        "fcs/my-own-gain",
    ),
    "two writers of one property": component(
        f'<pure_gain name="a"> <input>{_STICK}</input> {_OUT} </pure_gain>'
        f' <pure_gain name="b"> <input>aero/alpha-rad</input> {_OUT} </pure_gain>'
    ),
    "reads a later component": component(
        f'<pure_gain name="fcs/a"> <input>fcs/b</input> {_OUT} </pure_gain>'
        f' <pure_gain name="fcs/b"> <input>{_STICK}</input> <gain>2</gain> </pure_gain>'
    ),
    "scheduled gain": _of("scheduled_gain", _TABLE),
    "summer": _of("summer", "<input>aero/alpha-rad</input>"),
    "summer, bias": _of("summer", "<bias>0.2</bias>"),
    "aerosurface scale": _of(
        "aerosurface_scale", "<range> <min>-0.3</min> <max>0.2</max> </range>"
    ),
    "aerosurface scale, domain": _of(
        "aerosurface_scale",
        "<domain> <min>-2</min> <max>1</max> </domain>"
        " <range> <min>-0.3</min> <max>0.2</max> </range>",
    ),
    "aerosurface scale, not centered": _of(
        "aerosurface_scale",
        "<zero_centered>0</zero_centered> <range> <min>-0.3</min> <max>0.2</max> </range>",
    ),
    "aerosurface scale, range of properties": _of(
        "aerosurface_scale",
        "<range> <min>-aero/alpha-rad</min> <max>aero/alpha-rad</max> </range>",
    ),
    "kinematic": _of("kinematic", _TRAVERSE, "fcs/flap-cmd-norm"),
    "kinematic, noscale": _of("kinematic", f"{_TRAVERSE} <noscale/>", "aero/alpha-deg"),
    "kinematic, middle detent": _of(
        "kinematic",
        "<traverse> <setting> <position>-5</position> <time>0</time> </setting> <setting>"
        " <position>3</position> <time>1</time> </setting> <setting> <position>12</position>"
        " <time>1</time> </setting> </traverse>",
    ),
    "kinematic, falling detents": _of(
        "kinematic",
        "<traverse> <setting> <position>10</position> <time>0</time> </setting> <setting>"
        " <position>0</position> <time>1</time> </setting> </traverse>",
        "fcs/flap-cmd-norm",
    ),
    "deadband": _of("deadband", "<width>0.3</width>"),
    "deadband of a property": _of("deadband", "<width>aero/alpha-rad</width>"),
    "lag filter": _of("lag_filter", "<c1>20</c1>"),
    "lag filter of a rate": _of("lag_filter", "<c1>20</c1>", _Q),
    "lag filter by a property": _of("lag_filter", "<c1>velocities/vc-kts</c1>"),
    "lag filter that grows": _of("lag_filter", "<c1>-2</c1>"),
    "lead lag filter": _of("lead_lag_filter", "<c1>1</c1> <c2>4</c2> <c3>1</c3> <c4>5</c4>"),
    "lead lag, no constant": _of("lead_lag_filter", "<c1>1</c1> <c2>0</c2> <c3>1</c3> <c4>5</c4>"),
    "loop that settles": component(
        f'<summer name="fcs/c"> <input>{_STICK}</input> <input>fcs/d</input> {_OUT} </summer>'
        '<pure_gain name="fcs/d"> <input>fcs/c</input> <gain>0.5</gain> </pure_gain>'
    ),
    "latch": component(
        '<switch name="fcs/c"> <default value="fcs/c"/> <test value="0.3"> aero/alpha-rad lt 0.1'
        f" </test> {_OUT} </switch>"
    )
    | {"control": '<property value="0.2">fcs/c</property>'},
    "latch by its own test": component(
        '<switch name="metrics/aero-rp-x-in"> <default value="6"/> <test value="2">'
        " metrics/aero-rp-x-in gt 50 </test> </switch>"
    ),
    "loop that toggles": _switch(
        '<test value="0.3"> fcs/c lt 0.1 </test> <test value="0.7"> fcs/c lt 0.5 </test>'
    ),
    "integrator without a gain": _of("integrator", ""),
    "kinematic without times": _of(
        "kinematic",
        "<traverse> <setting> <position>0</position> </setting> <setting>"
        " <position>5</position> </setting> </traverse>",
    ),
    "second order filter": _of(
        "second_order_filter", "<c1>0</c1> <c2>0</c2> <c3>9</c3> <c4>1</c4> <c5>8</c5> <c6>12</c6>"
    ),
    "washout filter": _of("washout_filter", "<c1>5</c1>", _Q),
    "washout of the stick": _of("washout_filter", "<c1>5</c1>"),
    "integrator of a rate": _of("integrator", "<c1>0.1</c1>", _Q),
    "integrator with trigger": _of("integrator", "<c1>0.1</c1> <trigger>fcs/hold</trigger>", _Q),
    "integrator of the stick": _of("integrator", "<c1>0.1</c1>"),
    "pid, kp": _of("pid", "<kp>0.5</kp>", _Q),
    "pid, kp and ki of a rate": _of("pid", "<kp>0.5</kp> <ki>0.1</ki>", _Q),
    "pid, kp and kd": _of("pid", "<kp>0.5</kp> <kd>0.1</kd>", _Q),
    "pid, ki of the stick": _of("pid", "<kp>0.5</kp> <ki>0.1</ki>"),
    "pid, kp of a property": _of("pid", "<kp>aero/alpha-rad</kp>", _Q),
    "pid, standard": _of("pid", "<kp>0.5</kp> <ki>0</ki> <kd>0.2</kd>", _Q, 'type="standard"'),
    "pid, standard with ki": _of("pid", "<kp>0.5</kp> <ki>0.2</ki>", _Q, 'type="standard"'),
    "pid, pvdot": _of("pid", f"<kp>0.5</kp> <kd>1</kd> <pvdot>{_Q}</pvdot>"),
    "pid, trigger": _of("pid", "<kp>0.5</kp> <ki>0.1</ki> <trigger>fcs/hold</trigger>", _Q),
    "actuator": _of("actuator", "<lag>20</lag>"),
    "actuator, rate limit": _of("actuator", "<rate_limit>5</rate_limit>"),
    "actuator, rate limits of two senses": _of(
        "actuator",
        '<rate_limit sense="incr">5</rate_limit> <rate_limit sense="decr">3</rate_limit>',
    ),
    "actuator, bias": _of("actuator", "<bias>0.1</bias>"),
    "actuator, deadband": _of("actuator", "<deadband_width>0.2</deadband_width>"),
    "actuator, hysteresis": _of("actuator", "<hysteresis_width>0.05</hysteresis_width>"),
    "actuator, lag by a property": _of("actuator", "<lag>velocities/vc-kts</lag>"),
    "sensor": _of("sensor", "", _SENSOR_INPUT),
    "accelerometer": component(
        '<accelerometer name="fcs/c"> <axis>Z</axis> <location unit="IN"> <x>0</x> <y>0</y>'
        f" <z>0</z> </location> {_OUT} </accelerometer>"
    ),
    "angle": component(
        '<angle name="fcs/c"> <target_angle unit="DEG">aero/alpha-deg</target_angle>'
        f' <source_angle unit="RAD">aero/beta-rad</source_angle> {_OUT} </angle>'
    ),
    "distributor": component(
        '<distributor name="fcs/c" type="exclusive"> <case> <property value="0.3">fcs/probe'
        "</property> </case> </distributor>"
    )
    | _PROBE,
    "actuator, saturated": component(
        f'<actuator name="fcs/c"> <input>{_STICK}</input> {_clip(-0.1, 0.1)} </actuator>'
        f' <pure_gain name="d"> <input>fcs/c/saturated</input> {_OUT} </pure_gain>'
    ),
    "pid, begun": _of("pid", "<kp>0.5</kp> <ki>0.0001</ki>", _Q)
    | {"control": '<property value="1">fcs/c/initial-integrator-value</property>'},
    "linear actuator": _of("linear_actuator", "<module>1</module> <gain>1</gain>"),
    "function": component(
        '<fcs_function name="fcs/c"> <function> <sum> <p>aero/alpha-rad</p> <v>0.1</v> </sum>'
        f" </function> {_OUT} </fcs_function>"
    ),
    "switch": _switch(_TEST.format("gt")),
    "switch, false": _switch(_TEST.format("lt")),
    "switch, sign": _switch(_TEST.format("&gt;=")),
    "switch by a constant": _switch('<test value="0.7"> fcs/g gt 1 </test>') | {"control": _g(2.0)},
    "switch, two tests": _switch(_TEST.format("lt") + _TEST.replace("0.7", "0.5").format("gt")),
    "switch, AND": _switch(
        '<test logic="AND" value="0.7"> velocities/vc-kts gt 1\n velocities/vc-kts lt 1 </test>'
    ),
    "switch, OR": _switch(
        '<test logic="OR" value="0.7"> velocities/vc-kts gt 1\n velocities/vc-kts lt 1 </test>'
    ),
    "switch, nested": _switch(
        '<test logic="AND" value="0.7"> <test logic="OR"> velocities/vc-kts gt 1\n'
        " velocities/vc-kts lt 1 </test> <test> velocities/vc-kts gt 1 </test> </test>"
    ),
    "switch, number before the sign": _switch('<test value="0.4"> 0 lt aero/alpha-rad </test>'),
    "switch, minus property": _switch(
        '<test value="-aero/alpha-rad"> velocities/vc-kts gt 1 </test>'
    ),
    "switch, no default": _switch(_TEST.format("lt"), ""),
    "switch of two properties": _switch(
        '<test value="0.7"> velocities/vc-kts gt velocities/vt-fps </test>'
    ),
    "channel": _channel(""),
    "channel, execute 0": _channel(
        'execute="fcs/yd-on"', '<property value="0">fcs/yd-on</property>'
    ),
    "channel, execrate": _channel('execrate="4"'),
    "gain, input of another tree": _of("pure_gain", "<gain>2</gain>", f"/{_STICK}"),
    "gain, output to another tree": component(
        f'<pure_gain name="fcs/c"> <input>{_STICK}</input> <output>/fcs/probe</output> </pure_gain>'
    ),
    "property set twice": _TAKES_G | {"control": f"{_g(0.6)} {_g(0.9)}"},
    "property set without a value": _TAKES_G | {"control": f"<property>fcs/g</property> {_g(0.9)}"},
    "property set in two systems": _TAKES_G
    | {"sections": f'<system name="a">{_g(0.6)}</system> <system name="b">{_g(0.9)}</system>'},
    "property that a gain reads": _of("pure_gain", "<gain>fcs/g</gain>")
    | {"control": '<property value="0.6">fcs/g</property>'},
    "autopilot section": {
        "sections": (
            '<autopilot name="AP"> <channel name="a"> <pure_gain name="fcs/c">'
            f" <input>{_STICK}</input> {_OUT} </pure_gain> </channel> </autopilot>"
        ),
        "pitch": pitching("fcs/probe"),
    },
    "system section": {
        "sections": (
            '<system name="S"> <property value="0.4">s/k</property> <channel name="a">'
            f' <pure_gain name="fcs/c"> <input>{_STICK}</input> <gain>s/k</gain> {_OUT}'
            " </pure_gain> </channel> </system>"
        ),
        "pitch": pitching("fcs/probe"),
    },
}
