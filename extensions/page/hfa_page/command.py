"""The command `hfa report`."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from hfa.options.argument_types import listed_names, option_errors, output_file
from hfa.options.command import Outcome, Request, command
from hfa.options.option import option
from hfa.options.output import ProgressLine
from hfa.options.plants import parameter_set
from hfa.options.ranges import array_of, value_range
from hfa.options.show import provenance, with_provenance
from hfa.options.trims import SEVERAL, SeveralTrims, dihedral_option, trim_input
from hfa_aircraft.loading import load_model
from hfa_page.flights import load_flights
from hfa_page.job_report import critic_picture, main_report, page, plotly_script, sections_of
from hfa_page.main_job import (
    ASKED,
    MOST_ASKED,
    MOST_SWEPT,
    SWEEP,
    main_job,
    slider_beside,
)
from hfa_support.errors import BadInputError, printable
from hfa_support.files import write_text
from hfa_support.reporting.data_files import jsonable
from hfa_support.reporting.figure import save
from hfa_support.reporting.report import Report


@dataclass(frozen=True, kw_only=True, eq=False)
class ReportRequest(Request, SeveralTrims):
    """Options of `hfa report`."""

    moved: ClassVar = {"--at": "type --dihedral"}
    aircraft: None = None
    at: None = None
    units: None = None
    mass: None = None
    isa: None = None
    conditions: None = None
    row: None = None
    dihedral: str | None = dihedral_option(
        f"angles shown in detail: {SEVERAL}; default: the printed 5 and 15", "RANGE"
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
        "dihedral angles of the slider and the root locus, degrees; default 0:20:0.5", "RANGE"
    )
    outputs: tuple[str, ...] | None = option(
        "outputs for which C and D are added to the page", "NAME,...", listed_names
    )
    beside: Any = option(
        "another aircraft, whose trims and modes a second tab of the page shows", "FILE", load_model
    )
    flights: Any = option(
        "best_flights.json of studies/best_flights/results, or the folder that "
        "contains the file; adds flights from the paper's x(0)",
        "FILE",
        load_flights,
    )


@command(ReportRequest)
def report(request: ReportRequest) -> Outcome:
    """Write an HTML page with trims, linear models, games and comparisons with the printed
    matrices.

    Both printed pairs (A, B) are compared with the regenerated pairs. A slider shows trim and
    linear model at each dihedral angle. For the angles of --dihedral, the page also shows the
    printed values, the exact game solution and a learned critic. The page contains Plotly
    (package plotly) and loads nothing from a network. Exit code 1 if the printed matrices are not
    regenerated or a learned critic is wrong.
    """
    place = request.output
    if place is None and not request.json:
        raise BadInputError(
            "no output is chosen; give --output FILE.html, --output FOLDER or --json"
        )
    if place is not None:
        plotly_script()  # refused before anything is computed if Plotly is missing
    asked = trim_input(request)
    model = asked.model
    hold = asked.held()
    if "dihedral" in (*request.free, *hold):
        raise BadInputError(
            "dihedral is held or free, but --dihedral and --sweep define the angles of a report; "
            "remove --hold dihedral or --free dihedral"
        )
    angles = array_of("--dihedral", asked.at or ASKED, MOST_ASKED)
    swept = SWEEP
    if request.sweep is not None:
        with option_errors("--sweep"):
            values = value_range(model, model.schedule, request.sweep)
        swept = array_of("--sweep", values, MOST_SWEPT)
    condition = asked.common_condition(hold)
    beside = None if request.beside is None else slider_beside(request.beside)
    job = main_job(
        parameter_set(request),
        request.dynamics or "published",
        asked=np.unique(angles).tolist(),
        swept=np.unique(swept),
        outputs=request.outputs,
        flight=condition,
        start=asked.start,
        progress=ProgressLine("report"),
    )
    job = replace(job, flights=request.flights, beside=beside)
    source = asked.source(condition, asked.parameters_among(hold))
    sections = sections_of(job)
    whole = with_provenance(request, main_report(job, sections), source)
    lines = []
    if place is not None:
        html = page(job, sections, provenance(request, source))
        lines.append(_written(html, whole, place))
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


def _written(html: str, report: Report, place: Path) -> str:
    """Write the page, in a folder also its pictures and numbers, and return a line with their
    names.
    """
    if place.suffix:
        write_text(place, html)
        return f"wrote {printable(place)}"
    pictures = list(report.pictures())
    names = [picture.name for picture in pictures]
    earlier_names = _pictures_of_angles(place / "numbers.json")
    numbers = json.dumps(jsonable(report.data), allow_nan=False) + "\n"
    place.mkdir(exist_ok=True)
    for picture in pictures:
        save(picture.figure, place / picture.name, report.source)
    write_text(place / "numbers.json", numbers)
    write_text(place / "report.html", html)
    for name in earlier_names - {*names}:
        (place / name).unlink(missing_ok=True)
    return f"wrote {printable(place / 'report.html')}, numbers.json, {', '.join(names)}"


def _pictures_of_angles(numbers: Path) -> set[str]:
    """Return the names of the pictures at the angles of an earlier report, or none."""
    try:
        data = json.loads(numbers.read_text("utf-8"))
        return {critic_picture(angle["dihedral_deg"]) for angle in data["angles"]}
    except (OSError, ValueError, TypeError, KeyError):
        return set()  # no report, or a file of another program
