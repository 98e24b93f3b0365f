"""What the searches of a region and of a bound of the cost share: their end, and its reason."""

from __future__ import annotations

from abc import ABC, abstractmethod

from hfa_prove.check.equilibrium import Equilibrium
from hfa_prove.search.clock import Clock, OutOfTimeError
from hfa_prove.search.kinks import kink_at
from hfa_prove.statements.plant import Plant
from hfa_support.errors import NoSolutionError


class TimedSearch(ABC):
    """Search that keeps what it has proved if its time is over or the user interrupts it.

    plant: aircraft or loop of the statement
    equilibrium: enclosure of its equilibrium
    clock: limit of the processor time, and progress
    """

    def __init__(self, plant: Plant, equilibrium: Equilibrium, clock: Clock) -> None:
        self.plant = plant
        self.equilibrium = equilibrium
        self._clock = clock
        #: Why nothing more is proved, or "".
        self._stopped = ""

    @abstractmethod
    def _search(self) -> None:
        """Prove one statement after the other, and set `_stopped`.

        Raises OutOfTimeError at the time limit.
        """

    def _run(self) -> None:
        """Search until the end, the time limit or an interruption."""
        try:
            self._search()
        except OutOfTimeError as error:
            self._stopped = self._stopped or str(error)
        except KeyboardInterrupt:
            self._stopped = "interrupted"

    def _nothing_proved(self, words: str = "") -> NoSolutionError:
        """Return the error of a search that has proved nothing, with its reason.

        words: beginning of the message
        """
        kink = kink_at(self.plant, self.equilibrium)
        return NoSolutionError(words + (f"{self._stopped}; {kink}" if kink else self._stopped))
