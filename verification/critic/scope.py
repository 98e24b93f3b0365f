"""Data for the checks of a critic besides the game: box of states, other games, nonlinear plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from controller.game.zero_sum import Game
from hfa_support.arguments import checks_arguments
from hfa_support.progress import Progress
from verification.critic.critic_errors import Box

if TYPE_CHECKING:
    from verification.critic.about_trim import NonlinearPlant

#: Default limit of the errors of P, K, V, its gradient and the policies, and of the residual.
LIMIT = 1e-6
#: Number of initial conditions from which a critic that is not quadratic is simulated.
FLIGHTS = 100
#: Time for a proof of a network's largest error, s.
SECONDS = 20.0


class Scheduled(NamedTuple):
    """Games at different values of a model's scheduling variable.

    says: value -> text, "at dihedral 12.0000 deg"
    game_at: value -> game at this value
    starts: initial values of a search; empty if the model does not depend on the variable
    """

    says: Callable[[float], str]
    game_at: Callable[[float], Game]
    starts: tuple[float, ...]


class Nearby(NamedTuple):
    """Other games, on one of which a critic may have been learned by mistake.

    named: difference from the given game, such as "of the matrices printed for 5 deg" -> game
    scheduled: games at different values of the scheduling variable, or None
    """

    named: Mapping[str, Game] = {}
    scheduled: Scheduled | None = None


@checks_arguments
@dataclass(frozen=True)
class Scope:
    """Data for the checks of a critic besides the game.

    box: box of states in which V, its gradient and the policies are compared; by default the
        `usual_box` of the game
    nearby: function that returns other games, to recognize a critic that was learned on one of
        them; None for no comparison
    plant: nonlinear plant about its trim, in which a critic that is not quadratic is also
        simulated, or None
    flights: number of initial conditions from which such a critic is simulated
    seconds: time for a proof of the largest error of a network, or 0 for no proof
    progress: called during the proof with (elapsed seconds, allowed seconds), or None
    """

    box: Box | None = None
    nearby: Callable[[], Nearby] | None = None
    plant: NonlinearPlant | None = None
    flights: int = FLIGHTS
    seconds: float = SECONDS
    progress: Progress | None = None
