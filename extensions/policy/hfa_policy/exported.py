"""A deployed policy for other tools: what it commands at a sample, as C and as an FMU."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hfa_flight.export.c_text import comment_lines, filled, positions, units_of
from hfa_flight.export.exported_loop import Channel, ExportedLoop
from hfa_policy.flown import DeployedPolicy
from hfa_support.native.c_code import c_function

#: Header and source.
POLICY_FILES = ("deployed_policy.h", "deployed_policy.c")


def c_policy_texts(policy: DeployedPolicy, origin: str) -> dict[str, str]:
    """File -> its text: C of the command at a sample, observations, normalizer, clip and map
    inside.

    origin: where it comes from, lines of text
    """
    model = policy.deployed.model
    deployment = policy.deployed.deployment
    command = c_function(_command(policy), "command", ("x", "before"), ("u",))
    fields = {
        "origin": comment_lines(origin),
        "title": comment_lines(model.title),
        "states": positions(units_of(model, tuple(model.states))),
        "inputs": positions(units_of(model, tuple(model.inputs))),
        "moved": ", ".join(policy.deployed.commanded),
        "dt": repr(deployment.dt),
        "delay": repr(deployment.delay),
        "command": command,
    }
    return {file: filled(__package__, file, **fields) for file in POLICY_FILES}


def policy_loop(policy: DeployedPolicy) -> ExportedLoop:
    """The command u = g(v) at v = [X; U before] as a loop for `write_fmu`, whose one state is a
    clock, s: a unit without states is none of model exchange."""
    model = policy.deployed.model
    y = ca.SX.sym("y", 1)
    n, m = len(model.states), len(model.inputs)
    v = ca.SX.sym("v", n + m)
    u = _command(policy)(v[:n], v[n:])
    starts = [*policy.point.states, *policy.point.inputs]
    seen = [Channel(name, model.unit(name)) for name in model.states]
    seen += [Channel(f"before_{name}", model.unit(name)) for name in model.inputs]
    inputs = [one._replace(start=start) for one, start in zip(seen, starts, strict=True)]
    return ExportedLoop(
        function=ca.Function("loop", [y, v], [ca.SX(ca.DM.ones(1)), u]),
        states=(Channel("clock", "s", rate_unit="1"),),
        outputs=tuple(Channel(name, model.unit(name)) for name in model.inputs),
        inputs=tuple(inputs),
        flown=0,
        longest_step=policy.deployed.deployment.dt,
    )


def _command(policy: DeployedPolicy) -> ca.Function:
    """(X, U before) -> U at its trim, all scalars."""
    model = policy.deployed.model
    command = policy.deployed.command
    if not command.is_a("SXFunction"):
        command = command.expand()
    X = ca.SX.sym("X", len(model.states))
    U = ca.SX.sym("U", len(model.inputs))
    trim = ca.DM(np.array(policy.deployed.trim_vector(policy.point)))
    commanded = ca.densify(command(X, U, trim))
    return ca.Function("command", [X, U], [commanded], {"cse": True})
