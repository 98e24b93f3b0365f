"""Conversion of docstrings, which are plain text, to the format of Sphinx.

A line "name: text" that names an argument becomes that parameter's text. One that names an
attribute of a class becomes the text of the attribute's own entry.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

from sphinx.pycode import ModuleAnalyzer

from hfa_model.parameters import FIELDS, Parameters

#: "values: (N, k), all combinations": an argument or an attribute, or several, and what it is.
_ENTRY = re.compile(r"^(?!Source)(?P<names>[A-Za-z]\w*(\(.*\))?(, \w+)*): +(?P<text>.*)$")


def read(_app: Any, kind: str, name: str, value: Any, _options: Any, lines: list[str]) -> None:
    """Rewrite the lines of a docstring (`autodoc-process-docstring`)."""
    if kind == "attribute":
        lines[:] = escaped(lines)
        return
    text, examples = _parted(lines)
    members = _members(value) if kind == "class" else set()
    parameters = _parameters(value) if kind in ("function", "method") else {}
    prose: list[str] = []
    for names, paragraph in entries_of(text):
        if not names:
            prose += ["", *escaped(paragraph), ""]
        elif parameters.keys() >= set(names):
            parameters |= dict.fromkeys(names, escaped(paragraph))
        elif not members.issuperset(names):
            prose += _indented(f"- **{', '.join(names)}**: ", escaped(paragraph))
    fields = [
        line
        for name, paragraph in parameters.items()
        for line in _indented(f":param {name}: ", paragraph)
    ]
    lines[:] = [*prose, "", *fields, "", *examples, ""]


def describe_attributes(owner: type) -> None:
    """Give Sphinx the text of each attribute, as if it were in a comment at its definition."""
    comments = ModuleAnalyzer.for_module(owner.__module__).find_attr_docs()
    text = entries_of((inspect.getdoc(owner) or "").splitlines())
    if owner is Parameters:
        text = (
            ([name], [f"{spec.unit}, {spec.meaning}"]) for name, spec in FIELDS._asdict().items()
        )
    for names, lines in text:
        comments.update({(owner.__qualname__, name): lines for name in names})


def entries_of(text: list[str]) -> Iterator[tuple[list[str], list[str]]]:
    """Yield (names, lines) of each part. An entry "name: text" has names, and prose has none.

    A continuation of an entry is indented deeper than the entry.
    """
    names: list[str] = []
    lines: list[str] = []
    for line in text:
        entry = _ENTRY.match(line)
        if entry is not None:
            yield names, lines
            names = entry["names"].split(", ")
            lines = [entry["text"]]
        elif names and not line.startswith(" "):
            yield names, lines
            names = []
            lines = [line]
        else:
            lines.append(line.strip() if names else line)
    yield names, lines


def _parted(lines: list[str]) -> tuple[list[str], list[str]]:
    """Return (text, examples). The examples begin with the first `>>>`."""
    begin = next((i for i, line in enumerate(lines) if line.startswith(">>>")), len(lines))
    return lines[:begin], lines[begin:]


def _members(owner: type) -> set[str]:
    """Return the attributes that a class and its bases declare."""
    return {name for base in owner.__mro__ for name in inspect.get_annotations(base)}


def _parameters(routine: Any) -> dict[str, list[str]]:
    """Return parameter -> its text, which is empty at first."""
    names = [name for name in inspect.signature(routine).parameters if name not in ("self", "cls")]
    return {name: [""] for name in names}


def _indented(head: str, lines: list[str]) -> list[str]:
    return [head + lines[0], *(f"   {line}" for line in lines[1:])]


def escaped(lines: list[str]) -> list[str]:
    """Escape text outside of backquotes that reStructuredText would interpret as markup."""
    parts = (re.split(r"(`[^`]*`)", line) for line in lines)
    return [
        "".join(
            re.sub(r"([*|_\\])", r"\\\1", part) if i % 2 == 0 else part
            for i, part in enumerate(line_parts)
        )
        for line_parts in parts
    ]
