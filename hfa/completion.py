"""Completion of commands and options in bash.

To enable completion, type: complete -C "python -m hfa.completion" hfa
"""

from __future__ import annotations

import os
import sys

from hfa.entry_points import command_named, commands, found_in
from hfa.options.aircraft import Aircraft
from hfa_support.errors import BadInputError


def candidates(words: list[str]) -> list[str]:
    """Return the completions of the last word of a command line, in alphabetical order.

    words: the words typed so far, without `hfa`. The last word may be empty.
    """
    *before, begun = words
    try:
        name, _ = found_in(before)
    except BadInputError:  # the second word of `prove` is missing
        name = ""
    if name and begun.startswith("-"):
        options = command_named(name).load().request.options(Aircraft.loaded({}))
        known = [flag for option in options.values() for flag in option.flags if flag[:2] == "--"]
    else:
        rows = [command.split() for command in commands()]
        place = len(before)
        known = [row[place] for row in rows if row[:place] == before and len(row) > place]
    return sorted({word for word in known if word.startswith(begun)})


def main() -> int:
    """Print the completions of the command line in the variable COMP_LINE, one word on each line.

    The line is cut at the cursor position in the variable COMP_POINT. Returns the exit code 0.
    """
    typed = os.environ.get("COMP_LINE", "")[: int(os.environ.get("COMP_POINT", "10000"))]
    words = typed.split()[1:]
    if not typed or typed[-1].isspace():
        words.append("")
    print(*candidates(words), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
