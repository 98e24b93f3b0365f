"""Execution of a study as a separate program."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from hfa.main import main

if TYPE_CHECKING:
    from hfa.options.command import Command


def run_alone(command: Command, program: str, argv: Sequence[str] | None = None) -> int:
    """Run a command as a separate program and return its exit code (see `hfa.main.main`).

    program: name of the program in messages
    argv: command line without the program name, or None for the command line of this process
    """
    return main(argv, lambda words: (command, program, words))
