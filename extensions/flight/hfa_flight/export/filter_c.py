"""Export of a policy behind a Kalman filter, in C."""

from __future__ import annotations

import casadi as ca
import numpy as np

from hfa_aircraft.limits import Limits
from hfa_flight.export.c_text import comment_lines, filled, positions, units_of
from hfa_flight.policies.filtered_policy import IMPOSSIBLE, LOST, FilteredPolicy, command_of
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
        "memory": len(policy.filter.Phi) + 2,
        "impossible": IMPOSSIBLE,
        "lost": LOST,
        "sample": c_function(filter_sample(policy), "sample", ("memory", "y"), ("u", "later")),
    }
    return {file: filled(file, **fields) for file in FILTER_FILES}


def filter_sample(policy: FilteredPolicy) -> ca.Function:
    """Return the function (memory, y) -> (U, memory) of a sample, as in `FilteredPolicy`.

    The memory has the predicted states, the number of missed samples in a row, and 1 once a sample
    was taken.
    """
    known, point = policy.filter, policy.point
    n, k = len(known.Phi), len(known.states)
    memory, y = ca.SX.sym("memory", n + 2), ca.SX.sym("y", len(known.sensors))
    predicted, missed, is_begun = ca.vertsplit(memory, [0, n, n + 1, n + 2])
    trim = np.array([getattr(point.states, name) for name in known.sensors])
    innovation = y - trim - ca.DM(known.C) @ predicted
    is_finite = _all(ca.fabs(innovation) <= 1e300)
    is_possible = _all(ca.fabs(innovation) <= IMPOSSIBLE * ca.DM(known.innovation))
    is_missed = ca.logic_and(is_finite, ca.logic_not(is_possible))
    in_a_row = ca.if_else(is_missed, missed + 1.0, ca.if_else(is_finite, 0.0, missed))
    is_lost = ca.logic_or(ca.logic_not(is_begun), in_a_row >= LOST)
    begins = ca.logic_and(is_missed, is_lost)
    used = predicted + ca.DM(known.L) @ innovation
    anew = ca.vertcat((ca.DM(known.C).T @ (y - trim))[:k], predicted[k:])
    updated = ca.vertcat(
        *[
            ca.if_else(is_possible, used[i], ca.if_else(begins, anew[i], predicted[i]))
            for i in range(n)
        ]
    )
    limits = Limits.of(point.model, tuple(point.model.inputs))
    command = command_of(policy.law, ca.SX(0.0), updated[:k], ca.DM(policy.law.held_inputs(0, 0.0)))
    U = ca.fmin(ca.fmax(command + point.u, ca.DM(limits.lowest)), ca.DM(limits.highest))
    moved = ca.DM(known.Phi) @ updated + ca.DM(known.Gamma) @ (U - point.u)
    later = ca.vertcat(moved, ca.if_else(begins, 0.0, in_a_row), 1.0)
    return ca.Function("sample", [memory, y], [ca.densify(U), ca.densify(later)])


def _all(holds: ca.SX) -> ca.SX:
    """Return whether every element holds."""
    every = ca.SX(1)
    for each in ca.vertsplit(holds):
        every = ca.logic_and(every, each)
    return every
