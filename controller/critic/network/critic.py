"""Critics that are neural networks, from files or CasADi functions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from controller.critic.critic import Critic, from_functions, from_weights
from controller.critic.features import basis_of, symbols_for
from controller.critic.network.network_file import OUTPUTS, Asked, NetworkFile, network_in
from controller.game.basis import Basis
from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError, numbers_in, prefix_errors, shortened

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
    curvature = ca.densify(curvature)  # ∂²Q/∂u², which does not depend on u
    slope = ca.densify(ca.substitute(slope, u, ca.DM.zeros(u.shape)))  # ∂Q/∂u at u = 0
    at_origin = np.array(ca.Function("curvature", [x], [curvature])(np.zeros(states)))
    eigenvalues = np.linalg.eigvalsh(at_origin)
    sign = np.sign(eigenvalues[0])
    if sign == 0.0 or np.any(np.sign(eigenvalues) != sign):
        raise BadInputError(
            f"Q(x, u) has neither a minimum nor a maximum over u at x = 0; {_ADVICE}"
        )
    root = ca.chol(sign * curvature)  # upper triangular, nan if it is not definite
    policy = -ca.solve(root, ca.solve(root.T, sign * slope))
    return ca.Function("policy", [x], [policy])


def _degree(Q: ca.Function, states: int) -> float:
    """Return an upper bound on the degree of Q in u, or inf if Q may not be a polynomial."""
    degrees = np.zeros(Q.sz_w())  # of the numbers in the registers
    largest = 0.0
    for index in range(Q.n_instructions()):
        operation = Q.instruction_id(index)
        read = Q.instruction_input(index)  # registers, or (argument, place) of OP_INPUT
        written = Q.instruction_output(index)
        if operation == ca.OP_OUTPUT:
            largest = max(largest, degrees[read[0]])
        elif operation == ca.OP_INPUT:
            degrees[written[0]] = float(read[1] >= states)  # the argument is [x u]
        elif operation == ca.OP_CONST:
            degrees[written[0]] = 0.0
        else:
            degrees[written[0]] = _degree_of(operation, [degrees[i] for i in read])
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
    return math.inf if any(degrees) else 0.0  # any function of constants is constant


def from_network(
    game: Game,
    source: str | Path | ca.Function | Mapping[str, Any] | Callable[..., Any],
    *,
    network: str = "",
    activation: str | None = None,
    scale: np.ndarray | None = None,
    basis: Basis | ca.Function | str = "quadratic",
) -> Critic:
    """Return the critic that a network defines.

    What the file of a policy states of its action (squash, clip, box) is a part of the policy. A
    network whose input is (x, u) is a Q function. Its policy is computed by `policy_of`.

    game: the game that the critic should solve
    source: a file of a network, a CasADi Function of the state, a torch module of linear layers, or
        a state dict. The name "V", "gradient" or "policy" of a CasADi Function is its kind, if
        `network` is not given
    network: the parts of a file or state dict and their kinds, such as "value", "V=value" or
        "V=value,policy=actor". Without a kind, the number of outputs decides
    activation: activation between the layers of a state dict, such as "tanh" or "ReLU"
    scale: (n,), factors on the states at the inputs of the network, none of them 0
    basis: functions on which a single layer acts, as for `from_weights`. The critic is then a
        polynomial

    Raises a BadInputError of one line for a wrong argument or file, and for a policy behind a
    normalizer, which a deployment file states.

    >>> import casadi as ca
    >>> import hfa
    >>> game = hfa.paper.published_game(hfa.paper.level_model(hfa.aircraft(), 0.2))
    >>> z = ca.SX.sym("z", 6)
    >>> V = ca.Function("V", [z], [3 * ca.sumsqr(z)])
    >>> hfa.from_network(game, V).P.diagonal().tolist()
    [3.0, 3.0, 3.0, 3.0, 3.0, 3.0]
    """
    n, m = game.B.shape
    scales = np.ones(n) if scale is None else numbers_in("scale", scale)
    if scales.shape != (n,) or not np.all(np.isfinite(scales) & (scales != 0.0)):
        raise BadInputError(
            f"scale does not consist of {n} finite numbers other than 0; give one for each state"
        )
    psi = basis_of(basis, n, game.names.states)
    count = psi.size if isinstance(psi, Basis) else psi.numel_out(0)
    sizes = (1, n, m, 1 + m)  # of V, its gradient, the policy, V and the policy
    stored = network_in(
        source,
        Asked(n, network, activation, basis_size=count, inputs=m, sizes=sizes, of_states=True),
    )
    name = where = type(source).__name__
    if isinstance(source, (str, Path)):
        name, where = Path(source).name, str(source)
    origin = f"network {name}: {stored.chain}"
    with prefix_errors(where):
        if stored.on_basis is not None:
            return _on_basis(game, stored, psi, scales, network, origin)
        return _of_states(game, stored, scales, origin)


def _of_states(game: Game, stored: NetworkFile, scales: np.ndarray, origin: str) -> Critic:
    """Return the critic of a network whose inputs are the states, or states and inputs (a Q)."""
    n, m = game.B.shape

    # A Q function is replaced by its policy.
    of_q_functions = {
        name: policy_of(function, n)
        for name, function in stored.functions.items()
        if function.numel_in(0) == n + m
    }
    if of_q_functions:
        origin = f"{origin} = Q(x, u), u from dQ/du = 0"
    functions = stored.functions | of_q_functions

    # What each output is.
    sizes = {name: function.numel_out(0) for name, function in functions.items()}
    kinds = _kinds(sizes, n, m)
    if any(is_taken_as_policy(name, size, m) for name, size in sizes.items()):
        origin = f"{origin}, its one output read as the policy u, not V"

    z: Any = ca.MX.sym("z", n)
    outputs: dict[str, Any] = {}
    for name, function in functions.items():
        output: Any = ca.vec(ca.vertcat(*function.call([ca.DM(scales) * z], True, False)))
        if kinds[name] == "V+policy":
            outputs |= {"V": output[0], "policy": output[1:]}
        else:
            outputs[kinds[name]] = output

    # Squash and box follow, if the file states them. The policy of a Q is the action already.
    declared = stored.declared
    if str(declared.action) and "policy" in outputs and not of_q_functions:
        outputs["policy"] = declared.action.of(outputs["policy"])
        origin = f"{origin}, {declared.action}"

    notes = declared.notes
    if declared.observations not in ((), game.names.states):
        notes += (f"observations {', '.join(declared.observations)}, taken as the states",)
    critic = from_functions(game, z, outputs, origin, stored.precision, is_small=stored.is_small)
    return replace(critic, declared=declared._replace(notes=notes))


def _on_basis(
    game: Game,
    stored: NetworkFile,
    psi: Basis | ca.Function,
    scales: np.ndarray,
    network: str,
    origin: str,
) -> Critic:
    """Return the critic V of a single layer whose inputs are the functions of a basis.

    scales, network: as for `from_network`
    """
    layer = stored.on_basis
    assert layer is not None  # the caller has checked it
    if len(layer.weight) != 1:
        raise BadInputError(
            f"the single layer on the basis functions has {len(layer.weight)} outputs; give a "
            "layer with one output, V"
        )
    kind = network.partition("=")[0] if "=" in network else ""
    if kind not in ("", "V"):
        raise BadInputError(
            f"the single layer on the basis functions is a value function V; remove {kind}= from "
            "--network"
        )
    weights = layer.weight[0]
    if isinstance(psi, Basis):
        weights = weights * psi.scaling(scales)
    else:
        z = symbols_for([psi], len(scales))
        psi = ca.Function("basis", [z], [psi(ca.DM(scales) * z)])
    critic = from_weights(game, weights, psi, float(layer.bias[0]), stored.precision)
    return replace(critic, origin=origin, is_layer=True, declared=stored.declared)


def is_taken_as_policy(name: str, size: int, m: int) -> bool:
    """Return whether an output is read as the policy u although V would also have this size.

    True for a single output without a kind, on a plant with one input.

    name: kind or name of the output
    size: number of entries of the output
    m: number of inputs of the plant
    """
    return name not in OUTPUTS and size == m == 1


def _kinds(sizes: Mapping[str, int], n: int, m: int) -> dict[str, str]:
    """Return the kind of each output of a network, by name of the output or requested kind."""
    counts = {"V": 1, "gradient": n, "policy": m, "V+policy": 1 + m}
    kinds = {}
    for name, size in sizes.items():
        permitted = [name] if name in counts else counts
        fitting = [kind for kind in permitted if counts[kind] == size]
        if is_taken_as_policy(name, size, m):
            fitting = ["policy"]
        elif fitting == ["gradient", "V+policy"]:  # n = 1 + m: the user must name V+policy
            fitting = ["gradient"]
        if not fitting:
            meanings = ", ".join(f"{kind} has {count}" for kind, count in counts.items())
            hint = ", or the inputs that it moves (--inputs, game.select)" if size < m else ""
            raise BadInputError(
                f"the network has {size} outputs, but for this plant {meanings}; give a network "
                f"with such a number of outputs{hint}"
            )
        is_unnamed_of_several = len(sizes) > 1 and name not in counts
        if len(fitting) > 1 or is_unnamed_of_several:
            words = f"{fitting[0]}={'' if name in OUTPUTS else name}"
            among = f", among {shortened(', '.join(sizes))}," if len(sizes) > 1 else ""
            raise BadInputError(
                f"a network with {size} outputs{among} may be {' or '.join(fitting)}; select one, "
                f'for example by network="{words}"',
                ("--network", words),
            )
        kinds[name] = fitting[0]
    if len(kinds) > 1 and sorted(kinds.values()) != ["V", "policy"]:
        raise BadInputError(
            f"the network's outputs are {', '.join(kinds.values())}; select one of them, or V and "
            "policy"
        )
    return kinds
