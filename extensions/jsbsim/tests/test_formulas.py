"""Operations, tables and components of files, compared with NumPy and with filters of SciPy."""

import math

import casadi as ca
import numpy as np
import pytest

from hfa import BadInputError
from hfa_jsbsim.control_system import _COMPONENTS, _controller
from hfa_jsbsim.functions import function_value
from hfa_jsbsim.properties import Properties
from hfa_jsbsim.xml_file import parsed

A, B, C = ca.SX.sym("a"), ca.SX.sym("b"), ca.SX.sym("c")
PAIRS = [(-2.5, 3.0), (-0.5, -1.5), (0.0, 2.0), (0.5, 0.5), (1.4, -0.3), (2.5, 1.0), (7.3, 2.0)]


def known(**options):
    """Return properties a, b and c, which are symbols."""
    properties = Properties(**options)
    for name, symbol in (("a", A), ("b", B), ("c", C)):
        properties.define(name, symbol)
    return properties


def values_of(text, points):
    """Return the values of a <function> with this content at points (a, b)."""
    element = parsed(f"<function>{text}</function>".encode(), "f.xml")
    value = ca.Function("f", [A, B], [ca.SX(function_value(element, known()))])
    return [float(value(*point)) for point in points]


def rounded(x):
    return math.copysign(math.floor(abs(x) + 0.5), x)


def of_log(function):
    return lambda a, b: function(a) if a > 0.0 else -math.inf


OPERATIONS = {
    "<sum>{a}{b}<v>3</v></sum>": lambda a, b: a + b + 3.0,
    "<product>{a}{b}<v>3</v></product>": lambda a, b: 3.0 * a * b,
    "<difference>{a}{b}<v>3</v></difference>": lambda a, b: a - b - 3.0,
    "<avg>{a}{b}<v>3</v></avg>": lambda a, b: (a + b + 3.0) / 3.0,
    "<min>{a}{b}<v>1</v></min>": lambda a, b: min(a, b, 1.0),
    "<max>{a}{b}<v>1</v></max>": lambda a, b: max(a, b, 1.0),
    "<quotient>{a}{b}</quotient>": lambda a, b: a / b,
    "<quotient>{b}{a}</quotient>": lambda a, b: b / a if a else math.inf,
    "<pow><abs>{b}</abs>{a}</pow>": lambda a, b: abs(b) ** a,
    "<fmod>{a}{b}</fmod>": math.fmod,
    "<mod><product>{a}<v>3</v></product><v>2</v></mod>": lambda a, b: math.fmod(int(3 * a), 2),
    "<atan2>{a}{b}</atan2>": math.atan2,
    "<abs>{a}</abs>": lambda a, b: abs(a),
    "<sin>{a}</sin>": lambda a, b: math.sin(a),
    "<cos>{a}</cos>": lambda a, b: math.cos(a),
    "<tan>{a}</tan>": lambda a, b: math.tan(a),
    "<asin><quotient>{a}<v>9</v></quotient></asin>": lambda a, b: math.asin(a / 9),
    "<acos><quotient>{a}<v>9</v></quotient></acos>": lambda a, b: math.acos(a / 9),
    "<atan>{a}</atan>": lambda a, b: math.atan(a),
    "<exp>{a}</exp>": lambda a, b: math.exp(a),
    "<ln>{a}</ln>": of_log(math.log),
    "<log2>{a}</log2>": of_log(math.log2),
    "<log10>{a}</log10>": of_log(math.log10),
    "<sqrt>{a}</sqrt>": lambda a, b: math.sqrt(a) if a >= 0.0 else -math.inf,
    "<floor>{a}</floor>": lambda a, b: math.floor(a),
    "<ceil>{a}</ceil>": lambda a, b: math.ceil(a),
    "<integer>{a}</integer>": lambda a, b: int(a),
    "<fraction>{a}</fraction>": lambda a, b: a - int(a),
    "<roundmultiple>{a}</roundmultiple>": lambda a, b: rounded(a),
    "<roundmultiple>{a}<v>0.4</v></roundmultiple>": lambda a, b: rounded(a / 0.4) * 0.4,
    "<sign>{a}</sign>": lambda a, b: -1.0 if a < 0.0 else 1.0,
    "<toradians>{a}</toradians>": lambda a, b: math.radians(a),
    "<todegrees>{a}</todegrees>": lambda a, b: math.degrees(a),
    "<lt>{a}{b}</lt>": lambda a, b: a < b,
    "<le>{a}{b}</le>": lambda a, b: a <= b,
    "<gt>{a}{b}</gt>": lambda a, b: a > b,
    "<ge>{a}{b}</ge>": lambda a, b: a >= b,
    "<eq>{a}{b}</eq>": lambda a, b: a == b,
    "<nq>{a}{b}</nq>": lambda a, b: a != b,
    "<and>{a}{b}</and>": lambda a, b: bool(a and b),
    "<or>{a}<v>1e-10</v></or>": lambda a, b: bool(a),
    "<not>{a}</not>": lambda a, b: not a,
    "<ifthen>{a}{b}<v>9</v></ifthen>": lambda a, b: b if a else 9.0,
    "<switch><abs>{a}</abs>{b}<v>6</v><v>7</v><v>8</v><v>5</v><v>4</v><v>3</v><v>2</v></switch>": (
        lambda a, b: [b, 6.0, 7.0, 8.0, 5.0, 4.0, 3.0, 2.0][math.floor(abs(a) + 0.5)]
    ),
    "<interpolate1d>{a}<v>-1</v><v>2</v><v>0</v>{b}<v>3</v><v>5</v></interpolate1d>": (
        lambda a, b: np.interp(a, [-1.0, 0.0, 3.0], [2.0, b, 5.0])
    ),
    "<product><pi/><p>-a</p></product>": lambda a, b: -math.pi * a,
}


def test_operations_are_those_of_numpy():
    for text, function in OPERATIONS.items():
        found = values_of(text.format(a="<p>a</p>", b="<p>b</p>"), PAIRS)
        expected = [float(function(*pair)) for pair in PAIRS]
        assert found == pytest.approx(expected, rel=1e-14), text


def table(text, *names):
    lookups = ("row", "column", "table")
    variables = [
        f'<independentVar lookup="{lookup}">{name}</independentVar>'
        for lookup, name in zip(lookups, names, strict=False)
    ]
    return f"<table>{''.join(variables)}{text}</table>"


def test_tables_are_interpolated_along_each_axis_and_constant_beyond():
    """Of one, two and three axes; the third also with other breakpoints in each part."""
    line = table("<tableData>\n0 1\n1 3\n4 -3\n</tableData>", "a")
    points = [(-1.0, 0.0), (0.25, 0.0), (2.0, 0.0), (9.0, 0.0)]
    assert values_of(line, points) == pytest.approx([1.0, 1.5, 1.0, -3.0])
    body = "\n  -1 1\n0 {} 2\n2 4 {}\n"
    plane = table(f"<tableData>{body.format(1, 8)}</tableData>", "a", "b")
    points = [(0.0, -1.0), (1.0, -1.0), (0.0, 0.0), (1.0, 0.0), (9.0, 9.0)]
    assert values_of(plane, points) == pytest.approx([1.0, 2.5, 1.5, 3.75, 8.0])
    one = table("<tableData>\n 5\n0 1\n2 4\n</tableData>", "a", "b")
    assert values_of(one, [(1.0, -9.0), (1.0, 5.0), (1.0, 9.0)]) == pytest.approx([2.5] * 3)
    other = "\n  -1 1\n0 3 4\n5 6 10\n"
    for second, at_one, highest in ((body.format(3, 10), 2.0, 2.0), (other, 4.0, 5.0)):
        text = "".join(
            f'<tableData breakPoint="{place}">{part}</tableData>'
            for place, part in ((10.0, body.format(1, 8)), (20.0, second))
        )
        element = parsed(f"<function>{table(text, 'a', 'b', 'c')}</function>".encode(), "f.xml")
        properties = known()
        value = ca.Function("f", [A, B, C], [function_value(element, properties)])
        for c, share in ((5.0, 0.0), (10.0, 0.0), (12.5, 0.25), (30.0, 1.0)):
            at = [float(value(0.0, b, c)) for b in (-1.0, 1.0)]
            assert at == pytest.approx([1.0 + 2.0 * share, 2.0 + (at_one - 2.0) * share])
        assert properties.ranges == {"a": (0.0, highest), "b": (-1.0, 1.0), "c": (10.0, 20.0)}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<p>a</p><p>b</p>", "the number of elements in <function> is 2; give one"),
        ("<p apply='x'>a</p>", "template functions"),
        ("<p>a#</p>", "contains #, which is replaced only in engine files"),
        ("<p>--a</p>", "begins with several signs"),
        ("<p>a b</p>", "is neither a number nor a property name"),
        ("<v>1\n2</v>", "<v> contains several lines"),
        ("<v>nan</v>", "<v> is nan; give a finite number"),
        ("<table><independentVar>a</independentVar></table>", "has no <tableData>"),
        ("<table type='internal'/>", "a table with the attribute type"),
        (table("<tableData>\n0 1\n1 3\n</tableData>"), "the table has 1 axes and 0 independentVar"),
        ("<table><independentVar lookup='depth'>a</independentVar><tableData>\n0 1\n1 3\n"
         "</tableData></table>", "the lookup depth of <independentVar> is unknown"),
        (table("<tableData>\n0 1_0\n1 3\n</tableData>", "a"), "is not a row of numbers"),
        (table("<tableData>\n0 inf\n1 3\n</tableData>", "a"), "a number that is not finite"),
        (table("<tableData>\n0 1\n1 3 4 5\n</tableData>", "a"), "a row of the table has the wrong"),
        (table("<tableData breakPoint='1'>\n0 1\n1 3\n</tableData>" * 2, "a"), "has no row of"),
        (table("<tableData breakPoint='1'>\n 0 1\n0 1 2\n1 3 4\n</tableData><tableData"
               " breakPoint='x'>\n 0 1\n0 1 2\n1 3 4\n</tableData>", "a"), "contains 'x'"),
    ],
)  # fmt: skip
def test_faults_of_functions_are_refused(text, said):
    with pytest.raises(BadInputError, match=said):
        values_of(text, PAIRS)


@pytest.mark.parametrize(
    ("name", "coefficients", "numerator", "denominator"),
    [
        ("lag", [3.0], [3.0], [1.0, 3.0]),
        ("washout", [3.0], [1.0, 0.0], [1.0, 3.0]),
        ("lead_lag", [2.0, 3.0, 4.0, 5.0], [2.0, 3.0], [4.0, 5.0]),
        ("second_order", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], [1.0, 2.0, 3.0], [4.0, 5.0, 6.0]),
    ],
)
def test_states_of_filters_have_the_transfer_function(name, coefficients, numerator, denominator):
    numbers = "".join(f"<c{i + 1}>{c}</c{i + 1}>" for i, c in enumerate(coefficients))
    text = f"<{name}_filter name='f'><input>a</input>{numbers}</{name}_filter>"
    properties = known(has_filter_states=True)
    component = parsed(text.encode(), "f.xml")
    output = ca.SX(_COMPONENTS[component.name](component, properties))
    states = ca.vertcat(*(state.symbol for state in properties.filters))
    rates = ca.vertcat(*(state.writer.compute() for state in properties.filters))
    for s in (0.0, 2.0j, 1.0 + 3.0j):
        matrices = (ca.jacobian(of, by) for of in (rates, output) for by in (states, A))
        F, G, H, D = (np.array(ca.DM(ca.densify(ca.SX(each)))) for each in matrices)
        response = H @ np.linalg.solve(s * np.eye(len(F)) - F, G) + D
        assert response[0, 0] == pytest.approx(
            np.polyval(numerator, s) / np.polyval(denominator, s)
        )
    steady = known()
    value = _COMPONENTS[component.name](parsed(text.encode(), "f.xml"), steady)
    gain = float(ca.DM(ca.jacobian(ca.SX(value), A)))
    assert gain == pytest.approx(np.polyval(numerator, 0.0) / np.polyval(denominator, 0.0))
    assert len(steady.left_out) == 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<angle><source_angle>a</source_angle><target_angle>b</target_angle></angle>",
         lambda a, b: math.remainder(b - a, 2.0 * math.pi)),
        ("<angle unit='DEG'><source_angle unit='DEG'>a</source_angle><target_angle>b</target_angle>"
         "</angle>", lambda a, b: math.degrees(math.remainder(b - math.radians(a), 2.0 * math.pi))),
        ("<sensor name='s'><input>a</input><gain>3</gain><bias>2</bias></sensor>",
         lambda a, b: 3.0 * a + 2.0),
        ("<gyro name='s'><axis>Y</axis><gain>3</gain><bias>2</bias></gyro>", lambda a, b: 3.0 * b + 2.0),
        ("<summer name='s'><input>a</input><input>-b</input><bias>2</bias></summer>",
         lambda a, b: a - b + 2.0),
        ("<pure_gain name='s'><input>a</input><gain>b</gain></pure_gain>", lambda a, b: a * b),
        ("<deadband name='s'><input>a</input><width>1</width><gain>3</gain></deadband>",
         lambda a, b: 3.0 * math.copysign(max(abs(a) - 0.5, 0.0), a)),
        ("<kinematic name='s'><input>a</input><traverse><setting><position>-1</position><time>0</time>"
         "</setting><setting><position>4</position><time>0</time></setting></traverse></kinematic>",
         lambda a, b: min(max(4.0 * a, -1.0), 4.0)),
        ("<lag_filter name='s'><input>a</input><c1>10</c1></lag_filter>", lambda a, b: a),
        ("<scheduled_gain name='s'><input>a</input><gain>3</gain>"
         + table("<tableData>\n0 1\n2 5\n</tableData>", "b") + "</scheduled_gain>",
         lambda a, b: 3.0 * a * np.interp(b, [0.0, 2.0], [1.0, 5.0])),
        ("<aerosurface_scale name='s'><input>a</input><domain><min>-2</min><max>4</max></domain>"
         "<range><min>-1</min><max>8</max></range><gain>3</gain></aerosurface_scale>",
         lambda a, b: 3.0 * a * (2.0 if a > 0.0 else 0.5)),
        ("<aerosurface_scale name='s'><input>a</input><domain><min>-2</min><max>4</max></domain>"
         "<zero_centered>0</zero_centered><range><min>-1</min><max>8</max></range>"
         "</aerosurface_scale>", lambda a, b: -1.0 + (a + 2.0) * 1.5),
        ("<fcs_function name='s'><function><p>b</p></function><input>a</input></fcs_function>",
         lambda a, b: a * b),
        ("<switch name='s'><default value='9'/><test logic='OR' value='a'> a gt 2\n b ge 2 </test>"
         "<test value='b'> a le 0\n b ne 2 </test></switch>",
         lambda a, b: a if a > 2.0 or b >= 2.0 else (b if a <= 0.0 and b != 2.0 else 9.0)),
        ("<actuator name='s'><input>a</input><deadband_width>1</deadband_width><bias>2</bias>"
         "</actuator>", lambda a, b: math.copysign(max(abs(a) - 0.5, 0.0), a) + 2.0),
    ],
)  # fmt: skip
def test_components_without_memory_have_their_formula(text, expected):
    properties = known()
    properties.define("velocities/q-rad_sec", B)
    component = parsed(text.encode(), "f.xml")
    value = ca.Function("f", [A, B], [ca.SX(_COMPONENTS[component.name](component, properties))])
    for pair in PAIRS:
        assert float(value(*pair)) == pytest.approx(expected(*pair), rel=1e-7, abs=1e-9), pair


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<gyro name='s'><axis>W</axis></gyro>", "give X, Y or Z"),
        ("<gyro name='s'><axis>X</axis><lag>2</lag></gyro>", "<lag> of a gyro is not supported"),
        ("<sensor name='s'><input>a</input><noise>2</noise></sensor>", "<noise> of a sensor"),
        ("<lag_filter name='s'><input>a</input><c1>0</c1></lag_filter>", "<c1> is 0, so the filter"),
        ("<lead_lag_filter name='s'><input>a</input><c1>1</c1><c2>1</c2><c3>1</c3><c4>0</c4>"
         "</lead_lag_filter>", "<c4> is 0, so the filter has no steady-state"),
        ("<second_order_filter name='s'><input>a</input><c1>1</c1><c2>1</c2><c3>1</c3><c4>1</c4>"
         "<c5>1</c5><c6>0</c6></second_order_filter>", "<c6> is 0, so the filter"),
        ("<switch name='s'><default/></switch>", "<default> has no value"),
        ("<switch name='s'><test> a gt 1 </test></switch>", "<test> has no value"),
        ("<switch name='s'><test value='1'> a\tgt 1 </test></switch>", "contains a tab"),
        ("<switch name='s'><test value='1'> a over 1 </test></switch>", "is not a condition"),
        ("<switch name='s'><test value='1'> 1 gt a </test></switch>", "begins with a number"),
        ("<switch name='s'><test value='1'></test></switch>", "<test> has no condition"),
        ("<switch name='s'><test value='1' logic='XOR'> a gt 1 </test></switch>", "write AND or OR"),
        ("<pure_gain name='s'><input>3</input></pure_gain>", "give the name of a property"),
        ("<pure_gain name='s'/>", "has no <input>"),
        ("<kinematic name='s'><input>a</input><traverse><setting><position>1</position><time>0"
         "</time></setting></traverse></kinematic>", "fewer than two <setting>"),
        ("<kinematic name='s'><input>a</input><traverse><setting><position>1</position><time>0"
         "</time></setting><setting><position>0</position><time>0</time></setting></traverse>"
         "</kinematic>", "less than the position before"),
    ],
)  # fmt: skip
def test_faults_of_components_are_refused(text, said):
    component = parsed(text.encode(), "f.xml")
    with pytest.raises(BadInputError, match=said):
        _COMPONENTS[component.name](component, known())


def test_steady_controllers_have_no_integral():
    """With filter states, the integral is a state of rate ki u, which a <trigger> stops."""
    text = (
        "<pid name='p'{}><input>a</input><kp>2</kp><ki>3</ki><kd>0.5</kd><pvdot>b</pvdot>{}</pid>"
    )
    for kind, total in (("", 5.0), (" type='standard'", 6.0)):
        component = parsed(text.format(kind, "").encode(), "f.xml")
        steady = ca.SX(_controller(component, known(), ca.SX(0, 1)))
        assert float(ca.Function("f", [A, B], [steady])(2.0, 2.0)) == total
    for trigger, rate in (("", 6.0), ("<trigger>b</trigger>", 0.0)):
        properties = known(has_filter_states=True)
        component = parsed(text.format("", trigger).encode(), "f.xml")
        value = ca.SX(_controller(component, properties, ca.SX(0, 1)))
        (state,) = properties.filters
        found = ca.Function("f", [A, B, state.symbol], [value, state.writer.compute()])
        assert [float(each) for each in found(2.0, 2.0, 7.0)] == [12.0, rate]
