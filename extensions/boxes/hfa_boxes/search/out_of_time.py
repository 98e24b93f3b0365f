"""The end of the processor time of a search on boxes."""

from __future__ import annotations

from hfa_support.errors import NoSolutionError


class OutOfTimeError(NoSolutionError):
    """Error of a proof or fit that exceeds its processor time."""

    def __init__(self, what: str, step: str, done: float) -> None:
        """Store the message.

        what: clause on the time, such as "the time limit was reached"
        step: description of the last step
        done: decided share of the cube, 0 in a fit
        """
        undecided = f", {1.0 - done:.2g} of the cube undecided" if done > 0.0 else ""
        super().__init__(f"{what} after {step}{undecided}")
