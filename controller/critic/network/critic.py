"""Critics that are neural networks, from files or CasADi functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from controller.critic.critic import Critic, from_functions, from_weights
from controller.critic.features import basis_of
from controller.critic.network.network_file import OUTPUTS, Asked, NetworkFile, network_in
from controller.critic.network.q_function import policy_of
from controller.critic.reading import Reading
from controller.critic.symbols import symbols_for
from controller.game.basis import Basis
from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError, file_faults, numbers_in, prefix_errors, shortened


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
    stored = network_in(
        source, Asked(n, network, activation, count, m, (1, n, m, 1 + m), of_states=True)
    )
    name = where = type(source).__name__
    if isinstance(source, (str, Path)):
        name, where = Path(source).name, str(source)
    origin = f"network {name}: {stored.chain}"
    with prefix_errors(where):
        if stored.on_basis is not None:
            return _on_basis(game, stored, psi, scales, network, origin)
        return _of_states(game, stored, scales, origin)


def critic_of_network(path: str | Path, game: Game, reading: Reading) -> Critic:
    """Return the critic of the network in a file.

    reading: the options of the command that describe the network
    """
    with prefix_errors(path), file_faults(path):
        return from_network(
            game,
            path,
            network=reading.network,
            activation=reading.activation,
            scale=reading.scale,
            basis=reading.psi(game),
        )


def _of_states(game: Game, stored: NetworkFile, scales: np.ndarray, origin: str) -> Critic:
    """Return the critic of a network whose inputs are the states, or states and inputs (a Q)."""
    n, m = game.B.shape
    of_q_functions = {
        name: policy_of(function, n)
        for name, function in stored.functions.items()
        if function.numel_in(0) == n + m
    }
    if of_q_functions:
        origin = f"{origin} = Q(x, u), u from dQ/du = 0"
    functions = stored.functions | of_q_functions
    sizes = {name: function.numel_out(0) for name, function in functions.items()}
    kinds = _kinds(sizes, n, m)
    if any(is_taken_as_policy(name, size, m) for name, size in sizes.items()):
        origin = f"{origin}, its one output read as the policy u, not V"
    z = symbols_for(functions.values(), n)
    outputs = _outputs_by_kind(functions, kinds, ca.DM(scales) * z)
    stated = stored.stated
    # The policy of a Q minimizes over u: it is the action already.
    if str(stated.action) and "policy" in outputs and not of_q_functions:
        outputs["policy"] = stated.action.of(outputs["policy"])
        origin = f"{origin}, {stated.action}"
    notes = stated.notes
    if stated.observations not in ((), game.names.states):
        notes += (f"observations {', '.join(stated.observations)}, taken as the states",)
    critic = from_functions(game, z, outputs, origin, stored.precision)
    return replace(critic, stated=stated._replace(notes=notes))


def _outputs_by_kind(
    functions: Mapping[str, ca.Function], kinds: Mapping[str, str], x: Any
) -> dict[str, Any]:
    """Return the expressions "V", "gradient", "policy" of a network, as far as it has them.

    functions: name -> function of the inputs x of the network
    kinds: name -> kind of its output
    """
    outputs = {}
    for name, function in functions.items():
        output = ca.vec(function(x))
        if kinds[name] == "V+policy":
            outputs["V"], outputs["policy"] = output[0], output[1:]
        else:
            outputs[kinds[name]] = output
    return outputs


def _on_basis(
    game: Game,
    stored: NetworkFile,
    psi: Basis | ca.Function,
    scales: np.ndarray,
    network: str,
    origin: str,
) -> Critic:
    """Return the critic V of a single layer whose inputs are the functions of a basis."""
    layer = stored.on_basis
    assert layer is not None  # the caller found one layer
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
    return replace(critic, origin=origin, is_layer=True, stated=stored.stated)


def is_taken_as_policy(name: str, size: int, m: int) -> bool:
    """Return whether an output is read as the policy u although V would also have this size.

    True for a single output without a kind, on a plant with one input.

    name: kind or name of the output
    size: number of entries of the output
    m: number of inputs of the plant
    """
    return name not in OUTPUTS and size == m == 1


def _fitting_kinds(name: str, size: int, counts: Mapping[str, int]) -> list[str]:
    """Return the kinds that an output of a network may have, by its name and its size.

    counts: kind -> number of entries for this plant

    Raises BadInputError if no kind fits.
    """
    m = counts["policy"]
    if is_taken_as_policy(name, size, m):
        return ["policy"]
    candidates = [name] if name in counts else list(counts)
    fitting = [kind for kind in candidates if counts[kind] == size]
    if not fitting:
        meanings = ", ".join(f"{kind} has {count}" for kind, count in counts.items())
        held = ", or the inputs that it moves (--inputs, game.select)" if size < m else ""
        raise BadInputError(
            f"the network has {size} outputs, but for this plant {meanings}; give a network "
            f"with such a number of outputs{held}"
        )
    if fitting == ["gradient", "V+policy"]:  # 1 + m = n: V+policy must be named
        return ["gradient"]
    return fitting


def _kinds(sizes: Mapping[str, int], n: int, m: int) -> dict[str, str]:
    """Return the kind of each output of a network, by name of the output.

    sizes: name of an output, or requested kind -> number of its entries
    n, m: numbers of states and of inputs of the plant
    """
    counts = {"V": 1, "gradient": n, "policy": m, "V+policy": 1 + m}
    kinds = {}
    for name, size in sizes.items():
        fitting = _fitting_kinds(name, size, counts)
        is_unclear = len(fitting) > 1 or (len(sizes) > 1 and name not in counts)
        if is_unclear:
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
