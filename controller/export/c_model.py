"""The aircraft as a pair of C files: equations, level flights, linear models, one trim and the policy about it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Any

import casadi as ca
import numpy as np

from hfa_model.aircraft import HFA, Aircraft, Equations
from hfa_model.dynamics import state_rates, symbols
from hfa_model.parameters import FIELDS, Parameters
from hfa_model.variants import Variant
from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_ROWS, LINEAR_STATES, STATE_UNITS, STATES
from hfa_support.native.c_code import c_function
from trim.linear.linear_model import LinearModel
from trim.point.condition import LEVEL_FLIGHT, LIMITS
from trim.point.operating_point import BALANCE
from trim.sweeps.points import first_guess, newton_functions

#: What a level flight is given by, in order.
_GIVEN = ("dihedral", "speed", "altitude", "alpha", "gamma")
HEADER, SOURCE, EXAMPLE = "hfa_aircraft.h", "hfa_aircraft.c", "loop_100hz.c"


@dataclass(frozen=True, eq=False)
class CModel:
    """What is written: an aircraft, its linear model at a trim, and a gain K (5, 6), u = -K x; None for none.

    origin: where it comes from, lines of text.
    """

    aircraft: Aircraft
    model: LinearModel
    gain: np.ndarray | None
    origin: str

    def header(self) -> str:
        """The text of `HEADER`: what is there, with names and units."""
        return filled(
            "hfa_aircraft.h.in",
            origin=comment_lines(self.origin),
            states=c_positions(STATES, STATE_UNITS),
            inputs=c_positions(INPUTS, INPUT_UNITS),
            linear_states=", ".join(LINEAR_STATES),
            balance=BALANCE,
        )

    def source(self) -> str:
        """The text of `SOURCE`."""
        variant = self.aircraft.variant
        parameters = zip(self.aircraft.parameters, Parameters._fields, FIELDS, strict=True)
        limits = [[LIMITS[name][side] for name in (*STATES, *INPUTS)] for side in (0, 1)]
        gain = np.zeros((len(INPUTS), len(LINEAR_STATES))) if self.gain is None else self.gain
        tables = [
            c_table("const double hfa_x0", self.model.point.states),
            c_table("const double hfa_u0", self.model.point.inputs),
            c_table("const double hfa_A", self.model.A),
            c_table("const double hfa_B", self.model.B),
            c_table("const double hfa_K", gain),
            c_table("const int hfa_linear_state", LINEAR_ROWS),
            c_table("static const double start", first_guess(HFA, LEVEL_FLIGHT.free, {})),
            c_table("static const double lowest", limits[0]),
            c_table("static const double highest", limits[1]),
        ]
        for name, words in (
            ("state_name", STATES),
            ("state_unit", STATE_UNITS),
            ("input_name", INPUTS),
            ("input_unit", INPUT_UNITS),
        ):
            tables.append(c_table(f"const char *const hfa_{name}", [f'"{word}"' for word in words]))
        values = "\n".join(f"    {value!r}, /* {name}, {field.unit} */" for value, name, field in parameters)
        return filled(
            "hfa_aircraft.c.in",
            origin=comment_lines(self.origin),
            parameters=f"static const double parameters[{len(FIELDS)}] = {{\n{values}\n}};",
            tables="\n".join(tables),
            functions="\n".join(_functions(variant)),
            balance=BALANCE,
        )


def c_model_texts(what: CModel) -> dict[str, str]:
    """File -> its text: header, source and, with a gain, a loop of 100 Hz that uses them."""
    texts = {HEADER: what.header(), SOURCE: what.source()}
    if what.gain is not None:
        texts[EXAMPLE] = files(__package__).joinpath(EXAMPLE).read_text("utf-8")
    return texts


def filled(template: str, **values: object) -> str:
    """The text of a template of this package."""
    return files(__package__).joinpath(template).read_text("utf-8").format(**values)


def comment_lines(text: str) -> str:
    """Text for the inside of a comment of C."""
    return "\n   ".join(text.replace("*/", "* /").splitlines())


def _functions(variant: Variant) -> list[str]:
    (x, u, p), w = symbols(), ca.SX.sym("w")
    f = state_rates(x, u, p, variant, w)
    still = state_rates(x, u, p, variant)
    by_rows = [ca.vec(ca.densify(ca.jacobian(still, by)).T) for by in (x, u)]
    rates = tuple((name, 0.0, HFA.rate_scale(name)) for name in HFA.steady)
    functions = newton_functions(replace(HFA, equations=Equations(variant)).layout, _GIVEN, LEVEL_FLIGHT.free, rates)
    assert functions is not None
    newton, at = functions
    return [
        c_function(ca.Function("rates", [x, u, w, p], [ca.densify(f)]), "rates", ("x", "u", "updraft", "p"), ("dx",)),
        c_function(ca.Function("jacobians", [x, u, p], by_rows), "jacobians", ("x", "u", "p"), ("A", "B")),
        c_function(newton, "newton", ("condition", "v", "p"), ("after", "residual")),
        c_function(at, "level_flight", ("condition", "v", "p"), ("x", "u", "A", "B", "dx")),
    ]


def c_positions(names: Sequence[str], units: Iterable[str], prefix: str = "") -> str:
    """Lines of an enumeration, the unit of each beside it where it has one."""
    return "\n".join(
        f"    HFA_{prefix}{name.upper()},{f' /* {unit} */' * bool(unit)}"
        for name, unit in zip(names, units, strict=True)
    )


def c_table(declared: str, values: Any) -> str:
    """A constant array of C, a matrix row by row."""
    array = np.array(values)
    sizes = "".join(f"[{size}]" for size in array.shape)
    return f"{declared}{sizes} = {_braced(array.tolist())};"


def _braced(values: Any) -> str:
    if not isinstance(values, list):
        return "HUGE_VAL" if values == np.inf else "-HUGE_VAL" if values == -np.inf else str(values)
    return f"{{{', '.join(map(_braced, values))}}}"
