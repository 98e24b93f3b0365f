"""Export of a deployed policy's command at a sample, in C."""

from __future__ import annotations

import casadi as ca

from hfa_flight.export.c_text import comment_lines, filled, positions, units_of
from hfa_flight.policies.deployment.policy import DeployedPolicy
from hfa_support.native.c_code import c_function

#: Further arguments for a policy that uses the observations of several samples.
_MORE = """,
    const double past[(POLICY_HISTORY - 1) * POLICY_OBSERVATIONS],
    double observed[POLICY_OBSERVATIONS]"""
_HISTORY = """ observed: the
   observations at this sample. past: those of the {0} samples before, the oldest first. At the
   first sample every part of past is what a call writes into observed."""
#: Header and source file.
POLICY_FILES = ("deployed_policy.h", "deployed_policy.c")


def c_policy_texts(policy: DeployedPolicy, origin: str) -> dict[str, str]:
    """Return the C source of the policy's command at a sample, as file name -> text.

    origin: comment on the origin of the policy
    """
    model = policy.deployed.model
    deployment = policy.deployed.deployment
    has_past = bool(policy.deployed.past)
    arguments = ("x", "before", "past") if has_past else ("x", "before")
    results = ("u", "observed") if has_past else ("u",)
    fields = {
        "origin": comment_lines(origin),
        "title": comment_lines(model.title),
        "states": positions(units_of(model, model.states)),
        "inputs": positions(units_of(model, model.inputs)),
        "moved": ", ".join(policy.deployed.commanded),
        "dt": repr(deployment.dt),
        "delay": repr(deployment.delay),
        "command": c_function(_command(policy), "command", arguments, results),
        "history": _HISTORY.format(deployment.history - 1) if has_past else "",
        "observations": len(deployment.observation),
        "frames": deployment.history,
        "more": _MORE if has_past else "",
        "called": ", ".join([*arguments, *results]),
    }
    return {file: filled(file, **fields) for file in POLICY_FILES}


def _command(policy: DeployedPolicy) -> ca.Function:
    """Return the function (X, U before) -> U at the policy's trim."""
    model = policy.deployed.model
    sampled = policy.deployed.sampled
    if not sampled.is_a("SXFunction"):
        sampled = sampled.expand()
    X = ca.SX.sym("X", len(model.states))
    U = ca.SX.sym("U", len(model.inputs))
    trim = ca.DM(policy.deployed.trim_vector(policy.point))
    past = ca.SX.sym("past", policy.deployed.past)
    commanded = ca.densify(sampled(X, U, trim, past)[0])
    if not policy.deployed.past:
        return ca.Function("command", [X, U], [commanded], {"cse": True})
    observed = policy.deployed.observe(X, U, trim)
    return ca.Function("command", [X, U, past], [commanded, observed], {"cse": True})
