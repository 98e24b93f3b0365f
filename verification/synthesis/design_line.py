"""Designs on the line through two: how well each follows its commands, and which gusts it stands."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from hfa_model.aircraft import Aircraft
from hfa_support.progress import Progress, told
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, in_degrees
from verification.synthesis.design_evaluation import DesignEvaluation
from verification.synthesis.moving_air import LARGEST
from verification.synthesis.tuning import Evaluation, Tuning
from verification.synthesis.tuning_report import error_name, shown_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = "hfa.design-line/1"
#: Where on the line the designs lie: 0 is the first, 1 the second.
SHARES = tuple(round(-0.2 + 0.1 * k, 1) for k in range(15))


class OnTheLine(NamedTuple):
    """share: place on the line. held: largest peak stood in each gust, ft/s; () where a loop is unstable."""

    share: float
    evaluation: Evaluation
    held: tuple[float, ...]


@dataclass(frozen=True, eq=False, repr=False)
class DesignLine(Reported):
    """The designs at `SHARES` of the way from the start of `tuning` to the one named `toward`, on its flights."""

    tuning: Tuning
    toward: str
    points: tuple[OnTheLine, ...]

    def worst(self, point: OnTheLine) -> tuple[float, float, float, float]:
        """Largest rms error of a case in the first output of the objective; smallest peak held upward and downward,
        ft/s, nan without such a gust; fastest input, rad/s."""
        first = next(iter(self.tuning.objective))
        error = max(errors[first] for errors in point.evaluation.errors)
        signed = [
            (math.copysign(1.0, gust.peak), peak) for gust, peak in zip(self.tuning.gusts, point.held, strict=True)
        ]
        up, down = (min((peak for side, peak in signed if side == sign), default=math.nan) for sign in (1.0, -1.0))
        return error, up, down, max(point.evaluation.rates)

    def report(self) -> Report:
        """A row for each design."""
        first, rows = next(iter(self.tuning.objective)), []
        for point in self.points:
            figures = ["unstable", "", "", ""]
            if point.held:
                error, up, down, rate = self.worst(point)
                figures = [f"{shown_error(error, first):.3f}", f"{up:g}", f"{down:g}", f"{in_degrees(rate):.2f}"]
            rows.append((f"{point.share:g}", *figures))
        header = ("share", f"rms {error_name(first)}", "held up ft/s", "held down ft/s", "rate deg/s")
        return Report(
            f"Designs from that of {self.tuning.name} (share 0) to {self.toward} (share 1): worst error of a case, and "
            f"the gust that is just held ({LARGEST:g} for all that were tried)",
            (Table(header, rows),),
            data={
                "schema": SCHEMA,
                "toward": self.toward,
                "points": [point._asdict() | {"evaluation": point.evaluation._asdict()} for point in self.points],
            },
        )

    def figure(self) -> Figure:
        """The worst error against the updraft held; the line has a gap where a corner or a case is unstable."""
        first = next(iter(self.tuning.objective))
        lost = (math.nan, math.nan)
        places = [self.worst(point)[:2] if point.held else lost for point in self.points]
        shown, peaks = [shown_error(error, first) for error, _ in places], [peak for _, peak in places]
        figure = new_figure(6.0, 4.0)
        axes = figure.subplots()
        axes.plot(shown, peaks, ".-", color="tab:blue")
        for point, error, peak in zip(self.points, shown, peaks, strict=True):
            if point.held:
                axes.annotate(f"{point.share:g}", (error, peak), textcoords="offset points", xytext=(4, 4), fontsize=7)
        axes.set_xlabel(f"largest rms error of a case, {error_name(first)}", fontsize=8)
        axes.set_ylabel("smallest peak of an updraft that is just held, ft/s", fontsize=8)
        axes.grid(alpha=0.3)
        return figure


def between(first: Mapping[str, Any], second: Mapping[str, Any], share: float) -> dict[str, Any]:
    """Entries of the design whose numbers are a^(1 - share) b^share of those of two designs, a and b.

    Where one of them is 0: (1 - share) a + share b, at least 0. What only one design has is left as it is; what is no
    number is that of the first.
    """
    found = copy.deepcopy({**second, **first})
    for name in set(first) & set(second):
        a, b = first[name], second[name]
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            found[name] = between(a, b, share)
        elif all(isinstance(each, (int, float)) and math.isfinite(each) for each in (a, b)) and a != b:
            found[name] = a ** (1.0 - share) * b**share if a and b else max(0.0, (1.0 - share) * a + share * b)
    return found


def design_line(
    aircraft: Aircraft,
    tuning: Tuning,
    toward: str,
    entries: Mapping[str, Any],
    progress: Progress | None = None,
) -> DesignLine:
    """entries: of the design file named `toward`. The flights, gusts and corners are those of the search."""
    evaluation, points = DesignEvaluation(aircraft, tuning), []
    for share in told(SHARES, progress):
        design = between(tuning.start, entries, share)
        found = evaluation.of(design)
        points.append(OnTheLine(share, found, evaluation.held(design) if found.errors else ()))
    return DesignLine(tuning, toward, tuple(points))
