"""Complete commands suggested by error messages."""

from __future__ import annotations


def with_options(program: str, words: list[str], options: tuple[str, ...]) -> list[str]:
    """Return the words of a command with one option added or replaced."""
    kept = list(words)
    name = options[0]
    if name in kept and name != "--set":
        place = kept.index(name)
        del kept[place : place + 2]
    return [*program.split(), *kept, *options]
