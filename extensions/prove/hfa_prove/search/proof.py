"""A proof, which is a statement with its witness, and the file of its certificate."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from flint import arb

from hfa_aircraft.model import Model
from hfa_prove.certificate import kind_of, write_certificate
from hfa_prove.check import check_certificate
from hfa_prove.fields import Rejected
from hfa_prove.report import proof_report
from hfa_prove.statements.game import GameStatement
from hfa_prove.statements.schedule import ScheduleStatement
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.files import forget_read
from hfa_support.provenance import Provenance
from hfa_support.reporting.report import Report, Reported
from hfa_support.version import VERSION

Content = dict[str, Any]
#: Least time between two writings of an unfinished certificate, in s and in multiples of the
#: writing time, so that writing takes at most a tenth of the time.
_PAUSE = 2.0
_RARELY = 9.0
#: Decimal digits of a ball, somewhat more than the checker uses.
_DIGITS = 55


@dataclass(frozen=True, eq=False, repr=False)
class Proof(Reported):
    """A statement with its proof.

    statement: the proved statement
    witness: data for the checker. {} for the solution of a game whose full claim is not proved.
    data: the result for JSON, with the entry `proved`
    """

    statement: ScheduleStatement | GameStatement
    witness: Content
    data: Content = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """Kind of the certificate: schedule or game."""
        return kind_of(self.statement)

    @property
    def proved(self) -> bool:
        """Whether the full claim is proved."""
        return bool(self.data["proved"])

    def report(self) -> Report:
        """Return the report of the proved statement."""
        return proof_report(self.statement, self.data)

    def write(self, path: Path, origin: Provenance) -> None:
        """Write the certificate of the proof, with all digits of every double.

        path: file of the certificate
        origin: provenance of the run, which the digest does not cover

        Raises NoSolutionError if the witness is {}.
        """
        if not self.witness:
            raise NoSolutionError("no part of the claim is proved, so no certificate is written")
        witness = witness_content(self.witness)
        write_certificate(path, self.statement, witness, origin.to_dict())


def witness_content(value: Any) -> Any:
    """Return a witness in the form that is stored in a certificate.

    Balls become their midpoints as decimal numbers in strings, and arrays become lists.
    """
    if isinstance(value, Mapping):
        return {name: witness_content(entry) for name, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [witness_content(entry) for entry in value]
    if isinstance(value, arb):
        return value.mid().str(_DIGITS, radius=False)
    return value.tolist() if isinstance(value, np.ndarray) else value


class CertificateFile:
    """File of a proof in progress, which is a valid certificate of the part proved so far.

    path: path of the file
    origin: provenance of the run
    resume: whether to continue the proof that is stored in the file
    """

    def __init__(self, path: Path, origin: Provenance, *, resume: bool = False) -> None:
        self.path = path
        self._origin = origin
        self._resume = resume
        self._next = time.monotonic() + _PAUSE

    def save(self, proof: Proof, *, finished: bool = False) -> None:
        """Write the certificate of the part proved so far.

        Nothing is written if the proof is unfinished and the file was written a short time ago.

        finished: whether the proof is finished
        """
        start = time.monotonic()
        if finished or start > self._next:
            proof.write(self.path, self._origin)
            now = time.monotonic()
            self._next = now + max(_PAUSE, _RARELY * (now - start))

    def known(self, statement: ScheduleStatement, model: Model) -> Content:
        """Return the verified witness of an earlier run, or {} if no run is resumed.

        statement: the statement to prove. Its trims and proved values are not compared with the
            file.

        Raises BadInputError if the file is not a certificate of this statement, was written by
        another version, or is not verified.
        """
        if not self._resume:
            return {}
        try:
            verified = check_certificate(self.path, model=model).statement
        except Rejected as error:
            raise BadInputError(f"{error}; remove the file and start again") from error
        forget_read(self.path)
        content: Content = json.loads(self.path.read_text(encoding="utf-8"))
        subjects = [_subject(claim.content()) for claim in (verified, statement)]
        if subjects[0] != subjects[1] or content["toolchain"] != VERSION:
            raise BadInputError(
                f"{self.path} is the certificate of another statement or version; give another "
                "path with -o"
            )
        witness: Content = content["witness"]
        return witness


def _subject(content: Content) -> Content:
    """Return a statement's entries on aircraft, controller and actuators, without stated trims."""
    subject = {
        name: value
        for name, value in content.items()
        if name in ("flight", "controller", "actuators")
    }
    subject["flight"] = {
        name: value for name, value in subject.get("flight", {}).items() if name != "trims"
    }
    return subject
