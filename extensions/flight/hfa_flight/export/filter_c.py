"""Export of a policy behind a Kalman filter, in C."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hfa_flight.export.c_text import comment_lines, enumerators, filled, units_of
from hfa_flight.policies.estimate import IMPOSSIBLE, LOST, memory_size
from hfa_flight.policies.filtered_policy import FilteredPolicy, sample_of
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
        "sensors": enumerators(units_of(model, policy.filter.sensors), "FILTER_"),
        "inputs": enumerators(units_of(model, model.inputs), "FILTER_"),
        "dt": repr(policy.dt),
        "memory": memory_size(policy.filter),
        "impossible": IMPOSSIBLE,
        "share": len(policy.filter.Phi) + 2,
        "fade": policy.fade,
        "lost": LOST,
        "sample": c_function(filter_sample(policy), "sample", ("memory", "y"), ("u", "later")),
    }
    return {file: filled(file, **fields) for file in FILTER_FILES}


def filter_sample(policy: FilteredPolicy) -> ca.Function:
    """Return the function (memory, y) -> (U, memory) of a sample, absolute, as `sample_of`."""
    known, point = policy.filter, policy.point
    memory = ca.SX.sym("memory", memory_size(known))
    y = ca.SX.sym("y", len(known.sensors))
    trim = np.array([getattr(point.states, name) for name in known.sensors])
    u, later, _ = sample_of(policy, ca.SX(0.0), memory, y - trim)
    return ca.Function("sample", [memory, y], [ca.densify(point.u + u), later], {"cse": True})
