"""Texts of `--help` and `--help more`."""

from __future__ import annotations

import argparse
import textwrap
from typing import TYPE_CHECKING

from hfa_support.entry_points import PARTS, offered

if TYPE_CHECKING:
    from hfa.options.parser import Parser


def help_text(parser: Parser, more: bool) -> str:
    """Return the help of a command: usage, description, options, subcommands and example.

    parser: parser of the command
    more: whether rare options are explained, or only listed by name
    """
    texts = [_options_text(parser, more)]
    if parser.words:
        lines = [f"  {parser.prog} {word:<10}{about}\n" for word, about in parser.words.items()]
        texts.append("".join(lines))
    if parser.example:
        gap = " " if len(parser.example) <= 70 else "\n"
        texts.append(f"example:{gap}{parser.example}\n")
    return "\n".join(texts)


def _options_text(parser: Parser, more: bool) -> str:
    """Return the usage, the description and the options of a command.

    Options that need a package which is not installed are omitted.

    parser: parser of the command
    more: whether rare options are explained, or only listed by name
    """
    declared = []
    for action in parser._actions:
        option = parser.options.get(action.dest)
        if option is not None and option.part and option.part not in offered(PARTS):
            action.help = argparse.SUPPRESS
        elif option is not None:
            about = option.about() if callable(option.about) else option.about
            action.help = about or argparse.SUPPRESS
            if about:
                declared.append(action)
    if more:
        return argparse.ArgumentParser.format_help(parser)
    hidden = [action for action in declared if parser.options[action.dest].rare]
    texts = [action.help for action in hidden]
    for action in hidden:
        action.help = argparse.SUPPRESS
    shown = argparse.ArgumentParser.format_help(parser)
    for action, text in zip(hidden, texts, strict=True):
        action.help = text
    if not hidden:
        return shown
    names = ", ".join(action.option_strings[-1] for action in hidden)
    return shown + textwrap.fill(f"more ({parser.prog} --help more): {names}", 80) + "\n"
