"""Reader of a user's file with the critic of a discrete-time plant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from controller.critic.critic import Critic, from_parts
from controller.critic.critic_file import critic_in, entries_in, is_network
from controller.critic.reading import Reading
from controller.game.discrete_game import DiscreteGame
from hfa_support.errors import prefix_errors


def critic_of_steps(
    path: str | Path, problem: DiscreteGame, reading: Reading | None = None
) -> tuple[Critic, dict[str, Any]]:
    """Return the critic in a file for a discrete-time plant, and name -> matrix of L and H.

    L or H is omitted if the file does not determine it. If the file contains H, missing P, K and L
    are computed from H. An H over (x, u) gives no L.

    reading: settings for reading the file, or None

    Raises BadInputError if the file or an entry is invalid.
    """
    entries = {} if is_network(Path(path)) else entries_in(path)
    if "H" not in entries:
        more = {"L": entries["L"]} if "L" in entries else {}
        return critic_in(path, problem.step, reading), more
    with prefix_errors(path):
        parts = problem.of_q_function(entries["H"])
        parts |= {name: entries[name] for name in ("P", "K", "L") if name in entries}
        critic = from_parts(problem.step, {name: parts[name] for name in ("P", "K")})
    more = {name: parts[name] for name in ("L",) if name in parts}
    return critic, more | {"H": entries["H"]}
