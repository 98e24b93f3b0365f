"""Sections and numbers of the page of `hfa report`, and the HTML file of the page.

The file contains its style sheet, the data and Plotly's script. It loads no other file.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, partial
from importlib.resources import files
from typing import Any, NamedTuple

from hfa_page.compared_with_print import printed_comparison_tables
from hfa_page.flights import flights_section
from hfa_page.main_job import MainJob, Position, Slider
from hfa_page.plots import InteractivePlot, pictures_over
from hfa_page.turbulence import flight_in_turbulence
from hfa_support.errors import missing_package
from hfa_support.provenance import Provenance
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.parts import Part, Picture
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Cell, Table
from trim.hfa.printed import printed_at
from trim.hfa.reports import linear_model_report, trim_report
from trim.linear.linear_model import LinearModel
from trim.linear.modes import modes_table
from trim.reports.first_lines import subject
from trim.reports.linear_report import matrices, units_in_words
from verification.figures import verdict_figure

_COLORS = (
    "Colors of A and B: green entries agree (within 1 half unit of the last printed digit), yellow "
    "entries are one off (2 half units), violet at most 3 half units, red more. The table of "
    "entries lists the half units."
)
TITLE = "Highly flexible aircraft: linear models"
_PAPER = (
    'Zhang, Ma, Zhang and Wu, <a href="https://doi.org/10.3390/electronics15173838"><cite>'
    "Zero-Sum Game-Based Practical Predefined-Time Reinforcement Learning for Robust Tracking "
    "Control of Highly Flexible Aircraft</cite></a>, Electronics 2026, 15(17), 3838"
)
#: Content security policy: the browser loads nothing from a network.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)


class Sections(NamedTuple):
    """Sections of the page.

    of_sliders: pictures of each aircraft that follow its slider
    in_air: the flight in turbulence at the first requested angle
    angles: model, game and critic at each requested angle
    others: comparison with the print, meanings of the checks, modes, and the aircraft
    """

    of_sliders: tuple[Report, ...]
    in_air: tuple[Report, ...]
    angles: tuple[Report, ...]
    others: tuple[Report, ...]


def sections_of(job: MainJob) -> Sections:
    """Return the sections of the page, with a flight that is simulated for it."""
    swept = job.slider.sweep.report()
    tables = [part for part in swept.parts if not isinstance(part, Picture)]
    return Sections(
        of_sliders=tuple(
            Report(subject(slider.sweep.model), pictures_over(slider)) for slider in job.sliders
        ),
        in_air=tuple(flight_in_turbulence(angle) for angle in job.angles[:1]),
        angles=tuple(angle_report(angle) for angle in job.angles),
        others=(
            Report("Every entry compared with the printed one", (job.regeneration.picture(),)),
            Report("Checks", (check_meanings(),)),
            Report("Modes over the dihedral angle", (replace(swept, parts=tables),)),
            Report("The aircraft", (job.parameters.report(),)),
        ),
    )


def main_report(job: MainJob, sections: Sections) -> Report:
    """Return the report of all results on the page. The data of the report contain every number."""
    of_sliders, in_air, angles, others = sections
    critics = [
        {"dihedral_deg": report.data["dihedral_deg"], **report.data["critic"]}
        for report in angles
        if "critic" in report.data
    ]
    return Report(
        title="",
        parts=(*of_sliders, *in_air, *angles, *others),
        data={
            "schema": "hfa.report/1",
            "ok": job.ok,
            "regeneration": job.regeneration.report().data,
            "sweep": job.slider.sweep.report().data,
            "critics": critics,
            "angles": [report.data for report in angles],
            "flights": None if job.flights is None else job.flights.data,
            "in_turbulence": in_air[0].data if in_air else None,
            "beside": None if job.beside is None else _first_trim(job.beside),
        },
    )


def _first_trim(slider: Slider) -> Mapping[str, Any] | None:
    """Return the data of the trim that is shown first, or None without it."""
    model = slider.points[slider.first].model
    return None if model is None else model.point.report().data


def check_meanings() -> Table:
    """Return a table with the name and the meaning of each check on the page."""
    return Table(("check", "what it says"), tuple(tomllib.loads(_file("glosses.toml")).items()))


def verdicts(job: MainJob) -> Table:
    """Return a table with the name and the verdict of each check of `hfa report`."""
    rows: list[tuple[Any, ...]] = [
        (f"printed pair at {pair.published.dihedral_deg:g} deg", verdict_text(pair.ok))
        for pair in sorted(job.regeneration.pairs, key=lambda pair: pair.published.dihedral_deg)
    ]
    for angle in job.angles:
        at = f"{angle.dihedral_deg:g} deg"
        rows.append((f"game at {at} certified", verdict_text(angle.solution is not None)))
        rows.append((f"learned critic at {at} exact", verdict_text(angle.ok)))
    trimmed = int(job.slider.sweep.trimmed.sum())
    rows.append((f"trimmed of {len(job.slider.points)} angles", Cell(str(trimmed))))
    return Table(("check", "verdict"), rows)


def stored_flights_section(job: MainJob) -> Report | None:
    """Return the section on stored flights from the paper's x(0), or None if none are stored."""
    if job.flights is None:
        return None
    linear = {
        point.dihedral_deg: (point.model.A, point.model.B)
        for point in job.slider.points
        if point.model is not None
    }
    return flights_section(job.flights, linear)


def critic_picture(degrees: float) -> str:
    """Return the name of the picture of the learned critic at a dihedral angle, deg."""
    return f"critic-{degrees:g}.png"


def angle_report(angle: Position) -> Report:
    """Return the section on a requested angle: linear model, game solution and learned critic.

    - Without a linear model, the section contains only the reason.
    - A game solution or critic that was not computed is omitted.

    With a linear model, the data of the section also contain the trim.
    """
    model = angle.model
    data: dict[str, Any] = {"dihedral_deg": angle.dihedral_deg, "reason": angle.reason}
    title = f"Dihedral {angle.dihedral_deg:.6g} deg: model, game, critic"
    if model is None:
        return Report(title, (f"No trim: {angle.reason}",), data=data)
    reports = {"model": _model_report(model)}
    if angle.solution is not None:
        reports["solution"] = angle.solution.report()
    if angle.check is not None:
        judged = angle.check.report()
        picture = Picture(
            critic_picture(angle.dihedral_deg),
            f"P learned, P exact and their difference at {angle.dihedral_deg:g} deg",
            partial(verdict_figure, angle.check),
        )
        reports["critic"] = replace(judged, parts=(*judged.parts, picture))
    parts: list[Part] = list(reports.values())
    if angle.reason:
        parts.append(f"No game solution: {angle.reason}")
    data["trim"] = trim_report(model.point).data
    for name, report in reports.items():
        data[name] = report.data
    return Report(title, parts, data=data)


class PointReports(NamedTuple):
    """Reports shown at one position of the slider.

    beside: first lines of the trim and modes, beside the drawing
    below: the sheet of the trim, A and B
    """

    beside: Report
    below: Report


def point_reports(position: Position) -> PointReports:
    """Return the reports shown at one position of the slider.

    If there is no trim, they contain only the reason.
    """
    title = f"At {position.condition.model.schedule} {position.label}"
    model = position.model
    if model is None:
        return PointReports(Report(title, (f"No trim: {position.reason}",)), Report(""))
    trim = trim_report(model.point)
    sheet = replace(trim, title=f"The sheet, of {trim.head['data']}", head={})
    modes = modes_table(model.modes, model.point.model.time_unit, participation=False)
    pair = Report(f"A and B, in {units_in_words(model)}", matrices(model))
    return PointReports(
        Report(title, (trim.title, modes)),
        Report("", (sheet, pair)),
    )


def _model_report(model: LinearModel) -> Report:
    """Return the report of the linear model at an angle."""
    report = linear_model_report(model)
    printed = printed_at(model.point)
    if printed is None or model.point.model.is_converted:  # printed values are in feet
        return report
    beside: tuple[Part, ...] = printed_comparison_tables(model, printed)
    return replace(report, parts=(*beside, _COLORS, *report.parts[len(beside) :]))


def page(job: MainJob, sections: Sections, origin: Provenance) -> str:
    """Return the page as HTML: a tab for each aircraft, with its slider; on that of the paper's
    aircraft the verdict, a table of verdicts, and sections, which are folded until the user opens
    them.

    origin: provenance, shown as the last section
    """
    pictures = main_report(job, sections).pictures()
    names = html.escape(json.dumps(sorted(picture.name for picture in pictures)))
    of_sliders = dict(zip(job.sliders, sections.of_sliders, strict=True))
    links = "".join(_link(slider.key, drawn.title) for slider, drawn in of_sliders.items())
    tabs = f'<nav aria-label="Aircraft" class="tabs"><ul>{links}</ul></nav>'
    provenance = Report("Provenance", (f"{origin.command}\n{origin.text()}",))
    article_of = {job.slider.key: _paper_article(job, sections, of_sliders[job.slider], provenance)}
    if job.beside is not None:
        article_of[job.beside.key] = slider_html(job.beside, of_sliders[job.beside])
    shown = "\n".join(f'<article id="{key}">{text}</article>' for key, text in article_of.items())
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{TITLE}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<meta name="pictures" content="{names}"><style>{_file("page.css")}</style></head><body><main>
<h1>{TITLE}</h1>
{tabs if job.beside else ""}
{shown}
</main>{plotly_script()}<script type="module">{_file("page.js")}</script></body></html>
"""


def _paper_article(job: MainJob, sections: Sections, drawn: Report, provenance: Report) -> str:
    """Return the tab of the paper's aircraft as HTML: verdict, slider, flights, folded sections.

    drawn: the pictures that follow the slider
    """
    folded = {
        f"part-{number}": section
        for number, section in enumerate((*sections.angles, *sections.others, provenance))
    }
    links = "".join(_link(name, section.title) for name, section in folded.items())
    checks = Report("Verdicts", (verdicts(job),)).html(3)
    stored_flights = stored_flights_section(job)
    flights = [*([] if stored_flights is None else [stored_flights]), *sections.in_air]
    parts = [
        f'<p>{verdict_sentence(job)}</p><nav aria-label="Contents"><ul>{links}</ul></nav>',
        slider_html(job.slider, drawn, f'<section class="verdicts">{checks}</section>'),
        *(f"<section>{section.html(3)}</section>" for section in flights),
        f'<p class="paper">The paper: {_PAPER}.</p>',
        *(_folded(name, section) for name, section in folded.items()),
    ]
    return "\n".join(parts)


def verdict_sentence(job: MainJob) -> str:
    """Return the first paragraph of the page as HTML: verdict and checks."""
    regenerated = _toned(job.regeneration.ok, "regenerated", "NOT regenerated")
    agrees = _toned(job.learned, "agrees", "DOES NOT agree")
    asked = " and ".join(f"{angle.dihedral_deg:g}" for angle in job.angles)
    sentences = [f"hfa: {_toned(job.ok, 'PASS', 'FAIL')}."]
    sentences.append(
        f"Both pairs of matrices (A, B) that the paper prints are {regenerated} from one set of "
        f"parameters ({html.escape(job.slider.sweep.model.name)} dynamics)."
    )
    at = f" at {asked} deg" if job.angles else ""
    sentences.append(
        f"The critic that hfa learns by its own law {agrees} with the exact solution of the "
        f"game{at}."
    )
    return " ".join(sentences)


def _link(section: str, title: str) -> str:
    """Return an entry of a list of contents, a link to a section."""
    return f'<li><a href="#{section}">{html.escape(title)}</a></li>'


def _folded(section: str, part: Report) -> str:
    """Return a section of the page as HTML that is folded until the user opens it."""
    return (
        f'<details id="{section}"><summary><h2>{html.escape(part.title)}</h2></summary>'
        f"<section>{replace(part, title='').html(2)}</section></details>"
    )


def slider_html(slider: Slider, drawn: Report, verdicts: str = "") -> str:
    """Return the part of the page that follows a slider, as HTML: the aircraft beside its modes, the
    root locus, the sheet and the linear model.

    drawn: the pictures that follow the slider
    verdicts: HTML below the modes
    """
    beside, below = [], []
    for number, point in enumerate(slider.points):
        hidden = "" if number == slider.first else " hidden"
        place = f'data-value="{point.label}"{hidden}'
        shown = point_reports(point)
        beside.append(f'<section class="point" {place}>{shown.beside.html(3)}</section>')
        below.append(f'<section class="point below" {place}>{shown.below.html(3)}</section>')
    plots = [part.html() for part in drawn.parts if isinstance(part, InteractivePlot)]
    aircraft = "".join(plots[:1])
    locus = "".join(plots[1:])
    label = slider.points[slider.first].label
    name = html.escape(slider.sweep.variables[-1])
    return f"""<div><h2>{html.escape(drawn.title)}</h2>
<p class="slider"><label for="{slider.key}-{name}">{name}</label>
<input type="range" id="{slider.key}-{name}" min="0" max="{len(slider.points) - 1}" value="{slider.first}" aria-valuetext="{label}">
<output for="{slider.key}-{name}">{label}</output> <span class="noscript">The slider needs scripts.</span></p>
<div class="first"><div>{aircraft}</div><div>{"".join(beside)}{verdicts}</div></div>
{locus}
{"".join(below)}</div>"""


def _file(name: str) -> str:
    """Return the text of a file of this package."""
    return files("hfa_page").joinpath(name).read_text(encoding="utf-8")


@cache
def plotly_script() -> str:
    """Return an HTML script element with Plotly's script, after its license as an HTML comment.

    The script is compressed. Raises BadInputError if Plotly is not installed.
    """
    try:
        from plotly.offline import get_plotlyjs
    except ImportError as error:
        raise missing_package("a page requires", "plotly") from error
    text = str(get_plotlyjs())
    packed = base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode()
    license_ = text.partition("*/")[0].removeprefix("/**")
    return f'<!--{license_}--><script type="text/plain" id="plotly">{packed}</script>'


def _toned(ok: bool, yes: str, no: str) -> str:
    """Return the word for a verdict as HTML, green or red."""
    return f'<strong class="good">{yes}</strong>' if ok else f'<strong class="bad">{no}</strong>'
