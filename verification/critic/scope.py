"""What a critic is judged on beside its game."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from verification.critic.critic_errors import Box

if TYPE_CHECKING:
    from verification.critic.about_trim import NonlinearPlant
    from verification.critic.other_games import Nearby

#: From how many starts a network is flown.
FLIGHTS = 100


@dataclass(frozen=True)
class Scope:
    """What a critic is judged on beside its game.

    box: of the states over which V, its slopes and the policies are compared; by default
        `balanced_box`.
    nearby: other games, to recognize a critic that was learned on one of them.
    plant: the nonlinear plant about its trim, on which a network is flown too.
    flights: from how many starts a network is flown.
    """

    box: Box | None = None
    nearby: Nearby | None = None
    plant: NonlinearPlant | None = None
    flights: int = FLIGHTS
