"""The command `hfa regenerate`."""

from __future__ import annotations

from dataclasses import dataclass, replace

from hfa.options.aircraft import Aircraft
from hfa.options.part import option, part
from hfa.options.request import Request, command
from hfa_model.variants import variant_named


@dataclass(frozen=True, kw_only=True, eq=False)
class RegenerateRequest(Request):
    """Options of `hfa regenerate`."""

    aircraft: Aircraft = part(Aircraft, without=("units", "source"))
    all: bool = option("print every entry, the matrices and the spectra")


@command(RegenerateRequest)
def regenerate(request: RegenerateRequest) -> int:
    """Compute both printed matrix pairs (A, B) from one aircraft, and compare each entry with its
    printed value.

    The exit code is 1 if a check fails.
    """
    from verification.regeneration import regenerate_all

    variant_named(request.aircraft.dynamics)  # the unsteady equations have no printed pair
    regeneration = regenerate_all(request.model)
    printed = None
    if not request.all:
        summary = regeneration.summary()
        rest = "Every entry, both spectra and the matrices: --all, or -o FILE"
        printed = replace(summary, parts=(*summary.parts, rest))
    request.show(regeneration.report(), printed=printed)
    return 0 if regeneration.ok else 1
