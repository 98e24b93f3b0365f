"""Run the comparison by `python -m studies.validation`."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from hfa.options.aircraft import Aircraft
from hfa.options.part import part
from hfa.options.request import Request, command
from studies.alone import run_alone
from studies.validation.outside import validate


@dataclass(frozen=True, kw_only=True, eq=False)
class ValidationRequest(Request):
    """Options of the comparison with published data."""

    aircraft: Aircraft = part(Aircraft, without=("units", "source"))


@command(ValidationRequest)
def validation(request: ValidationRequest) -> int:
    """Compare the model with printed and released data: a third printed model, and a simulation's
    trims.

    Exit code 1 when a difference is beyond its limit.
    """
    result = validate(request.model)
    request.show(result.report())
    return 0 if result.ok else 1


if __name__ == "__main__":
    sys.exit(run_alone(validation, "python -m studies.validation"))
