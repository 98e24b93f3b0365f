"""The main job on one page: both printed pairs regenerated, the linear models from 0 to 20 degrees, and a learned
critic held against the exact game solution."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from hfa_cli import options
from hfa_cli.output import check_target, jsonable
from hfa_model.errors import BadInputError
from hfa_model.files import write_text, written_whole
from verification.report_page import make_report, report_data, report_html, report_pictures


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa report`."""
    options.add_aircraft(parser)
    parser.add_argument("-o", "--output", metavar="FILE", help="write the page, one self-contained .html file")
    parser.add_argument(
        "--folder", metavar="FOLDER", help="write the page, its pictures and its numbers (JSON) into this folder"
    )


def run(arguments: argparse.Namespace) -> int:
    """Compute, write, say where; exit 1 when the print was not regenerated."""
    if (arguments.output is None) == (arguments.folder is None):
        raise BadInputError("say where the report goes: either --output FILE.html or --folder FOLDER")
    target = check_target(arguments.output, (".html",))
    folder = None if arguments.folder is None else _possible(arguments.folder)
    report = make_report(options.parameters_of(arguments), arguments.dynamics)
    pictures = report_pictures(report)
    page = report_html(report, pictures)
    if target is not None:
        write_text(target, page)
        print(f"wrote {target}")
    if folder is not None:
        folder.mkdir(exist_ok=True)
        for name, data in pictures.items():
            with written_whole(folder / name) as stream:
                stream.write(data)
        write_text(folder / "numbers.json", json.dumps(jsonable(report_data(report)), allow_nan=False) + "\n")
        write_text(folder / "report.html", page)
        print(f"wrote {folder / 'report.html'}, numbers.json, {', '.join(pictures)}")
    print(f"Both printed pairs regenerated: {'yes' if report.regenerated else 'NO'}")
    print(f"Learned critics agree with the exact game solution: {'yes' if report.learned else 'NO'}")
    return 0 if report.regenerated and report.learned else 1


def _possible(name: str) -> Path:
    """A folder that exists or can be made; made only when there is something to put in."""
    folder = Path(name)
    if not folder.is_dir() and (folder.exists() or not folder.parent.is_dir()):
        raise BadInputError(f"cannot make the folder {folder}: choose another, in a folder that exists")
    return folder
