"""Options of proofs over an interval of the scheduling variable."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from hfa.options.argument_types import number
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, shortened
from hfa_support.schema import Number

not_negative = partial(number, declared=Number(0.0))


def interval_of(_model: Model, _name: str, text: str) -> tuple[float, ...]:
    """Return the ends LOW and HIGH of the scheduling variable, or one value, in the unit typed.

    Raises BadInputError unless there is one number, or LOW < HIGH.
    """
    ends = tuple(number(part) for part in text.split(":"))
    if len(ends) > 2 or (len(ends) == 2 and not ends[0] < ends[1]):
        raise BadInputError(f"is {shortened(text)!r}; give one number, or LOW:HIGH with LOW < HIGH")
    return ends


def refuse_no_certificate(output: Path | None) -> None:
    """Raise BadInputError if the output file of a certificate is not a .json file."""
    if output is not None and output.suffix.lower() != ".json":
        raise BadInputError(
            f"{output}: a certificate must be a .json file; give a path with the suffix .json"
        )
