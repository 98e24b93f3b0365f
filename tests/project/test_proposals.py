"""Every command, option and call that a page, a docstring or a message mentions exists."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from functools import cache
from typing import NamedTuple

import pytest
from project import FOLDERS, ROOT

from hfa.entry_points import commands
from hfa.main import _named_command, parser_of

PAGES = [*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "ARCHITECTURE.md"))]
PAGES += sorted((ROOT / "docs").glob("*.md"))
#: Commands that texts mention and that do not exist: one of another author's package, one that a
#: page says is gone, and the form of all commands.
ABSENT = ("hfa level thrust", "hfa prove region", "hfa command --help")
#: Package or class of public names -> what a call in a text names.
PUBLIC = {package: importlib.import_module(package) for package in FOLDERS}
importlib.import_module("hfa.extend")  # which a page names
CLASSES = [name for name in dir(PUBLIC["hfa"]) if inspect.isclass(getattr(PUBLIC["hfa"], name))]
PUBLIC |= {name: getattr(PUBLIC["hfa"], name) for name in CLASSES}
#: A call of a public function or method, "hfa.solve(game)", or of a class: its name, its arguments.
CALL = re.compile(
    rf"(?<![\w./\"'-])((?:{'|'.join(FOLDERS)})(?:\.[a-z]\w*)+|(?:{'|'.join(CLASSES)})(?:\.[a-z]\w*)*)"
    r"\(((?:[^()]|\([^()]*\))*)\)"
)


class Text(NamedTuple):
    """A text that may mention commands or calls, with its place."""

    where: str
    text: str


def on_pages():
    """Yield the words in backticks of all pages, outside of code blocks."""
    for page in PAGES:
        text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.M | re.S)
        for match in re.finditer(r"`([^`\n]+(?:\n[^`\n]+)?)`", text):
            yield Text(f"{page.name}, {match[0]}", " ".join(match[1].split()))


#: What the text of a file contains if one of its strings may mention a command or a call.
MENTIONS = re.compile(rf"\bhfa[ \"'`]|\b(?:{'|'.join([*FOLDERS, *CLASSES])})\.[a-z][\w.]*\(")


def in_sources(package):
    """Yield the strings (docstrings, helps, messages) of files that match `MENTIONS`."""
    for path in sorted(FOLDERS[package].rglob("*.py")):
        text = path.read_text("utf-8")
        if not MENTIONS.search(text):
            continue  # to parse all files takes a second
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.JoinedStr):
                yield Text(f"{path.name}, line {node.lineno}", _shown(node))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield Text(f"{path.name}, line {node.lineno}", node.value)


def _shown(text):
    """Return an f-string with VALUE in place of its values."""
    parts = (part.value if isinstance(part, ast.Constant) else "VALUE" for part in text.values)
    return "".join(map(str, parts))


@cache
def options_of_commands():
    """Return command -> its options."""
    found = {}
    for name in commands():
        command, program, _ = _named_command(name.split())
        found[name] = {*parser_of(command, program)._option_string_actions}
    return found


def unknown_options(where, text):
    """Yield a complaint for each command in a text that does not exist, and for each option that
    its command does not have.
    """
    known = options_of_commands()
    names = "|".join(sorted(known, key=len, reverse=True))
    for match in re.finditer(r"(?<![\w.])hfa ([a-z]+[^`;|()\n]*)", text):
        line = match[0].strip()
        is_command = re.match(rf"({names})\b", match[1])
        if is_command is None:
            if ("`" + match[0] in text or text == line or " --" in line) and line not in ABSENT:
                yield f"{where}: {line}: no such command"
            continue
        for option in re.findall(r"(?<!\S)--[a-z][a-z-]*", match[1].partition(", ")[0]):
            if option not in {*known[is_command[1]], "--help"}:
                yield f"{where}: {line}: no such option {option}"


def unknown_names(where, text):
    """Yield a complaint for each call in a text of a function, or with a named argument, that does
    not exist.
    """
    for path, arguments in CALL.findall(text):
        found = PUBLIC[path.split(".")[0]]
        for name in path.split(".")[1:]:
            found = getattr(found, name, None)
        if not callable(found):
            yield f"{where}: {path}: no such function"
            continue
        try:
            call = ast.parse(f"f({re.sub(r'[.]{3}|[*], ', '_', arguments)})", mode="eval").body
            parameters = inspect.signature(found).parameters
        except (SyntaxError, ValueError):  # `Game(A, B, *, Q, R)`, and a call without a signature
            continue
        kinds = {parameter.kind for parameter in parameters.values()}
        named = {keyword.arg for keyword in call.keywords if keyword.arg}
        if inspect.Parameter.VAR_KEYWORD not in kinds and not named <= {*parameters}:
            yield f"{where}: {path}: no such argument {', '.join(sorted(named - {*parameters}))}"


@pytest.mark.parametrize("place", ["pages", *FOLDERS])
def test_commands_and_calls_in_texts_exist(place):
    """Each command, option, public function and named argument exists that a page (in backticks) or
    a string of the source mentions.
    """
    pytest.importorskip("hfa_flight")
    texts = on_pages() if place == "pages" else in_sources(place)
    found = [fault for each in texts for fault in (*unknown_options(*each), *unknown_names(*each))]
    assert found == []
