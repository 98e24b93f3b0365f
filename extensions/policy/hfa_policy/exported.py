"""Export of a deployed policy's command at a sample, in C and as an FMU."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from hfa_flight.export.c_code import c_function
from hfa_flight.export.c_text import comment_lines, filled, positions, units_of
from hfa_flight.export.exported_loop import Channel, ExportedLoop

if TYPE_CHECKING:
    from hfa_policy.flown import DeployedPolicy

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
    arguments = ("x", "before", *(("past",) if has_past else ()))
    results = ("u", *(("observed",) if has_past else ()))
    command = c_function(_command(policy), "command", arguments, results)
    fields = {
        "origin": comment_lines(origin),
        "title": comment_lines(model.title),
        "states": positions(units_of(model, tuple(model.states))),
        "inputs": positions(units_of(model, tuple(model.inputs))),
        "moved": ", ".join(policy.deployed.commanded),
        "dt": repr(deployment.dt),
        "delay": repr(deployment.delay),
        "command": command,
        "history": _HISTORY.format(deployment.history - 1) if has_past else "",
        "observations": len(deployment.observation),
        "frames": deployment.history,
        "more": _MORE if has_past else "",
        "called": ", ".join([*arguments, *results]),
    }
    return {file: filled(__package__, file, **fields) for file in POLICY_FILES}


def policy_loop(policy: DeployedPolicy) -> ExportedLoop:
    """Return the command u = g(v) with v = [X; U before; past], as a loop for `write_fmu`.

    The only state is a clock, s, because model exchange requires a state. If the policy uses
    earlier observations, the observations at the sample are also outputs.
    """
    model = policy.deployed.model
    y = ca.SX.sym("y", 1)
    n, m = len(model.states), len(model.inputs)
    past = policy.deployed.past
    v = ca.SX.sym("v", n + m + past)
    given = [v[:n], v[n : n + m], *([v[n + m :]] if past else [])]
    results = _command(policy).call(given)
    starts = [*policy.point.states, *policy.point.inputs]
    seen = [Channel(name, model.unit(name)) for name in model.states]
    seen += [Channel(f"before_{name}", model.unit(name)) for name in model.inputs]
    inputs = [one._replace(start=start) for one, start in zip(seen, starts, strict=True)]
    outputs = [Channel(name, model.unit(name)) for name in model.inputs]
    if past:
        names = [_identifier(name) for name in policy.deployed.deployment.observation]
        earlier = range(policy.deployed.deployment.history - 1, 0, -1)
        inputs += [Channel(f"past{age}_{name}", "1") for age in earlier for name in names]
        outputs += [Channel(f"observed_{name}", "1") for name in names]
    return ExportedLoop(
        function=ca.Function("loop", [y, v], [ca.SX(ca.DM.ones(1)), ca.vertcat(*results)]),
        states=(Channel("clock", "s", rate_unit="1"),),
        outputs=tuple(outputs),
        inputs=tuple(inputs),
        flown=0,
        longest_step=policy.deployed.deployment.dt,
    )


def _command(policy: DeployedPolicy) -> ca.Function:
    """Return the function (X, U before) -> U at the policy's trim.

    If the policy uses earlier observations, the function is (X, U before, past) -> (U, o).
    """
    model = policy.deployed.model
    sampled = policy.deployed.sampled
    if not sampled.is_a("SXFunction"):
        sampled = sampled.expand()
    X = ca.SX.sym("X", len(model.states))
    U = ca.SX.sym("U", len(model.inputs))
    trim = ca.DM(np.array(policy.deployed.trim_vector(policy.point)))
    past = ca.SX.sym("past", policy.deployed.past)
    commanded = ca.densify(sampled(X, U, trim, past)[0])
    if not policy.deployed.past:
        return ca.Function("command", [X, U], [commanded], {"cse": True})
    observed = policy.deployed.observe(X, U, trim)
    return ca.Function("command", [X, U, past], [commanded, observed], {"cse": True})


def _identifier(name: str) -> str:
    """Return a name with forbidden characters replaced by _.

    Each group of characters other than letters, digits and _ becomes one _. Leading and trailing _
    are removed.
    """
    return re.sub(r"\W+", "_", name).strip("_")
