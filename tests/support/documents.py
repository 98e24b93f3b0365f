"""Run what a document shows, and compare what it says with what happens.

A ```python block is run; a ```text block right after it is what it prints. In a ```console block, lines that begin
with "$ " are commands, and the lines after a command are what it prints; "# exit 1" at the end of a command is its
exit code. A line "..." stands for any number of lines, and the last line, which says
where an output comes from, may be left out. The blocks of one document run in order, in one folder
and one namespace; blocks in other languages, or in none, are not run.
"""

from __future__ import annotations

import contextlib
import difflib
import io
import re
import shlex
import subprocess
from collections.abc import Container
from pathlib import Path
from typing import Any, NamedTuple

from cli import hfa

ROOT = Path(__file__).parents[2]
#: The lines at the end of an output that say where it comes from; a document need not show them.
SOURCE = re.compile(r"\n*^hfa \d+\.\d+\.\d+, \d{4}-\d\d-\d\d.*(\nnot the identified aircraft: .*)?$", re.M)
_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.M | re.S)


class Block(NamedTuple):
    """One fenced block: its language, its text, and the line on which its text begins."""

    language: str
    text: str
    line: int


class Command(NamedTuple):
    """One command of a console block: its words, exit code, expected output, and its line."""

    text: str
    code: int
    expected: str
    line: int


def blocks_of(document: str) -> list[Block]:
    """The fenced blocks of a Markdown document, in order."""
    return [
        Block(match[1], match[2], document.count("\n", 0, match.start(2)) + 1) for match in _FENCE.finditer(document)
    ]


def commands_of(block: Block) -> list[Command]:
    """The commands of a console block."""
    commands: list[Command] = []
    for offset, line in enumerate(block.text.splitlines(keepends=True)):
        if line.startswith("$ "):
            text, code = re.fullmatch(r"\$ (.*?)(?:\s+# exit (\d+))?\n", line).groups()  # type: ignore[union-attr]
            commands.append(Command(text, int(code or 0), "", block.line + offset))
        else:
            commands[-1] = commands[-1]._replace(expected=commands[-1].expected + line)
    return commands


def difference(expected: str, actual: str) -> str:
    """Empty when the actual output is what is expected, with "..." for any lines; else a readable comparison."""
    lines = [line.rstrip() for line in expected.strip("\n").splitlines()]
    pattern = "".join(r"(?:.*\n)*?" if line == "..." else re.escape(line) + r"\n" for line in lines)
    said = "".join(f"{line.rstrip()}\n" for line in actual.strip("\n").splitlines())
    if re.fullmatch(pattern, said):
        return ""
    return "\n".join(difflib.unified_diff(lines, said.splitlines(), "the document", "what happens", lineterm="", n=1))


def complaints(document: str, *, elsewhere: Container[str] = (), name: str = "document") -> list[str]:
    """What is wrong with the blocks of a document; runs in the current folder, leaves files there.

    elsewhere: commands that are checked in another place and not run here.
    """
    namespace: dict[str, Any] = {"__name__": "__main__"}
    found: list[str] = []
    printed: str | None = None
    for block in blocks_of(document):
        where = f"{name}, line {block.line}"
        if block.language == "text":
            if printed is None:
                found.append(f"{where}: no python block before this text prints it")
            elif wrong := difference(block.text, printed):
                found.append(f"{where}:\n{wrong}")
            printed = None
            continue
        if printed:
            found.append(f"{where}: what the python block before prints is not shown")
        printed = None
        if block.language == "python":
            printed, error = _run_python(block, namespace, name)
            found += [f"{where}: {error}"] * bool(error)
        elif block.language == "console":
            for command in commands_of(block):
                if command.text not in elsewhere and (wrong := _wrong_with(command)):
                    found.append(f"{name}, line {command.line}: $ {command.text}\n{wrong}")
    if printed:
        found.append(f"{name}: what the last python block prints is not shown")
    namespace.clear()  # functions hold it: a file left open in it would warn in whichever test runs later
    return found


def _run_python(block: Block, namespace: dict[str, Any], name: str) -> tuple[str, str]:
    out = io.StringIO()
    try:
        with contextlib.redirect_stdout(out):
            # Blank lines before the code: a traceback then shows the document's own line numbers.
            exec(compile("\n" * (block.line - 1) + block.text, name, "exec"), namespace)
    except Exception as error:
        return out.getvalue(), f"the python block fails with {type(error).__name__}: {error}"
    return out.getvalue(), ""


def _wrong_with(command: Command) -> str:
    words = shlex.split(command.text)
    if words[0] == "make":
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
        return "\n".join(f"the Makefile has no target {word!r}" for word in words[1:] if word not in targets)
    if words[0] in ("cc", "size") or words[0].startswith("./"):
        return difference(command.expected, subprocess.run(words, check=True, capture_output=True, text=True).stdout)
    if words[0] != "hfa":
        return "neither hfa nor make, cc, size or ./PROGRAM"
    result = hfa(*words[1:])
    if result.code != command.code:
        return f"exit code {result.code} instead of {command.code}: {result.err}"
    said = result.out if SOURCE.search(command.expected) else SOURCE.sub("", result.out)
    return difference(command.expected, said + result.err)
