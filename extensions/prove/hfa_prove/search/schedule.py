"""Search for a proof that the trim exists and the loop is stable at every scheduling value.

The unstable modes are counted on boxes. For a moving scheduling value, a Lyapunov function that
depends on this value is proved to decrease.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import TypeVar

import numpy as np
from flint import arb

from hfa_flight.schedule.gain_schedule import GainSchedule
from hfa_prove.check.linear_loop import between, closed_loop
from hfa_prove.check.modes import check_motion, eigenvalue_signs, least_and_most
from hfa_prove.check.trims import LinearModelBox, Rejected
from hfa_prove.enclosure.ball_function import Undecided
from hfa_prove.enclosure.balls import doubles, is_positive_definite, matrix
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.results import breakpoint_data, schedule_data
from hfa_prove.search.family import Box, Family, TrimSearch, bisected
from hfa_prove.search.lines import find_line, lines_near_axis
from hfa_prove.search.loops import Loop, loop_of_schedule
from hfa_prove.search.proof import CertificateFile, Content, Proof
from hfa_prove.search.uncertain_loop import find_pieces
from hfa_prove.statements.flight import StatedTrim, trim_content
from hfa_prove.statements.schedule import Run, ScheduleStatement, UncertainActuators, loop_size
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress, with_progress

Found = TypeVar("Found")
#: Widths of the narrowest boxes, in steps of the family; narrower parts remain open. They are
#: larger with errors of parameters or actuators, which do not decrease with the box.
NARROWEST = 2.0**-10
NARROWEST_WITH_ERRORS = 2.0**-5
NARROWEST_WITH_ACTUATORS = 2.0**-3
#: Width of the widest box with errors of the parameters, in steps of the family.
_WIDEST_WITH_ERRORS = 0.25
#: Decay rate that is claimed for a box, relative to the decay rate at its center.
RATE_SHARE = 0.9
#: Largest distance between two breakpoints of P, in steps of the family.
_STEP = 0.125
#: Parts of the rate that the points suggest, tried until one is proved on the whole interval.
_SHARES = (0.95, 0.9, 0.8, 0.6, 0.4, 0.2)
#: Width of the narrowest box of the motion, in steps of the family.
_NARROWEST_MOVING = 2.0**-6
#: Number of steps of the search for W, and stride between the points that it uses.
_TRIES = 16
_STRIDE = 8
#: Power that gives the points with the lowest admissible rates the most weight.
_POWER = 8


@dataclass(frozen=True, eq=False)
class ProvedBox:
    """A box of scheduling values with its proved number of unstable modes.

    box: the box
    least, most: lowest and highest number of unstable modes
    rate: proved decay rate, 1/s
    content: data for the proof, as stored in a certificate
    """

    box: Box
    least: int
    most: int
    rate: float
    content: Content

    @property
    def run(self) -> Run:
        """The proved numbers of unstable modes over the box."""
        return Run(self.box.low, self.box.high, self.least, self.most)


@checks_arguments
def prove_schedule(
    family: Family,
    loop: Loop | GainSchedule,
    low: float,
    high: float,
    *,
    moving: bool = False,
    file: CertificateFile | None = None,
    progress: Progress | None = None,
) -> Proof:
    """Return a proof of the numbers of unstable modes of the loop and of the aircraft, on boxes.

    family: aircraft and its trims
    loop: controller and actuators, or gains u = -K x
    low, high: ends of the interval of the scheduling value
    moving: whether to prove stability for a moving scheduling value too
    file: file of the certificate, which is written during the proof, or None

    Raises NoSolutionError if no trim exists at a scheduling value. Raises BadInputError if the
    controller or the model does not cover the interval.
    """
    if isinstance(loop, GainSchedule):
        loop = loop_of_schedule(loop)
    search = ScheduleSearch(family, loop, low, high)
    if file is not None:
        search.resume(file.known(search.statement(), family.model))
    for index, name in enumerate(("loop", "modes")):
        for box in search.prove(name):
            if file is not None:
                file.save(search.proof())
            if progress is not None:
                progress(round(500 * (index + (box.high - low) / (high - low))), 1000)
    search.bound_crossings()
    if moving:
        search.prove_motion(progress)
    proof = search.proof()
    if file is not None:
        file.save(proof, finished=True)
    data = schedule_data(search.statement(), moving)
    for name, boxes in search.boxes.items():
        data[name]["boxes"] = len(boxes)
    return replace(proof, data=data | search.data())


class ScheduleSearch:
    """Search for the proof of a loop on an interval of scheduling values.

    family: aircraft and its trims
    loop: controller and actuators
    low, high: ends of the interval
    """

    def __init__(self, family: Family, loop: Loop, low: float, high: float) -> None:
        self.family = family
        self.loop = loop
        self.segments = loop.segments(low, high)
        self.low = low
        self.high = high
        measured = loop.controller.outputs(family.model)
        self.trims = TrimSearch(family, low, high, measured)
        self.size = loop_size(family.model, loop.controller, loop.actuators)
        self.boxes: dict[str, list[ProvedBox]] = {"loop": [], "modes": []}
        self.scheduled_rate: float | None = None
        self.motion: Content | None = None

    def prove(self, name: str) -> Iterator[Box]:
        """Prove the number of unstable modes on boxes, and yield each box, in ascending order.

        A box that is not proved is also yielded. The boxes of an earlier run are not repeated.

        name: "loop" for the closed loop, "modes" for the aircraft
        """
        prove = self._prove_loop if name == "loop" else self._prove_modes
        narrowest = NARROWEST_WITH_ERRORS if self.family.spread else NARROWEST
        if name == "loop" and isinstance(self.loop.actuators, UncertainActuators):
            narrowest = NARROWEST_WITH_ACTUATORS
        start = max([self.low, *(proved.box.high for proved in self.boxes[name])])
        for box, proved in bisected(self.segments, prove, narrowest * self.family.step, start):
            if proved is not None:
                self.boxes[name].append(proved)
            yield box

    def _prove_loop(self, box: Box) -> ProvedBox | None:
        """Return a box with the proved number of unstable modes of the loop, or None.

        The result is None if no number is proved. A stable loop is proved with a decay rate, or
        with Lyapunov functions if the actuators are uncertain.

        Raises BadInputError if the matrix of the loop overflows.
        """
        linear = self.linear_model(box)
        if isinstance(self.loop.actuators, UncertainActuators):
            pieces = find_pieces(linear, self.family.model, self.loop)
            if not pieces:
                return None
            proof = {"pieces": [vars(piece) for piece in pieces]}
            return ProvedBox(box, 0, 0, 0.0, trim_content(linear.trim) | proof)
        form = self.closed_loop(box)
        middle = doubles(form.center)
        if not np.isfinite(middle).all():
            raise BadInputError("the matrix of the loop overflows; check the gains in the table")
        rate = RATE_SHARE * max(0.0, -float(np.linalg.eigvals(middle).real.max()))
        return self._counted(box, form, rate)

    def _prove_modes(self, box: Box) -> ProvedBox | None:
        return self._counted(box, self.linear_model(box).A, 0.0)

    def _counted(self, box: Box, A: TaylorModel, rate: float) -> ProvedBox | None:
        """Return a box with the proved number of eigenvalues with Re λ > -rate, or None.

        The result is None if no number is proved.

        A: Taylor model of the matrix on the box
        rate: 1/s
        """
        proof = find_line(A, rate)
        if proof is None:
            return None
        count, line = proof
        content = trim_content(self.linear_model(box).trim) | vars(line)
        return ProvedBox(box, count, count, rate, content)

    def bound_crossings(self) -> None:
        """Prove bounds on the aircraft's number of unstable modes where the number is open."""
        widest = NARROWEST_WITH_ERRORS if self.family.spread else NARROWEST
        counted = [proved.run for proved in self.boxes["modes"]]
        for low, high in _gaps(counted, self.low, self.high):
            pieces = math.ceil((high - low) / (widest * self.family.step))
            for ends in pairwise(np.linspace(low, high, pieces + 1).tolist()):
                self._bound(Box(*ends))

    def _bound(self, box: Box) -> None:
        with suppress(Undecided, Rejected):
            linear = self.linear_model(box)
            for line in lines_near_axis(linear.A):
                least, most = least_and_most(linear.A, line)
                content = trim_content(linear.trim) | vars(line)
                self.boxes["modes"].append(ProvedBox(box, least, most, line.rate, content))

    def prove_motion(self, progress: Progress | None) -> None:
        """Store the largest rate at which stability is proved, with the proof.

        The rate is that of the scheduling value. Nothing is stored if no rate is proved.
        """
        search = MotionSearch(self)
        for rate in search.suggested_rates():
            boxes = search.boxes(rate, progress)
            if boxes:
                self.scheduled_rate = rate
                self.motion = {"breakpoints": search.breakpoints, "P": search.P, "boxes": boxes}
                return

    def resume(self, witness: Content) -> None:
        """Append the boxes that an earlier run has proved.

        Boxes on which only bounds of the aircraft's number of unstable modes are proved are
        omitted.

        witness: verified witness of the earlier run
        """
        for name, boxes in self.boxes.items():
            for content in witness.get(name, []):
                box = Box(*content["range"])
                if "pieces" in content:
                    boxes.append(ProvedBox(box, 0, 0, 0.0, content))
                elif name == "loop" or content["rate"] == 0.0:
                    signs = eigenvalue_signs(matrix(content["H"]), matrix(content["turn"]))
                    count = signs.count(-1)
                    boxes.append(ProvedBox(box, count, count, content["rate"], content))

    def statement(self) -> ScheduleStatement:
        """Return the statement that the present boxes prove."""
        decays = [box.rate for box in self.boxes["loop"] if box.most == 0]
        runs = {
            "loop": self._runs("loop", self.size),
            "modes": self._runs("modes", len(self.family.model.linear)),
        }
        return ScheduleStatement(
            replace(self.trims.flight, trims=self._stated_trims()),
            self.loop.controller,
            self.loop.actuators,
            runs["loop"],
            runs["modes"],
            min(decays, default=0.0),
            self.scheduled_rate,
        )

    def proof(self) -> Proof:
        """Return the statement that the present boxes prove, with its witness."""
        witness: Content = {
            name: [proved.content for proved in boxes] for name, boxes in self.boxes.items()
        }
        if self.motion is not None:
            witness["motion"] = self.motion
        return Proof(self.statement(), witness)

    def data(self) -> Content:
        """Return the ranges of A and B on each box, and V for a moving scheduling value."""
        boxes = []
        for proved in self.boxes["loop"]:
            linear = self.linear_model(proved.box)
            entries = {name: _ends(getattr(linear, name)) for name in "AB"}
            boxes.append(breakpoint_data(self.family.model, list(proved.box)) | entries)
        data: Content = {"boxes": boxes}
        if self.motion is not None:
            breakpoints = breakpoint_data(self.family.model, self.motion["breakpoints"])
            data["lyapunov"] = breakpoints | {"P": self.motion["P"]}
        return data

    def linear_model(self, box: Box) -> LinearModelBox:
        """Return the linear model on a box.

        Raises Undecided or Rejected if the box is too wide or a trim may exceed its limits. Raises
        TrimError if no trim exists at the center.
        """
        if self.family.spread and box.high - box.low > _WIDEST_WITH_ERRORS * self.family.step:
            raise Rejected("the parameter errors are enclosed only on narrower boxes")
        return self.trims.linear_model(box)

    def closed_loop(self, box: Box) -> TaylorModel:
        """Return F of the closed loop ζ' = F ζ on a box."""
        linear = self.linear_model(box)
        return closed_loop(linear, self.family.model, self.loop.controller, self.loop.actuators)

    def _runs(self, name: str, size: int) -> tuple[Run, ...]:
        """Return the numbers of unstable modes over the whole interval.

        Where nothing is proved, the bounds are 0 and `size`.

        name: "loop" or "modes"
        size: number of eigenvalues
        """
        proved = [box.run for box in self.boxes[name]]
        ends = {self.low, self.high}
        ends |= {run.low for run in proved} | {run.high for run in proved}
        runs = []
        for low, high in pairwise(sorted(ends)):
            here = [run for run in proved if run.low <= low and high <= run.high]
            least = max((run.least for run in here), default=0)
            most = min((run.most for run in here), default=size)
            runs.append((low, high, (least, most)))
        return tuple(Run(low, high, *bounds) for low, high, bounds in _joined(runs))

    def _stated_trims(self) -> tuple[StatedTrim, ...]:
        """Return the trim at the beginning of each contiguous set of boxes, for the statement."""
        boxes = sorted(proved.box for name in self.boxes for proved in self.boxes[name])
        starts = []
        reached = -math.inf
        for low, high in boxes:
            if low > reached:
                starts.append(low)
            reached = max(reached, high)
        return tuple(self.trims.stated_trim(start) for start in starts)


class MotionSearch:
    """Search for V = ζ'P(η)ζ that decreases on every motion with |η'| up to a limit.

    V' = ζ'(F'P + P F + η' dP/dη)ζ < 0 is proved for η' at both limits, and therefore holds for all
    rates between them. P solves F'P + P F = -W at every breakpoint, with the same W, and is linear
    between breakpoints. V is therefore continuous, and P is as smooth as F even where modes of F
    coincide.

    search: search for the proof of the loop
    """

    def __init__(self, search: ScheduleSearch) -> None:
        self._search = search
        breakpoints = []
        for segment in search.segments:
            pieces = math.ceil((segment.high - segment.low) / (_STEP * search.family.step))
            breakpoints += np.linspace(segment.low, segment.high, pieces + 1)[:-1].tolist()
        self.breakpoints = [*breakpoints, search.high]
        self._boxes = [Box(*ends) for ends in pairwise(self.breakpoints)]
        self.P = np.zeros((0, 0, 0))

    def suggested_rates(self) -> list[float]:
        """Return rates of the scheduling variable to try, the largest first.

        The rates are fractions of the largest rate that a Lyapunov function allows at the centers
        of the boxes. `self.P` stores the P of this function at the ends of the boxes.

        The list is empty in these cases:
        - The loop on a box cannot be enclosed.
        - The loop is not stable at the center of a box.
        - P is not positive definite at an end of a box.
        """
        try:
            loops = [self._search.closed_loop(box) for box in self._boxes]
        except (Undecided, Rejected):
            return []
        points = []
        for box, loop in zip(self._boxes, loops, strict=True):
            slope = doubles(loop.slope) * 2.0 / (box.high - box.low)
            points.append((doubles(loop.center), slope))
        if max(np.linalg.eigvals(A).real.max() for A, _ in points) >= 0.0:
            return []
        fastest, W = _weight([*points[::_STRIDE], points[-1]])
        ends = []
        for loop in loops:
            c0, c1, c2 = (doubles(part) for part in (loop.center, loop.slope, loop.bend))
            ends.append(c0 - c1 + c2)
        ends.append(c0 + c1 + c2)
        self.P = np.array([_lyapunov(A, W) for A in ends])
        if not all(is_positive_definite(matrix(P)) for P in self.P):
            return []
        rates = []
        for share in _SHARES:
            unit = math.floor(math.log10(share * fastest)) - 1  # two digits, rounded down
            rates.append(float(f"{math.floor(share * fastest / 10.0**unit)}e{unit}"))
        return rates

    def boxes(self, rate: float, progress: Progress | None) -> list[Content]:
        """Return the boxes that together prove a rate, as stored in a certificate.

        The list is empty if the rate is not proved on every box.
        """
        narrowest = _NARROWEST_MOVING * self._search.family.step
        proved: list[Content] = []
        for whole in with_progress(self._boxes, progress):
            for _, content in bisected([whole], partial(self._prove, rate), narrowest):
                if content is None:
                    return []
                proved.append(content)
        return proved

    def _prove(self, rate: float, box: Box) -> Content | None:
        loop = self._search.closed_loop(box)
        P = between(np.array(self.breakpoints), self.P, box.low, box.high)
        slope = P.slope * (2 / (arb(box.high) - arb(box.low)))
        half = doubles(-(loop.center.transpose() * P.center))
        try:
            turn = np.linalg.inv(np.linalg.cholesky(half + half.T)).T
        except np.linalg.LinAlgError:
            return None
        check_motion(loop, P, slope * arb(rate), turn)
        return trim_content(self._search.linear_model(box).trim) | {"turn": turn}


def _lyapunov(A: np.ndarray, W: np.ndarray) -> np.ndarray:
    """Return the solution P of A'P + P A = -W."""
    from scipy.linalg import solve_continuous_lyapunov

    P = solve_continuous_lyapunov(A.T, -W)
    return np.asarray((P + P.T) / 2)


def _weight(points: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[float, np.ndarray]:
    """Return the largest rate of the scheduling variable that was found, and its W > 0.

    A rate η' requires W ± η' dP/dη > 0 at all points (A, dA/dη). For the first W, P is a multiple
    of the identity in the modes of the center point. W is then moved, step by step, toward the
    p-norm of |dP/dη| over the points, in units of W. The largest terms have the most weight.

    points: pairs (A, dA/dη) of matrices (n, n)
    """
    W = _first_weight(points[len(points) // 2][0])
    best = (0.0, np.eye(len(W)))
    for _ in range(_TRIES):
        try:
            root = np.linalg.cholesky(W)
        except np.linalg.LinAlgError:
            break
        inverse = np.linalg.inv(root)
        total = np.zeros_like(W)
        largest = 0.0
        for A, slope in points:
            half = _lyapunov(A, W) @ slope
            growth = inverse @ _lyapunov(A, half + half.T) @ inverse.T
            sizes, axes = np.linalg.eigh(growth)
            largest = max(largest, float(np.abs(sizes).max()))
            total += (axes * np.abs(sizes) ** _POWER) @ axes.T
        if 1.0 / largest > best[0]:
            best = (1.0 / largest, W)
        sizes, axes = np.linalg.eigh(total)
        sizes = (sizes / sizes.max()).clip(0.0) ** (1.0 / _POWER)
        W = root @ ((axes * (1.0 + sizes)) @ axes.T) @ root.T / 2
    return best


def _first_weight(A: np.ndarray) -> np.ndarray:
    """Return W (n, n) for which P is a multiple of the identity in the modes of A.

    If the modes are nearly dependent, W is the identity.
    """
    values, vectors = np.linalg.eig(A)
    try:
        inverse = np.linalg.inv(vectors)
        W = (inverse.conj().T @ (-values.real[:, None] * inverse)).real
        np.linalg.cholesky(W)
    except np.linalg.LinAlgError:
        return np.eye(len(A))
    return np.asarray(W)


def _ends(entries: TaylorModel) -> list[list[list[float]]]:
    """Return [lowest, highest] of each entry of a matrix on a box, rounded outward."""
    rows = []
    for row in entries.range().tolist():
        ends = [(float(entry.lower()), float(entry.upper())) for entry in row]
        outward = [
            [float(np.nextafter(low, -np.inf)), float(np.nextafter(high, np.inf))]
            for low, high in ends
        ]
        rows.append(outward)
    return rows


def _joined(runs: Sequence[tuple[float, float, Found]]) -> list[tuple[float, float, Found]]:
    """Return consecutive intervals with results, in which neighbors with equal results are merged.

    runs: (low, high, result), in ascending order
    """
    together: list[tuple[float, float, Found]] = []
    for low, high, result in runs:
        if together:
            begin, end, last = together[-1]
            if (end, last) == (low, result):
                together[-1] = (begin, high, result)
                continue
        together.append((low, high, result))
    return together


def _gaps(runs: Sequence[Run], low: float, high: float) -> list[tuple[float, float]]:
    """Return the intervals (low, high) between `low` and `high` that no run covers, ascending.

    runs: intervals with results, in any order, which may overlap
    """
    empty = []
    reached = low
    for run in sorted(runs):
        if run.low > reached:
            empty.append((reached, run.low))
        reached = max(reached, run.high)
    if reached < high:
        empty.append((reached, high))
    return empty
