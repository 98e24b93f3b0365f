"""The main job on one page: both printed pairs regenerated, the linear models from 0 to 20 degrees, and a learned
critic compared with the exact game solution."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from hfa_cli import options
from hfa_cli.argument_types import output_file, parsed
from hfa_cli.origin import signed
from hfa_cli.output import check_folder
from hfa_cli.parser import add_value
from hfa_model.support.errors import BadInputError
from hfa_model.support.files import write_text, written_whole
from hfa_model.support.jsonable import jsonable
from hfa_model.support.report import Report
from verification.published.report_page import MainJob, main_job, main_report, page


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa report`."""
    options.add_aircraft(parser)
    about = "write the page, one self-contained .html file"
    parser.add_argument("-o", "--output", type=output_file(".html"), metavar="FILE", help=about)
    about = "write the page, its pictures and its numbers (JSON) into this folder"
    add_value(parser, "--folder", parsed(check_folder), "FOLDER", about)
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON (radians, feet, pounds)")


def run(arguments: argparse.Namespace) -> int:
    """Compute, write, say where; exit 1 when the printed matrices were not regenerated or a learned critic is wrong."""
    places = sum(place is not None for place in (arguments.output, arguments.folder))
    if places != 1 and not (places == 0 and arguments.json):
        raise BadInputError("say where the report goes: either --output FILE.html or --folder FOLDER")
    job = main_job(options.parameters_of(arguments), arguments.dynamics)
    report = signed(main_report(job))
    lines = [f"wrote {name}" for name in _written(job, report, arguments.output, arguments.folder)]
    lines.append(f"Both printed pairs regenerated: {'yes' if job.regeneration.ok else 'NO'}")
    lines.append(f"Learned critics agree with the exact game solution: {'yes' if job.learned else 'NO'}")
    print(report.json() if arguments.json else "\n".join(lines))
    return 0 if job.ok else 1


def _written(job: MainJob, report: Report, target: Path | None, folder: Path | None) -> list[str]:
    """Write the page to the file or into the folder; what was written."""
    if target is not None:
        write_text(target, page(job, report))
        return [str(target)]
    if folder is None:
        return []  # the numbers alone
    folder.mkdir(exist_ok=True)
    pictures = list(report.pictures())
    for picture in pictures:
        with written_whole(folder / picture.name) as stream:
            stream.write(picture.png)
    write_text(folder / "numbers.json", json.dumps(jsonable(report.data), allow_nan=False) + "\n")
    write_text(folder / "report.html", page(job, report))
    return [f"{folder / 'report.html'}, numbers.json, {', '.join(picture.name for picture in pictures)}"]
