"""The paper's update law as printed, and modified until it learns: every setting on both printed models.

Takes a minute or two. With --folder each row is kept as it is finished, and --resume goes on from those that are there.
"""

from __future__ import annotations

import argparse
from typing import Any

from controller.study.published_study import published_study
from controller.study.study_report import StudyFolder, study_report
from controller.study.study_rows import STUDY
from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import check_folder, check_target, parsed, whole
from hfa_cli.options.parser import add_refused, add_value
from hfa_cli.origin import provenance
from hfa_cli.output import show
from hfa_cli.progress import ProgressLine
from hfa_support.errors import BadInputError

#: Cases from which starting processes pays.
_MANY = 50


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa study`."""
    parser.add_argument(
        "--only", action="append", metavar="TEXT", help="the rows whose name contains TEXT; repeatable; default: all"
    )
    about = "keep each row there as it is finished; made when missing"
    add_value(parser, "--folder", parsed(check_folder), "FOLDER", about)
    parser.add_argument("--resume", action="store_true", help="do not run again the rows that are finished in --folder")
    about = "processes that share the runs; default: one a core for many runs, else 1"
    add_value(parser, "--workers", whole(1, options.MOST_WORKERS), "N", about)
    add_refused(parser, "--save", "is no longer there: keep the finished rows with --folder FOLDER")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the rows, report the table; that the law fails is a result and no failure."""
    target = check_target(arguments.output)
    if arguments.resume and arguments.folder is None:
        raise BadInputError("--resume needs the folder to continue; add --folder FOLDER")
    folder = None if arguments.folder is None else StudyFolder(arguments.folder, provenance())
    kept: dict[str, Any] = {} if folder is None else {"keep": folder.keep}
    if folder is not None and arguments.resume:
        kept["known"] = folder.known
    names = _names(arguments.only)
    processes = arguments.workers or _processes(names)
    rows = published_study(names, ProgressLine("study").say, processes=processes, **kept)
    show(study_report(rows), arguments, target=target)
    return 0


def _processes(names: tuple[str, ...]) -> int:
    """One a core for many runs."""
    cases = sum(len(list(STUDY[name].cases())) for name in names)
    return options.cores() if cases >= _MANY else 1


def _names(words: list[str] | None) -> tuple[str, ...]:
    for word in words or []:
        if not word or not any(word in name for name in STUDY):
            raise BadInputError(f"no row's name contains {word!r}; there are: {'; '.join(STUDY)}")
    return tuple(name for name in STUDY if words is None or any(word in name for word in words))
