"""Sections and numbers of the page of `hfa report`, and the HTML file of the page.

The file contains its style sheet, the data and Plotly's script. It loads no other file.
"""

from __future__ import annotations

import base64
import gzip
import html
import json
import math
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from importlib.resources import files
from typing import Any, NamedTuple

from hfa_model.parameters import INPUTS, LINEAR_STATES
from hfa_model.published import PublishedModel
from hfa_page.flights import flights_section
from hfa_page.main_job import MainJob, Position, Slider, flight_in_turbulence
from hfa_page.plots import InteractivePlot, pictures_over
from hfa_support.errors import missing_package
from hfa_support.provenance import Provenance
from hfa_support.reporting.parts import Part, Picture
from hfa_support.reporting.report import Report, verdict_text
from hfa_support.reporting.text import TONES, Cell, Table, four_decimals
from trim.hfa.printed import EntryRow, compare, printed_at
from trim.hfa.reports import linear_model_report
from trim.linear.linear_model import LinearModel
from trim.linear.modes import modes_table
from trim.reports.book import Condition, book_of
from trim.reports.first_lines import subject
from trim.reports.linear_report import matrices
from verification.reports import verdict_figure

#: Largest deviations, in half units of the last digit, of all tones but the last: same print, one
#: digit off, at most two digits off.
_MOST_HALF_UNITS = (1.0, 2.0, 3.0)


def printed_comparison_tables(model: LinearModel, published: PublishedModel) -> tuple[Table, ...]:
    """Return tables of A and B with a printed row below each computed row.

    The color of an entry depends on its deviation in half units of the last printed digit.
    """
    entries = iter(compare(model, published))
    tables = []
    for name, columns in (("A", LINEAR_STATES), ("B", INPUTS)):
        lines: list[tuple[str, ...]] = []
        for state in LINEAR_STATES:
            row = [next(entries) for _ in columns]
            lines.append((state, *(_toned(entry) for entry in row)))
            lines.append(("printed", *(four_decimals(entry.printed) for entry in row)))
        tables.append(Table((name, *columns), lines))
    return tuple(tables)


def _toned(entry: EntryRow) -> str:
    """Return the table cell of a computed entry, colored by its deviation from the print."""
    shown = four_decimals(entry.computed)
    if entry.is_zero:
        return shown
    tones = zip(TONES, (*_MOST_HALF_UNITS, math.inf), strict=True)  # from the best to the worst
    return Cell(shown, next(tone for tone, most in tones if abs(entry.half_units) <= most))


_MEANING_OF_COLORS = (
    "Colors of A and B: green entries agree (within 1 half unit of the last printed digit), yellow "
    "entries are one off (2 half units), violet at most 3 half units, red more. The table of "
    "entries lists the half units."
)
_TITLE = "Highly flexible aircraft: linear models"
_PAPER = (
    'Zhang, Ma, Zhang and Wu, <a href="https://doi.org/10.3390/electronics15173838"><cite>'
    "Zero-Sum Game-Based Practical Predefined-Time Reinforcement Learning for Robust Tracking "
    "Control of Highly Flexible Aircraft</cite></a>, Electronics 2026, 15(17), 3838"
)
#: Content security policy: the browser loads nothing from a network.
_SECURITY_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
)


class Sections(NamedTuple):
    """Sections of the page.

    of_slider: pictures that follow the slider
    in_air: the flight of the paper's aircraft in turbulence at the first requested angle, or ()
    angles: model, game and critic at each requested value
    others: modes; of the paper's aircraft the comparison with the print, the meanings of the checks
        and the parameters; of another one the book and the warnings, whose data the page has
    """

    of_slider: Report
    in_air: tuple[Report, ...]
    angles: tuple[Report, ...]
    others: tuple[Report, ...]


def computed_sections(job: MainJob) -> Sections:
    """Return the sections of the page. A flight of the paper's aircraft is simulated for one of
    them.
    """
    swept = job.slider.sweep.report()
    tables = [part for part in swept.parts if not isinstance(part, Picture)]
    modes = Report(f"Modes over {job.slider.sweep.model.schedule}", (replace(swept, parts=tables),))
    of_slider = Report(subject(job.slider.sweep.model), pictures_over(job.slider))
    angles = tuple(angle_report(angle) for angle in job.angles)
    if job.regeneration is None or job.parameters is None:
        conditions = job.book or [
            Condition(position.label, position.report, position.point)
            for position in job.slider.points
        ]
        others = (_book(conditions, with_sheets=bool(job.book)), _warnings(conditions), modes)
        return Sections(of_slider, (), angles, others)
    meanings = tomllib.loads(_file("glosses.toml"))
    return Sections(
        of_slider,
        in_air=tuple(flight_in_turbulence(angle) for angle in job.angles[:1]),
        angles=angles,
        others=(
            Report("Every entry compared with the printed one", (job.regeneration.picture(),)),
            Report("Checks", (Table(("check", "what it says"), tuple(meanings.items())),)),
            modes,
            Report("The aircraft", (job.parameters.report(),)),
        ),
    )


def _book(conditions: Sequence[Condition], *, with_sheets: bool) -> Report:
    """Return the section with the table of conditions and its figure.

    with_sheets: whether to add the sheets, each the report of a condition, because the slider does
        not show these conditions
    """
    points = [condition.point for condition in conditions if condition.point is not None]
    if not points:
        return Report("Book", ("No condition has a trim.",), data={"book": {}})
    # The page has a title, a cover and data of its own: the book gets an empty overview and head.
    whole = book_of(Report(""), conditions, points[0].model, head={})
    parts = [part for part in whole.parts if with_sheets or not isinstance(part, Report)]
    sheets = [condition.report.data for condition in conditions]
    return Report("Book", parts, data={"book": {"sheets": sheets}})


def _warnings(conditions: Sequence[Condition]) -> Report:
    """Return the section with the warnings about trims and data, and the conditions with each."""
    at: dict[str, list[str]] = {}
    for number, condition in enumerate(conditions, start=1):
        for row in condition.report.sheet:
            if row.name == "warnings":
                at.setdefault(str(row.value), []).append(condition.name or str(number))
    rows = [(warning, ", ".join(names)) for warning, names in at.items()]
    found = Table(("warning", "at"), rows) if rows else "No check of the data finds a warning."
    return Report("Warnings", (found,), data={"warnings": at})


def main_report(job: MainJob, sections: Sections) -> Report:
    """Return the report of all results on the page. The data of the report contain every number."""
    data: dict[str, Any] = {
        "schema": "hfa.report/1",
        "ok": job.ok,
        "sweep": job.slider.sweep.report().data,
        "angles": [report.data for report in sections.angles],
    }
    if job.regeneration is None:
        for section in sections.others:
            data |= section.data
    else:
        data["regeneration"] = job.regeneration.report().data
        data["critics"] = [
            {"dihedral_deg": report.data["dihedral_deg"], **report.data["critic"]}
            for report in sections.angles
            if "critic" in report.data
        ]
        data["flights"] = None if job.flights is None else job.flights.data
        data["in_turbulence"] = sections.in_air[0].data if sections.in_air else None
    parts = (sections.of_slider, *sections.in_air, *sections.angles, *sections.others)
    return Report("", parts, data=data)


def verdicts(job: MainJob) -> Table:
    """Return a table with the name and the verdict of each check of `hfa report`."""
    pairs = [] if job.regeneration is None else job.regeneration.pairs
    rows: list[tuple[Any, ...]] = [
        (f"printed pair at {pair.published.dihedral_deg:g} deg", verdict_text(pair.ok))
        for pair in sorted(pairs, key=lambda pair: pair.published.dihedral_deg)
    ]
    for angle in job.angles:
        if pairs or angle.solution is not None or angle.reason:  # a game was asked for
            found = "none" if angle.solution is None else "proved"
            rows.append((f"solution of the game at {angle.label}", Cell(found)))
        if pairs:
            rows.append((f"learned critic at {angle.label} exact", verdict_text(angle.ok)))
    values = "angles" if pairs else f"values of {job.slider.sweep.model.schedule}"
    rows.append((f"trimmed of {len(job.slider.points)} {values}", Cell(str(job.slider.trimmed))))
    return Table(("check", "verdict"), rows)


def stored_flights_sections(job: MainJob) -> Sequence[Report]:
    """Return the section on stored flights from the paper's x(0), or none without --flights."""
    if job.flights is None:
        return ()
    linear = {
        point.dihedral_deg: (point.model.A, point.model.B)
        for point in job.slider.points
        if point.model is not None
    }
    return (flights_section(job.flights, linear),)


def critic_picture(degrees: float) -> str:
    """Return the name of the picture of the learned critic at a dihedral angle, deg."""
    return f"critic-{degrees:g}.png"


def angle_report(angle: Position) -> Report:
    """Return the section on a requested value: linear model, game solution and learned critic.

    - Without a linear model, the section contains only the reason.
    - A game solution or critic that was not computed is omitted.

    With a linear model, the data of the section also contain the trim.
    """
    model = angle.model
    aircraft = angle.condition.model
    what = "model, game, critic"
    data: dict[str, Any] = {"dihedral_deg": angle.dihedral_deg}
    # Only the paper's aircraft has options with the name of its scheduling variable, --dihedral.
    if not aircraft.about.names_schedule:
        data = {"scheduled": {aircraft.schedule: angle.value}}
        what = "model" if angle.solution is None else "model, game"
    data["reason"] = angle.reason
    title = f"{aircraft.schedule.capitalize()} {angle.label}: {what}"
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
    data["trim"] = angle.report.data
    for name, report in reports.items():
        data[name] = report.data
    return Report(title, parts, data=data)


class PointReports(NamedTuple):
    """Reports shown at one position of the slider.

    beside: first lines of the trim and modes, beside the drawing
    sheet: the sheet of the trim, in columns
    pair: A and B, which need the whole width
    """

    beside: Report
    sheet: Report
    pair: Report


def point_reports(position: Position) -> PointReports:
    """Return the reports shown at one position of the slider.

    If there is no trim, they contain only the reason.
    """
    title = f"At {position.condition.model.schedule} {position.label}"
    model = position.model
    if model is None:
        none = Report("")
        return PointReports(Report(title, (f"No trim: {position.reason}",)), none, none)
    trim = position.report
    # The entry "data" of the head is the aircraft's file with its digest.
    sheet = replace(trim, title=f"The sheet, of {trim.head['data']}", head={})
    modes = modes_table(model.modes, model.point.model.time_unit, participation=False)
    pair = Report("A and B, in the units of the trim, angles in rad", matrices(model))
    return PointReports(Report(title, (trim.title, modes)), Report("", (sheet,)), pair)


def _model_report(model: LinearModel) -> Report:
    """Return the report of the linear model at an angle, with the printed entries below those of A
    and B if the paper prints them.
    """
    report = linear_model_report(model)
    printed = printed_at(model.point)
    # The paper prints feet; a model in SI units has a native one in feet.
    if printed is None or model.point.model.source.native:
        return report
    A_and_B: tuple[Part, ...] = printed_comparison_tables(model, printed)
    # They replace the tables of A and B, with which the report begins.
    return replace(report, parts=(*A_and_B, _MEANING_OF_COLORS, *report.parts[len(A_and_B) :]))


def page(job: MainJob, sections: Sections, whole: Report, origin: Provenance) -> str:
    """Return the page as HTML: verdict, slider, a table of verdicts, and sections, which are folded
    until the user opens them. The element "pictures" lists the files that a folder has beside it.

    whole: the report of all results (`main_report`)
    origin: provenance, shown as the last section
    """
    names = html.escape(json.dumps(sorted(picture.name for picture in whole.pictures())))
    title = _TITLE
    if job.regeneration is None:
        title = html.escape(f"{sections.of_slider.title}: trims and linear models")
    provenance = Report("Provenance", (f"{origin.command}\n{origin.text()}",))
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_SECURITY_POLICY}">
<meta name="pictures" content="{names}"><style>{_file("page.css")}</style></head><body><main>
<h1>{title}</h1>
<article>{_article(job, sections, provenance)}</article>
</main>{plotly_script()}<script type="module">{_file("page.js")}</script></body></html>
"""


def _article(job: MainJob, sections: Sections, provenance: Report) -> str:
    """Return the page below its heading as HTML: verdict, slider, flights, folded sections."""
    folded = {  # name in links -> section that is folded until the user opens it
        f"part-{number}": section
        for number, section in enumerate((*sections.angles, *sections.others, provenance))
    }
    links = "".join(
        f'<li><a href="#{name}">{html.escape(section.title)}</a></li>'
        for name, section in folded.items()
    )
    checks = Report("Verdicts, of the angles that they name", (verdicts(job),)).html(3)
    flights = (*stored_flights_sections(job), *sections.in_air)
    parts = [
        f'{verdict_sentence(job)}<nav aria-label="Contents"><ul>{links}</ul></nav>',
        slider_html(
            job.slider, sections.of_slider, f'<section class="verdicts">{checks}</section>'
        ),
        *(f"<section>{section.html(3)}</section>" for section in flights),
        *([] if job.regeneration is None else [f'<p class="paper">The paper: {_PAPER}.</p>']),
        *(
            f'<details id="{name}"><summary><h2>{html.escape(section.title)}</h2></summary>'
            f"<section>{replace(section, title='').html(2)}</section></details>"
            for name, section in folded.items()
        ),
    ]
    return "\n".join(parts)


def verdict_sentence(job: MainJob) -> str:
    """Return the first paragraph of the paper's page as HTML, verdict and checks; "" for another
    aircraft.
    """
    if job.regeneration is None:
        return ""
    regenerated = _toned_word(job.regeneration.ok, "regenerated", "NOT regenerated")
    agrees = _toned_word(job.learned, "agrees", "DOES NOT agree")
    asked = " and ".join(f"{angle.dihedral_deg:g}" for angle in job.angles)
    at = f" at {asked} deg" if job.angles else ""
    return (
        f"<p>hfa: {_toned_word(job.ok, 'PASS', 'FAIL')}. "
        f"Both pairs of matrices (A, B) that the paper prints are {regenerated} from one set of "
        f"parameters ({html.escape(job.slider.sweep.model.name)} dynamics). "
        f"The critic that hfa learns by its own law {agrees} with the exact solution of the "
        f"game{at}.</p>"
    )


def slider_html(slider: Slider, drawn: Report, verdicts: str) -> str:
    """Return the part of the page that follows a slider, as HTML: the aircraft beside its modes,
    the root locus, the sheet and the linear model.

    drawn: the pictures that follow the slider
    verdicts: HTML below the modes
    """
    beside, below = [], []
    for number, position in enumerate(slider.points):
        hidden = "" if number == slider.first else " hidden"
        place = f'data-value="{position.label}"{hidden}'
        shown = point_reports(position)
        beside.append(f'<section class="point" {place}>{shown.beside.html(3)}</section>')
        below.append(f'<section class="point below" {place}>{shown.sheet.html(3)}</section>')
        below.append(f'<section class="point" {place}>{shown.pair.html(3)}</section>')
    # The aircraft is beside the modes or, if nothing of it can be drawn, the root locus.
    plots = [part.html() for part in drawn.parts if isinstance(part, InteractivePlot)]
    beside_modes, others = "".join(plots[:1]), "".join(plots[1:])
    label = slider.points[slider.first].label
    name = html.escape(slider.sweep.model.schedule)
    return f"""<div><h2>{html.escape(drawn.title)}</h2>
<p class="slider"><label for="slider-{name}">{name}</label>
<input type="range" id="slider-{name}" min="0" max="{len(slider.points) - 1}" value="{slider.first}" aria-valuetext="{label}">
<output for="slider-{name}">{label}</output> <span class="noscript">The slider needs scripts.</span></p>
<div class="first"><div>{beside_modes}</div><div>{"".join(beside)}{verdicts}</div></div>
{others}
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


def _toned_word(ok: bool, yes: str, no: str) -> str:
    """Return the word for a verdict as HTML, green or red."""
    return f'<strong class="good">{yes}</strong>' if ok else f'<strong class="bad">{no}</strong>'
