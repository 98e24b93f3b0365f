"""The checker of certificates.

It proves the statement of a certificate from its witness. It imports nothing of the search and
trusts nothing that the search has found: witness, stated trims, provenance. What it trusts:

- `hfa_prove.check`, `statements`, `fields` and `certificate`, and balls (`hfa_prove.enclosure`)
- `hfa_aircraft.layout` and `model`, which build the equations, and CasADi: instruction lists,
  symbolic derivatives and substitution
- python-flint (Arb), NumPy and Python, and the user's aircraft file

Another checker reads the JSON, writes the equations from the documentation of the aircraft, refuses
every entry that it does not interpret, and proves the statement: trims by an interval Newton or
Krawczyk test about the stated values, eigenvalues by interval arithmetic on small pieces, rounded
outward. Forgeries test it: what is accepted after an entry was changed, removed or exchanged must
be true.
"""

from __future__ import annotations

# Sets the precision of balls.
import hfa_prove.enclosure.precision  # noqa: F401
from hfa_prove.certificate import Certificate
from hfa_prove.check.schedule import check_schedule
from hfa_prove.fields import naming
from hfa_support.progress import Progress


def check(certificate: Certificate, progress: Progress | None = None) -> int:
    """Prove the statement of a certificate, and return the number of pieces of the proof.

    progress: called with the number of proved pieces, or None

    Raises Rejected if the statement is not proved. Raises BadInputError if the equations contain an
    operation that is not supported.
    """
    with naming(certificate.path):
        return check_schedule(certificate.statement, certificate.witness, progress)
