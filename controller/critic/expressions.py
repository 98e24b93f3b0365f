"""Critics defined by expressions of the state: networks, and lists of functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.game.zero_sum import Game


def from_functions(
    game: Game,
    z: ca.SX,
    outputs: Mapping[str, ca.SX],
    origin: str,
    precision: str = "float64",
    variants: Mapping[str, Callable[[], Critic]] | None = None,
) -> Critic:
    """Return the critic whose functions are given as expressions of the symbols z.

    K = -∂u/∂z and P = ½ ∂²V/∂z² are exact derivatives at z = 0. If only "policy" is given, P is
    None.

    game: the game; R, B and N of the game define the policy if "policy" is not in `outputs`
    z: (n,), symbols
    outputs: "V", "gradient" (∂V/∂z), "policy" -> expression, at least one of them
    origin: source of the critic
    precision: floating-point type of the numbers in the critic's file
    variants: possible misreading of the file -> function that returns the critic for this reading;
        None for none
    """
    V = outputs.get("V")
    u = outputs.get("policy")
    gradient = outputs.get("gradient") if V is None else ca.gradient(V, z)
    expressions = {"V": V, "gradient": gradient, "policy": u}
    network = {
        name: ca.Function(name, [z], [ca.densify(expression)])
        for name, expression in expressions.items()
        if expression is not None
    }
    P = None if gradient is None else _derivative_at_0(gradient, z) / 2.0
    if u is not None:
        K = -_derivative_at_0(u, z)
    else:
        assert P is not None
        K = game.gain(P)
    return Critic(
        K,
        P,
        origin,
        constant=0.0 if V is None else float(network["V"](np.zeros(len(game.A)))),
        precision=precision,
        feedback=game.R_inverse_B_transposed if u is None else None,
        F=game.F if u is None and game.N.any() else None,
        network=network,
        variants=variants or {},
    )


def _derivative_at_0(expression: ca.SX, z: ca.SX) -> np.ndarray:
    """Return ∂expression/∂z at z = 0, (k, n), for an expression with k entries."""
    weights = type(z).sym("w", expression.numel())
    rows = ca.Function("rows", [z, weights], [ca.jtimes(expression, z, weights, True)])
    each_row = rows(np.zeros((z.numel(), expression.numel())), np.eye(expression.numel()))
    return np.array(each_row).T
