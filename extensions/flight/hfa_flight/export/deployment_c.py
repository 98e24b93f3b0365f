"""Export of a deployed policy's command at a sample, in C."""

from __future__ import annotations

import casadi as ca

from hfa_flight.export.c_text import comment_lines, enumerators, filled, units_of
from hfa_flight.policies.deployment.policy import DeployedPolicy
from hfa_support.native.c_code import c_function

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
    if not command.is_a("SXFunction"):
        command = command.expand()
    X = ca.SX.sym("X", len(model.states))
    U = ca.SX.sym("U", len(model.inputs))
    trim = ca.DM(policy.deployed.trim_vector(policy.point))
    commanded = ca.densify(command(X, U, trim))
    return ca.Function("command", [X, U], [commanded], {"cse": True})
