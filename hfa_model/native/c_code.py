"""A CasADi Function as plain C: one function of arrays, no library but math.h, no tables, no memory of its own."""

from __future__ import annotations

import textwrap

import casadi as ca

from hfa_model.support.errors import BadInputError

#: Operation -> C expression of its operands.
_OPERATIONS = {
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
    ca.OP_NOT: "(double)(!{0})",
    ca.OP_IF_ELSE_ZERO: "{0} != 0.0 ? {1} : 0.0",
}


def c_function(function: ca.Function, name: str, arguments: tuple[str, ...], results: tuple[str, ...]) -> str:
    """`static void name(const double *argument, ..., double *result, ...)`: the instructions of a dense SX Function.

    Columns of a matrix come one after the other. BadInputError names an operation that is not known here.
    """
    lines = []
    for index in range(function.n_instructions()):
        code, out, source = (
            function.instruction_id(index),
            function.instruction_output(index),
            function.instruction_input(index),
        )
        if code == ca.OP_CONST:
            lines.append(f"w{out[0]} = {function.instruction_constant(index)!r};")
        elif code == ca.OP_INPUT:
            lines.append(f"w{out[0]} = {arguments[source[0]]}[{source[1]}];")
        elif code == ca.OP_OUTPUT:
            lines.append(f"{results[out[0]]}[{out[1]}] = w{source[0]};")
        elif code in _OPERATIONS:
            lines.append(f"w{out[0]} = {_OPERATIONS[code].format(*(f'w{each}' for each in source))};")
        else:
            words = [word for word in dir(ca) if word.startswith("OP_") and getattr(ca, word) == code]
            raise BadInputError(f"{name}: the operation {words[0] if words else code} cannot be written as C")
    names = ", ".join([*(f"const double *{each}" for each in arguments), *(f"double *{each}" for each in results)])
    work = textwrap.fill(", ".join(f"w{index}" for index in range(function.sz_w())), 100)
    body = "\n".join(f"    {line}" for line in [*f"double {work};".splitlines(), *lines])
    return f"static void {name}({names})\n{{\n{body}\n}}\n"
