"""Export of an aircraft to C.

The C code contains the equations of motion, a trim, the linear model and a policy about this trim,
and an example 100 Hz loop.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.layout import components
from hfa_aircraft.model import Model
from hfa_flight.export.c_text import (
    comment_lines,
    constant_tables,
    displaced_state,
    enumerators,
    filled,
    name_tables,
    or_unused,
    units_of,
)
from hfa_flight.policies.policy import FunctionPolicy, GainPolicy, Policy
from hfa_flight.policies.scheduled_gains import ScheduledGainPolicy
from hfa_support.native.c_code import c_function
from trim.linear.linear_model import LinearModel

#: Names of the header, the source and the example.
AIRCRAFT_FILES = ("hfa_aircraft.h", "hfa_aircraft.c", "loop_100hz.c")
#: Bodies of the C function hfa_policy, with the deviations z.
_LINEAR = """    for (int i = 0; i < HFA_INPUTS; i++) {
        u[i] = hfa_u0[i];
        for (int j = 0; j < HFA_LINEAR_STATES; j++) u[i] -= hfa_K[i][j] * z[j];
    }"""
#: With a gain table: K linear between breakpoints of the state at {place}, constant beyond.
_SCHEDULED = """    const double eta = x[{place}];
    int cell = 0;
    while (cell < {last} && eta > breakpoint[cell + 1]) cell++;
    double share = (eta - breakpoint[cell]) / (breakpoint[cell + 1] - breakpoint[cell]);
    share = share < 0.0 ? 0.0 : share > 1.0 ? 1.0 : share;
    for (int i = 0; i < HFA_INPUTS; i++) {{
        u[i] = hfa_u0[i];
        for (int j = 0; j < HFA_LINEAR_STATES; j++)
            u[i] -= (gain[cell][i][j] + share * (gain[cell + 1][i][j] - gain[cell][i][j])) * z[j];
    }}"""
_CALLED = """    double v[HFA_INPUTS];
    policy(z, v);
    for (int i = 0; i < HFA_INPUTS; i++) u[i] = hfa_u0[i] + v[i];"""


class _PolicyInC(NamedTuple):
    """C source of a policy.

    K: gain at the trim, zero for a nonlinear policy
    formula: comment on the function hfa_policy
    body: body of this function
    tables: declaration -> values of the constants that the body reads
    function: source of the function that the body calls, or ""
    """

    K: np.ndarray
    formula: str
    body: str
    tables: dict[str, Any]
    function: str


def c_model_texts(
    linear: LinearModel,
    policy: Policy | None,
    origin: str,
) -> dict[str, str]:
    """Return the C source of an aircraft as file name -> text.

    The files are a header, a source file and, if a policy is given, an example 100 Hz loop.

    linear: linear model at a trim
    policy: gain, function or gain table about that trim, or None
    origin: provenance, for a comment

    Raises BadInputError if the equations cannot be expressed in C.
    """
    model = linear.point.model
    header, source, example = AIRCRAFT_FILES
    origin_and_title = {"origin": comment_lines(origin), "title": comment_lines(model.title)}
    states = units_of(model, model.states)
    inputs = units_of(model, model.inputs)
    winds = or_unused(units_of(model, model.disturbances))
    in_c = _policy_in_c(linear, policy)
    rates = c_function(_rates(model), "rates", ("x", "u", "w", "p"), ("dx",))
    texts = {
        header: filled(
            header,
            **origin_and_title,
            states=enumerators(states),
            inputs=enumerators(inputs),
            winds=enumerators(winds, "HFA_WIND_"),
            linear_states=", ".join(model.linear),
            linear_count=len(model.linear),
            policy=in_c.formula,
        ),
        source: filled(
            source,
            **origin_and_title,
            parameters=_parameters(model),
            tables=constant_tables(
                {
                    "const double hfa_x0": linear.point.states,
                    "const double hfa_u0": linear.point.inputs,
                    "const double hfa_A": linear.A,
                    "const double hfa_B": linear.B,
                    "const double hfa_K": in_c.K,
                    **in_c.tables,
                    "const int hfa_linear_state": model.state_places(model.linear),
                    **name_tables("state", states),
                    **name_tables("input", inputs),
                    **name_tables("wind", winds),
                }
            ),
            function=rates + in_c.function,
            policy=in_c.body,
        ),
    }
    if policy is not None:
        state, amount = displaced_state(model)
        texts[example] = filled(example, state=state.upper(), amount=amount, unit=model.unit(state))
    return texts


def _policy_in_c(linear: LinearModel, policy: Policy | None) -> _PolicyInC:
    """Return the source of a policy, or of u = u0 without one."""
    no_gain = np.zeros(linear.B.T.shape)
    of_gain = "u = u0 - K z: the policy at x. Nothing is limited."
    if isinstance(policy, FunctionPolicy):
        formula = "u = u0 + v(z): the policy at x, within the control limits. K is zero."
        return _PolicyInC(no_gain, formula, _CALLED, {}, "\n" + _policy_function(policy))
    if policy is None or isinstance(policy, GainPolicy):
        K = no_gain if policy is None else policy.K
        return _PolicyInC(K, of_gain, _LINEAR, {}, "")
    assert isinstance(policy, ScheduledGainPolicy)  # of a file without a sample time
    model, schedule = linear.point.model, policy.schedule
    K = schedule.table.at(linear.point.values[model.schedule])
    if len(schedule.breakpoints) == 1:
        return _PolicyInC(K, of_gain, _LINEAR, {}, "")
    formula = (
        f"u = u0 - K({model.schedule}) z: the policy at x, K linear between breakpoints "
        "and constant\n   beyond; hfa_K is K at x0. Nothing is limited."
    )
    place = model.state_places((model.schedule,))[0]
    body = _SCHEDULED.format(place=place, last=len(schedule.breakpoints) - 2)
    tables = {
        "static const double breakpoint": schedule.breakpoints,
        "static const double gain": schedule.gains,
    }
    return _PolicyInC(K, formula, body, tables, "")


def _parameters(model: Model) -> str:
    """Return the definition of the C array of the model's parameters, with one line for each."""
    lines = [
        f"    {parameter.start!r}, /* {name}, {parameter.unit} */"
        for name, parameter in model.parameters.items()
    ] or ["    0.0, /* none */"]
    values = "\n".join(lines)
    return f"static const double parameters[{len(lines)}] = {{\n{values}\n}};"


def _policy_function(policy: FunctionPolicy) -> str:
    """Return the source of the C function `static void policy(const double *z, double *v)`."""
    z = ca.SX.sym("z", policy.function.numel_in(0))
    return c_function(ca.Function("policy", [z], [policy.expression(z)]), "policy", ("z",), ("v",))


def _rates(model: Model) -> ca.Function:
    """Return the CasADi Function (x, u, w, p) -> dx, the equations of motion."""
    vectors: Any = model.layout.symbols("x", "u", "p")
    w = ca.SX.sym("w", max(1, len(model.disturbances)))  # C has no arrays without entries
    winds = components(w)[: len(model.disturbances)]
    no_outputs = ()
    rates, _ = model.layout.expressions(tuple(map(components, vectors)), no_outputs, winds)
    return ca.Function("rates", [vectors[0], vectors[1], w, vectors[2]], [rates])
