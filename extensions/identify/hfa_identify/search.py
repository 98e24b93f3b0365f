"""Search for the parameters of a model in flight records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from hfa_aircraft.model import Model
from hfa_identify.fit import Fit, OutputError
from hfa_identify.records import Record
from hfa_identify.response import Responses


class Search:
    """Search for the unknowns with which simulations fit records.

    held: initial value of an unmeasured state, by name.
    """

    def __init__(
        self, responses: Responses, records: Sequence[Record], held: Mapping[str, float]
    ) -> None:
        self.responses = responses
        self.records = tuple(records)
        signals = responses.signals.values()
        self.bounds = np.array([(each.min, each.max) for each in signals])
        self.begin = np.array([each.start for each in signals])
        self.guesses = [begin_of(responses.model, record, held) for record in self.records]

    def fit(self, progress: Callable[[float, float], None] | None = None) -> Fit:
        """Return the fit of the records. Raises FloatingPointError as `OutputError.fit` does."""
        output_error = OutputError(self.responses, self.records, self.bounds, self.guesses)
        return output_error.fit(self.begin, self.guesses, progress)

    def moving_inputs(self) -> list[str]:
        """Return the inputs that vary in at least one record."""
        return [
            name
            for place, name in enumerate(self.responses.model.inputs)
            if any(np.ptp(record.inputs[:, place]) > 0.0 for record in self.records)
        ]


def begin_of(model: Model, record: Record, held: Mapping[str, float]) -> np.ndarray:
    """Return the guess of a record's initial state, (n,).

    Each component is the first finite measured value, the value in `held`, the value in the
    model's trim, or the declared start of the state, in this order of precedence.
    """
    start = []
    for name, signal in model.states.items():
        values = record.measured.get(name)
        seen = values[np.isfinite(values)] if values is not None else np.empty(0)
        if len(seen):
            start.append(float(seen[0]))
        else:
            start.append(float(held.get(name, model.trim.get(name, signal.start))))
    return np.array(start)
