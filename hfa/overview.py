"""The overview of commands that `hfa` prints if no command is given."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from hfa.entry_points import CommandEntry, commands
from hfa.options.parser import Parser

#: Groups of commands in the order of the help, group -> heading. Groups of other packages follow.
GROUPS = {
    "use": "the three uses: trim reports, linear models, checks of learned critics",
    "model": "models",
    "critic": "games and policies",
    "flight": "flights",
    "proof": "proofs",
}


def _group(name: str, entries: Mapping[str, CommandEntry], width: int) -> str:
    """Return one group of commands as text for the overview, one line for each command."""
    lines = [f"  {command:<{width}}  {entry.about}" for command, entry in entries.items()]
    return "\n".join([GROUPS.get(name, name), *lines])


def overview() -> Parser:
    """Return the parser of a command line without a command, whose help lists all commands.

    The parser accepts --help, --version and the name of a command.
    """
    by_group: dict[str, dict[str, CommandEntry]] = {name: {} for name in GROUPS}
    listed = commands()
    for name, entry in listed.items():
        if name.partition(" ")[0] in listed and " " in name:
            continue  # the help of the first word lists the second words
        by_group.setdefault(entry.group, {})[name] = entry
    width = max(len(name) for entries in by_group.values() for name in entries)
    parser = Parser(
        {},
        prog="hfa",
        usage="hfa [--version] command ...  (with examples: hfa command --help)",
        epilog="\n".join(
            _group(name, entries, width) for name, entries in by_group.items() if entries
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", nargs="?", help=argparse.SUPPRESS)
    return parser
