"""The main job on one page: both printed pairs regenerated, the linear models over the dihedral angle with a slider,
and at each asked angle the trim, the model beside its print, the exact game solution and a learned critic.

The page needs Plotly (`pip install .[page]`), which it then holds: it loads nothing from any network."""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path

import numpy as np

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import folder_or_file, parsed, some_of
from hfa_cli.options.parser import add_value
from hfa_cli.options.ranges import Range, array_of, value_range
from hfa_cli.origin import provenance
from hfa_cli.output import stated
from hfa_cli.progress import ProgressLine
from hfa_model.outputs import OUTPUTS
from hfa_model.vectors import STATES
from hfa_support.errors import BadInputError
from hfa_support.files import write_text, write_texts
from hfa_support.jsonable import jsonable
from hfa_support.reporting.figure import save
from hfa_support.reporting.report import Report
from hfa_support.streams import say
from trim.point.condition import TrimCondition
from verification.page.claims import load_claims
from verification.page.job_report import main_report
from verification.page.main_job import ASKED, MOST_ASKED, MOST_SWEPT, SWEEP, MainJob, main_job
from verification.page.page_html import page, plotly_script


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa report`."""
    angles = partial(value_range, "dihedral")
    about = "angles shown in full, degrees: a,b,c or start:stop:step; default: the printed 5 and 15"
    add_value(parser, "--dihedral", angles, "RANGE", about)
    add_value(parser, "--sweep", angles, "RANGE", "angles of the slider and the root locus; default 0:20:0.5")
    add_value(parser, "--outputs", some_of(*STATES, *OUTPUTS), "a,b,...", "C and D of these outputs too")
    about = "claims of the paper to show: the claims.json that `python -m studies.section5` wrote, or its folder"
    add_value(parser, "--claims", parsed(lambda text: load_claims(Path(text))), "FILE", about)
    options.add_flight(parser)
    options.add_aircraft(parser)
    about = "one self-contained .html file, or a folder for the page, its pictures and its numbers (JSON)"
    parser.add_argument("-o", "--output", type=folder_or_file(".html"), metavar="PLACE", help=about)
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON (radians, feet, pounds)")


def run(arguments: argparse.Namespace) -> int:
    """Compute, write, say where; exit 1 when the printed matrices were not regenerated or a learned critic is wrong."""
    if arguments.output is None and not arguments.json:
        raise BadInputError("give the place of the report, --output FILE.html or --output FOLDER, or --json")
    if arguments.output is not None:
        plotly_script()  # refused before anything is computed
    job = main_job(
        options.parameters_of(arguments),
        arguments.dynamics,
        asked=_angles("--dihedral", arguments.dihedral, np.array(ASKED), MOST_ASKED).tolist(),
        swept=_angles("--sweep", arguments.sweep, SWEEP, MOST_SWEPT),
        outputs=arguments.outputs,
        claims=arguments.claims,
        flight=_flight_of(arguments),
        start=options.start_of(arguments),
        progress=ProgressLine("report"),
    )
    report = stated(main_report(job), arguments)
    lines = [f"wrote {name}" for name in _written(job, report, arguments.output)]
    lines.append(f"Both printed pairs regenerated: {'yes' if job.regeneration.ok else 'NO'}")
    lines.append(f"Learned critics agree with the exact game solution: {'yes' if job.learned else 'NO'}")
    say(report.json() if arguments.json else "\n".join(lines))
    return 0 if job.ok else 1


def _flight_of(arguments: argparse.Namespace) -> TrimCondition:
    """What is trimmed at every angle of the page; the angle itself is the page's."""
    if "dihedral" in (*(arguments.free or ()), *(arguments.hold or {})):
        raise BadInputError("the angles of a report are given by --dihedral and --sweep; do not free or hold dihedral")
    return options.flight_of(arguments, dihedral_is_free=False)


def _angles(option: str, given: Range | None, default: np.ndarray, most: int) -> np.ndarray:
    """Of an option, each once and in order, rad; BadInputError when there are more than one page holds."""
    if given is None:
        return default
    angles = np.unique(array_of(option, given, most))
    if angles.size > most:
        raise BadInputError(f"{option} has {angles.size} angles; one page holds at most {most}, take fewer")
    return angles


def _written(job: MainJob, report: Report, place: Path | None) -> list[str]:
    """Write the page to the file or into the folder; what was written."""
    if place is None:
        return []  # the numbers alone
    if place.suffix:
        write_text(place, page(job, report, provenance()))
        return [str(place)]
    place.mkdir(exist_ok=True)
    pictures = list(report.pictures())
    for picture in pictures:
        save(picture.draw(), place / picture.name, report.source)
    numbers = json.dumps(jsonable(report.data), allow_nan=False) + "\n"
    write_texts(place, {"numbers.json": numbers, "report.html": page(job, report, provenance())})
    return [f"{place / 'report.html'}, numbers.json, {', '.join(picture.name for picture in pictures)}"]
