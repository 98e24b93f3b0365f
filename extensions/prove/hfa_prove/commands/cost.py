"""The command `hfa prove cost`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hfa.options.output import ProgressLine
from hfa.options.request import command
from hfa_prove.commands.options import refuse_no_certificate
from hfa_prove.commands.request import CostRequest

if TYPE_CHECKING:
    from hfa_prove.search.cost import CostBound


@command(CostRequest)
def cost(request: CostRequest) -> int:
    """Prove a lower bound on the cost of every flight of the nonlinear aircraft to its trim.

    The cost is the integral of x'Qx + u'Ru, in deviations from the trim. The bound consists of a
    polynomial W in the initial condition and a level. Every flight that ends at the trim, within
    the envelope and the limits of the inputs, costs at least the smaller of W and the level. -o
    FILE.json writes a certificate, also if the run is interrupted. `hfa optimize --bound FILE`
    compares flights with the bound. Exit code 0 if the bound is proved. The command requires the
    package python-flint.
    """
    from hfa_prove.enclosure.precision import flint_or_refusal

    flint_or_refusal()
    refuse_no_certificate(request.output.file)
    return _prove(request)


def _prove(request: CostRequest) -> int:
    from hfa_flight.interruption import interruptible
    from hfa_prove.certificate import write_certificate
    from hfa_prove.report_search import bound_report
    from hfa_prove.search.cost import bound_search

    problem = request.problem()
    origin = request.provenance.to_dict()

    def save(found: CostBound) -> None:
        if request.output.file is not None:
            write_certificate(request.output.file, found.statement, found.witness.content(), origin)

    with interruptible(ProgressLine("cost")) as progress:
        found = bound_search(
            problem,
            degree=request.degree,
            margin=request.margin,
            seconds=request.seconds,
            progress=progress,
            save=save,
        ).found()
    request.print(bound_report(found))
    return 0
