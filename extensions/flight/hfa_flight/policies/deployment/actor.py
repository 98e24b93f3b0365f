"""Actor of a policy file: its network and the settings stored in the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from controller.critic.network.network_file import network_in
from controller.critic.network.row_network import RowNetwork
from hfa_aircraft.readers.matrices_file import sample_time
from hfa_flight.policies.deployment.stable_baselines import is_stable_baselines, read_zip
from hfa_support.arrays.read import read_arrays
from hfa_support.errors import BadInputError, numbers_in, prefix_errors, shown

#: Entries by which the file of a gain K describes its columns, its rows and its sample time.
_OF_GAIN = ("states", "inputs", "state_units", "input_units", "dt")
SUFFIXES = (".zip", ".onnx", ".pt", ".pth", ".pkl", ".safetensors", ".json", ".npz")


@dataclass(frozen=True, eq=False)
class Actor:
    """Network of a policy, a function of normalized observations.

    function: observations (k,) -> actions (m,).
    chain: description of the layers.
    squash: True if the output passes through tanh and is mapped to the box, False if the output is
        clipped to the box.
    clip_mean: largest absolute value before tanh.
    box: lowest and highest action stored in the file, (m,) each, or None.
    rows: version of `function` for many rows, or None.
    of_gain: what the file of a gain K says about it: states, inputs, their units, and dt.
    """

    function: ca.Function
    chain: str
    squash: bool = False
    clip_mean: float = float("inf")
    box: tuple[np.ndarray, np.ndarray] | None = None
    rows: RowNetwork | None = None
    of_gain: Mapping[str, Any] = field(default_factory=dict)


def read_actor(
    entries: Mapping[str, Any], folder: Path, observations: int, history: int, actions: int
) -> Actor:
    """Read the network of a policy that the table [policy] of a deployment file names.

    entries: table [policy]. Its entries "activation", "layout", "squash" and "network" are needed
        only if the policy's file does not store them
    folder: folder to which file names are relative
    observations, actions: number of observations and of actions in the deployment file
    history: number of samples of the observations

    Raises BadInputError if the file is missing, cannot be read or contradicts the deployment file.
    """
    width = history * observations
    source = entries.get("file")
    if source is None:
        raise BadInputError(
            "policy.file is missing; give the path of the file that contains the policy"
        )
    if isinstance(source, ca.Function):
        actor = Actor(source, f"function {source.name()}", bool(entries.get("squash", False)))
        _refuse_sizes(actor.function, "the function", width, actions)
        return actor
    if not isinstance(source, (str, Path)):
        raise BadInputError(
            f"policy.file is {shown(source)}; give the path of the file that contains the policy"
        )
    path = folder / source
    if path.suffix.lower() not in SUFFIXES:
        raise BadInputError(
            f"policy.file is {path}; give a file with the suffix {', '.join(SUFFIXES)}"
        )
    if path.suffix.lower() == ".zip" and is_stable_baselines(path):
        actor = _of_zip(path, entries, observations, history)
    else:
        actor = _of_other_file(path, entries, width)
    _refuse_sizes(actor.function, path, width, actions)
    return actor


def _of_zip(path: Path, entries: Mapping[str, Any], observations: int, history: int) -> Actor:
    """Read the actor in a Stable-Baselines3 zip."""
    stored = read_zip(path)
    of_file = {
        "activation": stored.activation,
        "layout": list(stored.layout),
        "squash": stored.squash,
    }
    for name, value in of_file.items():
        if name in entries and entries[name] != value:
            raise BadInputError(
                f"policy.{name} is {shown(entries[name])}, but {path} contains "
                f"{shown(value)}; remove policy.{name}"
            )
    frames, rest = divmod(stored.observations, observations)
    if rest == 0 and frames != history:
        raise BadInputError(
            f"{path} requires {stored.observations} observations, {frames} times as many as the "
            f"deployment file lists; list all observations, or give history = {frames} in "
            f"[timing] for a policy of {frames} stacked samples"
        )
    if rest:
        raise BadInputError(
            f"{path} requires {stored.observations} observations, but the deployment file lists "
            f"{observations}; list all training observations, in the order used in training"
        )
    network = network_in(path, stored.observations, stored.activation, {"policy": stored.part})
    return Actor(
        function=network.functions["policy"],
        chain=f"{stored.algorithm}, {network.chain}",
        squash=stored.squash,
        clip_mean=stored.clip_mean,
        box=(stored.low, stored.high),
        rows=network.rows.get("policy"),
    )


def _of_other_file(path: Path, entries: Mapping[str, Any], observations: int) -> Actor:
    """Read the actor in an ONNX file, a state dict or a file with a gain K."""
    squash = bool(entries.get("squash", False))
    stored = stored_gain(path)
    if stored is not None:
        of_file = {name: stored[name] for name in _OF_GAIN if name in stored}
        of_file["dt"] = sample_time(stored)
        rows, columns = stored["K"].shape
        chain = f"a gain {rows} x {columns}"
        return Actor(gain_function(stored["K"]), chain, squash, of_gain=of_file)
    if path.suffix.lower() == ".onnx" and "activation" in entries:
        raise BadInputError(
            f"policy.activation is given, but {path} contains the activations; remove "
            "policy.activation"
        )
    parts = {"policy": str(entries.get("network", ""))}
    network = network_in(path, observations, entries.get("activation"), parts)
    if not network.functions:
        raise BadInputError(
            f"{path} contains no policy with {observations} observations; list the observations of "
            "the training"
        )
    name, function = next(iter(network.functions.items()))
    return Actor(function, network.chain, squash, rows=network.rows.get(name))


def stored_gain(path: Path) -> dict[str, Any] | None:
    """Return the entries of an .npz file with the gain K of u = -K o, (actions, observations).

    The result is None for another suffix, and for a file without K. Raises BadInputError if the
    file cannot be read or K is not a finite matrix.
    """
    entries = read_arrays(path) if path.suffix.lower() == ".npz" else {}
    if "K" not in entries:
        return None
    with prefix_errors(path):
        gain = numbers_in("K", entries["K"])
        if gain.ndim != 2 or not np.all(np.isfinite(gain)):
            raise BadInputError(
                f"K (shape {gain.shape}) is not a matrix of finite numbers; give finite "
                "numbers, one row per action and one column per observation"
            )
    return {**entries, "K": gain}


def gain_function(K: np.ndarray) -> ca.Function:
    """Return the CasADi Function from the observations o (k,) to the actions -K o (m,).

    K: (m, k)
    """
    o = ca.SX.sym("o", K.shape[1])
    return ca.Function("gain", [o], [ca.densify(-ca.DM(K) @ o)])


def _refuse_sizes(function: ca.Function, what: Any, observations: int, actions: int) -> None:
    """Raise BadInputError unless a function has as many inputs and outputs as the deployment."""
    takes = function.numel_in(0)
    gives = function.numel_out(0)
    if takes != observations:
        raise BadInputError(
            f"{what} requires {takes} observations, but the deployment file lists "
            f"{observations}; list all training observations, in the order used in training"
        )
    if gives != actions:
        raise BadInputError(
            f"{what} returns {gives} actions, but the deployment file lists {actions}; list all "
            "training actions, in the order used in training"
        )
