"""Reading of critic files."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from controller.critic.critic import Critic, from_parts, from_q_function, polynomial_policy
from controller.critic.features import blocks_in_order
from controller.critic.network.declared import NOTHING, SUFFIXES
from controller.critic.reading import DIMENSIONS, CriticFile, Reading, in_plant_units
from controller.game.basis import Basis
from controller.game.linear_game import DISCRETE_KEYS, MODEL_KEYS, unused
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game
from hfa_aircraft.readers.matrices_file import (
    NAME_ALIASES,
    NAME_KEYS,
    FileScales,
    entries_found,
    file_scales,
    is_discrete,
    one_number,
    sample_time,
    words,
)
from hfa_aircraft.signals import PlantNames
from hfa_support.arrays.read import UNKNOWN, read_arrays
from hfa_support.entry_points import CRITICS, loaded, offered
from hfa_support.errors import BadInputError, file_faults, numbers_in, prefix_errors, shortened
from hfa_support.files import MATRIX_FILES, regular_file, unpacked
from hfa_support.matrices import checked_matrix, shape_text
from hfa_support.reporting.text import numbered

if TYPE_CHECKING:
    from trim.linear.linear_model import LinearModel


#: Suffixes of critic files that the project reads. Arrays may contain a network.
OWN_FILES = (*MATRIX_FILES, *SUFFIXES)
#: Alias of an entry -> its standard name.
_ALIASES = {"weights": "W", "gains": "K"}
_GAME_ENTRIES = (*MODEL_KEYS, "discount")
#: Those of the game on a plant.
_OF_THE_GAME = ("Q", "R", "N", "E", "delta", "discount")
#: Entries that are always used or compared.
_ALWAYS_READ = (
    *_ALIASES,
    *NAME_KEYS,
    *NAME_ALIASES,
    UNKNOWN,
    *_GAME_ENTRIES,
    *DISCRETE_KEYS,
    "Ts",
    "plant",
)
#: Largest difference of equal entries, relative to the entry (six printed digits), or to the
#: largest entry of its matrix (the rounding of an entry that should be 0).
_BY_PRINTING, _BY_ROUNDING = 1e-6, 1e-15


def critic_file(path: str | Path) -> CriticFile:
    """Return a critic file: of a network (`is_network`), of arrays, or of an installed package.

    - A file of arrays contains at least one of W (also `weights`), P and K (also `gains`).
    - An array without a name is W, P or K according to its shape.
    - K of one input may be a vector (n,).
    - `policy_weights` (m, M), weights of all monomials up to a degree, is the policy in place of K.
    - In discrete time, H of a Q-function replaces W, and gives the P, K and L that are missing. L
      is the gain of the worst disturbance.

    Arrays in other units than those of the plant are converted.

    Raises BadInputError, which names the file, if it cannot be read.
    """
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in critic_suffixes():
        raise BadInputError(
            f"{path}: the suffix {file.suffix!r} is unknown; use {', '.join(critic_suffixes())}"
        )
    if suffix not in OWN_FILES:
        with prefix_errors(path), file_faults(path):
            # The reader of an installed package, for this suffix.
            read: CriticFile = loaded(offered(CRITICS, OWN_FILES)[suffix])(path)
            return read
    if is_network(file):
        return CriticFile(partial(_critic_of_network, path), is_network=True)
    entries = entries_in(path)
    with prefix_errors(path):
        return CriticFile(partial(_critic_of, entries), game=partial(_game_in, entries, str(path)))


def critic_in(path: str | Path, game: Game, reading: Reading | None = None) -> Critic:
    """Return the critic in a file (`critic_file`).

    path: the critic file
    game: the game whose states and inputs the critic uses
    reading: options; None for the defaults

    Raises BadInputError, which names the file, if the file does not contain a critic of this game.
    """
    file = critic_file(path)
    with prefix_errors(path):
        return file.critic(game, reading or Reading())


def _critic_of_network(path: str | Path, game: Game, reading: Reading) -> Critic:
    """Return the critic of the network in a file."""
    from controller.critic.network.critic import from_network

    network, activation, scale = reading.network, reading.activation, reading.scale
    with prefix_errors(path):
        psi = reading.psi(game)
        return from_network(
            game, path, network=network, activation=activation, scale=scale, basis=psi
        )


def _critic_of(entries: dict[str, Any], game: Game, reading: Reading) -> Critic:
    """Return the critic in the entries of a file of arrays."""
    refuse_other_step(entries, game.dt)
    scales = file_scales(entries, game.names)
    notes = list(_other_signals(entries, game.names))
    others = _other_entries(entries, game)
    other_game = ""
    if others:
        verb = "is" if len(others) == 1 else "are"
        other_game = f"{' and '.join(others)} of the file {verb} not that of the game"
        notes.append(other_game)
    if game.is_discrete and "H" in entries:
        read = ["H", "H_signals", "P", "K", "L"]
        critic = _critic_of_q_function(entries, game, scales)
    else:
        read = ["W", "P", "K", "policy_weights"]
        read += ["basis"] if "W" in entries else []
        read += ["S"] if "K" in entries else []  # the P of MATLAB's lqr
        read += ["L"] if game.is_discrete else []
        critic = _critic_of_parts(entries, game, reading, scales)
    of_lqr = "S" in entries and "S" in read  # whose P is S
    found = ", ".join(name for name in read if name in entries and not (of_lqr and name == "P"))
    notes += unused(entries, (*_ALWAYS_READ, *read), f"read: {found}")
    if not notes:
        return critic
    return replace(critic, declared=NOTHING._replace(notes=tuple(notes), other_game=other_game))


def _critic_of_parts(
    entries: dict[str, Any], game: Game, reading: Reading, scales: FileScales
) -> Critic:
    """Return the critic of W, P and K in a file, with L in discrete time."""
    L = None
    if game.is_discrete and "L" in entries:
        L = in_plant_units({"L": numbers_in("L", entries["L"])}, scales)["L"]
    if UNKNOWN in entries:  # an array without a name
        entries = {part_by_shape(entries[UNKNOWN], game): entries[UNKNOWN]}
    # Without W, the basis is only checked if the user named one.
    has_basis = "W" in entries or reading.basis is not None
    psi = _basis_of_weights(entries, game, reading, scales) if has_basis else None
    parts = single_parts(entries, scales, psi)
    if "W" not in parts and isinstance(psi, ca.Function):
        raise BadInputError(
            "--basis lists functions, but the file contains no W; add W, or give --basis a name"
        )
    policy = None
    if "policy_weights" in entries:
        weights = checked_matrix("policy_weights", entries["policy_weights"], LARGEST_CRITIC_ENTRY)
        if len(weights) != (m := len(scales.inputs)):
            raise BadInputError(
                f"policy_weights has {len(weights)} rows; give one for each of the {m} inputs"
            )
        policy = polynomial_policy(weights / scales.inputs[:, None], scales.states)
    return replace(from_parts(game, parts, "quadratic" if psi is None else psi, policy), L=L)


def _basis_of_weights(
    entries: Mapping[str, Any], game: Game, reading: Reading, scales: FileScales
) -> Basis | ca.Function:
    """Return ψ of the weights in a file: of the user, else of the entry basis, else quadratic."""
    if reading.basis is None and "basis" in entries:
        named = words(entries, "basis")
        if len(named) != 1:
            raise BadInputError("the entry basis is not one name; give a name such as 'quadratic'")
        reading = replace(reading, basis=named[0])
    psi = reading.psi(game)
    if isinstance(psi, ca.Function):  # functions of the states in the file's units
        z = ca.SX.sym("z", len(game.A))
        psi = ca.Function("basis", [z], [psi(ca.DM(scales.states) * z)])
    return psi


def _critic_of_q_function(entries: Mapping[str, Any], game: Game, scales: FileScales) -> Critic:
    """Return the critic of the Q-function H in a file, with the P, K and L that it has."""
    stored = {name: numbers_in(name, entries[name]) for name in "HPKL" if name in entries}
    stored["H"] = _in_order_of(game, stored["H"], words(entries, "H_signals"))
    parts = in_plant_units(stored, scales)
    return from_q_function(game, parts.pop("H"), parts)


def _in_order_of(game: Game, H: np.ndarray, signals: tuple[str, ...]) -> np.ndarray:
    """Return H over (x, u) or (x, u, w) of a file that states the order of signals or blocks."""
    if not signals:
        return H
    disturbances = numbered("w", game.E.shape[1])
    blocks = {"x": game.names.states, "u": game.names.inputs, "w": disturbances}
    places = blocks_in_order(signals, blocks)  # in H, of the signals in the order of the plant
    if H.shape != (len(places),) * 2:
        raise BadInputError(
            f"H is {shape_text(H.shape)}, but H_signals lists {len(places)} signals; list each of "
            "them once"
        )
    return H[np.ix_(places, places)]


def _other_signals(entries: Mapping[str, Any], plant: PlantNames) -> Iterator[str]:
    """Yield notes on signals, units and plant of a file that differ from those of the game."""
    for key in ("states", "inputs"):
        of_file, of_plant = words(entries, key), getattr(plant, key)
        if of_file and ", ".join(of_file).lower() != ", ".join(of_plant).lower():
            texts = [shortened(", ".join(names), 200) for names in (of_file, of_plant)]
            yield f"{key} {texts[0]} of the file, taken as {texts[1]}"
    origin = ", ".join(words(entries, "plant"))
    if origin not in ("", plant.origin):
        yield f"of {origin}; the game is of {plant.origin}"
    for signal in ("state", "input"):
        names, units = getattr(plant, f"{signal}s"), getattr(plant, f"{signal}_units")
        of_file = words(entries, f"{signal}_units")
        converted = [
            f"{name} from {unit_of_file} to {unit}"
            for name, unit_of_file, unit in zip(names, of_file, units, strict=False)
            if unit_of_file and unit and unit_of_file != unit
        ]
        if converted:
            yield f"converted {', '.join(converted)}"


def _game_in(entries: Mapping[str, Any], path: str, names: PlantNames) -> dict[str, Any]:
    """Return the entries Q, R, N, E, delta, dt and discount of a critic's file in plant units.

    The result is empty if the file is of more states, as those of servos.
    """
    if len(words(entries, "states")) not in (0, len(names.states)):
        return {}
    with prefix_errors(path):
        game = _in_units(entries, file_scales(entries, names))
        step = sample_time(entries)
    weights = {name: game[name] for name in _OF_THE_GAME if name in game}
    return weights | {"dt": step} if step else weights


def _in_units(entries: Mapping[str, Any], scales: FileScales) -> dict[str, Any]:
    """Return the entries of a file that a game has, too, in the units of the plant."""
    s, r = scales  # factors of states and inputs from the plant's units to the file's
    factors = {"A": s / s[:, None], "B": r / s[:, None], "E": 1.0 / s[:, None]}
    factors |= {"Q": np.outer(s, s), "R": np.outer(r, r), "N": np.outer(s, r)}
    converted: dict[str, Any] = {}
    for name in (name for name in _GAME_ENTRIES if name in entries):
        entry = entries[name]
        if name not in factors:  # JSON has null for an infinite delta
            converted[name] = math.inf if entry is None else one_number(name, entry)
            continue
        stored = numbers_in(name, entry)
        if name in "QR" and stored.ndim == 1:
            stored = np.diag(stored)
        factor = factors[name]
        if name != "E" and stored.size == factor.size:
            stored = stored.reshape(factor.shape)
        is_column = name == "E" and stored.ndim == 2 and len(stored) == len(s)
        converted[name] = stored * factor if is_column or stored.shape == factor.shape else stored
    return converted


def _other_entries(entries: Mapping[str, Any], game: Game) -> list[str]:
    """Return the matrices, delta and discount of a file that are not the game's."""
    others = []
    for name, stored in _in_units(entries, file_scales(entries, game.names)).items():
        own = np.asarray(getattr(game, name))
        size = np.abs(own).max(initial=0.0) if own.ndim else 0.0
        if np.shape(stored) != own.shape or not np.allclose(
            stored, own, rtol=_BY_PRINTING, atol=_BY_ROUNDING * size
        ):
            others.append(f"{name} {stored:g}" if not own.ndim else name)
    return others


def gain_in(entries: Mapping[str, Any], plant: PlantNames) -> np.ndarray:
    """Return the gain K (m, n) in the entries of a critic file, in the units of the plant.

    Raises BadInputError as `single_parts` does.
    """
    # Without other matrices, which are not used, and need not fit the plant.
    of_gain = {name: entry for name, entry in entries.items() if name not in ("W", "P")}
    return single_parts(of_gain, file_scales(entries, plant), None)["K"]


#: Schemas of files with P and K of a game, beside H in discrete time.
_SCHEMAS_OF_GAMES = ("hfa.learning-result/1", "hfa.game-solution/1")


def refuse_other_step(entries: Mapping[str, Any], dt: float | bool | None) -> None:
    """Raise BadInputError if a critic's file is of another sample time than the game, or of the
    other kind of time.

    H is of discrete time. A file of `hfa learn` and `hfa solve` without H is of continuous time.
    Any other file that states no time, such as one of a gain, is of either.

    dt: sample time of the game, s, True if it is not known, None in continuous time
    """
    # Like dt, with False in place of None.
    stored = sample_time(entries) or is_discrete(entries) or "H" in entries
    states_time = stored or "time" in entries or str(entries.get("schema")) in _SCHEMAS_OF_GAMES
    is_same_kind = bool(stored) == (dt is not None)
    is_other_step = (  # only if both are known
        isinstance(stored, float)
        and isinstance(dt, float)
        and not math.isclose(stored, dt, rel_tol=1e-6)
    )
    if not states_time or (is_same_kind and not is_other_step):
        return
    raise BadInputError(
        f"the file has a policy in {_time_text(stored)}, but the game is in {_time_text(dt)}; give "
        "a policy of this game, --dt and --discount to hfa verify, or a sampled gain to hfa assess "
        "FILE --sample-time S"
    )


def _time_text(dt: float | bool | None) -> str:
    """Return the kind of time of a sample time as text."""
    if not dt:
        return "continuous time"
    return "discrete time" if dt is True else f"steps of {dt:g} s"


def read_critic(
    path: str | Path,
    game: Game | None = None,
    *,
    basis: str | list[str] | None = None,
    network: str = "",
    activation: str | None = None,
    scale: Any = None,
    linear: LinearModel | None = None,
) -> Critic:
    """Return the critic in a file of matrices, weights or a network.

    path: the file (.npz, .mat, .json, .csv, or a suffix that an installed package reads)
    game: the game with the states and inputs of the critic. None is allowed only for a file with a
        gain K and without units.
    basis: basis of the weights: a name, or functions "x1**2, x1*x2", also as a list; by default the
        basis named in the file, else "quadratic"
    network: outputs of a network file and their kinds, as for `from_network`
    activation: activation between the layers of a state dict; after a comma, the activation of the
        output. None for any other file.
    scale: (n,), factors on the states at the network's inputs, or None for no scaling
    linear: linear model of the game at a trim of an aircraft; required for a deployment file

    Raises BadInputError, which names the file, if the file does not contain a critic of this game,
    or if the game is missing.

    >>> import hfa
    >>> critic = hfa.read_critic("policy.pt", game, activation="tanh")  # doctest: +SKIP
    """
    if game is None:
        entries = {} if is_network(Path(path)) else entries_in(path)
        if "K" not in entries or not {"state_units", "input_units"}.isdisjoint(entries):
            raise BadInputError(
                f"{path} cannot be read without a game; give the game as the second argument"
            )
        with prefix_errors(path):
            return Critic(gain_in(entries, PlantNames()))
    return critic_in(path, game, Reading(basis, network, activation, scale, linear))


def critic_suffixes() -> tuple[str, ...]:
    """Return all suffixes of critic files, including those that installed packages read."""
    return (*OWN_FILES, *offered(CRITICS, OWN_FILES))


def is_network(path: Path) -> bool:
    """Return whether a file contains a network.

    - .npz and .json: True if the name of an array is "weight" or ends with ".weight"
    - other files of matrices, also damaged ones: False
    - any other suffix: True if it is the suffix of a critic file
    """
    suffix = path.suffix.lower()
    if suffix not in MATRIX_FILES:
        return suffix in critic_suffixes()
    arrays: list[str] = []
    try:
        if suffix == ".npz":
            members = unpacked(regular_file(path).read_bytes())
            arrays = [name.removesuffix(".npy") for name in members]
        elif suffix == ".json":
            arrays = [str(name) for name in read_arrays(path)]
    except Exception:  # any damage; reading the arrays reports it
        return False
    return any(re.search(r"(^|\.)weight$", name) for name in arrays)


def entries_in(path: str | Path) -> dict[str, Any]:
    """Return name -> value for the entries of a critic file.

    An entry with an alias as its name, such as `weights`, is returned under both names. Beside K, S
    is the P of MATLAB's [K, S, e] = lqr(...), also if P are the poles.

    Raises BadInputError for an entry `dt` that is no sample time.
    """
    stored = read_arrays(path)
    with prefix_errors(path):
        sample_time(stored)  # refuses a wrong entry
    if {"K", "S"} <= stored.keys():
        n = len(np.atleast_2d(stored["S"]))
        # A P with one state, 1 x 1, is taken as the pole.
        is_absent_or_poles = np.size(stored.get("P", ())) <= n
        if is_absent_or_poles:
            stored["P"] = stored["S"]
    return {name: stored[alias] for alias, name in _ALIASES.items() if alias in stored} | stored


def part_by_shape(
    array: np.ndarray, game: Game, otherwise: str = "name the file P.npy or K.npy"
) -> str:
    """Return which of "W", "P" and "K" an unnamed array is, according to its shape.

    otherwise: what to do instead, if it may be P or K
    """
    n, m = game.B.shape
    shapes = {"P": (n, n), "K": (m, n)}
    fitting = [name for name, shape in shapes.items() if array.shape == shape]
    # A vector of n numbers is K, unless a quadratic basis has n weights: for n = 1.
    if m == 1 and array.shape == (n,) != (n * (n + 1) // 2,):
        fitting = ["K"]
    if not fitting and max(array.shape, default=1) == math.prod(array.shape):
        fitting = ["W"]
    if len(fitting) != 1:
        meaning = (
            f"may be P or K; {otherwise}"
            if fitting
            else f"does not fit W, P or K; give W as a row, P {shapes['P']} or K {shapes['K']}"
        )
        raise BadInputError(f"the array of shape {array.shape} {meaning}")
    return fitting[0]


def single_parts(
    entries: Mapping[str, Any], scales: FileScales, basis: Basis | ca.Function | None
) -> dict[str, np.ndarray]:
    """Return the arrays W (M,), P (n, n) and K (m, n) of a critic file, in the units of the plant.

    Arrays that the file does not contain are omitted.

    entries: entries of the file
    scales: factors from the plant's units to the file's units
    basis: ψ of W; None for a file without W

    Raises BadInputError
    - if the file has none of these entries,
    - if an array has a wrong shape or a number out of range.
    """
    parts = {name: numbers_in(name, entries[name]) for name in DIMENSIONS if name in entries}
    if not parts:
        raise BadInputError(
            f"the file contains no W, P or K; add one of these matrices{entries_found(entries)}"
        )
    if "K" in parts and parts["K"].ndim == 3:
        raise BadInputError(
            "K is a table of gains; give one K of m x n, or judge the table by `hfa assess FILE "
            "--sample-time S`"
        )
    for name, values in parts.items():
        is_row = max(values.shape, default=1) == values.size
        if values.ndim == DIMENSIONS[name] + 1 and not is_row:
            raise BadInputError(
                f"{name} has shape {values.shape}, one for each time; give one of them, such as "
                "the last row"
            )
        if not values.size or (name == "W" and not is_row):
            raise BadInputError(
                f"{name} has shape {values.shape}; give W as a row or column, P and K as matrices"
            )
        shaped = values.reshape(-1) if name == "W" else values
        # One input. `scales` has none if they are not known.
        if name == "K" and values.ndim == 1 and len(scales.inputs) <= 1:
            shaped = values[None]
        parts[name] = checked_matrix(name, shaped, LARGEST_CRITIC_ENTRY, DIMENSIONS[name])
    return in_plant_units(parts, scales, basis)
