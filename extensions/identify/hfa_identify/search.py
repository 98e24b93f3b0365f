"""Search for the parameters, first on short windows of the records, then on complete records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from hfa_aircraft.model import Model
from hfa_identify.bands import unexplained
from hfa_identify.fit import MOST_STEPS, Fit, OutputError
from hfa_identify.records import FEWEST, Record
from hfa_identify.response import Responses

#: Duration of the windows, s.
_WINDOW = 1.0
#: The search in windows or thinned records converges if a step is smaller, in standard deviations.
_ROUGH = 0.5
#: Steps after which a second fit must be likelier than the first.
_SECOND = 10


class Search:
    """Search for the unknowns with which simulations fit records.

    held: initial value of an unmeasured state, by name.
    """

    def __init__(
        self, responses: Responses, records: Sequence[Record], held: Mapping[str, float]
    ) -> None:
        self.responses = responses
        self.records = tuple(records)
        self.held = held
        signals = responses.signals.values()
        self.bounds = np.array([(each.min, each.max) for each in signals])
        self.begin = np.array([each.start for each in signals])
        self.guesses = [begin_of(responses.model, record, held) for record in self.records]
        self._whole = OutputError(responses, self.records, self.bounds, self.guesses)

    def fit(self, progress: Callable[[float, float], None] | None = None) -> Fit:
        """Return the fit of the complete records.

        The search begins with a fit of short windows, whose simulations diverge less easily. If the
        fit of the complete records diverges, does not converge or contradicts the measured motion,
        the windows are fitted again with the variance of the motion as noise variance. The more
        likely fit is returned.

        Raises FloatingPointError if all simulations diverge.
        """
        found = None
        for by_motion in (False, True):
            try:
                rough = self.rough(progress, by_motion=by_motion)
                most = MOST_STEPS if found is None else _SECOND
                fit = self.whole(rough.theta, progress=progress, most_steps=most)
                if found is not None and fit.likelihood < found.likelihood and not fit.converged:
                    fit = self.whole(fit.theta, fit.starts, progress)
            except FloatingPointError:
                continue
            if found is None or fit.likelihood < found.likelihood:
                found = fit
            if found.converged and not unexplained(found).any():
                break
        return found or self.whole(self.begin, progress=progress)

    def rough(
        self,
        progress: Callable[[float, float], None] | None = None,
        by_motion: bool = False,
    ) -> Fit:
        """Return the fit of short windows, with samples as sparse as permissible.

        The integration step limits the time between samples.

        by_motion: whether the variance of the motion replaces the noise variance
        """
        windows = [part for record in self.thinned for part in record.windows(_WINDOW)]
        starts = [begin_of(self.responses.model, window, self.held) for window in windows]
        search = OutputError(self.responses, windows, self.bounds, starts, by_motion, is_rough=True)
        return search.fit(self.begin, starts, progress, _ROUGH)

    def moving_inputs(self) -> list[str]:
        """Return the inputs that vary in at least one record."""
        return [
            name
            for place, name in enumerate(self.responses.model.inputs)
            if any(np.ptp(record.inputs[:, place]) > 0.0 for record in self.records)
        ]

    @cached_property
    def thinned(self) -> list[Record]:
        """The records, reduced to about one sample for each integration step."""
        thinned = []
        for record, start in zip(self.records, self.guesses, strict=True):
            together = self.responses.samples_in_step(record, start, self.begin)
            together = min(together, len(record.time) // FEWEST)
            thinned.append(record.thinned(together))
        return thinned

    def whole(
        self,
        theta: np.ndarray,
        starts: Sequence[np.ndarray] | None = None,
        progress: Callable[[float, float], None] | None = None,
        most_steps: int = MOST_STEPS,
    ) -> Fit:
        """Return the fit of the complete records, from given unknowns (p,) and initial states.

        starts: initial state of each record, (n,) each, or None for the guesses
        most_steps: largest number of Gauss-Newton steps

        Raises FloatingPointError as `OutputError.fit` does.
        """
        begin = self.guesses if starts is None else starts
        return self._whole.fit(theta, begin, progress, most_steps=most_steps)


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
