"""Critics that are neural networks, from files or CasADi functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from controller.critic.critic import Critic, from_functions, from_weights
from controller.critic.features import basis_of, symbols_for
from controller.critic.network.network_file import OUTPUTS, Asked, NetworkFile, network_in
from controller.critic.network.onnx_graph import check_width
from controller.game.basis import Basis
from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError, numbers_in, prefix_errors, shortened


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

    What the file of a policy states of its action (squash, clip, box) is a part of the policy.

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
        Asked(n, network, activation, basis_size=count, sizes=sizes, of_states=True),
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
    """Return the critic of a network whose inputs are the states."""
    n, m = game.B.shape
    functions = stored.functions

    # What each output is.
    sizes = {name: function.numel_out(0) for name, function in functions.items()}
    kinds = _kinds(sizes, n, m)
    if any(is_taken_as_policy(name, size, m) for name, size in sizes.items()):
        origin = f"{origin}, its one output read as the policy u, not V"

    z: Any = ca.MX.sym("z", n)
    outputs: dict[str, Any] = {}
    for name, function in functions.items():
        check_width(function.numel_in(0), n)
        output: Any = ca.vec(ca.vertcat(*function.call([ca.DM(scales) * z], True, False)))
        if kinds[name] == "V+policy":
            outputs |= {"V": output[0], "policy": output[1:]}
        else:
            outputs[kinds[name]] = output

    # Squash and box follow, if the file states them.
    declared = stored.declared
    if str(declared.action) and "policy" in outputs:
        outputs["policy"] = declared.action.of(outputs["policy"])
        origin = f"{origin}, {declared.action}"

    notes = declared.notes
    if declared.observations not in ((), game.names.states):
        notes += (f"observations {', '.join(declared.observations)}, taken as the states",)
    critic = from_functions(game, z, outputs, origin, stored.precision)
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
