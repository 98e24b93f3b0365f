"""The command `hfa prove models`."""

from __future__ import annotations

from dataclasses import dataclass

from hfa.options.argument_types import positive
from hfa.options.command import command
from hfa.options.request import option
from hfa.output import ProgressLine, print_report, show
from hfa_proof.options import RangeOptions, family_of


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelsRequest(RangeOptions):
    """Options of `hfa prove models`."""

    limit_error: float = option(
        "largest relative error of the interpolation; default 1e-3", "X", positive, default=1e-3
    )


@command(ModelsRequest)
def models(request: ModelsRequest) -> int:
    """Find the fewest linear models between which A, B, the inputs and the exact K are interpolated
    within --limit-error, and prove it in ball arithmetic for every value of LOW:HIGH.

    -o FILE.json writes a certificate for hfa prove --check FILE; another suffix writes the models.
    The command needs `pip install .[proof]`."""
    from hfa_proof.arithmetic import flint_or_refusal
    from hfa_proof.search.models_grid import prove_models

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
