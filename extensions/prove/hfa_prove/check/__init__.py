"""The checker of certificates.

It proves the statement of a certificate from its witness. It imports nothing of the search and
trusts nothing that the search has found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

# Refuses a missing python-flint before any module imports it, and sets the precision of balls.
import hfa_prove.enclosure.precision  # noqa: F401
from hfa_prove.certificate import Certificate
from hfa_prove.fields import naming
from hfa_prove.statements.schedule import ScheduleWitness
from hfa_support.progress import Progress


@dataclass(frozen=True, eq=False)
class Proved:
    """A statement that the checker has proved.

    certificate: the certificate that proves it
    size: number of boxes or pieces of the proof
    """

    certificate: Certificate
    size: int

    @property
    def statement(self) -> Any:
        """The proved statement."""
        return self.certificate.statement

    @property
    def written(self) -> Mapping[str, str]:
        """Version, command and date stored in the certificate, not verified."""
        return self.certificate.written


def check(certificate: Certificate, progress: Progress | None = None) -> Proved:
    """Prove the statement of a certificate.

    progress: called with the number of checked boxes, or None

    Raises Rejected if the statement is not proved. Raises BadInputError if the equations contain an
    operation that is not supported.
    """
    with naming(certificate.path):
        return Proved(certificate, _size(certificate.statement, certificate.witness, progress))


def _size(statement: Any, witness: Any, progress: Progress | None) -> int:
    """Prove a statement with the modules of its kind, and return the number of boxes or pieces."""
    if isinstance(witness, ScheduleWitness):
        from hfa_prove.check.schedule import check_schedule

        return check_schedule(statement, witness, progress)
    from hfa_prove.check.region_boxes import check_region

    return check_region(statement, witness, progress)
