"""DAVE-ML files: check cases, formulas, tables, and an aircraft compared with the same aircraft
from a table of derivatives.
"""

import math
import re

import casadi as ca
import numpy as np
import pytest
from project import ROOT

import hfa
from hfa import BadInputError
from hfa_daveml import model_unit, read_document, value_of

UAV = ROOT / "examples" / "uav.dml"
TEXT = UAV.read_text(encoding="utf-8")
#: A foot in m, and a newton in lbf.
_FOOT = 0.3048
_NEWTON = 1.0 / (0.45359237 * 9.80665)
#: The example's definition of the mass.
_MASS = re.search(r'  <variableDef name="totalMass".*?</variableDef>\n', TEXT, re.S)[0]

CASE, OUTPUTS, GRID = (
    re.search(rf"<{name}.*?</{name}>", TEXT, re.S)[0]
    for name in ("checkInputs", "checkOutputs", "griddedTableDef")
)

#: First value of the table, and first printed output of the check case.
FIRST_VALUE = re.search(r"<dataTable>[-.\d]+", TEXT)[0]
PRINTED = re.search(r"<signalValue>([^<]+)", OUTPUTS)[1]
#: Message if a printed value of a check case is not that of the tables and formulas.
FALSE = "differ from the tables"

#: A file with one variable y of x, its elements and further elements.
_ONE = """<DAVEfunc><variableDef name="x" varID="x" units="nd"><isInput/></variableDef>
<variableDef name="y" varID="y" units="nd">{}</variableDef>{}</DAVEfunc>"""


def changed(folder, old, new):
    """Return the path of a copy of the example file with one replacement.

    old: text in the example, which must occur
    new: text that replaces its first occurrence
    """
    assert old in TEXT
    path = folder / "changed.dml"
    path.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    return str(path)


def formula(text, x, folder):
    """Return the value at x of a MathML formula in a DAVE-ML file."""
    path = folder / "one.dml"
    path.write_text(_ONE.format(f"<calculation><math>{text}</math></calculation>", ""))
    return float(ca.evalf(value_of(read_document(str(path)), "y", {"x": x})))


def with_definitions(folder, name, renamed, text):
    """Return the path of a copy of the example with renamed variables, and with the definitions in
    `text` in place of its check cases.
    """
    content = TEXT
    for old, new in renamed.items():
        assert f'"{old}"' in content
        content = content.replace(f'"{old}"', f'"{new}"')
    content = re.sub(r"<checkData>.*</checkData>", text, content, flags=re.S)
    path = folder / name
    path.write_text(content, encoding="utf-8")
    return str(path)


#: A state in ft and rad (speed, alpha, beta, rates, roll, pitch, yaw, altitude), and elevator,
#: aileron, rudder, rad, and thrust, lbf, at which models are compared.
STATE = [120.0, 0.06, 0.05, 0.1, 0.2, -0.1, 0.3, 0.2, 0.1, 500.0]
INPUTS = [0.02, -0.03, 0.01, 5.0]


def test_forces_in_body_axes_give_the_aircraft_of_lift_and_drag(tmp_path):
    """C_X = C_L sin α - C_D cos α and C_Z = -C_L cos α - C_D sin α give the motion and the outputs
    of C_L and C_D. C_Z without C_X is refused.
    """

    def product(factor, function):
        angle = f"<apply><{function}/><ci>alpha_rad</ci></apply>"
        return f"<apply><times/><cn>-1</cn><ci>{factor}</ci>{angle}</apply>"

    def coefficient(axis, operation):
        body = f"<calculation><math><apply><{operation}</apply></math></calculation><isOutput/>"
        name = f"aeroBodyForceCoefficient_{axis}"
        return f'<variableDef name="{name}" varID="C{axis}" units="nd">{body}</variableDef>'

    x = coefficient("X", f"minus/>{product('CD', 'cos')}{product('CL', 'sin')}")
    z = coefficient("Z", f"plus/>{product('CL', 'cos')}{product('CD', 'sin')}")
    renamed = {"totalCoefficientOfLift": "own lift", "totalCoefficientOfDrag": "own drag"}
    path = with_definitions(tmp_path, "body.dml", renamed, x + z)
    models = hfa.load_model(path), hfa.load_model(str(UAV))
    rates = [model.rates_at(STATE, INPUTS) for model in models]
    assert rates[0] == pytest.approx(rates[1], rel=1e-9, abs=1e-12)
    outputs = [model.outputs_at(STATE, INPUTS) for model in models]
    assert outputs[0] == pytest.approx(outputs[1], rel=1e-9)
    with pytest.raises(BadInputError, match="missing outputs: aeroBodyForceCoefficient_X"):
        hfa.load_model(with_definitions(tmp_path, "none.dml", renamed, z))


def test_a_deflection_is_an_input_and_another_constant_a_parameter(tmp_path):
    """With initial values, the deflection of the elevator, -2 deg, is an input of the model, and a mass
    of fuel, 2 kg, a parameter, both in the model's units rad and slug.

    Limits in the file are those of the model; limits that the file does not have are marked as assumed.
    """
    old = '<variableDef name="elevatorDeflection" varID="de" units="deg"'
    fuel = '<variableDef name="fuel" varID="f" units="kg" initialValue="2"><isInput/></variableDef>'
    path = changed(tmp_path, old, f'{fuel}{old} initialValue="-2"')
    model = hfa.load_model(path)
    assert model.inputs["elevatorDeflection"].start == pytest.approx(np.radians(-2.0))
    assert model.parameters["fuel"].start == pytest.approx(2.0 / 14.59390294)
    limits = (model.inputs["elevatorDeflection"].min, model.inputs["elevatorDeflection"].max)
    assert limits == pytest.approx((np.radians(-25.0), np.radians(25.0)))
    assert model.inputs["engineThrust"].max == pytest.approx(60.0 * _NEWTON)
    alpha = model.states["alpha"]
    assert (alpha.min, alpha.max) == pytest.approx((np.radians(-10.0), np.radians(10.0)))
    assert not alpha.assumed
    assert model.states["beta"].assumed


def test_an_output_of_one_file_is_an_input_of_another(tmp_path):
    """The example without its mass, and a second file that computes it from the wing area of the first,
    give the trim of the example, also in a folder whose name has a +.
    """
    folder = tmp_path / "a+b"
    folder.mkdir()
    slug_per_ft2 = 13.5 / 14.59390294 / (0.55 / _FOOT**2)  # 13.5 kg and 0.55 m²
    (folder / "aero.dml").write_text(TEXT.replace(_MASS, ""), encoding="utf-8")
    (folder / "mass.dml").write_text(
        '<DAVEfunc><variableDef name="referenceWingArea" varID="S" units="ft2"><isInput/>'
        '</variableDef><variableDef name="totalMass" varID="m" units="slug"><calculation><math>'
        f"<apply><times/><ci>S</ci><cn>{slug_per_ft2!r}</cn></apply></math></calculation><isOutput/>"
        "</variableDef></DAVEfunc>"
    )
    joined = hfa.load_model(f"{folder}/aero.dml+{folder}/mass.dml")
    points = [hfa.trim(model) for model in (joined, hfa.load_model(str(UAV)))]
    np.testing.assert_allclose(points[0].states, points[1].states, rtol=1e-8)


def test_two_files_declare_one_input(tmp_path):
    """An input that two files declare has the narrower limits of both, in either order of the files, and
    if one is in m and the other in ft. With an initial value, which both files have, it is a parameter.

    Another initial value, one in one file only, and one in another unit are refused.
    """

    def both_orders(own, other):
        """Return the paths, in both orders, of the example and a file, which both declare the input load."""
        declared = '<variableDef name="load" varID="load" {}><isInput/></variableDef>'
        first = changed(tmp_path, "<variableDef", f"{declared.format(own)}<variableDef")
        second = tmp_path / "second.dml"
        second.write_text(f"<DAVEfunc>{declared.format(other)}</DAVEfunc>", encoding="utf-8")
        return f"{first}+{second}", f"{second}+{first}"

    with_limits = 'units="ft" initialValue="2" minValue="-3" maxValue="7"'
    for paths in both_orders(with_limits, 'units="ft" initialValue="2" maxValue="5"'):
        load = hfa.load_model(paths).parameters["load"]
        assert (load.min, load.start, load.max) == (-3.0, 2.0, 5.0)
    for paths in both_orders('units="ft" maxValue="7"', 'units="m" maxValue="1.524"'):
        assert hfa.load_model(paths).inputs["load"].max == pytest.approx(5.0)
    for other in (
        'units="ft" initialValue="3"',
        'units="ft"',
        'units="m" initialValue="2"',
        'units="lbf" initialValue="2"',
    ):
        for paths in both_orders(with_limits, other):
            with pytest.raises(BadInputError, match=r"variable load.* another unit or initial"):
                hfa.load_model(paths)


def test_a_missing_and_a_repeated_definition_are_refused(tmp_path):
    """A file without the mass, a mass in two files, and a file that is missing are refused."""
    alone = tmp_path / "aero.dml"
    alone.write_text(TEXT.replace(_MASS, ""), encoding="utf-8")
    other = tmp_path / "mass.dml"
    other.write_text(f"<DAVEfunc>{_MASS}</DAVEfunc>", encoding="utf-8")
    with pytest.raises(BadInputError, match=r"totalMass; add \+FILE"):
        hfa.load_model(str(alone))
    with pytest.raises(BadInputError, match="is also an output of"):
        hfa.load_model(f"{other}+{UAV}")
    with pytest.raises(BadInputError, match=r"none.dml cannot be read"):
        hfa.load_model(f"{UAV}+{tmp_path}/none.dml")


#: Operator -> its value for x = 0.3, or for x and -1, or for x, -1 and 2.
OPERATORS = {
    **{name: function(0.3) for name, function in (
        ("abs", abs), ("floor", np.floor), ("ceiling", np.ceil), ("exp", np.exp), ("ln", np.log),
        ("log", np.log10), ("sin", np.sin), ("cos", np.cos), ("tan", np.tan),
        ("arcsin", np.arcsin), ("arccos", np.arccos), ("arctan", np.arctan), ("sinh", np.sinh),
        ("cosh", np.cosh), ("tanh", np.tanh), ("root", np.sqrt), ("minus", np.negative),
    )},
    **{f"{name} <cn>-1</cn>": function(0.3, -1.0) for name, function in (
        ("minus", np.subtract), ("divide", np.divide), ("power", np.power), ("lt", np.less),
        ("gt", np.greater), ("leq", np.less_equal), ("geq", np.greater_equal), ("eq", np.equal),
        ("neq", np.not_equal), ("<csymbol>atan2</csymbol>", np.arctan2),
    )},
    "plus <cn>-1</cn><cn>2</cn>": 1.3,
    "times <cn>-1</cn><cn>2</cn>": -0.6,
    "min <cn>-1</cn><cn>2</cn>": -1.0,
    "max <cn>-1</cn><cn>2</cn>": 2.0,
    "leq <cn>0.3</cn>": 1.0,
    "geq <cn>0.3</cn>": 1.0,
    "eq <cn>0.3</cn>": 1.0,
    "gt <cn>0.3</cn>": 0.0,
    "lt <cn>0.3</cn>": 0.0,
    "neq <cn>0.3</cn>": 0.0,
    "geq <cn>1</cn>": 0.0,
    "and <true/>": 1.0,
    "and <false/>": 0.0,
    "or <false/>": 1.0,
    "not": 0.0,
}  # fmt: skip


@pytest.mark.parametrize("operator", OPERATORS)
def test_operators_have_the_values_of_numpy(operator, tmp_path):
    """Each operator of a formula has its value, with the arguments in their order."""
    name, _, others = operator.partition(" ")
    element = name if name.startswith("<") else f"<{name}/>"
    found = formula(f"<apply>{element}<ci>x</ci>{others}</apply>", 0.3, tmp_path)
    assert found == pytest.approx(float(OPERATORS[operator]), rel=1e-14)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<apply><ci>x</ci></apply>", 0.3),  # x = 0.3
        ("<apply><abs/><apply><minus/><ci>x</ci></apply></apply>", 0.3),
        ("<apply><floor/><apply><minus/><ci>x</ci></apply></apply>", -1.0),
        ("<apply><not/><apply><lt/><ci>x</ci><cn>0</cn></apply></apply>", 1.0),
        ("<apply><or/><apply><lt/><ci>x</ci><cn>0</cn></apply><false/></apply>", 0.0),
        ("<pi/>", np.pi),
        ("<exponentiale/>", np.e),
        ("<cn type='e-notation'>1.5<sep/>-3</cn>", 1.5e-3),
        (
            "<piecewise><piece><cn>1</cn><apply><lt/><ci>x</ci><cn>0</cn></apply></piece>"
            "<piece><cn>2</cn><apply><lt/><ci>x</ci><cn>1</cn></apply></piece>"
            "<piece><cn>4</cn><apply><lt/><ci>x</ci><cn>2</cn></apply></piece>"
            "<otherwise><cn>3</cn></otherwise></piecewise>",
            2.0,
        ),
    ],
)
def test_formulas_have_their_analytical_values(text, expected, tmp_path):
    """Nested operators, constants, numbers and the first piece that applies have their analytical
    values.
    """
    assert formula(text, 0.3, tmp_path) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("", "no table, formula or initial value"),
        ("<uncertainty/>", "<uncertainty> is not supported"),
        *(
            (f"<calculation><math>{formula}</math></calculation>", message)
            for formula, message in (
                ("<apply><floof/><ci>x</ci></apply>", "<floof> is not supported"),
                ("<ci>z</ci>", "z is not defined"),
                ("<ci>y</ci>", "the definition of the variable is circular"),
                ("", "one <math> with one formula"),
                ("<cn>1</cn><cn>2</cn>", "one <math> with one formula"),
                ("<cn>one</cn>", "not a number"),
                ("<cn type='e-notation'>1</cn>", "not a number"),
                ("<matrix/>", "<matrix> is not supported"),
                ("<apply><sin/><ci>x</ci><ci>x</ci></apply>", "arguments of <sin> is 2"),
                ("<apply><minus/></apply>", "arguments of <minus> is 0"),
                ("<piecewise><otherwise/></piecewise>", "one <otherwise>"),
                ("<piecewise/>", "one <otherwise>"),
                (
                    "<piecewise><piece><cn>1</cn></piece><otherwise><cn>1</cn></otherwise></piecewise>",
                    "<piece> does not contain",
                ),
                (
                    "<apply><divide/><cn>1</cn><cn>0</cn></apply>",
                    "<divide> of 1, 0 is not a finite",
                ),
                ("<apply><power/><cn>-8</cn><cn>0.5</cn></apply>", "<power> of -8, 0.5 is not a"),
                ("<apply><power/><cn>10</cn><cn>400</cn></apply>", "<power> of 10, 400 is not a"),
                ("<apply><ln/><cn>0</cn></apply>", "<ln> of 0 is not a finite number"),
                ("<apply><exp/><cn>1000</cn></apply>", "<exp> of 1000 is not a finite number"),
            )
        ),
    ],
)
def test_unsupported_definitions_are_refused(body, message, tmp_path):
    """Unknown operators, undefined variables, missing or circular definitions, uncertainties and
    values that are not finite are refused.
    """
    path = tmp_path / "one.dml"
    path.write_text(_ONE.format(body, ""))
    with pytest.raises(BadInputError, match=message):
        value_of(read_document(str(path)), "y", {"x": 1.0})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('extrapolate="neither"', 'extrapolate="both"', 'extrapolate="both" is not supported'),
        ("<bpVals>-10, 0, 10", "<bpVals>-10, 10, 0", "two or more increasing numbers"),
        ("<bpVals>-10, 0, 10", "<bpVals>-10, 10", "the breakpoints require 2"),
        ('units="kgm2"', 'units="stone"', "the unit 'stone' is unknown"),
        ("<griddedTableDef", "<ungriddedTableDef", "is not valid XML"),
        ('varID="m" units="kg"', 'varID="m" units="ft_s"', "totalMass is in 'ft_s'"),
        ('initialValue="0.55"', 'initialValue="0"', "referenceWingArea is 0; give a positive"),
        ('varID="b"', 'varID="S"', "variable S: there are two definitions"),
        (
            "</function>",
            '</function><function name="b"><independentVarRef varID="alpha"/>'
            '<dependentVarRef varID="CL"/><functionDefn><griddedTableRef gtID="wing"/>'
            "</functionDefn></function>",
            "variable CL: the variable has both a table and a formula",
        ),
        (
            "<signalValue>35.0",
            "<signalUnits>ft_s</signalUnits><signalValue>35.0",
            "V is in ft_s in the",
        ),
        ("<varID>T</varID>", "<varID>throttle</varID>", "throttle is not a variable"),
        (
            "<varID>CL</varID><signalValue>0.4732079482</signalValue>",
            "<varID>CL</varID>",
            "<signalValue> is missing",
        ),
        ('<dependentVarRef varID="CL_wing"/>', "", "<dependentVarRef> is missing"),
        ('<dependentVarRef varID="CL_wing"/>', "<dependentVarRef/>", "attribute varID is missing"),
        ('<bpRef bpID="alphas"/>', "", "has no <bpRef>"),
        ('<bpRef bpID="alphas"/>', '<bpRef bpID="betas"/>', "breakpoints betas are not defined"),
        ('<bpRef bpID="alphas"/>', '<bpRef bpID="alphas"/><bpRef bpID="alphas"/>', "require 9"),
        ("<bpVals>-10, 0, 10</bpVals>", "", "<bpVals> is missing"),
        ("<bpVals>-10, 0", "<bpVals>-10, nan", "a number that is not finite"),
        ('min="-10"', 'min="nan"', "nan is not finite"),
        ('min="-10"', 'min="low"', "'low' is not a number"),
        ('<independentVarRef varID="alpha"', '<independentVar varID="alpha"', "0 arguments"),
        ("<cn>-0.36</cn>", "<cn>-0.36</cn></apply><apply><cn>1</cn>", "is not supported"),
        ("0.28, 0.8821", "0.28, -0.8821", "not upward"),
        (CASE, CASE.replace("checkInputs", "checkInput"), "<checkInputs> is missing"),
        (OUTPUTS, "<checkOutputs/>", "has no <signal>"),
        (GRID, "", "the table of the function is missing"),
        (TEXT, TEXT.replace("DAVEfunc", "DAVE"), "the root element is <DAVE>"),
        # A coefficient, a value of a table, an input, and printed outputs above and below.
        ("<cn>-0.36</cn>", "<cn>0.36</cn>", FALSE),
        (FIRST_VALUE, "<dataTable>-0.5", FALSE),
        ("<signalValue>0.5</signalValue>", "<signalValue>-0.5</signalValue>", FALSE),
        (OUTPUTS, OUTPUTS.replace(PRINTED, repr(float(PRINTED) + 1.0), 1), FALSE),
        (OUTPUTS, OUTPUTS.replace(PRINTED, repr(float(PRINTED) - 1.0), 1), FALSE),
    ],
)
def test_a_wrong_file_is_refused(old, new, message, tmp_path):
    """A file with a faulty entry, or with numbers that its check cases contradict, is refused."""
    path = changed(tmp_path, old, new)
    with pytest.raises(BadInputError, match=message):
        hfa.load_model(path)


_POINTS = (
    '<variableDef name="z" varID="z" units="nd"><isInput/></variableDef><function name="f">'
    '<independentVarPts varID="x" min="-0.5">-1, 0, 1</independentVarPts>'
    '<independentVarPts varID="z">0 10</independentVarPts>'
    '<dependentVarPts varID="y">1, 2, <!-- x = 0 --> 3, 5, 7, 11</dependentVarPts></function>'
)


def value_at(path, x, z):
    """Return y of a file at x and z."""
    return float(ca.evalf(value_of(read_document(str(path)), "y", {"x": x, "z": z})))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("3, 5, 7, 11", "3, 5, 7", "the table has 5 values, but the breakpoints require 6"),
        ("-1, 0, 1", "-1, 1, 0", "breakpoints x: .* increasing"),
        ("0 10", "0 ten", "not a number"),
        ('varID="y">1', 'varID="w">1', "variable w is not defined"),
        ('min="-0.5"', 'interpolate="floor"', "interpolate"),
        ("dependentVarPts", "dependentVarPoints", "Pts> is missing"),
    ],
)
def test_a_faulty_function_of_points_is_refused(old, new, message, tmp_path):
    """Missing elements, wrong values, undefined variables, breakpoints in a wrong order and another
    interpolation are refused.
    """
    assert old in _POINTS
    path = tmp_path / "points.dml"
    path.write_text(_ONE.format("", re.sub(rf"(?<!in){old}", new, _POINTS)))
    with pytest.raises(BadInputError, match=message):
        value_at(path, 0.0, 0.0)


def test_a_printed_output_without_a_tolerance_is_exact(tmp_path):
    outputs = re.sub(r"<tol>.*?</tol>", "", OUTPUTS)
    with pytest.raises(BadInputError, match=FALSE):
        hfa.load_model(changed(tmp_path, OUTPUTS, outputs))


def test_units_of_a_file_are_converted():
    """Each unit, as it is spelled in files, has the factor to the model's unit by its definition."""
    lbf = 0.45359237 * 9.80665
    slug = lbf / 0.3048
    for spelling, unit, factor in (
        ("deg", "rad", math.pi / 180.0),
        ("deg_s", "rad/s", math.pi / 180.0),
        ("rad_s", "rad/s", 1.0),
        ("m", "ft", 1.0 / 0.3048),
        ("f", "ft", 1.0),
        ("f_s", "ft/s", 1.0),
        ("m_s", "ft/s", 1.0 / 0.3048),
        ("nmi_h", "ft/s", 1852.0 / 3600.0 / 0.3048),
        ("m2", "ft^2", 1.0 / 0.3048**2),
        ("kg", "slug", 1.0 / slug),
        ("kgm2", "slug ft^2", 1.0 / (slug * 0.3048**2)),
        ("N", "lbf", 1.0 / lbf),
        ("Nm", "ft lbf", 1.0 / (lbf * 0.3048)),
        ("lbf_ft2", "lbf/ft^2", 1.0),
        ("fracMAC", "", 1.0),
        ("kt", "ft/s", 1852.0 / 3600.0 / 0.3048),
    ):
        assert model_unit(spelling) == (unit, pytest.approx(factor, rel=1e-12)), spelling
    assert model_unit("stone") is None
