"""Run the identification by `python -m studies.identification`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from hfa.options.argument_types import whole
from hfa.options.command import Outcome, ProgressLine, Request, command, output_option
from hfa.options.parser import option
from studies.alone import run_alone
from studies.identification.parameters import run_identification

#: Suffix of a parameter file.
PARAMETERS = ".toml"


@dataclass(frozen=True, kw_only=True, eq=False)
class IdentificationRequest(Request):
    """Options of the identification."""

    output: Path | None = output_option(PARAMETERS, purpose=" (the parameters)")
    seed: int = option("seed of the rough guesses; default 0", "N", whole(0), default=0)


@command(IdentificationRequest)
def identification(request: IdentificationRequest) -> Outcome:
    """Find the aircraft's parameters from the printed matrices, and report their accuracy."""
    result = run_identification(request.seed, ProgressLine("identify"))
    is_parameters = request.output is not None and request.output.suffix.lower() == PARAMETERS
    write = result.fit.save if is_parameters else None
    return Outcome(report=result.report(), write=write)


if __name__ == "__main__":
    sys.exit(run_alone(identification, "python -m studies.identification"))
