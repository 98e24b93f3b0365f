"""Run the identification by `python -m studies.identification`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from hfa.options.argument_types import whole
from hfa.options.output import ProgressLine, print_report, show
from hfa.options.request import command, option
from hfa.options.trims import OutputOptions, output_option
from studies.alone import run_alone
from studies.identification.parameters import run_identification

#: Suffix of a parameter file.
PARAMETERS = ".toml"


@dataclass(frozen=True, kw_only=True, eq=False)
class IdentificationRequest(OutputOptions):
    """Options of the identification."""

    seed: int = option("seed of the rough guesses; default 0", "N", whole(0), default=0)
    output: Path | None = output_option(PARAMETERS, purpose=" (the parameters)")


@command(IdentificationRequest)
def identification(request: IdentificationRequest) -> int:
    """Find the aircraft's parameters from the printed matrices, and report their accuracy."""
    result = run_identification(request.seed, ProgressLine("identify"))
    if request.output is not None and request.output.suffix.lower() == PARAMETERS:
        result.fit.save(request.output)
        print_report(result.report(), request)
    else:
        show(result.report(), request)
    return 0


if __name__ == "__main__":
    sys.exit(run_alone(identification, "python -m studies.identification"))
