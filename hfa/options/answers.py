"""The whole command that answers what an error asks for."""

from __future__ import annotations


def with_options(program: str, words: list[str], options: tuple[str, ...]) -> list[str]:
    """The words of a command with one more option, in place of what it said of the same."""
    kept = list(words)
    name = options[0]
    if name in kept and name != "--set":
        place = kept.index(name)
        del kept[place : place + 2]
    return [*program.split(), *kept, *options]
