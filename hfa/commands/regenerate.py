"""The command `hfa regenerate`."""

from __future__ import annotations

from dataclasses import dataclass, replace

from hfa.options.output import show
from hfa.options.request import command, option
from hfa.options.trims import HfaOptions, OutputOptions


@dataclass(frozen=True, kw_only=True, eq=False)
class RegenerateRequest(HfaOptions, OutputOptions):
    """Options of `hfa regenerate`."""

    all: bool = option("print every entry, the matrices and the spectra")


@command(RegenerateRequest)
def regenerate(request: RegenerateRequest) -> int:
    """Compute both printed matrix pairs (A, B) from one aircraft, and compare each entry with its
    printed value.

    The exit code is 1 if a check fails.
    """
    from verification.regeneration import regenerate_all

    regeneration = regenerate_all(request.hfa)
    printed = None
    if not request.all:
        summary = regeneration.summary()
        rest = "Every entry, both spectra and the matrices: --all, or -o FILE"
        printed = replace(summary, parts=(*summary.parts, rest))
    show(regeneration.report(), request, printed=printed)
    return 0 if regeneration.ok else 1
