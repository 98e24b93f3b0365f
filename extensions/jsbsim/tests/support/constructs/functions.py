"""Constructs of functions, tables and aerodynamics."""

from constructs.jet import coefficient, function, pitching, slope

_A = "<p>aero/alpha-rad</p>"
_B = "<p>aero/beta-rad</p>"
_V = "<v>0.5</v>"


def _of(operation, *arguments):
    """Return the slots of a construct with an operation in a function."""
    return function(f"<{operation}> {' '.join(arguments)} </{operation}>")


def _table(data, *variables, head=""):
    """Return the slots of a construct with a <table> in a function."""
    names = "".join(variables)
    return function(f"<table> {names} {head} <tableData> {data} </tableData> </table>")


def _variable(name, lookup=""):
    """Return the XML of an independent variable of a table."""
    attribute = f' lookup="{lookup}"' if lookup else ""
    return f"<independentVar{attribute}>{name}</independentVar>"


_ROW = _variable("aero/alpha-rad", "row")
_COLUMN = _variable("aero/beta-rad", "column")
_ALPHA = _variable("aero/alpha-rad")


def _axis(name, text, attributes=""):
    """Return the slots of a construct with a further <axis>."""
    return {"axes": f'<axis name="{name}" {attributes}> {text} </axis>'}


def _axes(up, along, across, attributes=""):
    """Return the slots that rename the axes of the jet's lift, drag and side force."""
    names = {"lift_axis": up, "drag_axis": along, "side_axis": across}
    return {slot: f'name="{name}" {attributes}' for slot, name in names.items()}


_OF_TWO = (
    *("sum", "product", "difference", "quotient", "avg", "min", "max", "pow", "fmod", "mod"),
    *("atan2", "lt", "le", "gt", "ge", "eq", "nq", "and", "or"),
)
_OF_ONE = (
    *("abs", "sin", "cos", "tan", "asin", "acos", "atan", "exp", "ln", "log2", "log10", "sqrt"),
    *("floor", "ceil", "integer", "sign", "toradians", "todegrees", "not"),
)
_FORCE = coefficient(slope(0.3, "aero/alpha-rad"))
_HYSTERESIS = (
    '<alphalimits unit="DEG"> <min>-10</min> <max>{}</max> </alphalimits>'
    ' <hysteresis_limits unit="DEG"> <min>{}</min> <max>{}</max> </hysteresis_limits>'
)

CONSTRUCTS = {
    **{name: _of(name, _A, _V) for name in _OF_TWO},
    **{name: _of(name, f"<sum> {_A} <v>0.4</v> </sum>") for name in _OF_ONE},
    **{
        f"{name} of a negative number": _of("max", f"<{name}> <v>-1</v> </{name}>", "<v>-0.5</v>")
        for name in ("ln", "log2", "log10", "sqrt")
    },
    **{
        f"{name} that changes its sign": _of(
            "max", f"<{name}> <sum> {_B} <v>0.01</v> </sum> </{name}>", "<v>-0.5</v>"
        )
        for name in ("ln", "log2", "log10", "sqrt")
    },
    "ln of zero": _of("max", "<ln> <v>0</v> </ln>", "<v>-0.5</v>"),
    "quotient by zero": _of("min", f"<quotient> {_A} <v>0</v> </quotient>", _V),
    "quotient of zero by zero": _of("min", "<quotient> <v>0</v> <v>0</v> </quotient>", _V),
    "fmod by zero": _of("min", f"<fmod> {_A} <v>0</v> </fmod>", _V),
    "not of a small number": _of("not", "<v>1e-10</v>"),
    "ifthen of a small number": _of("ifthen", "<v>-1e-10</v>", _V, "<v>0.2</v>"),
    "and of a small number": _of("and", "<v>1e-10</v>", "<v>1</v>"),
    "or of a small number": _of("or", "<v>1e-10</v>", "<v>0</v>"),
    "or of a small enough number": _of("or", "<v>2e-9</v>", "<v>0</v>"),
    "atan2 of minus zero": _of("atan2", "<v>-0.0</v>", "<v>-1</v>"),
    "value in another alphabet": function("<v>\u0663</v>"),
    "table of rows over a further axis": function(
        f'<table> {_ROW} {_COLUMN} <tableData breakPoint="0"> -1 2\n 1 3 </tableData>'
        ' <tableData breakPoint="0.1"> -1 5\n 1 3 </tableData> </table>'
    ),
    "sum of one": _of("sum", _A),
    "difference of three": _of("difference", _A, _V, _B),
    "pi": _of("product", "<pi/>", _A),
    "ifthen": _of("ifthen", f"<gt> {_A} <v>0</v> </gt>", _V, "<v>0.2</v>"),
    "switch function": _of("switch", "<v>1</v>", "<v>0.1</v>", "<v>0.2</v>", "<v>0.3</v>"),
    "switch function by a state": _of(
        "switch",
        f"<product> {_A} <v>10</v> </product>",
        *(f"<v>{0.1 * number}</v>" for number in range(5)),
    ),
    "interpolate1d": _of(
        "interpolate1d", _A, "<v>-1</v> <v>0</v> <v>0</v> <v>2</v> <v>1</v> <v>1</v>"
    ),
    "random": _of("random"),
    "urandom": _of("urandom"),
    "rotation_alpha_local": _of("rotation_alpha_local", *["<v>0.1</v>"] * 6),
    "unknown operation": _of("sinh", _A),
    "value of two lines": function("<v>0.5\n0.7</v>"),
    "value with an underscore": function("<v>1_0.5e-2</v>"),
    "value nan": function("<v>nan</v>"),
    "value inf": function("<v>inf</v>"),
    "value with a blank": function("<v> 0.5 0.7 </v>"),
    "property with a minus": _of("sum", "<p>-aero/alpha-rad</p>"),
    "property with an index": _of("sum", "<p>aero/alpha-rad[0]</p>"),
    "property and value attribute": {
        "air": '<property value="0.4">aero/k</property>',
        **function("<p>aero/k</p>"),
    },
    "function with a name": {
        "air": f'<function name="aero/f"> <sum> {_A} {_V} </sum> </function>',
        **function("<p>aero/f</p>"),
    },
    "function of a later function": {
        "air": (
            '<function name="aero/f"> <p>aero/g</p> </function>'
            f' <function name="aero/g"> <sum> {_A} {_V} </sum> </function>'
        ),
        **function("<p>aero/f</p>"),
    },
    "function in an axis read by another": {
        "lift": f'<function name="aero/L"> <product> <v>100</v> {_A} </product> </function>',
        **function("<product> <v>0.01</v> <p>aero/L</p> </product>"),
    },
    "function in a function": function(f'<function name="aero/f"> {_A} </function>'),
    "function that copies": {
        "air": f'<function name="aero/f" copyto="aero/g"> {_A} </function>',
        **function("<p>aero/g</p>"),
    },
    "function type pre": {
        "air": f'<function name="aero/f" type="pre"> {_A} </function>',
        **function("<p>aero/f</p>"),
    },
    "function type post": {
        "air": f'<function name="aero/f" type="post"> {_A} </function>',
        **function("<p>aero/f</p>"),
    },
    "function type template": {
        "air": (
            '<function name="aero/t" type="template"> <product> <p>#</p>'
            " <v>2</v> </product> </function>"
        ),
        **function('<p apply="aero/t">aero/alpha-rad</p>'),
    },
    "function with a description": {
        "air": f'<function name="aero/f"> <description>text</description> {_A} </function>',
        **function("<p>aero/f</p>"),
    },
    "table of rows": _table("-1 0.3\n 0 0.1\n 0.1 0.4\n 1 0.2", _ALPHA),
    "table, lookup row": _table("-1 0.3\n 0 0.1\n 1 0.2", _ROW),
    "table of two": _table("   -1 1\n -1 0.1 0.2\n 1 0.3 0.7", _ROW, _COLUMN),
    "table of three": function(
        f"<table> {_ROW} {_COLUMN} {_variable('velocities/vt-fps', 'table')}"
        ' <tableData breakPoint="100"> -1 1\n -1 0.1 0.2\n 1 0.3 0.7 </tableData>'
        ' <tableData breakPoint="900"> -1 1\n -1 0.3 0.1\n 1 0.2 0.4 </tableData> </table>'
    ),
    "table with a name": {
        "air": (
            f'<function name="aero/f"> <table name="aero/T"> {_ALPHA}'
            " <tableData> -1 0.3\n 1 0.2\n </tableData> </table> </function>"
        ),
        **function("<p>aero/f</p>"),
    },
    "table read by its name": {
        "air": (
            f'<function name="aero/f"> <table name="aero/T"> {_ALPHA}'
            " <tableData> -1 0.3\n 1 0.2\n </tableData> </table> </function>"
        ),
        **function("<p>aero/T</p>"),
    },
    "table of a minus variable": _table("-1 0.3\n 1 0.2", _variable("-aero/alpha-rad")),
    "table of an engine in a function": function(
        f'<table type="internal"> {_ALPHA} <tableData>\n 0 0.1\n 0.2 0.3\n </tableData> </table>'
    ),
    "table with nan": _table("-1 nan\n 1 0.2", _ALPHA),
    "table with one row": _table("-1 0.3", _ALPHA),
    "table unsorted": _table("1 0.3\n -1 0.2\n 2 0.1", _ALPHA),
    "table beyond its end": _table("-2 0.3\n -1 0.2", _ALPHA),
    "axis X": _axis("X", _FORCE),
    "axis Z, body": _axis("Z", _FORCE),
    "axis AXIAL": _axis("AXIAL", _FORCE),
    "axis NORMAL": _axis("NORMAL", _FORCE),
    "axis ROLL again": _axis("ROLL", coefficient(slope(0.2, "aero/beta-rad"), length="bw-ft")),
    "axis ROLL, stability frame": _axis("ROLL", _FORCE, 'frame="STABILITY"'),
    "axis LIFT, frame": _axis("LIFT", _FORCE, 'frame="BODY"'),
    "force at the center of gravity": {
        "lift": f'<function apply_at_cg="true"> <product> <v>300</v> {_A} </product> </function>'
    },
    "axes AXIAL and NORMAL": _axes("NORMAL", "AXIAL", "SIDE"),
    "axes X, Y, Z": _axes("Z", "X", "Y"),
    **{
        f"axes X, Y, Z, {frame.lower()} frame": _axes("Z", "X", "Y", f'frame="{frame}"')
        for frame in ("BODY", "STABILITY", "WIND", "EARTH")
    },
    **{
        f"moments, {frame.lower()} frame": {"moment_frame": f' frame="{frame}"'}
        for frame in ("BODY", "STABILITY", "WIND", "EARTH")
    },
    "axes X, Y, Z, lift by cl-squared": {
        **_axes("Z", "X", "Y"),
        "lift": coefficient(slope(0.1, "aero/cl-squared")),
    },
    "side force at the center of gravity": {
        "axes": (
            '<axis name="SIDE"> <function apply_at_cg="true"> <product> <v>300</v>'
            f" {_A} </product> </function> </axis>"
        ),
        "side_axis": 'name="YAW"',
    },
    "moment at the center of gravity": {
        "pitch": f'<function apply_at_cg="true"> <product> <v>300</v> {_A} </product> </function>'
    },
    "lift at the center of gravity, cl-squared": {
        "lift": (
            f'<function apply_at_cg="true"> <product> <v>300</v> {_A} </product> </function>'
            + coefficient(slope(0.1, "aero/cl-squared"))
        )
    },
    "alpha limits": {"air": '<alphalimits unit="DEG"> <min>-20</min> <max>20</max> </alphalimits>'},
    "hysteresis limits, not stalled": {"air": _HYSTERESIS.format(60, 70, 80)}
    | function("<p>aero/stall-hyst-norm</p>"),
    "hysteresis limits, stalled": {"air": _HYSTERESIS.format(-50, -60, -55)}
    | function("<p>aero/stall-hyst-norm</p>"),
    "reference point moves": {
        "air": "<aero_ref_pt_shift_x> <function> <v>0.2</v> </function> </aero_ref_pt_shift_x>"
    },
    "lift by cl-squared": {"lift": coefficient(slope(0.1, "aero/cl-squared"))},
    "moment by alphadot": {"pitch": pitching("aero/alphadot-rad_sec")},
    "rounded to a multiple": _of("roundmultiple", _A, "<v>0.1</v>"),
}
