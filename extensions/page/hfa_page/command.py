"""The command `hfa report`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hfa.options.advice import trimmed
from hfa.options.argument_types import (
    array_of,
    listed_names,
    option_errors,
    output_file,
    value_range,
)
from hfa.options.command import Outcome, ProgressLine, Request, command, provenance, with_provenance
from hfa.options.conditions import ListedCondition
from hfa.options.games import WeightOptions, given_weights
from hfa.options.parser import PAPER, option, refuse
from hfa.options.plants import loaded_aircraft
from hfa.options.trims import (
    SEVERAL,
    SeveralTrims,
    TrimInput,
    at_name,
    trim_input,
)
from hfa_aircraft.model import Model
from hfa_model import choice
from hfa_model.variants import variant_named
from hfa_page.flights import load_flights
from hfa_page.job_report import computed_sections, critic_picture, main_report, page, plotly_script
from hfa_page.main_job import (
    ASKED,
    MOST_ASKED,
    MOST_SWEPT,
    SWEEP,
    MainJob,
    games_over,
    slider_over,
    values_about,
    without_trim,
)
from hfa_support.errors import BadInputError, NoSolutionError, printable
from hfa_support.files import folder_written_whole, write_text, written_whole
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import jsonable
from trim.hfa.reports import trim_report
from trim.reports.book import Condition
from verification.regeneration import regenerate_all


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportRequest(Request, WeightOptions, SeveralTrims):
    """Options of `hfa report`."""

    at: str | None = option(
        f"values of the scheduling variable shown in detail: {SEVERAL}", "RANGE"
    )
    units: None = None
    row: None = None
    dihedral: str | None = option(
        f"angles shown in detail: {SEVERAL}; default: the printed 5 and 15, degrees",
        "RANGE",
        group=PAPER,
        first=True,
    )
    output: Path | None = option(
        "write one self-contained .html file, or a folder with the page, pictures and numbers "
        "(JSON)",
        "PLACE",
        output_file(".html", folder=True),
        names="-o --output",
    )
    json: bool = option("print the numbers as JSON (radians, feet, pounds)")
    sweep: str | None = option(
        "values of the slider and the root locus; default: dihedral 0:20:0.5, of another aircraft "
        "0.75 to 1.5 of the value at its trim",
        "RANGE",
    )
    outputs: tuple[str, ...] | None = option(
        "outputs for which C and D are added to the page", "NAME,...", listed_names
    )
    flights: Any = option(
        "best_flights.json of studies/best_flights/results, or the folder that "
        "contains the file; adds flights from the paper's x(0)",
        "FILE",
        load_flights,
    )


@command(ReportRequest)
def report(request: ReportRequest) -> Outcome:
    """Write an HTML page with the trims, linear models and games of an aircraft.

    A slider shows trim and linear model at each value of the scheduling variable. Of another
    aircraft than the HFA, the page has a book of its trims or of --conditions, warnings about its
    data, and the games of --Q and --R. Of the HFA, both printed pairs (A, B) are compared with the
    regenerated pairs, and for the angles of --dihedral, the page also shows the printed values, the
    exact game solution and a learned critic. The page contains Plotly (package plotly) and loads
    nothing from a network. Exit code 1 without a trim, if the printed matrices are not regenerated,
    or if a learned critic is wrong.
    """
    place = request.output
    if place is None and not request.json:
        raise BadInputError(
            "no output is chosen; give --output FILE.html, --output FOLDER or --json"
        )
    if request.aircraft is None:
        refuse(request, ["conditions", "delta", "Q", "R", "sizes", "N"], "requires --aircraft")
    if place is not None:
        plotly_script()  # refused before anything is computed if Plotly is missing
    asked = trim_input(request)
    hold = asked.held()
    swept = _swept(request, asked.model, hold)
    job = (_own_job if request.aircraft else _paper_job)(request, asked, swept)
    source = asked.source(asked.common_condition(hold), hold)
    sections = computed_sections(job)
    whole = with_provenance(request, main_report(job, sections), source)
    lines = []
    if place is not None:
        html = page(job, sections, whole, provenance(request, source))
        lines.append(_written(html, whole, place))
    if job.regeneration is None:
        lines.append(f"Trimmed: {job.slider.trimmed} of {len(job.slider.points)}")
    else:
        lines.append(f"Both printed pairs regenerated: {'yes' if job.regeneration.ok else 'NO'}")
        lines.append(
            f"Learned critics agree with the exact game solution: {'yes' if job.learned else 'NO'}"
        )
    return Outcome(
        report=whole,
        ok=job.ok,
        source=source,
        printed=None if request.json else Report("\n".join(lines)),
        is_written=True,
    )


def _swept(request: ReportRequest, model: Model, hold: Mapping[str, Any]) -> np.ndarray | None:
    """Return the values that --sweep gives to the scheduling variable, or None without this option.

    Raises BadInputError for a model without this variable, and if it is held or free.
    """
    by = model.schedule
    if not by:
        raise BadInputError(
            f"{model.name} declares no schedule, the variable of the page's slider; declare it"
        )
    if by in (*request.free, *hold):
        raise BadInputError(
            f"{by} is held or free, but --{at_name(model)} and --sweep define its values in a "
            f"report; remove --hold {by} or --free {by}"
        )
    if request.sweep is None:
        return None
    with option_errors("--sweep"):
        values = value_range(model, by, request.sweep)
    return np.unique(array_of("--sweep", values, MOST_SWEPT))


def _paper_job(request: ReportRequest, asked: TrimInput, swept: np.ndarray | None) -> MainJob:
    """Return the results for the paper's aircraft: both printed pairs (A, B), regenerated at the
    paper's condition, and trims, games and critics at the condition of the options.
    """
    parameters = loaded_aircraft(request).parameters
    assert parameters is not None  # of the paper's aircraft
    aircraft = choice.aircraft(variant_named(request.dynamics or "published"), parameters.values)
    progress = ProgressLine("report")
    progress(0.0, 1.0, "printed pairs")
    regeneration = regenerate_all(aircraft)
    progress(0.05, 1.0, "sweep")  # up to 0.1, where `games_over` begins
    at = np.unique(array_of("--dihedral", asked.at or ASKED, MOST_ASKED)).tolist()
    slider = slider_over(
        aircraft,
        np.union1d(SWEEP if swept is None else swept, at),
        at[0],
        request.outputs,
        asked.common_condition(asked.held()),
        asked.start,
    )
    games = games_over(slider, at, progress)
    return MainJob(
        slider,
        games,
        parameters=parameters,
        regeneration=regeneration,
        flights=request.flights,
    )


def _own_job(request: ReportRequest, asked: TrimInput, swept: np.ndarray | None) -> MainJob:
    """Return the results for another aircraft at the values of --sweep, or about its trim."""
    refuse(request, ["flights"], "has flights of the paper's aircraft; remove it or --aircraft")
    model, hold = asked.model, asked.held()
    at = None if asked.at is None else np.unique(array_of("--at", asked.at, MOST_ASKED))
    # Values without --at or --sweep follow from a trim: that of the model's default condition or,
    # with --at, that at its first value.
    if at is None or swept is None:
        point = trimmed(asked.trim(None if at is None else float(at[0]), hold))
        swept = values_about(point) if swept is None else swept
        at = np.array([point[model.schedule]]) if at is None else at
    slider = slider_over(
        model.with_parameters(**{name: hold[name] for name in model.parameters if name in hold}),
        np.union1d(swept, at),
        float(at[0]),
        request.outputs,
        asked.common_condition(hold),
        asked.start,
    )
    book = [_condition(asked, row) for row in asked.rows]
    games = games_over(slider, at.tolist(), ProgressLine("report"), given_weights(request, model))
    return MainJob(slider, games, book)


def _condition(asked: TrimInput, row: ListedCondition) -> Condition:
    """Return a row of --conditions with its sheet, or with the reason why it has no trim."""
    try:
        point = trimmed(asked.trim_of(row))
    except (BadInputError, NoSolutionError) as error:
        return Condition(row.name, without_trim(str(error)), None)
    return Condition(row.name, trim_report(point), point)


def _written(html: str, report: Report, place: Path) -> str:
    """Write the page, in a folder also pictures and numbers, and return a line with the names."""
    if place.suffix:
        write_text(place, html)
        return f"wrote {printable(place)}"
    pictures = list(report.pictures())
    names = [picture.name for picture in pictures]
    earlier_names = _pictures_of_angles(place / "numbers.json")
    numbers = json.dumps(jsonable(report.data), allow_nan=False) + "\n"
    # A new folder is written whole; in one with files, which may be the user's, each file is.
    has_files = place.exists() and any(place.iterdir())
    with nullcontext(place) if has_files else folder_written_whole(place) as folder:
        for picture in pictures:
            with written_whole(folder / picture.name) as stream:
                stream.write(picture.png)
        write_text(folder / "numbers.json", numbers)
        write_text(folder / "report.html", html)
    for name in earlier_names - {*names}:
        (place / name).unlink(missing_ok=True)
    return f"wrote {printable(place / 'report.html')}, numbers.json, {', '.join(names)}"


def _pictures_of_angles(numbers: Path) -> set[str]:
    """Return the names of the pictures at the angles of an earlier report, or none.

    numbers: its file of numbers, which may not exist
    """
    try:
        data = json.loads(numbers.read_text("utf-8"))
        return {critic_picture(angle["dihedral_deg"]) for angle in data["angles"]}
    except (OSError, ValueError, TypeError, KeyError):
        return set()  # no report, or a file of another program
