"""Error for a search that exceeds its processor time."""

from __future__ import annotations

from hfa_support.errors import NoSolutionError


class OutOfTimeError(NoSolutionError):
    """Raised if a proof or fit exceeds its processor time."""

    def __init__(self, what: str, step: str, done: float) -> None:
        """Compose the message of the error.

        what: clause about the time, such as "the time limit was reached"
        step: description of the last step
        done: share of the cube that is decided, 0 in a fit
        """
        undecided = f", {1.0 - done:.2g} of the cube undecided" if done > 0.0 else ""
        super().__init__(f"{what} after {step}{undecided}")
