"""For every place of an interval: the trim exists, so many modes are unstable, the scheduled gain
stabilizes.

Also while the scheduling variable moves: a Lyapunov function of it is proved to decrease at every
place and rate."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from itertools import pairwise

import numpy as np
from flint import arb_mat

from controller.game.gain_schedule import GainSchedule
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress, told
from verification.proof.arithmetic.ball_function import Undecided
from verification.proof.arithmetic.balls import (
    TaylorModel,
    doubles,
    exact,
    is_positive_definite,
    matrix,
)
from verification.proof.enclosures.matrix_balls import counted, is_positive
from verification.proof.enclosures.trim_branch import (
    Family,
    ModelForms,
    PlaceBox,
    TrimBranch,
    bisected,
)
from verification.proof.search.certificate import (
    CertificateFile,
    Content,
    Proof,
    flights_claim,
    proved_box,
)
from verification.proof.search.proof_report import SCHEMA, loop_statement, place_data
from verification.proof.search.scheduled_loop import LoopTable, closed_loop, segments
from verification.proof.search.uncertain_loop import proved_pieces

Forms = Callable[[PlaceBox], ModelForms]
#: Narrower boxes, in steps of the family, are not tried: they stay open. With errors of the
#: parameters or actuators, which do not become smaller with the box, one gives up earlier.
NARROWEST, NARROWEST_WITH_ERRORS, NARROWEST_WITH_ACTUATORS = 2.0**-10, 2.0**-5, 2.0**-3
#: The part of the middle's decay rate that is claimed for the whole box.
RATE_SHARE = 0.9
#: Largest distance between two places at which P is given, in steps of the family.
_STEP = 0.125
#: Parts of the rate that points suggest, tried until one is proved on the whole interval.
_SHARES = (0.95, 0.9, 0.8, 0.6, 0.4, 0.2)
#: Narrower boxes are not tried, likewise.
_NARROWEST_MOVING = 2.0**-6
#: Steps of the search for W, which goes from place to place at most this many of them apart ..
_TRIES, _STRIDE = 16, 8
#: .. and how much the place that allows least counts.
_POWER = 8


def prove_schedule(
    family: Family,
    table: GainSchedule | LoopTable,
    low: float,
    high: float,
    *,
    moving: bool = False,
    file: CertificateFile | None = None,
    progress: Progress | None = None,
) -> Proof:
    """Prove or refute, box by box, that the loop is Hurwitz; count the unstable modes of A, and
    bound them elsewhere.

    moving: also prove how fast the scheduling variable may move. file: of the certificate, which is
    written on the way. Raises NoSolutionError where a place has no trim, BadInputError when the
    table or the model does not reach."""
    table, model, forms = (
        LoopTable.of(table),
        family.model,
        lru_cache(maxsize=256)(TrimBranch(family).forms),
    )
    parts = segments(table, low, high)
    statement = flights_claim(family, low, high) | {
        "table": {key: getattr(table, key) for key in ("places", *"KMNX")}
    }
    if table.actuators is not None:
        statement |= {"actuators": vars(table.actuators)}
    known: Content = {"boxes": {}, "open": {}} if file is None else file.known(statement, model)
    boxes: dict[str, list[Content]] = {name: [] for name in ("loop", "modes", "least", "most")}
    gaps: dict[str, list[list[float]]] = {"loop": [], "modes": []}
    for name, own in gaps.items():
        boxes[name] += known["boxes"].get(name, [])
        own += [ends for ends in known["open"].get(name, []) if ends[1] != high]

    def frontier(name: str) -> float:
        """Up to which place everything from `low` on is proved or known to stay open."""
        return max(
            [low, *(box["range"][1] for box in boxes[name]), *(ends[1] for ends in gaps[name])]
        )

    def so_far() -> Proof:
        still = {
            name: own + [[frontier(name), high]] * (frontier(name) < high)
            for name, own in gaps.items()
        }
        return Proof("schedule", statement, boxes, model, still)

    narrowest = [NARROWEST_WITH_ERRORS if family.spread else NARROWEST] * 2
    if table.actuators is not None:
        narrowest[0] = NARROWEST_WITH_ACTUATORS
    for index, (name, given) in enumerate((("loop", table), ("modes", None))):
        prove = partial(_prove, forms, given, family)
        for box, proved in bisected(parts, prove, narrowest[index] * family.step, frontier(name)):
            if proved is not None:
                boxes[name].append(proved)
            else:
                gaps[name].append([box.low, box.high])
            if file is not None:
                file.save(so_far())
            if progress is not None:
                progress(round(500 * (index + (box.high - low) / (high - low))), 1000)
    for name, side in (("least", 1), ("most", -1)):
        for ends in gaps["modes"]:
            with suppress(Undecided):
                boxes[name] += _bound(forms(PlaceBox(*ends)), family, side)
    if moving:
        more, moved = proved_motion(forms, family, table, low, high, progress=progress)
        if moved:
            statement, boxes = statement | more, boxes | {"motion": moved}
    found = Proof("schedule", statement, boxes, model, gaps)
    if file is not None:
        file.save(found, finished=True)
    data = {"schema": SCHEMA, "statement": "schedule", "dynamics": model.name} | place_data(
        model, [low, high]
    )
    entries = [
        place_data(model, box["range"]) | {key: box[key] for key in "AB"} for box in boxes["loop"]
    ]
    return replace(found, data=data | loop_statement(found, moving)[1] | {"boxes": entries})


def _bound(model: ModelForms, family: Family, side: int) -> list[Content]:
    """How many modes of A lie right of the first line, on a side of the axis, 1 or -1, that is
    proved to have none."""
    values = sorted(np.linalg.eigvals(doubles(model.A.parts[0])).real.tolist())
    lines = [(a + b) / 2 for a, b in pairwise(values) if b > a and side * (a + b) > 0.0]
    for line in sorted(lines, key=abs):
        found = counted(model.A, -line)
        if found is not None:
            return [proved_box(model, family, **found._asdict() | {"rate": -line})]
    return []


def _prove(forms: Forms, table: LoopTable | None, family: Family, box: PlaceBox) -> Content | None:
    """The loop of a table on a box, or without one A: so many eigenvalues have Re λ > -rate, and
    none Re λ = -rate."""
    model = forms(box)
    if table is not None and table.actuators is not None:
        pieces = proved_pieces(table, model, table.actuators.bandwidth)
        return (
            proved_box(model, family, pieces=[each._asdict() for each in pieces])
            if pieces
            else None
        )
    form, rate = model.A if table is None else closed_loop(table, model), 0.0
    middle = doubles(form.parts[0])
    if not np.isfinite(middle).all():
        raise BadInputError(
            "the loop's entries are too large to compute with; check the gains of the table"
        )
    if table is not None:
        rate = RATE_SHARE * max(0.0, -float(np.linalg.eigvals(middle).real.max()))
    found = counted(form, rate)
    return None if found is None else proved_box(model, family, **found._asdict() | {"rate": rate})


def proved_motion(
    forms: Forms,
    family: Family,
    table: LoopTable,
    low: float,
    high: float,
    *,
    progress: Progress | None = None,
) -> tuple[Content, list[Content]]:
    """place_rate and lyapunov (places, P) of a statement, and the boxes that prove it; no boxes
    when none are found.

    V = ζ'P(η)ζ decreases on every motion with |η'| <= place_rate: V' = z'(A_c'P + P A_c + η' dP/dη)
    z < 0 for both signs of η' = ± rate, hence for all rates between. P solves A_c'P + P A_c = -W at
    some places, with one W for all, and is linear between: V is continuous, its derivative is the
    above where η is inside a piece, and P is as smooth as A_c, whatever its modes do."""
    places = list[float]()
    for part in segments(table, low, high):
        pieces = math.ceil((part.high - part.low) / (_STEP * family.step))
        places += np.linspace(part.low, part.high, pieces + 1)[:-1].tolist()
    places.append(high)
    boxes = [PlaceBox(a, b) for a, b in pairwise(places)]
    try:
        loops = [closed_loop(table, forms(box)) for box in boxes]
    except Undecided:
        return {}, []
    scales = [1.0 / float(box.radius) for box in boxes]
    points = [
        (doubles(each.parts[0]), doubles(each.parts[1]) * s)
        for each, s in zip(loops, scales, strict=True)
    ]
    if max(np.linalg.eigvals(A).real.max() for A, _ in points) >= 0.0:
        return {}, []
    suggested, W = _weight([*points[::_STRIDE], points[-1]])
    last = loops[-1].parts
    ends = [doubles(c0 - c1 + c2) for c0, c1, c2, *_ in (loop.parts for loop in loops)]
    ends += [doubles(last[0] + last[1] + last[2])]
    P = [_lyapunov(A, W) for A in ends]

    def prove(rate: float, index: int, box: PlaceBox) -> Content | None:
        first, width = exact(places[index]), exact(places[index + 1]) - exact(places[index])
        rise = (matrix(P[index + 1]) - matrix(P[index])) * (1 / width)
        value = matrix(P[index]) + (box.middle - first) * rise
        turn = _decreases(
            closed_loop(table, forms(box)),
            TaylorModel(value, rise * box.radius),
            exact(rate) * rise,
        )
        return None if turn is None else proved_box(forms(box), family, turn=turn)

    def proved(rate: float) -> list[Content]:
        """The boxes on which the rate is proved; none when it is not on all of them."""
        found: list[Content] = []
        for index, whole in told(list(enumerate(boxes)), progress):
            for _, box in bisected(
                [whole], partial(prove, rate, index), _NARROWEST_MOVING * family.step
            ):
                if box is None:
                    return []
                found.append(box)
        return found

    for share in _SHARES if all(is_positive_definite(matrix(each)) for each in P) else ():
        unit = math.floor(math.log10(share * suggested)) - 1  # two digits, rounded down
        rate = float(f"{math.floor(share * suggested / 10.0**unit)}e{unit}")
        if found := proved(rate):
            return {"place_rate": rate, "lyapunov": {"places": places, "P": P}}, found
    return {}, []


def _decreases(loop: TaylorModel, P: TaylorModel, motion: arb_mat) -> np.ndarray | None:
    """Coordinates in which -(A_c'P + P A_c ± motion) is proved positive definite; None when it is
    not."""
    half = -(loop.transpose() * P)
    decrease = half + half.transpose()
    try:
        turn = np.linalg.inv(np.linalg.cholesky(doubles(decrease.parts[0]))).T
    except np.linalg.LinAlgError:
        return None
    return turn if all(is_positive(decrease + each, turn) for each in (motion, -motion)) else None


def _lyapunov(A: np.ndarray, W: np.ndarray) -> np.ndarray:
    """P of A'P + P A = -W."""
    from scipy.linalg import solve_continuous_lyapunov

    found = solve_continuous_lyapunov(A.T, -W)
    return np.asarray((found + found.T) / 2)


def _weight(points: list[tuple[np.ndarray, np.ndarray]]) -> tuple[float, np.ndarray]:
    """The rate that W allows at all of the points A, dA/dη, and W > 0 which allows much.

    At a rate W + η' dP/dη > 0 is asked. W begins so that P is the identity in the modes of the
    middle point, and is then moved, step by step, towards Σ |dP/dη|^p, a sum over the points in
    units of W, where the largest counts most."""
    A = points[len(points) // 2][0]
    values, vectors = np.linalg.eig(A)
    best, W = (0.0, np.eye(len(A))), np.eye(len(A))
    try:
        inverse = np.linalg.inv(vectors)
        W = (inverse.conj().T @ (-values.real[:, None] * inverse)).real
        np.linalg.cholesky(W)
    except np.linalg.LinAlgError:  # dependent modes
        W = np.eye(len(A))
    for _ in range(_TRIES):
        try:
            root = np.linalg.cholesky(W)
        except np.linalg.LinAlgError:
            break
        inverse, total, largest = np.linalg.inv(root), np.zeros_like(W), 0.0
        for A, slope in points:
            half = _lyapunov(A, W) @ slope
            sizes, axes = np.linalg.eigh(inverse @ _lyapunov(A, half + half.T) @ inverse.T)
            largest = max(largest, float(np.abs(sizes).max()))
            total += (axes * np.abs(sizes) ** _POWER) @ axes.T
        best = max(best, (1.0 / largest, W), key=lambda each: each[0])
        sizes, axes = np.linalg.eigh(total)
        sizes = (sizes / sizes.max()).clip(0.0) ** (1.0 / _POWER)
        W = root @ ((axes * (1.0 + sizes)) @ axes.T) @ root.T / 2
    return best
