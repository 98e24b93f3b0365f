"""Forces that depend on the time since the start of a flight."""

from __future__ import annotations

import math

import casadi as ca

_COMPARISONS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE)


def without_time(values: ca.SX, time: ca.SX) -> list[ca.SX]:
    """Return values late in a flight, nan at the states at which they depend on the time.

    A comparison of the time with a number is that of an infinite time. A product does not depend on
    the time where its other factor is 0, and a switch where it is open.

    values: expressions, a column
    time: symbol of the time
    """
    others = [each for each in ca.symvar(values) if not ca.is_equal(each, time)]
    # Only operations that depend on the time are followed; `parts` are the other expressions.
    values, symbols, parts = ca.extract_parametric(values, ca.vertcat(*others))
    others += symbols
    function = ca.Function("values", [time, ca.vertcat(*others)], [ca.densify(values)])
    # register -> value, and how much depends on the time: a sum that is 0 only for nothing
    known: dict[int, tuple[ca.SX, ca.SX]] = {}
    rows: list[ca.SX] = []
    for place in range(function.n_instructions()):
        op, read = function.instruction_id(place), function.instruction_input(place)
        if op == ca.OP_OUTPUT:
            value, varies = known[read[0]]
            rows.append(ca.if_else(varies != 0.0, math.nan, value))
            continue
        if op == ca.OP_INPUT:
            result = (others[read[1]], ca.SX(0.0)) if read[0] else (time, ca.SX(1.0))
        elif op == ca.OP_CONST:
            result = ca.SX(function.instruction_constant(place)), ca.SX(0.0)
        else:
            (one, of_one), (other, of_other) = known[read[0]], known[read[-1]]
            varies = of_one + of_other
            if op in _COMPARISONS:
                late = [math.inf if ca.is_equal(each, time) else each for each in (one, other)]
                if all(ca.SX(each).is_constant() for each in late):
                    (one, other), varies = map(ca.SX, late), ca.SX(0.0)
            elif op in (ca.OP_MUL, ca.OP_IF_ELSE_ZERO) and not varies.is_zero():
                varies = of_one * (other != 0.0) + of_other * (one != 0.0) + of_one * of_other
            value = ca.SX.unary(op, one) if len(read) == 1 else ca.SX.binary(op, one, other)
            result = value, varies
        known[function.instruction_output(place)[0]] = result
    at_zero = ca.vertcat(time, *symbols), ca.vertcat(ca.SX(0.0), *parts)
    return list(ca.vertsplit(ca.substitute(ca.vertcat(*rows), *at_zero)))
