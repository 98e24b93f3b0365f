"""For every place of an interval: the trim exists, so many modes are unstable, the scheduled gain stabilizes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from controller.policy.gain_table import GainTable
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress
from hfa_support.reporting.fields import Shown
from verification.arithmetic.ball_function import Undecided
from verification.arithmetic.balls import doubles
from verification.enclosures.eigenvalue_signs import counted
from verification.enclosures.place_box import PlaceBox, bisected
from verification.enclosures.trim_branch import Family, ModelForms, TrimBranch
from verification.proof.scheduled_loop import LoopTable, closed_loop, segments
from verification.proof.stated_model import StatedModel, stated
from verification.proof.uncertain_loop import proved_pieces

Found = TypeVar("Found")
#: Low and high place, and a number of unstable modes.
Run = tuple[float, float, int]

#: Narrower boxes, in steps of the family, are not tried: they stay open. With errors of the parameters or actuators,
#: which do not become smaller with the box, one gives up earlier.
NARROWEST, NARROWEST_WITH_ERRORS, NARROWEST_WITH_ACTUATORS = 2.0**-10, 2.0**-5, 2.0**-3
#: The part of the middle's decay rate that is claimed for the whole box.
RATE_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class ProvedBox:
    """On every place of the box `unstable` eigenvalues have Re λ > -rate, and none Re λ = -rate (1/s).

    proof: H, turn: (n, n), what proves it, in which coordinates (`eigenvalue_signs.py`); of a loop with uncertain
    actuators `pieces` of the bandwidth. model: the trims and the linear model that the box was proved with.
    """

    box: PlaceBox
    unstable: int
    rate: float
    proof: dict[str, Any]
    model: StatedModel


@dataclass(frozen=True, eq=False)
class Cover:
    """What is proved of an interval, box by box in increasing order, and what stays open."""

    proved: tuple[ProvedBox, ...]
    open: tuple[PlaceBox, ...]

    def frontier(self, low: float) -> float:
        """Up to which place everything from `low` on is proved or known to stay open."""
        return max([low, *(each.box.high for each in self.proved), *(each.high for each in self.open)])

    @property
    def runs(self) -> list[Run]:
        """Low, high and the number of unstable modes of every proved box."""
        return [(each.box.low, each.box.high, each.unstable) for each in self.proved]

    @property
    def counts(self) -> list[Run]:
        """Neighbouring boxes with the same number of unstable modes, joined."""
        return joined(self.runs)

    @property
    def gaps(self) -> list[tuple[float, float]]:
        """The open boxes, neighbours joined."""
        return [run[:2] for run in joined([(each.low, each.high, 0) for each in self.open])]


def joined(runs: list[tuple[float, float, Found]]) -> list[tuple[float, float, Found]]:
    """Low, high and what was found, such as a number: neighbours of which the same was found are one."""
    together: list[tuple[float, float, Found]] = []
    for low, high, found in runs:
        if together and together[-1][1:] == (low, found):
            together[-1] = (together[-1][0], high, found)
        else:
            together.append((low, high, found))
    return together


def gaps(runs: list[Run], low: float, high: float) -> list[tuple[float, float]]:
    """What the runs leave of the interval from low to high."""
    ends = [low, *(end for run in sorted(runs) for end in run[:2]), high]
    return [(a, b) for a, b in zip(ends[::2], ends[1::2], strict=True) if a < b]


def crossings(
    covers: dict[str, list[Run]], low: float, high: float, states: int
) -> list[tuple[float, float, tuple[int, int]]]:
    """Where `modes` of A are not counted: low, high, and the `least` and the `most` that are proved to be unstable."""
    cuts = sorted({end for name in ("least", "most") for run in covers[name] for end in run[:2]})
    found = []
    for first, last in gaps(covers["modes"], low, high):
        for a, b in pairwise([first, *(cut for cut in cuts if first < cut < last), last]):
            least, most = ([n for c, d, n in covers[name] if c <= a and b <= d] for name in ("least", "most"))
            found.append((a, b, (max(least, default=0), min(most, default=states))))
    return joined(found)


@dataclass(frozen=True, eq=False, repr=False)
class ScheduleProof(Shown):
    """Trims, unstable modes of A and of the loop A - B K over an interval of places.

    bounds: what proves the least and the most unstable modes of A where they are not counted: so many lie right of a
    line that lies right, or left, of the axis.
    """

    family: Family
    table: LoopTable
    low: float
    high: float
    loop: Cover
    modes: Cover
    bounds: tuple[list[ProvedBox], list[ProvedBox]]

    @property
    def covers(self) -> dict[str, list[Run]]:
        """What is proved of the loop, of the modes of A, and their least and greatest number."""
        least, most = ([(each.box.low, each.box.high, each.unstable) for each in found] for found in self.bounds)
        return {"loop": self.loop.runs, "modes": self.modes.runs, "least": least, "most": most}

    @property
    def crossings(self) -> list[tuple[float, float, tuple[int, int]]]:
        """Where the modes of A are not counted: low and high, the least and the most that may be unstable."""
        return crossings(self.covers, self.low, self.high, len(self.family.model.linear))

    @property
    def refuted(self) -> list[Run]:
        """Where the loop is proved unstable: low, high, number of unstable modes."""
        return [run for run in self.loop.counts if run[2] > 0]

    @property
    def proved(self) -> bool:
        """The trim exists and the loop is Hurwitz at every place; the modes are counted up to where they change."""
        return not self.loop.open and not self.refuted

    @property
    def rate(self) -> float:
        """Proved decay rate of the loop where it is Hurwitz, 1/s."""
        return min((each.rate for each in self.loop.proved if each.unstable == 0), default=0.0)


def prove_schedule(
    family: Family,
    table: GainTable | LoopTable,
    low: float,
    high: float,
    *,
    known: tuple[Cover, Cover] | None = None,
    save: Callable[[Cover, Cover], None] | None = None,
    progress: Progress | None = None,
) -> ScheduleProof:
    """Prove or refute, box by box.

    known: loop and modes as an earlier run left them. save: called after each box with what there is so far.
    Raises NoSolutionError where a place has no trim, BadInputError when the table or the model does not reach.
    """
    branch, table = TrimBranch(family), LoopTable.of(table)
    segments(table, low, high)

    @lru_cache(maxsize=64)
    def forms(box: PlaceBox) -> ModelForms:
        found = branch.forms(box)
        beyond = branch.beyond_limits(found)
        if beyond is not None:
            raise Undecided(f"{beyond} may lie beyond its limits")
        return found

    narrowest = [NARROWEST_WITH_ERRORS if family.spread else NARROWEST] * 2
    if table.actuators is not None:
        narrowest[0] = NARROWEST_WITH_ACTUATORS
    covers = list(known or (Cover((), ()), Cover((), ())))
    proofs: tuple[Callable[[PlaceBox], ProvedBox | None], ...] = (
        lambda box: _prove(forms(box), table, family),
        lambda box: _prove(forms(box), None, family),
    )
    for index, prove in enumerate(proofs):
        for found in _covered(covers[index], segments(table, low, high), prove, narrowest[index] * family.step):
            covers[index] = found
            if save is not None:
                save(*covers)
            if progress is not None:
                progress(round(500 * (index + (found.frontier(low) - low) / (high - low))), 1000)

    bounds = ([_bound(forms, box, family, side) for box in covers[1].open] for side in (1, -1))
    least, most = ([each for each in found if each is not None] for found in bounds)
    return ScheduleProof(family, table, low, high, covers[0], covers[1], (least, most))


def _covered(
    found: Cover,
    segments: list[PlaceBox],
    prove: Callable[[PlaceBox], ProvedBox | None],
    narrowest: float,
) -> Iterator[Cover]:
    """What is covered so far, after each box; covered parts are passed over."""
    for box, proved in bisected(segments, prove, narrowest, found.frontier(segments[0].low)):
        if proved is not None:
            found = Cover((*found.proved, proved), found.open)
        else:
            found = Cover(found.proved, (*found.open, box))
        yield found


def _bound(forms: Callable[[PlaceBox], ModelForms], box: PlaceBox, family: Family, side: int) -> ProvedBox | None:
    """How many modes of A lie right of the first line, on a side of the axis, 1 or -1, that is proved to have none."""
    try:
        model = forms(box)
    except Undecided:
        return None
    values = sorted(np.linalg.eigvals(doubles(model.A.parts[0])).real.tolist())
    lines = [(a + b) / 2 for a, b in pairwise(values) if b > a and side * (a + b) > 0.0]
    for line in sorted(lines, key=abs):
        found = counted(model.A, -line)
        if found is not None:
            return ProvedBox(box, found.unstable, -line, {"H": found.H, "turn": found.turn}, stated(model, family))
    return None


def _prove(model: ModelForms, table: LoopTable | None, family: Family) -> ProvedBox | None:
    """The loop of a table on a box, or without one A."""
    if table is not None and table.actuators is not None:
        pieces = proved_pieces(table, model)
        own = {"pieces": [each._asdict() for each in pieces or ()]}
        return None if pieces is None else ProvedBox(model.box, 0, 0.0, own, stated(model, family))
    form, rate = model.A if table is None else closed_loop(table, model), 0.0
    middle = doubles(form.parts[0])
    if not np.isfinite(middle).all():
        raise BadInputError("the loop's entries are too large to compute with; check the gains of the table")
    if table is not None:
        rate = RATE_SHARE * max(0.0, -float(np.linalg.eigvals(middle).real.max()))
    found = counted(form, rate)
    if found is None:
        return None
    return ProvedBox(model.box, found.unstable, rate, {"H": found.H, "turn": found.turn}, stated(model, family))
