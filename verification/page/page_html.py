"""The page: one HTML file with its style, its data and Plotly's script in it; nothing is loaded from elsewhere."""

from __future__ import annotations

import base64
import gzip
import html
import json
from dataclasses import replace
from functools import cache
from importlib.resources import files

from hfa_model.provenance import Provenance
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Report
from verification.page.job_report import point_report, verdicts
from verification.page.main_job import MainJob

TITLE = "Highly flexible aircraft: linear models"
_PAPER = (
    'Zhang, Ma, Zhang and Wu, <a href="https://doi.org/10.3390/electronics15173838"><cite>Zero-Sum Game-Based '
    "Practical Predefined-Time Reinforcement Learning for Robust Tracking Control of Highly Flexible Aircraft"
    "</cite></a>, Electronics 2026, 15(17), 3838"
)
#: A browser that follows it loads nothing from any network.
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"


def page(job: MainJob, report: Report, origin: Provenance) -> str:
    """The aircraft with its slider and the verdicts, then the sections of the report, each folded."""
    regenerated = _verdict(job.regeneration.ok, "regenerated", "NOT regenerated")
    agrees = _verdict(job.learned, "agrees", "DOES NOT agree")
    names = html.escape(json.dumps(sorted(picture.name for picture in report.pictures())))
    first, *parts = (part for part in report.parts if isinstance(part, Report))
    parts.append(Report("Provenance", (f"{origin.command}\n{origin.text()}",)))
    sections = "\n".join(_folded(f"part-{number}", part) for number, part in enumerate(parts))
    links = [("any-angle", first.title), *((f"part-{i}", part.title) for i, part in enumerate(parts))]
    contents = "".join(f'<li><a href="#{place}">{html.escape(title)}</a></li>' for place, title in links)
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{TITLE}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<meta name="pictures" content="{names}"><style>{_file("page.css")}</style></head><body><main>
<h1>{TITLE}</h1>
<p>Both pairs of matrices (A, B) that the paper prints are {regenerated} from one set of parameters,
{html.escape(job.sweep.dynamics)} dynamics. The learned critic {agrees} with the exact solution
of the game at {_listed(job)}.
The paper: {_PAPER}.</p>
<nav aria-label="Contents"><ul>{contents}</ul></nav>
{any_angle(job, first)}
{sections}
</main>{plotly_script()}<script type="module">{_file("page.js")}</script></body></html>
"""


def _folded(place: str, part: Report) -> str:
    """A section that a click unfolds; it is unfolded where it is printed, or where a link leads to it."""
    return (
        f'<details id="{place}"><summary><h2>{html.escape(part.title)}</h2></summary>'
        f"<section>{replace(part, title='').html(2)}</section></details>"
    )


def any_angle(job: MainJob, drawn: Report) -> str:
    """The slider over the sweep, its pictures next to the verdicts, and trim and model of the chosen angle."""
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


def _listed(job: MainJob) -> str:
    return html.escape(", ".join(f"{angle.dihedral_deg:g}" for angle in job.angles)) + " deg"


def _file(name: str) -> str:
    return files("verification.page").joinpath(name).read_text(encoding="utf-8")


@cache
def plotly_script() -> str:
    """Plotly's own script, whole, packed to less than half its size, its license in plain text before it.

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
