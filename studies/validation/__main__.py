"""Run the comparison by `python -m studies.validation`."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from hfa.options.command import Outcome, Request, command
from hfa.options.plants import AircraftOptions, LoadedAircraft, loaded_aircraft
from studies.alone import run_alone
from studies.validation.outside import validate


@dataclass(frozen=True, kw_only=True, eq=False)
class ValidationRequest(Request, AircraftOptions):
    """Options of the comparison with published data."""

    aircraft: None = None
    units: None = None
    mass: None = None


@command(ValidationRequest, loaded_aircraft)
def validation(_request: ValidationRequest, aircraft: LoadedAircraft) -> Outcome:
    """Compare the model with printed and released data: a third printed model, and a simulation's
    trims.

    Exit code 1 when a difference is beyond its limit.
    """
    result = validate(aircraft.model)
    return Outcome(report=result.report(), ok=result.ok, source=aircraft.source)


if __name__ == "__main__":
    sys.exit(run_alone(validation, "python -m studies.validation"))
