"""The page of the main job: its sections and every number of it, and the HTML file with style, data
and Plotly's script in it, which loads nothing from elsewhere."""

from __future__ import annotations

import base64
import gzip
import html
import json
from dataclasses import replace
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from controller.riccati.solution_report import solution_report
from hfa_model.provenance import Provenance
from hfa_support.errors import BadInputError
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.report import Part, Picture, Report
from hfa_support.reporting.text import Cell, Table, angle_text
from trim.hfa.hfa_report import trim_report
from trim.hfa.printed import (
    bands_known,
    comparison_table,
    entry_bands,
    matrices_beside_the_print,
    printed_at,
    with_bands,
)
from trim.linear.linear_model import LinearModel, linear_model_report, matrices
from trim.linear.modes import modes_of, modes_table
from verification.critic.figures import verdict_figure
from verification.page.claims import claims_section
from verification.page.main_job import Angle, MainJob
from verification.page.plots import front_view, locus_plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = "hfa.report/1"
_COLORS = (
    "Colors of A and B: green prints the same (within 1 half unit of the last printed digit), yellow is one off "
    "(2 half units), violet at most 3 half units, red more. The table entry by entry has the half units."
)
TITLE = "Highly flexible aircraft: linear models"
_PAPER = (
    'Zhang, Ma, Zhang and Wu, <a href="https://doi.org/10.3390/electronics15173838"><cite>Zero-Sum Game-Based '
    "Practical Predefined-Time Reinforcement Learning for Robust Tracking Control of Highly Flexible Aircraft"
    "</cite></a>, Electronics 2026, 15(17), 3838"
)
#: A browser that follows it loads nothing from any network.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)


def main_report(job: MainJob) -> Report:
    """What the page shows below its slider; data: every number."""
    regeneration, swept = job.regeneration.report(), job.sweep.report()
    angles = [angle_report(job, angle) for angle in job.angles]
    claims = claims_section(job.claims, job.regeneration)
    pictures = front_view(job.aircraft, job.points), locus_plot(job.sweep)
    critics = [
        {"dihedral_deg": each.data["dihedral_deg"], **each.data["critic"]}
        for each in angles
        if "critic" in each.data
    ]
    return Report(
        title="",
        parts=(
            Report("Any dihedral angle", [each for each in pictures if each is not None]),
            *angles,
            claims,
            Report("Every entry against the print", (job.regeneration.picture(),)),
            Report("Modes over the dihedral angle", (swept.without_pictures(),)),
            Report("The aircraft", (job.parameters.report(),)),
        ),
        data={
            "schema": SCHEMA,
            "ok": job.ok,
            "regeneration": regeneration.data,
            "sweep": swept.data,
            "critics": critics,
            "angles": [report.data for report in angles],
            "claims": claims.data or None,
        },
    )


def verdicts(job: MainJob) -> Table:
    """What was checked and what came of it, a row each."""
    rows: list[tuple[Any, ...]] = [
        (f"printed pair at {pair.published.dihedral_deg:g} deg regenerated", verdict_text(pair.ok))
        for pair in job.regeneration.pairs
    ]
    for angle in job.angles:
        at = f"{angle.dihedral_deg:g} deg"
        rows.append(
            (f"exact game solution certified at {at}", verdict_text(angle.solution is not None))
        )
        rows.append(
            (f"learned critic agrees with the exact solution at {at}", verdict_text(angle.ok))
        )
    trimmed = int(job.sweep.trimmed.sum())
    rows.append(
        (f"{trimmed} of {len(job.points)} angles of the sweep trimmed", verdict_text(trimmed > 0))
    )
    if job.claims is not None:
        rows.append(
            (f"claims of Section 5 of the paper: {job.claims.verdicts}", Cell("findings", "near"))
        )
    return Table(("check", "verdict"), rows)


def angle_report(job: MainJob, angle: Angle) -> Report:
    """One asked angle: linear model with the print, game solution, learned critic; the slider shows
    its trim."""
    model, data = angle.model, {"dihedral_deg": angle.dihedral_deg, "reason": angle.reason}
    title = f"Dihedral {angle_text(angle.dihedral)}: model, game, critic"
    if model is None:
        return Report(title, (f"No trim: {angle.reason}",), data=data)
    origin = f"the model at dihedral {angle_text(angle.dihedral)}, {model.point.dynamics} dynamics"
    named = model.states, model.inputs, origin, model.state_units, model.input_units
    shown = {"model": _model_report(job, angle, model)}
    if angle.solution is not None:
        shown["solution"] = solution_report(angle.solution, *named)
    if (check := angle.check) is not None:

        def draw() -> Figure:
            return verdict_figure(check, *named)

        text = f"P learned, P exact and their difference at {angle.dihedral_deg:g} deg; residual and error over time"
        judged, picture = (
            check.report(*named),
            Picture(f"critic-{angle.dihedral_deg:g}.png", text, draw),
        )
        shown["critic"] = replace(judged, parts=(*judged.parts, picture))
    unsolved = [f"No game solution: {angle.reason}"] if angle.reason else []
    trim = trim_report(job.aircraft, angle.condition, model.point)
    data |= {"trim": trim.data} | {name: each.data for name, each in shown.items()}
    return Report(title, (*shown.values(), *unsolved), data=data)


def point_report(job: MainJob, angle: Angle) -> Report:
    """What the slider shows of one angle: trim, modes, A and B."""
    title = f"At dihedral {angle_text(angle.dihedral)}"
    if angle.model is None:
        return Report(title, (f"No trim: {angle.reason}",))
    trim = trim_report(job.aircraft, angle.condition, angle.model.point)
    modes = modes_table(modes_of(angle.model.A, angle.model.states))
    return Report(
        title, (trim, Report("Modes", (modes,)), Report("A and B", matrices(angle.model)))
    )


def _model_report(job: MainJob, angle: Angle, model: LinearModel) -> Report:
    """The linear model; where the paper prints one, with the printed entries below the computed
    ones."""
    bands = (
        entry_bands(job.parameters, angle.condition, model) if bands_known(job.parameters) else None
    )
    report = with_bands(linear_model_report(model), model, bands)
    printed = printed_at(model.point)
    if printed is None or model.point.model.native is not None:  # the print is in feet
        return report
    beside: tuple[Part, ...] = matrices_beside_the_print(model, printed)
    kept = report.parts[len(beside) :]
    return replace(report, parts=(*beside, _COLORS, *kept, comparison_table(model, printed)))


def page(job: MainJob, report: Report, origin: Provenance) -> str:
    """The aircraft with its slider and the verdicts, then the sections of the report, each
    folded."""
    regenerated = _verdict(job.regeneration.ok, "regenerated", "NOT regenerated")
    agrees = _verdict(job.learned, "agrees", "DOES NOT agree")
    asked = ", ".join(f"{angle.dihedral_deg:g}" for angle in job.angles)
    names = html.escape(json.dumps(sorted(picture.name for picture in report.pictures())))
    first, *parts = (part for part in report.parts if isinstance(part, Report))
    parts.append(Report("Provenance", (f"{origin.command}\n{origin.text()}",)))
    sections = "\n".join(_folded(f"part-{number}", part) for number, part in enumerate(parts))
    links = [
        ("any-angle", first.title),
        *((f"part-{i}", part.title) for i, part in enumerate(parts)),
    ]
    contents = "".join(
        f'<li><a href="#{place}">{html.escape(title)}</a></li>' for place, title in links
    )
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{TITLE}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<meta name="pictures" content="{names}"><style>{_file("page.css")}</style></head><body><main>
<h1>{TITLE}</h1>
<p>Both pairs of matrices (A, B) that the paper prints are {regenerated} from one set of parameters,
{html.escape(job.sweep.model.name)} dynamics. The learned critic {agrees} with the exact solution
of the game at {asked} deg.
The paper: {_PAPER}.</p>
<nav aria-label="Contents"><ul>{contents}</ul></nav>
{any_angle(job, first)}
{sections}
</main>{plotly_script()}<script type="module">{_file("page.js")}</script></body></html>
"""


def _folded(place: str, part: Report) -> str:
    """A section that a click unfolds; it is unfolded where it is printed, or where a link leads to
    it."""
    return (
        f'<details id="{place}"><summary><h2>{html.escape(part.title)}</h2></summary>'
        f"<section>{replace(part, title='').html(2)}</section></details>"
    )


def any_angle(job: MainJob, drawn: Report) -> str:
    """The slider over the sweep, its pictures next to the verdicts, and trim and model of the
    chosen angle."""
    shown = [f"{point.dihedral_deg:g} deg" for point in job.points]
    asked = [angle.dihedral_deg for angle in job.angles]
    first = next((i for i, point in enumerate(job.points) if point.dihedral_deg in asked), 0)
    checks = Report("Verdicts", (verdicts(job),)).html(3)
    sections = "\n".join(
        f'<section class="point" data-angle="{label}"{"" if i == first else " hidden"}>'
        f"{point_report(job, point).html(3)}</section>"
        for i, (label, point) in enumerate(zip(shown, job.points, strict=True))
    )
    return f"""<div id="any-angle"><h2>{drawn.title}</h2>
<p class="slider"><label for="dihedral">Dihedral angle</label>
<input type="range" id="dihedral" min="0" max="{len(shown) - 1}" value="{first}" aria-valuetext="{shown[first]}">
<output for="dihedral" id="angle">{shown[first]}</output> <span class="noscript">The slider needs scripts.</span></p>
<div class="first"><div>{"".join(each.html() for each in drawn.pictures())}</div><section>{checks}</section></div>
{sections}</div>"""


def _file(name: str) -> str:
    return files("verification.page").joinpath(name).read_text(encoding="utf-8")


@cache
def plotly_script() -> str:
    """Plotly's own script, whole, packed to less than half its size, its license in plain text
    before it.

    BadInputError when Plotly is not installed.
    """
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise BadInputError("a page needs Plotly; install it with `pip install .[page]`") from error
    text = str(get_plotlyjs())
    packed = base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode()
    license_ = text.partition("*/")[0].removeprefix("/**")
    return f'<!--{license_}--><script type="text/plain" id="plotly">{packed}</script>'


def _verdict(ok: bool, yes: str, no: str) -> str:
    return f'<strong class="good">{yes}</strong>' if ok else f'<strong class="bad">{no}</strong>'
