"""Translation of CasADi Functions to plain C functions of arrays.

The C code needs only math.h and allocates no memory.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence

import casadi as ca

from hfa_support.errors import BadInputError

#: Operation -> C expression of its operands.
OPERATIONS = {
    ca.OP_CONST: "{0}",
    ca.OP_INPUT: "{0}",
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_SQRT: "sqrt({0})",
    ca.OP_POW: "pow({0}, {1})",
    ca.OP_CONSTPOW: "pow({0}, {1})",
    ca.OP_EXP: "exp({0})",
    ca.OP_SIN: "sin({0})",
    ca.OP_COS: "cos({0})",
    ca.OP_TAN: "tan({0})",
    ca.OP_ASIN: "asin({0})",
    ca.OP_ATAN: "atan({0})",
    ca.OP_ATAN2: "atan2({0}, {1})",
    ca.OP_FABS: "fabs({0})",
    ca.OP_FMIN: "fmin({0}, {1})",
    ca.OP_FMAX: "fmax({0}, {1})",
    ca.OP_LT: "(double)({0} < {1})",
    ca.OP_LE: "(double)({0} <= {1})",
    ca.OP_EQ: "(double)({0} == {1})",
    ca.OP_NE: "(double)({0} != {1})",
    ca.OP_NOT: "(double)(!{0})",
    ca.OP_AND: "(double)({0} && {1})",
    ca.OP_OR: "(double)({0} || {1})",
    ca.OP_SIGN: "{0} < 0.0 ? -1.0 : {0} > 0.0 ? 1.0 : {0}",
    ca.OP_FLOOR: "floor({0})",
    ca.OP_CEIL: "ceil({0})",
    ca.OP_LOG: "log({0})",
    ca.OP_ACOS: "acos({0})",
    ca.OP_TANH: "tanh({0})",
    ca.OP_SINH: "sinh({0})",
    ca.OP_COSH: "cosh({0})",
    ca.OP_ASINH: "asinh({0})",
    ca.OP_ACOSH: "acosh({0})",
    ca.OP_ATANH: "atanh({0})",
    ca.OP_EXPM1: "expm1({0})",
    ca.OP_LOG1P: "log1p({0})",
    ca.OP_ERF: "erf({0})",
    ca.OP_HYPOT: "hypot({0}, {1})",
    ca.OP_FMOD: "fmod({0}, {1})",
    ca.OP_REMAINDER: "remainder({0}, {1})",
    ca.OP_COPYSIGN: "copysign({0}, {1})",
    ca.OP_IF_ELSE_ZERO: "{0} != 0.0 ? {1} : 0.0",
}


def c_function(
    function: ca.Function,
    name: str,
    arguments: tuple[str, ...],
    results: tuple[str, ...],
    real: str = "double",
    operations: Mapping[int, str] = OPERATIONS,
) -> str:
    """Return the C source of a dense SX Function.

      static void name(const double *argument, ..., double *result, ...)

    Matrices are stored column by column. The source of a called Function comes first. The code
    compiles without warnings about empty or unused variables.

    function: the Function. It may call other SX Functions with one argument and one result, of
        different sizes: an instruction says no more of the called Function
    arguments, results: names of the pointers in C
    real: number type in C
    operations: C expression of each CasADi operation for this type

    Raises BadInputError if an operation or a called Function cannot be written as C.
    """
    callees = _callees(function, name)
    of_called = "".join(
        c_function(called, f"{name}_{called.name()}", ("x",), ("y",), real, operations)
        for called in function.find_functions(0)
    )
    inputs = [f"const {real} *{argument}" for argument in arguments]
    pointers = ", ".join(inputs + [f"{real} *{result}" for result in results])
    lines = []
    for index in range(function.n_instructions()):
        # Sources and targets are the numbers of variables w, or two numbers: of an argument or a
        # result, and of its entry.
        operation = function.instruction_id(index)
        sources = function.instruction_input(index)
        targets = function.instruction_output(index)
        operands = [f"w{number}" for number in sources]
        if operation == ca.OP_CONST:
            number = repr(function.instruction_constant(index))
            operands = [number.replace("inf", "HUGE_VAL").replace("nan", "NAN")]
        elif operation == ca.OP_INPUT:
            argument, entry = sources
            operands = [f"{arguments[argument]}[{entry}]"]
        if operation == ca.OP_OUTPUT:
            result, entry = targets
            lines.append(f"{results[result]}[{entry}] = w{sources[0]};")
        elif operation == ca.OP_CALL and (len(sources), len(targets)) in callees:
            callee = callees[len(sources), len(targets)]
            lines.append(_call(callee, operands, targets, real))
        elif operation in operations:
            lines.append(f"w{targets[0]} = {operations[operation].format(*operands)};")
        else:
            raise BadInputError(
                f"{name}: the operation {_name_of(operation)} cannot be written as C; write the "
                "equations without this operation"
            )

    variables = dict.fromkeys(re.findall(r"\bw\d+", " ".join(lines)))
    if variables:
        declaration = f"{real} {textwrap.fill(', '.join(variables), 100)};"
        lines = [*declaration.splitlines(), *lines]
    body = "".join(f"    {line}\n" for line in lines)
    unused = "".join(
        f"    (void){pointer};\n"
        for pointer in (*arguments, *results)
        if not re.search(rf"\b{pointer}\[", body)
    )
    return f"{of_called}static void {name}({pointers})\n{{\n{body}{unused}}}\n"


def _callees(function: ca.Function, name: str) -> dict[tuple[int, int], str]:
    """Return (entries of the argument, entries of the result) -> name in C of each Function that a
    Function calls. Raises BadInputError for one that is no SX Function, and for two of equal sizes,
    which instructions do not distinguish.

    name: name of the calling function in C
    """
    callees: dict[tuple[int, int], str] = {}
    for called in function.find_functions(0):
        if not called.is_a("SXFunction"):
            raise BadInputError(
                f"{name}: the function {called.name()} of the model, compiled or interpolated, as "
                "of an FMU, cannot be written as C; use CasADi SX expressions instead"
            )
        sizes = called.numel_in(0), called.numel_out(0)
        if sizes in callees:
            raise BadInputError(
                f"{name}: two called functions of {sizes[0]} numbers cannot be written as C; use "
                "CasADi SX expressions instead"
            )
        callees[sizes] = f"{name}_{called.name()}"
    return callees


def _name_of(operation: int) -> str:
    """Return the name of an operation of CasADi by its number, "OP_ERFINV"."""
    names = (name for name in dir(ca) if name.startswith("OP_"))
    return next(name for name in names if getattr(ca, name) == operation)


def _call(callee: str, operands: Sequence[str], targets: Sequence[int], real: str) -> str:
    """Return the C block that calls a function and stores its results in variables w.

    targets: numbers of the variables, -1 for a result that is not used
    """
    memory = f"const {real} in[] = {{{', '.join(operands)}}}; {real} out[{len(targets)}];"
    stores = " ".join(
        f"w{target} = out[{place}];" for place, target in enumerate(targets) if target >= 0
    )
    return f"{{ {memory} {callee}(in, out); {stores} }}"
