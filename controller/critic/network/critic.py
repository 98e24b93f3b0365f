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
from controller.critic.network.network_file import NetworkFile, network_in, network_of_tensors
from controller.critic.network.q_function import policy_of
from controller.critic.network.torch_module import module_network, state_dict_of
from controller.critic.reading import Reading
from controller.critic.symbols import symbols_for
from controller.game.basis import Basis
from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError, file_faults, prefix_errors, shortened, warn

#: Kinds of outputs: V, dV/dz, u, and the vector (V, u).
OUTPUTS = ("V", "gradient", "policy", "V+policy")


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

    A network whose input is (x, u) is a Q function. Its policy is computed by `policy_of`.

    game: the game that the critic should solve
    source: a file that `network_in` reads, a CasADi Function of the state, a torch.nn.Sequential of
        linear layers and activations, or the state dict of another torch module or this module. The
        name "V", "gradient" or "policy" of a CasADi Function is its kind, if `network` is not given
    network: the parts of a file or state dict and their kinds, such as "value", "V=value" or
        "V=value,policy=actor". Without a kind, the number of outputs decides
    activation: activation between the layers of a state dict
    scale: (n,), factors on the states at the inputs of the network, none of them 0
    basis: functions on which a single layer acts, as for `from_weights`. The critic is then a
        polynomial

    Raises a BadInputError of one line for a wrong argument or file.

    >>> import casadi as ca
    >>> import hfa
    >>> game = hfa.paper.published_game(hfa.paper.level_model(hfa.aircraft(), 0.2))
    >>> z = ca.SX.sym("z", 6)
    >>> V = ca.Function("V", [z], [3 * ca.sumsqr(z)])
    >>> hfa.from_network(game, V).P.diagonal().tolist()
    [3.0, 3.0, 3.0, 3.0, 3.0, 3.0]
    """
    n, m = game.B.shape
    scales = np.ones(n) if scale is None else np.asarray(scale, dtype=float)
    if scales.shape != (n,) or not np.all(np.isfinite(scales) & (scales != 0.0)):
        raise BadInputError(
            f"scale does not consist of {n} finite numbers other than 0; give one for each state"
        )
    psi = basis_of(basis, n, game.names.states)
    if isinstance(source, ca.Function):
        kind = network or (source.name() if source.name() in OUTPUTS else "")
        stored = NetworkFile({kind: source}, "a CasADi function", "float64")
        return _of_states(game, stored, scales, "network")
    count = psi.size if isinstance(psi, Basis) else psi.numel_out(0)
    parts = _parts(network)
    tensors = None if isinstance(source, (str, Path)) else state_dict_of(source)
    if isinstance(source, (str, Path)):
        stored = network_in(source, n, activation, parts, count, m)
        named = str(source)
        origin = f"network {Path(source).name}: {stored.chain}"
    elif tensors is not None:
        stored = network_of_tensors(tensors, n, activation, parts, count, m, is_ordered=True)
        named = type(source).__name__
        origin = f"network {named}: {stored.chain}"
    else:
        stored = module_network(source, network, n, m)
        return _of_states(game, stored, scales, f"network {stored.chain}")
    with prefix_errors(named):
        if stored.on_basis is not None:
            return _on_basis(game, stored, psi, scales, parts, origin)
        return _of_states(game, stored, scales, origin, ",".join(parts.values()))


def critic_of_network(path: str | Path, game: Game, reading: Reading) -> Critic:
    """Return the critic of the network in a file.

    Warns that a .zip file is read without its normalizer, clip and action map. Raises BadInputError
    if an activation is given for an ONNX file.

    reading: the options of the command that describe the network
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".onnx" and reading.activation is not None:
        raise BadInputError(
            f"{path}: an ONNX file already contains the activations; remove --set activation"
        )
    if suffix == ".zip":
        warn(
            f"{path}: the network is judged without normalizer, clip and action map; give a "
            "deployment file, --weights DEPLOYMENT.toml, to judge it with them"
        )
    with prefix_errors(path), file_faults(path):
        return from_network(
            game,
            path,
            network=reading.network,
            activation=reading.activation,
            scale=reading.scale,
            basis=reading.psi(game),
        )


def _of_states(
    game: Game,
    stored: NetworkFile,
    scales: np.ndarray,
    origin: str,
    asked: str = "",
) -> Critic:
    """Return the critic of a network whose inputs are the states, or states and inputs (a Q)."""
    n, m = game.B.shape
    functions = {}
    for name, function in stored.functions.items():
        if function.numel_in(0) == n + m:
            origin = f"{origin} = Q(x, u), u from dQ/du = 0"
            function = policy_of(function, n)
        functions[name] = function
    sizes = {name: function.numel_out(0) for name, function in functions.items()}
    kinds = _kinds(sizes, n, m, asked)
    if any(is_taken_as_policy(name, size, m) for name, size in sizes.items()):
        origin = f"{origin}, its one output read as the policy u, not V"
    z = symbols_for(functions.values(), n)
    outputs = {}
    for name, function in functions.items():
        numbers = ca.vec(function(ca.DM(scales) * z))
        if kinds[name] == "V+policy":
            outputs["V"] = numbers[0]
            outputs["policy"] = numbers[1:]
        else:
            outputs[kinds[name]] = numbers
    return from_functions(game, z, outputs, origin, stored.precision)


def _on_basis(
    game: Game,
    stored: NetworkFile,
    psi: Basis | ca.Function,
    scales: np.ndarray,
    parts: Mapping[str, str],
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
    others = sorted(set(parts) - {"", "V"})
    if others:
        raise BadInputError(
            f"the single layer on the basis functions is a value function V; remove {others[0]}= "
            "from --network"
        )
    weights = layer.weight[0]
    if isinstance(psi, Basis):
        weights = weights * psi.scaling(scales)
    else:
        z = symbols_for([psi], len(scales))
        psi = ca.Function("basis", [z], [psi(ca.DM(scales) * z)])
    critic = from_weights(game, weights, psi, float(layer.bias[0]), stored.precision)
    return replace(critic, origin=origin, is_layer=True)


def _parts(network: str) -> dict[str, str]:
    """Return the requested parts of a file by kind, from text such as "V=value,policy=actor"."""
    parts: dict[str, str] = {}
    for item in network.split(","):
        output, equals, part = item.strip().rpartition("=")
        if equals and output not in OUTPUTS:
            raise BadInputError(
                f"--network {shortened(item)!r}: the word before = is not a kind of output; "
                f"choose from {', '.join(OUTPUTS)}"
            )
        parts[output] = part
    return parts


def is_taken_as_policy(name: str, size: int, m: int) -> bool:
    """Return whether an output is read as the policy u although V would also have this size.

    True for a single output without a kind, on a plant with one input.

    name: kind or name of the output
    size: number of entries of the output
    m: number of inputs of the plant
    """
    return name not in OUTPUTS and size == m == 1


def _kinds(sizes: Mapping[str, int], n: int, m: int, part: str) -> dict[str, str]:
    """Return the kind of each output of a network, by name of the output.

    part: name of an output, for the advice in a refusal
    """
    counts = {"V": 1, "gradient": n, "policy": m, "V+policy": 1 + m}
    kinds = {}
    for name, size in sizes.items():
        candidates = [name] if name in counts else list(counts)
        fitting = [kind for kind in candidates if counts[kind] == size]
        if is_taken_as_policy(name, size, m):
            fitting = ["policy"]
        if fitting == ["gradient", "V+policy"]:  # 1 + m = n: V+policy must be named
            fitting = ["gradient"]
        if not fitting:
            meanings = ", ".join(f"{kind} has {count}" for kind, count in counts.items())
            held = ", or the inputs that it moves (--inputs, game.select)" if size < m else ""
            raise BadInputError(
                f"the network has {size} outputs, but for this plant {meanings}; give a network "
                f"with such a number of outputs{held}"
            )
        if len(fitting) > 1:
            raise BadInputError(
                f"a network with {size} outputs may be {' or '.join(fitting)}; select one, for "
                f'example by network="{fitting[0]}={part}"',
                ("--network", f"{fitting[0]}={part}"),
            )
        kinds[name] = fitting[0]
    if len(kinds) > 1 and sorted(kinds.values()) != ["V", "policy"]:
        raise BadInputError(
            f"the network's outputs {shortened(', '.join(sizes))} are "
            f"{', '.join(kinds.values())}; select one output, or V and a policy, for "
            "example --network V=value,policy=actor"
        )
    return kinds
