"""The command `hfa regenerate`."""

from __future__ import annotations

from dataclasses import dataclass, replace

from hfa.options.command import Outcome, Request, command
from hfa.options.plants import AircraftOptions, LoadedAircraft, loaded_aircraft
from hfa_model.variants import variant_named


@dataclass(frozen=True, kw_only=True, eq=False)
class RegenerateRequest(Request, AircraftOptions):
    """Options of `hfa regenerate`."""

    aircraft: None = None
    units: None = None
    mass: None = None


@command(RegenerateRequest, loaded_aircraft)
def regenerate(request: RegenerateRequest, aircraft: LoadedAircraft) -> Outcome:
    """Compute both printed matrix pairs (A, B) from one aircraft, and compare each entry with its
    printed value.

    The exit code is 1 if a check fails.
    """
    from verification.regeneration import regenerate_all

    # Raises BadInputError for the unsteady equations, which have no printed pair.
    variant_named(request.dynamics or "published")
    regeneration = regenerate_all(aircraft.model)
    summary = regeneration.summary()
    rest = "Every entry, both spectra and the matrices: -o FILE.html, or --json"
    return Outcome(
        report=regeneration.report(),
        ok=regeneration.ok,
        source=aircraft.source,
        printed=replace(summary, parts=(*summary.parts, rest)),
    )
