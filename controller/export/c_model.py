"""An aircraft as a pair of C files: its equations, a trim, the linear model and the policy about it, and a loop."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.resources import files
from typing import Any

import casadi as ca
import numpy as np

from controller.flight.gusts import UPDRAFT
from hfa_support.model import HasModel, Model, components
from hfa_support.native.c_code import c_function
from trim.linear.linear_model import LinearModel

HEADER, SOURCE, EXAMPLE = "hfa_aircraft.h", "hfa_aircraft.c", "loop_100hz.c"


def c_model_texts(aircraft: HasModel, linear: LinearModel, gain: np.ndarray | None, origin: str) -> dict[str, str]:
    """File -> its text: header, source and, with a gain K (m, k) of u = -K x, a loop of 100 Hz that uses them.

    linear: the model at a trim. origin: where it comes from, lines of text. BadInputError for what C cannot express.
    """
    model, point = aircraft.model, linear.point
    said = {"origin": comment_lines(origin), "title": comment_lines(model.title)}
    K = np.zeros(linear.B.T.shape) if gain is None else gain
    named = {"state": model.states, "input": model.inputs}
    tables = [
        c_table("const double hfa_x0", point.states),
        c_table("const double hfa_u0", point.inputs),
        c_table("const double hfa_A", linear.A),
        c_table("const double hfa_B", linear.B),
        c_table("const double hfa_K", K),
        c_table("const int hfa_linear_state", [list(model.states).index(name) for name in model.linear]),
        *(
            c_table(f"const char *const hfa_{kind}_name", [f'"{name}"' for name in all_])
            for kind, all_ in named.items()
        ),
        *(
            c_table(f"const char *const hfa_{kind}_unit", [f'"{unit}"' for unit in model.units(tuple(all_))])
            for kind, all_ in named.items()
        ),
    ]
    numbers = [(each.start, name, each.unit) for name, each in model.parameters.items()] or [(0.0, "none", "1")]
    values = "\n".join(f"    {value!r}, /* {name}, {unit} */" for value, name, unit in numbers)
    texts = {
        HEADER: filled(
            "hfa_aircraft.h.in",
            **said,
            states=c_positions(tuple(model.states), model.units(tuple(model.states))),
            inputs=c_positions(tuple(model.inputs), model.units(tuple(model.inputs))),
            linear_states=", ".join(model.linear),
            linear_count=len(model.linear),
        ),
        SOURCE: filled(
            "hfa_aircraft.c.in",
            **said,
            parameters=f"static const double parameters[{len(numbers)}] = {{\n{values}\n}};",
            tables="\n".join(tables),
            function=c_function(_rates(model), "rates", ("x", "u", UPDRAFT, "p"), ("dx",)),
        ),
    }
    if gain is not None:
        state, amount = displaced(model)
        texts[EXAMPLE] = filled(f"{EXAMPLE}.in", state=state.upper(), amount=amount, unit=model.unit(state))
    return texts


def displaced(model: Model) -> tuple[str, float]:
    """What an example starts off trim: 1 ft/s too fast, or the first state of the linear model by 1 % of its size."""
    name = "speed" if "speed" in model.states else model.linear[0]
    return name, 1.0 if name == "speed" else model.states[name].nominal / 100


def _rates(model: Model) -> ca.Function:
    """(x, u, updraft, p) -> dx; a model without that disturbance does not depend on it."""
    x, u, p = model.layout.symbols("x", "u", "p")
    w = ca.SX.sym("w")
    air = [w if name == UPDRAFT else 0.0 for name in model.disturbances]
    f, _ = model.layout.expressions(tuple(map(components, (x, u, p))), (), air)
    return ca.Function("rates", [x, u, w, p], [f])


def filled(template: str, **values: object) -> str:
    """The text of a template of this package."""
    return files(__package__).joinpath(template).read_text("utf-8").format(**values)


def comment_lines(text: str) -> str:
    """Text for the inside of a comment of C."""
    return "\n   ".join(text.replace("*/", "* /").splitlines())


def c_positions(names: Sequence[str], units: Iterable[str], prefix: str = "") -> str:
    """Lines of an enumeration, each with its unit where it has one."""
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
