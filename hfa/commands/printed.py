"""Commands about the HFA alone, which compare it with what is printed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hfa.options.argument_types import whole
from hfa.options.command import command
from hfa.options.request import option
from hfa.options.trims import HfaOptions, OutputOptions, output_option
from hfa.output import ProgressLine, print_report, show

#: Suffix of a parameters file.
PARAMETERS = ".toml"


@dataclass(frozen=True, kw_only=True, eq=False)
class HfaRequest(HfaOptions, OutputOptions):
    """The HFA."""


@command(HfaRequest)
def regenerate(request: HfaRequest) -> int:
    """Regenerate both printed pairs (A, B) from one aircraft and compare them with the printed
    ones, entry by entry.

    Exit code 1 when a check fails.
    """
    from verification.regeneration import regenerate_all

    regeneration = regenerate_all(request.hfa)
    show(regeneration.report(), request)
    return 0 if regeneration.ok else 1


@command(HfaRequest)
def validate(request: HfaRequest) -> int:
    """Compare the model with what others have printed and released: a third printed model, and a
    simulation's trims.

    Exit code 1 when a difference is beyond its limit.
    """
    from verification.validation import validate

    validation = validate(request.hfa)
    show(validation.report(), request)
    return 0 if validation.ok else 1


@dataclass(frozen=True, kw_only=True, eq=False)
class IdentifyRequest(OutputOptions):
    """The parameters, identified."""

    seed: int = option("seed of the rough guesses; default 0", "N", whole(0), default=0)
    output: Path | None = output_option(PARAMETERS, purpose=" (the parameters)")


@command(IdentifyRequest)
def identify(request: IdentifyRequest) -> int:
    """Find the aircraft's parameters from the printed matrices and say how far to trust them."""
    from trim.identification import run_identification

    result = run_identification(request.seed, ProgressLine("identify"))
    if request.output is not None and request.output.suffix.lower() == PARAMETERS:
        result.fit.save(request.output)
        print_report(result.report(), request)
    else:
        show(result.report(), request)
    return 0
