"""The command `hfa prove models`."""

from __future__ import annotations

from dataclasses import dataclass

from hfa.options.argument_types import positive
from hfa.options.output import ProgressLine, print_report, show
from hfa.options.request import command, option
from hfa_prove.commands.options import RangeOptions, family_of


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelsRequest(RangeOptions):
    """Options of `hfa prove models`."""

    limit_error: float = option(
        "largest allowed relative error of the interpolation; default 1e-3",
        "X",
        positive,
        default=1e-3,
    )


@command(ModelsRequest)
def models(request: ModelsRequest) -> int:
    """Find linear models with a proved interpolation error of at most --limit-error.

    A, B, the trim inputs and K of the exact game are interpolated linearly. The error is proved in
    ball arithmetic for every value of LOW:HIGH, with as few models as the proof allows. -o
    FILE.json writes a certificate for `hfa prove --check FILE`. -o with another suffix writes the
    models. The command requires the package python-flint."""
    from hfa_prove.search.models import prove_models
    from verification.enclosure.precision import flint_or_refusal

    flint_or_refusal()
    family = family_of(request)
    low, high = request.ends(family)
    progress = ProgressLine("prove")
    proof = prove_models(family, low, high, request.limit_error, progress=progress)
    if request.output is not None and request.output.suffix.lower() == ".json":
        proof.write(request.output, request.provenance)
        print_report(proof.report(), request)
    else:
        show(proof.report(), request)
    return 0
