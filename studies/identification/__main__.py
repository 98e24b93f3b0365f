"""Run the identification by `python -m studies.identification`."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from hfa.options.argument_types import whole
from hfa.options.output import Output, ProgressLine, output_option
from hfa.options.part import option, part
from hfa.options.request import Request, command
from studies.alone import run_alone
from studies.identification.parameters import run_identification

#: Suffix of a parameter file.
PARAMETERS = ".toml"


@dataclass(frozen=True, kw_only=True, eq=False)
class IdentificationRequest(Request):
    """Options of the identification."""

    output: Output = part(Output, file=output_option(PARAMETERS, purpose=" (the parameters)"))
    seed: int = option("seed of the rough guesses; default 0", "N", whole(0), default=0)


@command(IdentificationRequest)
def identification(request: IdentificationRequest) -> int:
    """Find the aircraft's parameters from the printed matrices, and report their accuracy."""
    result = run_identification(request.seed, ProgressLine("identify"))
    file = request.output.file
    is_parameters = file is not None and file.suffix.lower() == PARAMETERS
    request.show(result.report(), write=result.fit.save if is_parameters else None)
    return 0


if __name__ == "__main__":
    sys.exit(run_alone(identification, "python -m studies.identification"))
