"""Checker of a certificate, which proves the statement from the witness.

The checker imports nothing from the search. Every quantity is a Taylor model in the position s
within a box and in the errors t of the parameters.

    statement.py  the claim                 witness.py  data for the proof
    trims.py      trims and linear models   loop.py     the loop
    roots.py      roots of equations        sealed.py   the file
    modes.py      numbers of eigenvalues    riccati.py  the exact solution of a game
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from flint import arb, ctx

from hfa_prove.check.cover import covering
from hfa_prove.check.game import (
    check_axis,
    check_gain,
    critic_distances,
    solution_on,
)
from hfa_prove.check.loop import actuated_loop, between, closed_loop
from hfa_prove.check.modes import check_motion, check_pieces, least_and_most
from hfa_prove.check.trims import LinearModelBox, check_branches, linear_model_on
from hfa_prove.fields import Rejected
from hfa_prove.statements.schedule import (
    GameStatement,
    GameWitness,
    Line,
    ModesBox,
    Motion,
    Plant,
    Run,
    ScheduleStatement,
    ScheduleWitness,
    SolutionBox,
    TrimBox,
    UncertainActuators,
    loop_size,
)
from hfa_support.progress import Progress, with_progress
from verification.enclosure.balls import matrix
from verification.enclosure.series import TaylorModel

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
            assert isinstance(box.proof, Line)
            least, most = least_and_most(linear.A, box.proof)
        bounds[name].append(Run(box.trim.low, box.trim.high, least, most))
        linear_models.append(linear)
    _check_runs("loop", statement.loop, bounds["loop"], size)
    _check_runs("modes", statement.modes, bounds["modes"], n)
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
        assert isinstance(box.proof, list)
        loop = actuated_loop(linear, model, statement.controller, statement.actuators)
        check_pieces(loop, statement.actuators, box.proof)
        return 0, 0
    assert isinstance(box.proof, Line)
    A = closed_loop(linear, model, statement.controller, statement.actuators)
    least, most = least_and_most(A, box.proof)
    if most == 0 and box.proof.rate < statement.decay_rate:
        most = A.parts[0].nrows()  # stable, but not with the decay rate that is claimed
    return least, most


def _check_runs(name: str, runs: Sequence[Run], bounds: Sequence[Run], size: int) -> None:
    """Raise Rejected unless the boxes prove the stated numbers of unstable modes.

    name: subject of the runs in messages, "loop" or "modes"
    runs: stated lowest and highest numbers over ranges of the scheduling variable
    bounds: lowest and highest numbers that each box proves
    size: number of eigenvalues
    """
    for run in runs:
        ends = [(run.low, run.high)]
        if run.least > 0:
            enough = [bound for bound in bounds if bound.least >= run.least]
            what = f"the boxes of {name} with {run.least} or more unstable modes"
            covering(what, ends, enough, _ends_of_run)
        if run.most < size:
            enough = [bound for bound in bounds if bound.most <= run.most]
            what = f"the boxes of {name} with at most {run.most} unstable modes"
            covering(what, ends, enough, _ends_of_run)


def _ends_of_run(run: Run) -> list[tuple[float, float]]:
    return [(run.low, run.high)]


def _ends_of_cell(cell: tuple[TrimBox, Any]) -> list[tuple[float, float]]:
    trim, _ = cell
    return [(trim.low, trim.high)]


def _check_scheduled_rate(
    statement: ScheduleStatement, motion: Motion, progress: Progress | None
) -> list[LinearModelBox]:
    """Return linear models on boxes that prove stability while the scheduling variable η moves.

    V' = ζ'(F'P + P F + η' dP/dη) ζ < 0 is proved for η' at both limits of the rate, and therefore
    holds for all rates between them.

    Raises Rejected if stability is not proved.
    """
    flight = statement.flight
    boxes = covering(
        "the boxes of the motion", [(flight.low, flight.high)], motion.boxes, _ends_of_cell
    )
    linear_models = []
    for trim, turn in with_progress(boxes, progress):
        linear = _linear_model(statement, trim)
        loop = closed_loop(linear, flight.model, statement.controller, statement.actuators)
        P = between(motion.breakpoints, motion.P, trim.low, trim.high)
        slope = P.parts[1] * (2 / (arb(trim.high) - arb(trim.low)))
        check_motion(loop, P, slope * arb(statement.scheduled_rate), turn)
        linear_models.append(linear)
    return linear_models


@ctx.workprec(_PRECISION)
def check_game(statement: GameStatement, witness: GameWitness) -> int:
    """Prove the claims about a game and return the number of boxes in the proof, 1.

    The claims, as far as they are stated, are:
    - the distances of the critic from the exact solution
    - the gain of the critic's P and W
    - the numbers of unstable modes of the loop and of the plant
    - the lower and upper bound of delta_min

    Raises Rejected unless all claims are proved.
    """
    weights = statement.weights
    doubles = _plant(statement, witness, decimals=False)
    wide = _plant(statement, witness, decimals=True) if statement.decimals else doubles
    exact = solution_on(weights, *wide, witness.solution, lowest=1)
    bounds = critic_distances(statement.critic, exact)
    for name, (least, most) in statement.distances.items():
        lowest, highest = bounds[name]
        if not (highest <= arb(most) and (least == 0.0 or lowest >= arb(least))):
            raise Rejected(f"the stated distance of {name} is not proved")
    A, B = wide
    if statement.gain_of_value:
        check_gain(weights, B, statement.critic)
    n = A.parts[0].nrows()
    loop = A - B * matrix(statement.critic["K"])
    _check_runs("loop", [Run(0.0, 0.0, *statement.loop)], _line_bounds(loop, witness.loop), n)
    if statement.delta_min is None:
        return 1
    assert statement.modes is not None
    A, B = doubles
    _check_runs("modes", [Run(0.0, 0.0, *statement.modes)], _line_bounds(A, witness.modes), n)
    refused, value = statement.delta_min
    assert witness.value is not None
    solution_on(replace(weights, delta=value), A, B, witness.value, lowest=1)
    below = replace(weights, delta=refused)
    if isinstance(witness.refused, SolutionBox):
        solution_on(below, A, B, witness.refused, lowest=-1)
    else:
        check_axis(below, A, B, witness.refused or [])
    return 1


def _plant(
    statement: GameStatement, witness: GameWitness, *, decimals: bool
) -> tuple[TaylorModel, TaylorModel]:
    """Return the matrices A and B of the plant of a game.

    The trim of the doubles is within its radii about the center. The larger radii for all decimals
    contain these radii, and each trim in them is unique. All trims are therefore on one branch.

    decimals: whether the matrices enclose those of every decimal number that rounds to the stored
        doubles, instead of those of the doubles alone
    """
    plant = statement.plant
    if isinstance(plant, Plant):
        return TaylorModel(matrix(plant.A)), TaylorModel(matrix(plant.B))
    assert witness.trim is not None
    radii = witness.trim.wide_radii if decimals else witness.trim.radii
    trim = TrimBox(plant.low, plant.high, witness.trim.center, radii)
    linear = linear_model_on(plant, trim, decimals=decimals)
    check_branches(plant, [linear])
    return linear.A, linear.B


def _line_bounds(A: TaylorModel, lines: Sequence[Line]) -> list[Run]:
    return [Run(0.0, 0.0, *least_and_most(A, line)) for line in lines]
