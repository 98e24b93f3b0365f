"""Building blocks of C source: templates, comments, enumerations, tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.gusts import state_of
from hfa_flight.air.sensors import values_in_air
from hfa_flight.policies.deployment.policy import DeployedPolicy
from hfa_flight.policies.estimate import (
    IMPOSSIBLE,
    RESTARTS_AFTER,
    estimate_in,
    memory_size,
    memory_slices,
)
from hfa_flight.policies.filtered_policy import (
    FilteredPolicy,
    after_command,
    before_command,
    command_of,
)
from hfa_flight.policies.policy import GainPolicy, Policy
from hfa_flight.policies.scheduled_gains import ScheduledGainPolicy
from hfa_support.files import folder_written_whole, written_whole
from hfa_support.native.c_code import c_function
from trim.linear.linear_model import LinearModel


def filled(file: str, **values: object) -> str:
    """Return a file whose template is FILE.in, with the values of its fields filled in."""
    return files(__package__).joinpath(f"{file}.in").read_text("utf-8").format(**values)


def comment_lines(text: str) -> str:
    """Return a text as the content of a C comment. A comment end within the text is broken up."""
    return "\n   ".join(text.replace("*/", "* /").splitlines())


def enumerators(units: Mapping[str, str], prefix: str = "HFA_") -> str:
    """Return the lines of a C enumeration, such as "HFA_SPEED, /* ft/s */".

    units: name -> unit, or "" without a unit
    prefix: begin of each name
    """
    lines = []
    for name, unit in units.items():
        comment = f" /* {unit} */" if unit else ""
        lines.append(f"    {prefix}{name.upper()},{comment}")
    return "\n".join(lines)


def constant_tables(values_by_declaration: Mapping[str, Any]) -> str:
    """Return C definitions of constant arrays, with matrices row by row.

    values_by_declaration: declaration of the array without its sizes -> values
    """
    lines = []
    for declaration, values in values_by_declaration.items():
        array = np.array(values)
        sizes = "".join(f"[{size}]" for size in array.shape)
        lines.append(f"{declaration}{sizes} = {braced(array.tolist())};")
    return "\n".join(lines)


def braced(values: Any) -> str:
    """Return a number, a text or a nested list as a C initializer."""
    if isinstance(values, list):
        return f"{{{', '.join(map(braced, values))}}}"
    return str(values)


def units_of(model: Model, names: Iterable[str]) -> dict[str, str]:
    """Return the units of signals of a model, by name."""
    return {name: model.unit(name) for name in names}


def displaced_state(model: Model) -> dict[str, object]:
    """Return the fields of a state, its initial deviation and unit, for the example loop.

    The first state of the linear model deviates by 1 % of its nominal size.
    """
    name = model.linear[0]
    size = model.states[name].nominal / 100
    return {"state": name.upper(), "amount": size, "unit": model.unit(name)}


def write_texts(folder: Path, texts: Mapping[str, str]) -> list[Path]:
    """Write text files in UTF-8 to a folder, all or none, and return their paths.

    The folder is created if necessary.

    texts: file name -> text
    """
    with ExitStack() as written:  # the files are in the folder when all are written
        is_new = not folder.exists()
        place = written.enter_context(folder_written_whole(folder)) if is_new else folder
        for name, text in texts.items():
            stream = written.enter_context(written_whole(place / name))
            stream.write(text.encode("utf-8"))
            stream.flush()
    return [folder / name for name in texts]


#: Header and source file.
POLICY_FILES = ("deployed_policy.h", "deployed_policy.c")


def c_policy_texts(policy: DeployedPolicy, origin: str) -> dict[str, str]:
    """Return the C source of the policy's command at a sample, as file name -> text.

    origin: comment on the origin of the policy
    """
    model = policy.deployed.model
    deployment = policy.deployed.deployment
    fields = {
        "origin": comment_lines(origin),
        "title": comment_lines(model.title),
        "states": enumerators(units_of(model, model.states)),
        "inputs": enumerators(units_of(model, model.inputs)),
        "moved": ", ".join(policy.deployed.commanded),
        "dt": repr(deployment.dt),
        "delay": repr(deployment.delay),
        "command": c_function(_command(policy), "command", ("x", "before"), ("u",)),
        "observations": len(deployment.observation),
    }
    return {file: filled(file, **fields) for file in POLICY_FILES}


def _command(policy: DeployedPolicy) -> ca.Function:
    """Return the function (X, U before) -> U at the policy's trim."""
    model = policy.deployed.model
    command = policy.deployed.command
    if not command.is_a("SXFunction"):  # only scalar operations become plain C
        command = command.expand()
    X = ca.SX.sym("X", len(model.states))
    U = ca.SX.sym("U", len(model.inputs))
    trim = ca.DM(policy.deployed.trim_vector(policy.point))
    commanded = ca.densify(command(X, U, trim))
    return ca.Function("command", [X, U], [commanded], {"cse": True})


#: Header, source and example file.
FILTER_FILES = ("hfa_filter.h", "hfa_filter.c", "loop_filter.c")


def c_filter_texts(policy: FilteredPolicy, origin: str) -> dict[str, str]:
    """Return the C source of one sample of a policy behind a filter, as file name -> text, with an
    example loop of the aircraft of `c_model_texts`.

    origin: comment on the origin of the policy
    """
    model = policy.point.model
    fields = {
        **displaced_state(model),
        "origin": comment_lines(origin),
        "title": comment_lines(f"{model.title}, {policy.filter.text()}"),
        "sensors": enumerators(_meanings(policy), "FILTER_"),
        "inputs": enumerators(units_of(model, model.inputs), "FILTER_"),
        "dt": repr(policy.dt),
        "delay": repr(policy.delay),
        "states": len(model.states),
        "winds": max(1, len(model.disturbances)),
        "memory": memory_size(policy.filter) + policy.under_way * len(policy.point.u),
        "impossible": IMPOSSIBLE,  # standard deviations
        "share": memory_slices(policy.filter).share.start,  # place of the acting share
        "fade": policy.fade,  # s
        "restarts_after": RESTARTS_AFTER,  # samples
        "sample": c_function(filter_sample(policy), "sample", ("memory", "y"), ("u", "later")),
        "sensed": c_function(sensed_values(policy), "sensed", ("x", "w"), ("y",)),
    }
    return {file: filled(file, **fields) for file in FILTER_FILES}


def _meanings(policy: FilteredPolicy) -> dict[str, str]:
    """Return sensor -> what it measures, and its unit."""
    model, moving = policy.point.model, in_gusts(policy.point.model)
    over_ground = {state_of(model, name) for name in ("speed", "alpha", "beta")}
    return {
        name: f"{'state' if name in model.states else 'output'} {name}"
        f"{' over the ground' * (name in over_ground)}, {moving.unit(name)}"
        for name in policy.sensors
    }


def sensed_values(policy: FilteredPolicy) -> ca.Function:
    """Return the function (X, w) -> measured values y without errors, in absolute values."""
    point, model = policy.point, policy.point.model
    x = ca.SX.sym("x", len(model.states))
    w = ca.SX.sym("w", max(1, len(model.disturbances)))  # C has no arrays without entries
    winds = dict(zip(model.disturbances, ca.vertsplit(w), strict=False))
    at = x, ca.DM(point.u), model.p  # no sensor of a filter depends on the inputs
    y = values_in_air(model, policy.sensors, at, winds)
    return ca.Function("sensed", [x, w], [ca.densify(y)])


def filter_sample(policy: FilteredPolicy) -> ca.Function:
    """Return the function (memory, measured y) -> (commanded U, memory of the next sample), in
    absolute values. The memory is that of the filter, then the commands under way, the oldest
    first, as deviations from the trim.
    """
    kalman, point, law = policy.filter, policy.point, policy.law
    size, m = memory_size(kalman), len(point.u)
    memory, y = ca.SX.sym("memory", size + policy.under_way * m), ca.SX.sym("y", len(kalman.C))
    under_way = ca.vertsplit(memory[size:], m)
    before = estimate_in(kalman, memory[:size])
    now, seen, _ = before_command(policy, before, under_way, y - ca.DM(kalman.at_trim))
    # an exported law depends neither on time nor on held inputs that change
    command = command_of(law, ca.SX(0.0), seen, ca.DM(law.held_inputs(0, 0.0)))
    u, later = after_command(policy, now, under_way, command)
    results = [ca.densify(point.u + u), ca.vertcat(later, *under_way[1:], u)]
    return ca.Function("sample", [memory, y], results, {"cse": True})


#: Names of the header, the source and the example.
AIRCRAFT_FILES = ("hfa_aircraft.h", "hfa_aircraft.c", "loop_100hz.c")
#: Bodies of the C function hfa_policy, with the deviations z.
_BODY_OF_GAIN = """    for (int i = 0; i < HFA_INPUTS; i++) {
        u[i] = hfa_u0[i];
        for (int j = 0; j < HFA_LINEAR_STATES; j++) u[i] -= hfa_K[i][j] * z[j];
    }"""
_BODY_OF_CALL = """    double v[HFA_INPUTS];
    policy(z, v);
    for (int i = 0; i < HFA_INPUTS; i++) u[i] = hfa_u0[i] + v[i];"""


class _PolicyInC(NamedTuple):
    """C source of a policy.

    K: gain at the trim, zero for a nonlinear policy
    formula: comment on the function hfa_policy
    body: body of this function
    function: source of the function that the body calls, or ""
    """

    K: np.ndarray
    formula: str
    body: str
    function: str


def c_model_texts(
    linear: LinearModel,
    policy: Policy,
    origin: str,
) -> dict[str, str]:
    """Return the C source of an aircraft as file name -> text.

    The files are a header, a source file and an example 100 Hz loop.

    linear: linear model at a trim
    policy: gain, function or gain table about that trim
    origin: provenance, for a comment

    Raises BadInputError if the equations cannot be expressed in C.
    """
    model = linear.point.model
    header, source, example = AIRCRAFT_FILES
    origin_and_title = {"origin": comment_lines(origin), "title": comment_lines(model.title)}
    states = units_of(model, model.states)
    inputs = units_of(model, model.inputs)
    winds = units_of(model, model.disturbances) or {"unused": ""}  # C has no empty array
    in_c = _policy_in_c(linear, policy)
    rates = c_function(_rates(model), "rates", ("x", "u", "w", "p"), ("dx",))
    return {
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
                    "const int hfa_linear_state": model.state_places(model.linear),
                    "const char *const hfa_state_name": [f'"{name}"' for name in states],
                    "const char *const hfa_state_unit": [f'"{unit}"' for unit in states.values()],
                }
            ),
            function=rates + in_c.function,
            policy=in_c.body,
        ),
        example: filled(example, **displaced_state(model)),
    }


def _policy_in_c(linear: LinearModel, policy: Policy) -> _PolicyInC:
    """Return the source of a policy."""
    K = np.zeros(linear.B.T.shape)
    if isinstance(policy, GainPolicy):
        K[:, : policy.K.shape[1]] = policy.K  # which may not see the positions of servos
        formula = "u = u0 - K z: the policy at x. Nothing is limited."
        return _PolicyInC(K, formula, _BODY_OF_GAIN, function="")
    formula = "u = u0 + v(z): the policy at x, within the control limits. K is zero."
    if isinstance(policy, ScheduledGainPolicy):  # of a file without a sample time
        model, table = linear.point.model, policy.schedule.table
        K = table.at(linear.point.values[model.schedule])
        formula = (
            f"u = u0 - K({model.schedule}) z: the policy at x, K linear between breakpoints "
            "and constant\n   beyond; hfa_K is K at x0. Nothing is limited."
        )
    z = ca.SX.sym("z", len(linear.states))
    command = command_of(policy, ca.SX(0.0), z, ca.DM(policy.held_inputs(0, 0.0)))
    v = ca.Function("policy", [z], [ca.densify(command)])
    source = c_function(v, "policy", ("z",), ("v",))
    return _PolicyInC(K, formula, _BODY_OF_CALL, function=f"\n{source}")


def _parameters(model: Model) -> str:
    """Return the definition of the C array of the model's parameters, with one line for each."""
    lines = [
        f"    {parameter.start!r}, /* {name}, {parameter.unit} */"
        for name, parameter in model.parameters.items()
    ] or ["    0.0, /* none */"]
    values = "\n".join(lines)
    return f"static const double parameters[{len(lines)}] = {{\n{values}\n}};"


def _rates(model: Model) -> ca.Function:
    """Return the CasADi Function (x, u, w, p) -> dx, the equations of motion."""
    vectors: Any = model.layout.symbols("x", "u", "p")
    w = ca.SX.sym("w", max(1, len(model.disturbances)))  # C has no arrays without entries
    winds = w[: len(model.disturbances)]
    no_outputs = ()
    rates, _ = model.layout.expressions(vectors, no_outputs, winds)
    return ca.Function("rates", [vectors[0], vectors[1], w, vectors[2]], [rates])
