"""Choice of the aircraft that a certificate concerns."""

from __future__ import annotations

from typing import Any

from hfa_aircraft.model import Model
from hfa_proof.checker.reading import require
from hfa_proof.flexible_aircraft import aircraft_of
from hfa_support.errors import BadInputError, shown

#: Largest difference of a trim from the stated one, in nominal values of its unknowns.
SAME_TRIM = 1e-6


def model_of(name: Any, source: Any, own: Model | None) -> Model:
    """Return the aircraft that a statement concerns.

    This is the flexible aircraft of the paper or the user's model.

    name: name of the dynamics in the statement
    source: hash of the user's file in the statement, "" for the flexible aircraft
    own: the user's model, or None

    Raises Malformed unless `name` and `source` are strings. Raises BadInputError if the statement
    concerns another model than the user's, or an aircraft whose file is not given.
    """
    require(isinstance(name, str) and isinstance(source, str), "dynamics", name)
    if own is not None:
        if (own.name, own.extras.source[1]) != (name, source):
            raise BadInputError(
                f"the certificate is about {shown(name)} from another file than the given file "
                f"of {own.name}; give the aircraft file used to prove the certificate"
            )
        return own
    flexible = None if source else aircraft_of(name)
    if flexible is None:
        raise BadInputError(
            f"the certificate is about {shown(name)}; give the aircraft file with --aircraft "
            "FILE.py:NAME"
        )
    return flexible
