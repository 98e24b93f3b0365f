"""The overview of commands that `hfa` prints if no command is given."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from hfa.entry_points import CommandEntry, commands
from hfa.options.parser import Parser
from hfa_support.version import VERSION

#: Groups of commands in the order of the help. Groups of other packages follow.
GROUPS = ("model", "critic", "flight", "proof", "exchange")


def _group(name: str, entries: Mapping[str, CommandEntry]) -> str:
    """Return one group of commands as text for the overview, one line for each command."""
    examples = [entry.example for entry in entries.values() if entry.example]
    title = f"{name}, for example {examples[0]}" if examples else name
    return "\n".join([title, *(f"  {each:<16}{entry.about}" for each, entry in entries.items())])


def overview() -> Parser:
    """Return the parser of a command line without a command, whose help lists all commands.

    The parser accepts --help, --version and the name of a command.
    """
    by_group: dict[str, dict[str, CommandEntry]] = {name: {} for name in GROUPS}
    for name, entry in commands().items():
        by_group.setdefault(entry.group, {})[name] = entry
    parser = Parser(
        prog="hfa",
        usage="hfa [--version] command ...  (hfa command --help)",
        description="Trims and linear models of aircraft, zero-sum games, and checks of critics.",
        epilog="\n\n".join(_group(name, entries) for name, entries in by_group.items() if entries),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", nargs="?", help=argparse.SUPPRESS)
    parser.add_argument(
        "--version", action="version", version=f"hfa {VERSION}", help=argparse.SUPPRESS
    )
    return parser
