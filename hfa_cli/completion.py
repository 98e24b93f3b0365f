"""Every command in one parser, for the program that writes completions for a shell:

shtab --prog hfa --shell bash hfa_cli.completion.whole_parser
"""

from __future__ import annotations

from hfa_cli.main import COMMANDS, filled, overview
from hfa_cli.options.parser import Parser


def whole_parser() -> Parser:
    """`hfa` with all its commands and their options; the command itself imports only the one that runs."""
    parser = overview(with_command=False)
    commands = parser.add_subparsers(dest="command", parser_class=Parser)
    for name, about in COMMANDS.items():
        filled(commands.add_parser(name, help=about), name)
    return parser
