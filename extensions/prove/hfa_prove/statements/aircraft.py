"""The aircraft that a statement concerns, read from a certificate."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from typing import Any

import casadi as ca

from hfa_aircraft.model import Model
from hfa_prove.enclosure.ball_function import LARGEST
from hfa_prove.enclosure.splines import is_table, tables_of
from hfa_prove.fields import Fields
from hfa_prove.hfa import aircraft_of
from hfa_support.errors import BadInputError, shown

#: Largest difference of a trim from the stated one, in nominal values of its unknowns.
SAME_TRIM = 1e-6


def read_model(file: Fields, name: str, known: Any) -> Model:
    """Return the aircraft that a statement concerns.

    This is the user's model, or the flexible aircraft of the paper.

    file: reader of the object with the entry
    name: name of the entry, which contains the facts of the model (`facts`)
    known: namespace with the user's `aircraft`, None for a built-in one

    Raises BadInputError if the statement concerns another model than the user's, or an aircraft
    whose file is not given. Raises Malformed if another fact differs.
    """
    stated = file.fields(name)
    dynamics = stated.value("dynamics", str)
    equations = stated.value("equations", str)
    own = known.aircraft
    if own is not None and (own.name, digest_of_equations(own)) != (dynamics, equations):
        raise BadInputError(
            f"the certificate is about {shown(dynamics)} with other equations than those of the "
            f"given file of {own.name}; give the aircraft file used to prove the certificate"
        )
    model = own or (None if equations else aircraft_of(dynamics))
    if model is None:
        raise BadInputError(
            f"the certificate is about {shown(dynamics)}; give the aircraft file with --aircraft "
            "FILE.py:NAME"
        )
    for fact, value in facts(model).items():
        if fact not in ("dynamics", "equations"):
            stated.same(fact, value)
    stated.close()
    return model


def facts(model: Model) -> dict[str, Any]:
    """Return the entries of a certificate that identify a model.

    dynamics: name of the model
    equations: digest of the equations, "" for the flexible aircraft of this program
    states: names of the moving states
    steady: names of the states whose rates are 0 at a trim
    schedule, schedule_unit: scheduling variable and its unit in certificates
    state_units, input_units, disturbance_units: units of the moving states, inputs and disturbances
    nominal: nominal values of all states and inputs, in which distances of trims are measured
    """
    return {
        "dynamics": model.name,
        "equations": digest_of_equations(model),
        "states": list(model.linear),
        "steady": list(model.steady),
        "schedule": model.schedule,
        "schedule_unit": model.schedule_unit if model.schedule else "",
        "state_units": list(model.units(model.linear)),
        "input_units": list(model.units(tuple(model.inputs))),
        "disturbance_units": list(model.units(tuple(model.disturbances))),
        "nominal": model.nominal((*model.states, *model.inputs)).tolist(),
    }


@lru_cache(maxsize=16)
def digest_of_equations(model: Model) -> str:
    """Return the SHA-256 of the graph of a model's equations and of the names of its signals.

    Comments, titles, default values and the order of statements in a file do not change it. The
    result is "" for the flexible aircraft of this program, which its name identifies.
    """
    flexible = aircraft_of(model.name)
    if flexible is not None and flexible.layout == model.layout:
        return ""
    layout = model.layout
    x, u, p, w = layout.symbols("x", "u", "p", "w")
    vectors = [ca.vertsplit(each) if each.numel() else [] for each in (x, u, p)]
    disturbances = ca.vertsplit(w) if w.numel() else []
    rates, outputs = layout.expressions(vectors, tuple(model.outputs), disturbances)
    graph = ca.Function("equations", [x, u, p, w], [ca.densify(rates), ca.densify(outputs)])
    names = repr((tuple(map(tuple, layout.names)), layout.replaced))
    return hashlib.sha256(f"{names} {digest_of(graph, model.name)}".encode()).hexdigest()


def digest_of(function: ca.Function, what: str) -> str:
    """Return the SHA-256 of a function's instructions and of all digits of its constants.

    Functions that it calls, such as tables, are contained.

    what: name of the function, for the message

    Raises BadInputError if the function has more than `LARGEST` operations.
    """
    scalar = function.expand() if function.is_a("MXFunction") else function
    if scalar.n_instructions() > LARGEST:
        raise BadInputError(
            f"{what} has {scalar.n_instructions()} operations, but at most {LARGEST} are "
            "supported; give a smaller one"
        )
    hashed = hashlib.sha256()
    for index in range(scalar.n_instructions()):
        code = scalar.instruction_id(index)
        places = (*scalar.instruction_input(index), -1, *scalar.instruction_output(index))
        content = ""
        if code == ca.OP_CONST:
            content = float(scalar.instruction_constant(index)).hex()
        elif code == ca.OP_CALL:
            called = scalar.instructions_sx()[index].which_function()
            # CasADi adds derivatives that it has computed to the stored form of a table
            content = repr(tables_of(called)) if is_table(called) else called.serialize()
        hashed.update(f"{code} {places} {content};".encode())
    return hashed.hexdigest()
