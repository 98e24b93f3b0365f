"""Names and units of states and inputs, for results about one aircraft."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any


class StatesAndInputs:
    """Base class of results that have a `model`: names and units of its states and inputs."""

    if TYPE_CHECKING:

        @property
        def model(self) -> Any:
            """`Model` of the aircraft."""

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states, in order."""
        return tuple(self.model.states)

    @property
    def state_units(self) -> tuple[str, ...]:
        """Unit of each state."""
        return self.model.units(self.state_names)

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the inputs, in order."""
        return tuple(self.model.inputs)

    @property
    def input_units(self) -> tuple[str, ...]:
        """Unit of each input."""
        return self.model.units(self.input_names)
