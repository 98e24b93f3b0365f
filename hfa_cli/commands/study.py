"""The paper's update law as printed, and with the help that it needs: every setting on both printed models.

Takes minutes. With --save the finished rows are kept, and --resume takes them from there.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from controller.study.published_study import STUDY, StudyRow, published_study
from controller.study.study_report import load_study, study_data, study_table, study_text
from hfa_cli import options
from hfa_cli.output import check_target, deliver
from hfa_model.support.errors import BadInputError
from hfa_model.support.files import write_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `hfa study`."""
    parser.add_argument(
        "--only", action="append", metavar="TEXT", help="the rows whose name contains TEXT; repeatable; default: all"
    )
    parser.add_argument("--save", metavar="FILE", help="keep the finished rows in this .json file")
    parser.add_argument("--resume", metavar="FILE", help="take finished rows from a file of --save or -o")
    options.add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the rows, report the table; that the law fails is a result and no failure."""
    target = check_target(arguments.output)
    state = check_target(arguments.save, (".json",))
    rows = published_study(
        _names(arguments.only),
        _show if sys.stderr.isatty() else None,
        finished=() if arguments.resume is None else load_study(arguments.resume),
        keep=None if state is None else lambda done: _keep(done, state),
    )
    deliver(
        study_data(rows), lambda: study_text(rows), lambda: study_table(rows), as_json=arguments.json, target=target
    )
    return 0


def _names(words: list[str] | None) -> tuple[str, ...]:
    for word in words or []:
        if not word or not any(word in name for name in STUDY):
            raise BadInputError(f"no row's name contains {word!r}; there are: {'; '.join(STUDY)}")
    return tuple(name for name in STUDY if words is None or any(word in name for word in words))


def _keep(done: tuple[StudyRow, ...], path: Path) -> None:
    write_text(path, json.dumps(study_data(done), indent=1, allow_nan=False) + "\n")


def _show(fraction: float, row: str) -> None:
    """One line on standard error, gone when done."""
    end = "\r\033[K" if fraction >= 1.0 else ""
    print(f"\r\033[Kstudy: {100 * fraction:3.0f} %  {row}", end=end, file=sys.stderr, flush=True)
