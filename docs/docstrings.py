"""Conversion of plain-text docstrings to the markup of Sphinx.

In the docstring of a function, a line "name: text" describes the parameter of this name. In the
docstring of a class, the line describes the attribute of this name.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from sphinx.pycode import ModuleAnalyzer

from hfa_model.parameters import FIELDS, Parameters

#: Line such as "values: (N, k), all combinations", with one or several names and a description.
_ENTRY = re.compile(r"^(?!Source)(?P<names>[A-Za-z]\w*(\(.*\))?(, \w+)*): +(?P<text>.*)$")


class Part(NamedTuple):
    """Part of a docstring: an entry "name, name: text", or prose, which has no names."""

    names: list[str]
    lines: list[str]


def read(_app: Any, kind: str, name: str, value: Any, _options: Any, lines: list[str]) -> None:
    """Convert a docstring to the markup of Sphinx (event `autodoc-process-docstring`).

    kind: "attribute", "class", "function" or "method"
    value: the documented object
    lines: lines of the docstring, replaced in place
    """
    if kind == "attribute":
        lines[:] = escaped(lines)
        return
    text, examples = _parted(lines)
    members = _members(value) if kind == "class" else set()
    parameters = _parameters(value) if kind in ("function", "method") else {}
    prose: list[str] = []
    for names, paragraph in parts_of(text):
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
    """Register the description of each attribute of a class with Sphinx.

    For `Parameters`, the descriptions are the units and meanings in `FIELDS`. For another class,
    the descriptions are entries of its docstring.
    """
    comments = ModuleAnalyzer.for_module(owner.__module__).find_attr_docs()
    parts = parts_of((inspect.getdoc(owner) or "").splitlines())
    if owner is Parameters:
        parts = (
            Part([name], [f"{spec.unit}, {spec.meaning}"])
            for name, spec in FIELDS._asdict().items()
        )
    for names, lines in parts:
        comments.update({(owner.__qualname__, name): lines for name in names})


def parts_of(text: list[str]) -> Iterator[Part]:
    """Yield the parts of a docstring. Further lines of an entry begin with a space."""
    names: list[str] = []
    lines: list[str] = []
    for line in text:
        entry = _ENTRY.match(line)
        if entry is not None:
            yield Part(names, lines)
            names = entry["names"].split(", ")
            lines = [entry["text"]]
        elif names and not line.startswith(" "):
            yield Part(names, lines)
            names = []
            lines = [line]
        else:
            lines.append(line.strip() if names else line)
    yield Part(names, lines)


def _parted(lines: list[str]) -> tuple[list[str], list[str]]:
    """Return the lines of a docstring before its examples, and the lines of its examples."""
    begin = next((i for i, line in enumerate(lines) if line.startswith(">>>")), len(lines))
    return lines[:begin], lines[begin:]


def _members(owner: type) -> set[str]:
    """Return the names of the annotated attributes of a class and its bases."""
    return {name for base in owner.__mro__ for name in inspect.get_annotations(base)}


def _parameters(routine: Any) -> dict[str, list[str]]:
    """Return a dictionary with a blank description [""] for each parameter of a routine."""
    names = [name for name in inspect.signature(routine).parameters if name not in ("self", "cls")]
    return {name: [""] for name in names}


def _indented(head: str, lines: list[str]) -> list[str]:
    """Return the lines of an item, the first behind its head and the others indented."""
    return [head + lines[0], *(f"   {line}" for line in lines[1:])]


def escaped(lines: list[str]) -> list[str]:
    r"""Escape the characters *, |, _ and \ outside of backquotes.

    reStructuredText would interpret them as markup.
    """

    def escape(found: re.Match[str]) -> str:
        is_quoted = found[0].startswith("`")
        return found[0] if is_quoted else f"\\{found[0]}"

    return [re.sub(r"`[^`]*`|[*|_\\]", escape, line) for line in lines]
