"""Export of a policy behind a Kalman filter, in C."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hfa_aircraft.limits import Limits
from hfa_flight.export.c_text import comment_lines, filled, positions, units_of
from hfa_flight.policies.estimate import (
    IMPOSSIBLE,
    LOST,
    memory_size,
    propagated,
    unpacked,
    updated,
)
from hfa_flight.policies.filtered_policy import FilteredPolicy, command_of
from hfa_support.native.c_code import c_function

#: Header and source file.
FILTER_FILES = ("hfa_filter.h", "hfa_filter.c")


def c_filter_texts(policy: FilteredPolicy, origin: str) -> dict[str, str]:
    """Return the C source of one sample of a policy behind a filter, as file name -> text.

    origin: comment on the origin of the policy
    """
    model = policy.point.model
    fields = {
        "origin": comment_lines(origin),
        "title": comment_lines(f"{model.title}, {policy.filter.text()}"),
        "sensors": positions(units_of(model, policy.filter.sensors), "FILTER_"),
        "inputs": positions(units_of(model, model.inputs), "FILTER_"),
        "dt": repr(policy.dt),
        "memory": memory_size(policy.filter),
        "impossible": IMPOSSIBLE,
        "lost": LOST,
        "sample": c_function(filter_sample(policy), "sample", ("memory", "y"), ("u", "later")),
    }
    return {file: filled(file, **fields) for file in FILTER_FILES}


def filter_sample(policy: FilteredPolicy) -> ca.Function:
    """Return the function (memory, y) -> (U, memory) of a sample, as in `FilteredPolicy`.

    The memory is that of `hfa_flight.policies.estimate`, zero before the first sample.
    """
    known, point = policy.filter, policy.point
    k, size = len(known.states), memory_size(known)
    memory, y = ca.SX.sym("memory", size), ca.SX.sym("y", len(known.sensors))
    trim = np.array([getattr(point.states, name) for name in known.sensors])
    now, _ = updated(known, unpacked(known, memory), y - trim)
    limits = Limits.of(point.model, tuple(point.model.inputs))
    command = command_of(policy.law, ca.SX(0.0), now.x[:k], ca.DM(policy.law.held_inputs(0, 0.0)))
    U = ca.fmin(ca.fmax(command + point.u, ca.DM(limits.lowest)), ca.DM(limits.highest))
    moved = ca.DM(known.Phi) @ now.x + ca.DM(known.Gamma) @ (U - point.u)
    later = propagated(known, now, moved, ca.sparsify(ca.DM(known.Phi)))
    return ca.Function("sample", [memory, y], [ca.densify(U), later.packed()], {"cse": True})
