"""Learn the value and the gain of the game with one of the critics; the weights go to a file for `hfa verify`."""

from __future__ import annotations

import argparse

from hfa_cli.options import games, trims
from hfa_cli.options.parser import Options
from hfa_cli.output import show


def options() -> Options:
    """Of `hfa learn`."""
    return {**games.game_options(), **games.LEARNING, **trims.output()}


def run(arguments: argparse.Namespace) -> int:
    """Learn and report; exit 1 when a certificate does not hold."""
    named = games.game_of(arguments)
    result = games.run_learning(arguments, named.game)
    whole = result.report(*named.names, history=True).data
    report = result.report(*named.names).with_data(**named.labels())
    show(report, arguments, target=arguments.output, only_in_files=whole, notes=named.warnings)
    return 0 if result.converged else 1
