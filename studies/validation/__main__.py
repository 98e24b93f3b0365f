"""Run the comparison by `python -m studies.validation`."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from hfa.options.output import show
from hfa.options.request import command
from hfa.options.trims import HfaOptions, OutputOptions
from studies.alone import run_alone
from studies.validation.outside import validate


@dataclass(frozen=True, kw_only=True, eq=False)
class ValidationRequest(HfaOptions, OutputOptions):
    """Options of the comparison with published data."""


@command(ValidationRequest)
def validation(request: ValidationRequest) -> int:
    """Compare the model with printed and released data: a third printed model, and a simulation's
    trims.

    Exit code 1 when a difference is beyond its limit.
    """
    result = validate(request.hfa)
    show(result.report(), request)
    return 0 if result.ok else 1


if __name__ == "__main__":
    sys.exit(run_alone(validation, "python -m studies.validation"))
