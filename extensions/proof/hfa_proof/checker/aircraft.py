"""Aircraft of a certificate."""

from __future__ import annotations

from typing import Any

from hfa_aircraft.model import Model
from hfa_proof.checker.reading import require
from hfa_proof.flexible_aircraft import aircraft_of
from hfa_support.errors import BadInputError, shown

#: A trim is the stated one when it lies this close to it, in nominal values of its unknowns.
SAME_TRIM = 1e-6


def model_of(name: Any, source: Any, own: Model | None) -> Model:
    """Return the model of a statement: the HFA's or the user's own.

    Raises BadInputError unless the user's model is that of the statement.

    name: name of the dynamics, as in the statement
    source: the hash of the user's file, "" for the HFA
    own: the user's model, where one is named
    """
    require(isinstance(name, str) and isinstance(source, str), "dynamics", name)
    if own is not None:
        if (own.name, own.extras.source[1]) != (name, source):
            raise BadInputError(
                f"the certificate concerns {shown(name)} from a file other than that of {own.name}"
            )
        return own
    flexible = None if source else aircraft_of(name)
    if flexible is None:
        raise BadInputError(
            f"the certificate concerns {shown(name)}; name its file by --aircraft FILE.py:NAME"
        )
    return flexible
