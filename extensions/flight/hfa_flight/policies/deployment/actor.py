"""Policy of a deployment: what the policy's file says, completed by the table [policy]."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic_file import entries_in, is_network
from controller.critic.network.checkpoints import read_normalizer
from controller.critic.network.declared import (
    NOTHING,
    SUFFIXES,
    ActionBox,
    Declared,
    Normalizer,
    notes_on_statistics,
)
from controller.critic.network.network_file import Asked, NetworkFile, network_in
from controller.critic.network.operations import RowNetwork, row_function
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY
from hfa_aircraft.readers.matrices_file import NAME_KEYS, sample_time, words
from hfa_support.errors import BadInputError, numbers_in, prefix_errors, shown
from hfa_support.files import MATRIX_FILES
from hfa_support.matrices import checked_matrix


@dataclass(frozen=True, eq=False)
class Actor:
    """Policy of a deployment, a function of its observations.

    function: normalized observations (k,) -> output of the network (m,)
    chain: description of the layers, and of squash and box in the file
    declared: what the file states, with box and normalizer of the file or the deployment, and
        with notes on contradictions between the two
    rows: version of `function` for many rows, or None
    of_gain: what the file of a gain K says about it: names and units of states and inputs, and dt
    notes: sentences on contradictions between the files and the deployment
    """

    function: ca.Function
    chain: str
    declared: Declared = NOTHING
    rows: RowNetwork | None = None
    of_gain: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


class Wanted(NamedTuple):
    """What a deployment lists: the table [policy], and the sizes and boxes of its policy.

    policy: the table. Its entries activation, network and squash are needed only if the policy's
        file does not state them
    folder: folder to which file names are relative
    observations: number of observations
    boxes: action -> its box [lowest, highest], or None
    """

    policy: Mapping[str, Any]
    folder: Path
    observations: int
    boxes: Mapping[str, Any]


def read_actor(wanted: Wanted) -> Actor:
    """Read the policy that the table [policy] of a deployment file names.

    Raises BadInputError if a file is missing, cannot be read or contradicts the deployment file.
    """
    source = wanted.policy.get("file")
    of_gain: dict[str, Any] = {}
    if isinstance(source, ca.Function):
        origin: Any = "the function"
        stored = network_in(source, Asked(wanted.observations))
    elif isinstance(source, (str, Path)):
        origin = wanted.folder / source
        stored, of_gain = _read(origin, wanted)
    else:
        raise BadInputError(
            f"policy.file is {shown(source)}; give the path of the file that contains the policy"
        )
    (function,) = stored.functions.values()  # only the policy was asked for
    _refuse_sizes(function, origin, wanted)
    declared = stored.declared
    with prefix_errors(origin):
        action = _action(declared.action, wanted)
    normalizer, notes = _normalizer(declared, wanted)
    return Actor(
        function,
        chain="; ".join(filter(None, [stored.chain, str(declared.action)])),
        declared=declared._replace(
            action=action, normalizer=normalizer, notes=(*notes, *declared.notes)
        ),
        rows=row_function(function),
        of_gain=of_gain,
        notes=notes,
    )


def _read(path: Path, wanted: Wanted) -> tuple[NetworkFile, dict[str, Any]]:
    """Return the network in a file, and what the file says about a gain, nothing for a network."""
    known = (*SUFFIXES, *MATRIX_FILES)
    if path.suffix.lower() not in known:
        raise BadInputError(
            f"policy.file is {path}; give a file with the suffix {', '.join(known)}"
        )
    if path.suffix.lower() in MATRIX_FILES and not is_network(path):
        return _gain(path)
    network = f"policy={wanted.policy.get('network', '')}"  # only the policy of the file
    activation, sizes = wanted.policy.get("activation"), (len(wanted.boxes),)
    return network_in(path, Asked(wanted.observations, network, activation, sizes=sizes)), {}


def _gain(path: Path) -> tuple[NetworkFile, dict[str, Any]]:
    """Return the policy u = -K o of a file with a gain K, and what the file says about it."""
    entries = entries_in(path)
    with prefix_errors(path):
        if "K" not in entries:
            raise BadInputError("the file contains neither a network nor a gain K; add K")
        K = numbers_in("K", entries["K"])
        K = checked_matrix("K", K[None] if K.ndim == 1 else K, LARGEST_CRITIC_ENTRY)
        of_gain: dict[str, Any] = {key: words(entries, key) for key in NAME_KEYS}
        of_gain["dt"] = sample_time(entries)
    rows, columns = K.shape
    return NetworkFile({"policy": gain_function(K)}, f"a gain {rows} x {columns}"), of_gain


def gain_function(K: np.ndarray) -> ca.Function:
    """Return the CasADi Function from the observations o (k,) to the actions -K o (m,).

    K: (m, k)
    """
    o = ca.SX.sym("o", K.shape[1])
    return ca.Function("gain", [o], [ca.densify(-ca.DM(K) @ o)])


def box_of(boxes: Mapping[str, Any]) -> ActionBox:
    """Return the boxes of a deployment file, infinite for an action without a box.

    boxes: action -> [lowest, highest], or None
    """
    low = np.full(len(boxes), -np.inf)
    high = np.full(len(boxes), np.inf)
    for place, box in enumerate(boxes.values()):
        if box is not None:
            low[place], high[place] = box
    return ActionBox(low=low, high=high)


def _action(declared: ActionBox, wanted: Wanted) -> ActionBox:
    """Return squash and box from the network's output to the action.

    They are those of the policy's file, or else those that the deployment lists.

    Raises BadInputError if the two differ, or if a squashed action has no finite box.
    """
    listed = box_of(wanted.boxes)
    squash = wanted.policy.get("squash")
    low, high = declared.low, declared.high
    is_declared = bool(declared.squash) or low is not None
    if is_declared and squash is not None and squash != bool(declared.squash):
        raise BadInputError(
            f"policy.squash is {shown(squash)}, but the file has {declared}; remove policy.squash"
        )
    if low is None or high is None:
        action = listed._replace(squash=declared.squash or ("tanh" if squash else ""))
    else:
        action = declared
        for place, (name, box) in enumerate(wanted.boxes.items()):
            stored = [float(low[place]), float(high[place])]
            # Boxes in files are rounded to single precision.
            if box is not None and not np.allclose(box, stored, rtol=1e-6, atol=1e-9):
                raise BadInputError(
                    f"action.{name}.box is {shown(box)}, but the policy contains the box {stored}; "
                    f"remove action.{name}.box"
                )
    if action.squash and not np.isfinite(np.array([action.low, action.high], dtype=float)).all():
        raise BadInputError(
            "a policy with squashed actions requires a box for each action; give box = [lowest, "
            "highest]"
        )
    return action


def _normalizer(declared: Declared, wanted: Wanted) -> tuple[Normalizer | None, tuple[str, ...]]:
    """Return the normalizer of the deployment, and notes on contradictions.

    Raises BadInputError if its size is not that of the observations.
    """
    entry = wanted.policy.get("normalizer")
    if entry is None:
        missing = "the policy was trained behind a VecNormalize; give its file as policy.normalizer"
        return None, (missing,) if declared.is_normalized else ()
    count = 0  # observations from which the normalizer was made, 0 if unknown
    normalizer: Normalizer | None
    if isinstance(entry, Mapping):
        normalizer = Normalizer(**entry)
    else:
        normalizer, count = read_normalizer(wanted.folder / entry)
    if normalizer is not None and normalizer.mean.size != wanted.observations:
        raise BadInputError(
            f"{normalizer.origin} normalizes {normalizer.mean.size} observations, but the "
            f"deployment file lists {wanted.observations}; give the normalizer of this policy"
        )
    notes: tuple[str, ...] = ()
    if normalizer is not None:
        notes = notes_on_statistics(normalizer.mean, normalizer.variance)
    least, most = declared.seen  # by the training of the policy
    if notes or count == 0 or least <= count <= most:
        return normalizer, notes
    reason = "it was not saved with this policy"
    if count > most:
        reason += ", unless learn() was called several times"
    return normalizer, (
        f"policy.normalizer saw {count} observations, but the policy was trained with {least}: "
        f"{reason}",
    )


def _refuse_sizes(function: ca.Function, origin: Any, wanted: Wanted) -> None:
    """Raise BadInputError unless a function has as many inputs and outputs as the deployment."""
    takes, gives = function.numel_in(0), function.numel_out(0)
    if takes != wanted.observations:
        raise BadInputError(
            f"{origin} requires {takes} observations, but the deployment file lists "
            f"{wanted.observations}; list all training observations, in the order used in training"
        )
    if gives != len(wanted.boxes):
        raise BadInputError(
            f"{origin} returns {gives} actions, but the deployment file lists {len(wanted.boxes)}; "
            "list all training actions, in the order used in training"
        )
