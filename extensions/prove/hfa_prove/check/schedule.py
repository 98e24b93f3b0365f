"""Checker of a statement about a schedule, which proves the statement from its witness.

The checker imports nothing from the search. Every quantity is a Taylor model in the position s
within a box and in the errors t of the parameters.
"""

from __future__ import annotations

from flint import arb, ctx

from hfa_prove.check.cover import check_covered
from hfa_prove.check.linear_loop import actuated_loop, between, closed_loop
from hfa_prove.check.modes import check_motion, check_pieces, check_runs, least_and_most
from hfa_prove.check.trims import LinearModelBox, check_branches, linear_model_on
from hfa_prove.statements.flight import Line, TrimBox
from hfa_prove.statements.schedule import (
    ModesBox,
    Motion,
    Run,
    ScheduleStatement,
    ScheduleWitness,
    UncertainActuators,
    loop_size,
)
from hfa_support.progress import Progress, with_progress

#: Bits of a midpoint.
_PRECISION = 256


@ctx.workprec(_PRECISION)
def check_schedule(
    statement: ScheduleStatement, witness: ScheduleWitness, progress: Progress | None = None
) -> int:
    """Prove the claims about a schedule and return the number of boxes in the proof.

    The claims are the numbers of unstable modes over each range of the scheduling variable, and
    stability while the scheduling variable moves.

    Raises Rejected if a claim is not proved.
    """
    flight = statement.flight
    n = len(flight.model.linear)
    size = loop_size(flight.model, statement.controller, statement.actuators)
    boxes = [("loop", box) for box in witness.loop] + [("modes", box) for box in witness.modes]
    bounds: dict[str, list[Run]] = {"loop": [], "modes": []}
    linear_models = []
    for name, box in with_progress(boxes, progress):
        linear = _linear_model(statement, box.trim)
        if name == "loop":
            least, most = _loop_bounds(statement, linear, box)
        else:
            assert isinstance(box.proof, Line)  # as the witness was read
            least, most = least_and_most(linear.A, box.proof)
        bounds[name].append(Run(box.trim.low, box.trim.high, least, most))
        linear_models.append(linear)
    check_runs("loop", statement.loop, bounds["loop"], size)
    check_runs("modes", statement.modes, bounds["modes"], n)
    count = len(boxes)
    if witness.motion is not None:
        linear_models += _check_scheduled_rate(statement, witness.motion, progress)
        count += len(witness.motion.boxes)
    check_branches(flight, linear_models)
    return count


def _linear_model(statement: ScheduleStatement, trim: TrimBox) -> LinearModelBox:
    measured = statement.controller.outputs(statement.flight.model)
    return linear_model_on(statement.flight, trim, measured)


def _loop_bounds(
    statement: ScheduleStatement, linear: LinearModelBox, box: ModesBox
) -> tuple[int, int]:
    """Return the lowest and highest number of unstable modes of the loop, proved on a box.

    If the loop is proved stable, but not with the claimed decay rate, the highest number is the
    number of all modes.

    Raises Rejected if the data of the box prove no numbers.
    """
    model = statement.flight.model
    if isinstance(statement.actuators, UncertainActuators):
        assert isinstance(box.proof, list)  # as the witness was read
        loop = actuated_loop(linear, model, statement.controller, statement.actuators)
        check_pieces(loop, statement.actuators, box.proof)
        return 0, 0
    assert isinstance(box.proof, Line)  # as above
    A = closed_loop(linear, model, statement.controller, statement.actuators)
    least, most = least_and_most(A, box.proof)
    if most == 0 and box.proof.rate < statement.decay_rate:
        most = A.center.nrows()  # stable, but not with the decay rate that is claimed
    return least, most


def _check_scheduled_rate(
    statement: ScheduleStatement, motion: Motion, progress: Progress | None
) -> list[LinearModelBox]:
    """Return linear models on boxes that prove stability while the scheduling variable η moves.

    V' = ζ'(F'P + P F + η' dP/dη) ζ < 0 is proved for η' at both limits of the rate, and therefore
    holds for all rates between them.

    Raises Rejected if stability is not proved.
    """
    flight = statement.flight
    ends = [[(trim.low, trim.high)] for trim, _ in motion.boxes]
    check_covered("the boxes of the motion", [(flight.low, flight.high)], ends)
    linear_models = []
    for trim, turn in with_progress(motion.boxes, progress):
        linear = _linear_model(statement, trim)
        loop = closed_loop(linear, flight.model, statement.controller, statement.actuators)
        P = between(motion.breakpoints, motion.P, trim.low, trim.high)
        slope = P.slope * (2 / (arb(trim.high) - arb(trim.low)))
        check_motion(loop, P, slope * arb(statement.scheduled_rate), turn)
        linear_models.append(linear)
    return linear_models
