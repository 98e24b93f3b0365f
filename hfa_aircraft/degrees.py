"""Detection of equations that compute the sine, cosine or tangent of a signal in degrees."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from hfa_aircraft.layout import Layout, components
from hfa_aircraft.model import Model

#: CasADi's operations that require an angle in radians, with their names in Python.
_OF_ANGLES = {ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan"}
#: Operations whose result has the unit of their arguments.
_KEEP_THE_UNIT = (ca.OP_ASSIGN, ca.OP_NEG, ca.OP_ADD, ca.OP_SUB)


def notes_on_degrees(model: Model) -> list[str]:
    """Return a warning for each sine, cosine or tangent of a signal in degrees in the equations.

    The equations receive the signal in its declared unit. The angle is therefore wrong by the
    factor 180/π. Sums and differences of signals in degrees are examined too. A signal that the
    equations multiply by a factor is assumed to be converted to radians.
    """
    model = model.native
    names = tuple(name for name, signal in model.signals.items() if signal.unit == "deg")
    if not names:
        return []
    return [
        f"the equations compute the {function} of {name}, which is declared in deg; declare {name} "
        f"in rad (reports show degrees), or convert {name} to rad in the equations"
        for name, function in _angles_in_degrees(model.layout, names)
    ]


@lru_cache(maxsize=16)
def _angles_in_degrees(layout: Layout, names: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Return pairs (signal, "sin", "cos" or "tan" of it or of a sum with it in the equations)."""
    vectors = layout.symbols("x", "u", "p")
    f, y = layout.expressions([components(vector) for vector in vectors], layout.names.outputs)
    program = ca.Function("equations", vectors, [f, y])
    found: dict[tuple[str, str], None] = {}
    #: Index in memory -> signals in degrees whose sum or difference is stored there.
    in_degrees: dict[int, tuple[str, ...]] = {}
    for number in range(program.n_instructions()):
        operation = program.instruction_id(number)
        arguments = program.instruction_input(number)
        if operation == ca.OP_OUTPUT:
            continue
        signals: tuple[str, ...] = ()
        if operation == ca.OP_INPUT:
            vector, entry = arguments
            name = layout.names[vector][entry]
            signals = (name,) if name in names else ()
        elif operation in _KEEP_THE_UNIT:
            signals = tuple(name for index in arguments for name in in_degrees.get(index, ()))
        elif operation in _OF_ANGLES:
            for name in in_degrees.get(arguments[0], ()):
                found[name, _OF_ANGLES[operation]] = None
        for result in program.instruction_output(number):
            in_degrees[result] = signals
    return tuple(found)
