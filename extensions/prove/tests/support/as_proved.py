"""A statement as if the checker had proved it, for tests of reports."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hfa_prove.certificate import Certificate
from hfa_prove.check import Proved

WRITTEN = {"version": "1", "date": "2026-01-01", "command": "a test"}


def as_proved(statement: Any, witness: Any = None, sizes: tuple[int, ...] = (1,)) -> Proved:
    """Return a result of the checker without a proof."""
    return Proved(Certificate(Path("certificate.json"), statement, witness, WRITTEN), sizes)
