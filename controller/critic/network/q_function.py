"""Policy of a Q(x, u) that is quadratic in u: the u at which ∂Q/∂u = 0."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError

_ADVICE = (
    "export the policy u(x) that was trained with this Q function and select it (for an actor "
    "in the same file: --network policy=NAME)"
)


def policy_of(Q: ca.Function, states: int) -> ca.Function:
    """Return the function x (n,) -> u (m,) with ∂Q/∂u = 0.

    u is nan at x where ∂²Q/∂u² does not have the definite sign that it has at x = 0.

    Q: function of (x, u), (n + m,), with one output
    states: n

    Raises BadInputError if Q has several outputs, if its degree in u may exceed 2, or if ∂²Q/∂u² is
    not definite at x = 0.
    """
    if Q.numel_out(0) != 1:
        raise BadInputError(
            f"the network of (x, u) has {Q.numel_out(0)} outputs; give a Q function, which has one "
            "output"
        )
    if _degree(Q.expand(), states) > 2.0:
        raise BadInputError(f"Q(x, u) is not quadratic in u; {_ADVICE}")
    x = ca.SX.sym("x", states)
    u = ca.SX.sym("u", Q.numel_in(0) - states)
    curvature, slope = ca.hessian(Q(ca.vertcat(x, u)), u)
    curvature = ca.densify(curvature)
    slope = ca.densify(ca.substitute(slope, u, ca.DM.zeros(u.shape)))
    at_origin = np.array(ca.Function("curvature", [x], [curvature])(np.zeros(states)))
    eigenvalues = np.linalg.eigvalsh(at_origin)
    sign = np.sign(eigenvalues[0])
    if sign == 0.0 or np.any(np.sign(eigenvalues) != sign):
        raise BadInputError(
            f"Q(x, u) has neither a minimum nor a maximum over u at x = 0; {_ADVICE}"
        )
    root = ca.chol(sign * curvature)
    policy = -ca.solve(root, ca.solve(root.T, sign * slope))
    return ca.Function("policy", [x], [policy])


def _degree(Q: ca.Function, states: int) -> float:
    """Return an upper bound on the degree of Q in u, or inf if Q may not be a polynomial."""
    degrees = np.zeros(Q.sz_w())
    largest = 0.0
    for index in range(Q.n_instructions()):
        operation = Q.instruction_id(index)
        inputs = Q.instruction_input(index)
        outputs = Q.instruction_output(index)
        if operation == ca.OP_OUTPUT:
            largest = max(largest, degrees[inputs[0]])
        elif operation == ca.OP_INPUT:
            degrees[outputs[0]] = float(inputs[1] >= states)
        elif operation == ca.OP_CONST:
            degrees[outputs[0]] = 0.0
        else:
            degrees[outputs[0]] = _degree_of(operation, [degrees[i] for i in inputs])
    return float(largest)


def _degree_of(operation: int, degrees: list[float]) -> float:
    """Return an upper bound on the degree of an operation's result, or inf if none is known."""
    if operation in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE):
        return max(degrees)
    if operation == ca.OP_MUL:
        return sum(degrees)
    if operation == ca.OP_SQ:
        return 2.0 * degrees[0]
    if operation == ca.OP_DIV and degrees[1] == 0.0:
        return degrees[0]
    return math.inf if any(degrees) else 0.0
