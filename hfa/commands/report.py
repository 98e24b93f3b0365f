"""The command `hfa report`."""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path

import numpy as np

from hfa.options import trims
from hfa.options.argument_types import output_file, some_of
from hfa.options.parser import Option, Options, command
from hfa.options.ranges import array_of, value_range
from hfa.output import ProgressLine, provenance, stated
from hfa_model.outputs import OUTPUTS
from hfa_model.vectors import STATES
from hfa_support.errors import BadInputError
from hfa_support.files import write_text, write_texts
from hfa_support.jsonable import jsonable
from hfa_support.progress import say
from hfa_support.reporting.figure import save
from hfa_support.reporting.report import Report
from verification.page.claims import load_claims
from verification.page.job_report import main_report, page, plotly_script
from verification.page.main_job import ASKED, MOST_ASKED, MOST_SWEPT, SWEEP, MainJob, main_job


def _options() -> Options:
    angles = partial(value_range, "dihedral")
    claims = "claims of the paper to show: the claims.json that `python -m studies.section5` wrote, or its folder"
    place = "one self-contained .html file, or a folder for the page, its pictures and its numbers (JSON)"
    asked = "shown in full: a,b,c or start:stop:step; default: the printed 5 and 15"
    swept = "angles of the slider and the root locus; default 0:20:0.5"
    return {
        **trims.at(angles, "RANGE", asked, default=ASKED),
        "--sweep": Option(swept, "RANGE", angles, tuple(SWEEP.tolist())),
        "--outputs": Option("C and D of these outputs too", "a,b,...", some_of(*STATES, *OUTPUTS)),
        "--claims": Option(claims, "FILE", lambda text: load_claims(Path(text))),
        **trims.flights(),
        **trims.HFA_OPTIONS,
        "-o --output": Option(place, "PLACE", output_file(".html", folder=True)),
        "--json": Option("print the numbers as JSON (radians, feet, pounds)"),
    }


@command(_options)
def report(arguments: argparse.Namespace) -> int:
    """The main job on one page: both printed pairs regenerated, the linear models over the dihedral
    angle with a slider, and at each asked angle the trim, the model beside its print, the exact
    game solution and a learned critic.

    The page needs Plotly (`pip install .[page]`), which it then holds: it loads nothing from any
    network. Exit code 1 when the printed matrices were not regenerated or a learned critic is
    wrong."""
    if arguments.output is None and not arguments.json:
        raise BadInputError(
            "give the place of the report, --output FILE.html or --output FOLDER, or --json"
        )
    if arguments.output is not None:
        plotly_script()  # refused before anything is computed
    if "dihedral" in (*arguments.free, *arguments.hold):
        raise BadInputError(
            "the angles of a report are given by --dihedral and --sweep; do not free or hold dihedral"
        )
    job = main_job(
        trims.parameters_of(arguments),
        arguments.dynamics,
        asked=np.unique(array_of("--dihedral", arguments.at, MOST_ASKED)).tolist(),
        swept=np.unique(array_of("--sweep", arguments.sweep, MOST_SWEPT)),
        outputs=arguments.outputs,
        claims=arguments.claims,
        flight=trims.flights_of(arguments),
        start=trims.start_of(arguments),
        progress=ProgressLine("report"),
    )
    found = stated(main_report(job), arguments)
    lines = _written(job, found, arguments)
    lines.append(f"Both printed pairs regenerated: {'yes' if job.regeneration.ok else 'NO'}")
    lines.append(
        f"Learned critics agree with the exact game solution: {'yes' if job.learned else 'NO'}"
    )
    say(found.json() if arguments.json else "\n".join(lines))
    return 0 if job.ok else 1


def _written(job: MainJob, report: Report, arguments: argparse.Namespace) -> list[str]:
    """Write the page to the file or into the folder of -o; what was written, in a line."""
    place = arguments.output
    if place is None:
        return []  # the numbers alone
    html = page(job, report, provenance(arguments))
    if place.suffix:
        write_text(place, html)
        return [f"wrote {place}"]
    place.mkdir(exist_ok=True)
    pictures = list(report.pictures())
    for picture in pictures:
        save(picture.draw(), place / picture.name, report.source)
    numbers = json.dumps(jsonable(report.data), allow_nan=False) + "\n"
    write_texts(place, {"numbers.json": numbers, "report.html": html})
    return [
        f"wrote {place / 'report.html'}, numbers.json, {', '.join(picture.name for picture in pictures)}"
    ]
