"""What a search over a design found, start and best with the constraints, and all that it has seen as a picture."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from hfa_model.vectors import STATE_UNITS, STATES
from hfa_support.reporting.checks import Check, at_least, at_most, checks_block
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, in_degrees
from verification.synthesis.tuning import Evaluation, Tuned, Tuning

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = "hfa.design-search/1"


def tuning_report(tuning: Tuning, found: Tuned) -> Report:
    """Start and best beside each other."""
    variables = [
        (variable.name, f"{first:.6g}", f"{best:.6g}", f"{variable.low:g} to {variable.high:g}")
        for variable, first, best in zip(tuning.variables, found.first, found.best, strict=True)
    ]
    best, checks = found.best_evaluation, tuple(_checks(tuning, found.best_evaluation))
    both = [_figures(tuning, each) for each in (found.first_evaluation, best)]
    names = list(both[1] or both[0])
    rows = [(name, *(f"{each[name]:.4g}" if name in each else "unstable" for each in both)) for name in names]
    flown = (Table(("figure", "start", "best"), rows),) if rows else ()
    return Report(
        f"Search over {len(tuning.variables)} variables of {tuning.name}: cost {found.first_evaluation.cost:.6g} at "
        f"first, {best.cost:.6g} after {len(found.seen)} evaluations",
        (
            Table(("variable", "start", "best", "limits"), variables),
            *flown,
            checks_block(map(_shown, checks)),
        ),
        data={
            "schema": SCHEMA,
            "ok": all(check.ok for check in checks),
            "evaluations": len(found.seen),
            "variables": {
                variable.name: {"start": first, "best": value}
                for variable, first, value in zip(
                    tuning.variables, found.first.tolist(), found.best.tolist(), strict=True
                )
            },
            "start": found.first_evaluation._asdict(),
            "best": best._asdict(),
            "checks": [check.to_dict() for check in checks],
        },
    )


def _figures(tuning: Tuning, found: Evaluation) -> dict[str, float]:
    """Name and unit -> figure of everything that was simulated; empty where a loop is unstable."""
    figures: dict[str, float] = {}
    for number, (errors, rate) in enumerate(zip(found.errors, found.rates, strict=True), 1):
        figures |= {
            f"case {number}, rms {error_name(name)}": shown_error(errors[name], name) for name in tuning.objective
        }
        figures[f"case {number}, rate deg/s"] = math.degrees(rate)
    for number, rms in enumerate(found.rms, 1):
        figures |= {
            f"turbulence {number}, rms {error_name(name)}": shown_error(each, name) for name, each in rms.items()
        }
    figures |= {f"gust {number}, share of the envelope": share for number, share in enumerate(found.gusts, 1)}
    return figures


def _checks(tuning: Tuning, best: Evaluation) -> Iterator[Check]:
    if not best.rates:
        worst = f"a loop has {best.abscissa:.3g} 1/s" if math.isfinite(best.abscissa) else "there is no controller"
        yield at_most("abscissa", best.abscissa, tuning.abscissa, f"{worst}, so nothing was flown")
        return
    yield at_most("abscissa", best.abscissa, tuning.abscissa, f"the worst corner has {best.abscissa:.3g} 1/s")
    rate = max(best.rates)
    yield at_most("rate", rate, tuning.rate, f"an input moves at {math.degrees(rate):.3g} deg/s")
    if tuning.margin:
        yield at_least("margin", best.margin, tuning.margin, f"the smallest disk margin is {best.margin:.3g}")
    if math.isfinite(tuning.fastest):
        yield at_most("fastest", best.fastest, tuning.fastest, f"a loop has a pole of {best.fastest:.4g} 1/s")
    for number, share in enumerate(best.gusts, 1):
        yield at_most(f"gust_{number}", share, 1.0, f"in gust {number} the aircraft leaves its envelope")


def _shown(check: Check) -> Check:
    """For a table, a rate in deg/s."""
    if check.name != "rate":
        return check
    return check._replace(name="rate deg/s", value=math.degrees(check.value), limit=math.degrees(check.limit))


def shown_error(value: float, name: str) -> float:
    """Degrees for angles."""
    return in_degrees(value) if _angle(name) else value


def error_name(name: str) -> str:
    """With deg behind an angle."""
    return f"{name} deg" if _angle(name) else name


def _angle(name: str) -> bool:
    return name in STATES and getattr(STATE_UNITS, name) == "rad"


def trade_off(tuning: Tuning, seen: Sequence[Evaluation]) -> np.ndarray:
    """Largest rms error of a case in the first output of the objective, and largest share of the envelope in a gust
    (without gusts: largest rate, rad/s), of every evaluation that was flown to the end, (N, 2)."""
    first = next(iter(tuning.objective))
    flown = [each for each in seen if each.errors and len(each.gusts) == len(tuning.gusts)]
    worst = [(max(errors[first] for errors in each.errors), max(each.gusts or each.rates)) for each in flown]
    return np.array(worst).reshape(len(flown), 2)


def best_of_both(points: np.ndarray) -> np.ndarray:
    """Those of (N, 2) than which no other is smaller in both, by the first, (k, 2)."""
    ordered = points[np.lexsort(points.T[::-1])]
    lowest = np.minimum.accumulate(ordered[:, 1])
    return ordered[np.append(True, lowest[1:] < lowest[:-1])] if len(ordered) else ordered


def tuning_figure(tuning: Tuning, seen: Sequence[Evaluation]) -> Figure:
    """Every evaluation that was flown to the end, and the line of those that no other beats in both."""
    first = next(iter(tuning.objective))
    points = trade_off(tuning, seen)
    if not tuning.gusts:
        points[:, 1] = np.degrees(points[:, 1])
    points[:, 0] = [shown_error(value, first) for value in points[:, 0]]
    front = best_of_both(points)
    figure = new_figure(6.0, 4.0)
    axes = figure.subplots()
    axes.plot(*points.T, ".", markersize=3, color="tab:gray", label="evaluations flown to the end")
    axes.plot(*front.T, ".-", drawstyle="steps-post", color="tab:blue", label="no other is better in both")
    if tuning.gusts:
        axes.axhline(1.0, linestyle=":", color="black", label="the envelope")
        axes.set_ylim(0.0, 2.0)
    if len(points):
        axes.set_xlim(0.9 * points[:, 0].min(), min(1.05 * points[:, 0].max(), 2.0 * float(np.median(points[:, 0]))))
    axes.set_xlabel(f"largest rms error of a case, {error_name(first)}", fontsize=8)
    axes.set_ylabel("largest share of the envelope in a gust" if tuning.gusts else "fastest surface, deg/s", fontsize=8)
    axes.legend(fontsize=7)
    axes.grid(alpha=0.3)
    return figure
