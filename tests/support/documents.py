"""Run what a document shows, and compare what it says with what happens.

A ```python block is run; a ```text block right after it is what it prints. In a ```console block, lines that begin
with "$ " are commands, and the lines after a command are what it prints; "# exit 1" at the end of a command is its
exit code. A line "..." matches any number of lines, and the last line, which names where an output comes from, may
be left out. The blocks of one document run in order, in one folder and one namespace; blocks in other languages, or in
none, are not run, and those marked as in ```console slow only where slow ones are asked for.
"""

from __future__ import annotations

import contextlib
import difflib
import io
import re
import shlex
import subprocess
from collections.abc import Iterator
from typing import Any, NamedTuple

from cli import hfa
from project import ROOT

#: The lines at the end of an output that name where it comes from; a document need not show them.
SOURCE = re.compile(r"\n*^hfa \d+\.\d+\.\d+, \d{4}-\d\d-\d\d.*(\nnot the identified aircraft: .*)?$", re.M)
_FENCE = re.compile(r"^```(\w*)( slow)?\n(.*?)^```$", re.M | re.S)
_COMMAND = re.compile(r"^\$ (.*?)(?:\s+# exit (\d+))?\n((?:(?!\$ ).*\n)*)", re.M)


class Block(NamedTuple):
    """One fenced block: its language, its text, the line on which its text begins, and whether it takes long."""

    language: str
    text: str
    line: int
    slow: bool


_NONE = Block("", "", 0, slow=False)


def blocks_of(document: str) -> list[Block]:
    """The fenced blocks of a Markdown document, in order."""
    return [
        Block(each[1], each[3], document.count("\n", 0, each.start(3)) + 1, each[2] is not None)
        for each in _FENCE.finditer(document)
    ]


def difference(expected: str, actual: str) -> str:
    """Empty when the actual output is the expected one, with "..." for any lines; else a readable comparison."""
    lines = [line.rstrip() for line in expected.strip("\n").splitlines()]
    pattern = "".join(r"(?:.*\n)*?" if line == "..." else re.escape(line) + r"\n" for line in lines)
    said = "".join(f"{line.rstrip()}\n" for line in actual.strip("\n").splitlines())
    if re.fullmatch(pattern, said):
        return ""
    return "\n".join(difflib.unified_diff(lines, said.splitlines(), "the document", "what happens", lineterm="", n=1))


def complaints(document: str, *, name: str = "document", slow: bool = False) -> list[str]:
    """What is wrong with the blocks of a document; runs in the current folder, leaves files there."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    blocks = [block for block in blocks_of(document) if slow or not block.slow]
    found = [
        f"{name}, line {block.line}: {wrong}"
        for before, block, after in zip([_NONE, *blocks], blocks, [*blocks[1:], _NONE], strict=False)
        for wrong in _wrong(before, block, after, namespace, name)
        if wrong
    ]
    namespace.clear()  # functions hold it: a file left open in it would warn in whichever test runs later
    return found


def _wrong(before: Block, block: Block, after: Block, namespace: dict[str, Any], name: str) -> Iterator[str]:
    if block.language == "text" and before.language != "python":
        yield "no python block before this text prints it"
    if block.language == "python":
        printed, error = _run_python(block, namespace, name)
        yield error or difference(after.text if after.language == "text" else "", printed)
    if block.language == "console":
        for command in _COMMAND.finditer(block.text):
            wrong = _wrong_with(command[1], int(command[2] or 0), command[3])
            yield wrong and f"$ {command[1]}\n{wrong}"


def _run_python(block: Block, namespace: dict[str, Any], name: str) -> tuple[str, str]:
    out = io.StringIO()
    try:
        with contextlib.redirect_stdout(out):
            # Blank lines before the code: a traceback then shows the document's own line numbers.
            exec(compile("\n" * (block.line - 1) + block.text, name, "exec"), namespace)
    except Exception as error:
        return out.getvalue(), f"the python block fails with {type(error).__name__}: {error}"
    return out.getvalue(), ""


def _wrong_with(command: str, code: int, expected: str) -> str:
    words = shlex.split(command)
    if words[0] == "make":
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
        return "\n".join(f"the Makefile has no target {word!r}" for word in words[1:] if word not in targets)
    if words[0] in ("cc", "size") or words[0].startswith("./"):
        return difference(expected, subprocess.run(words, check=True, capture_output=True, text=True).stdout)
    if words[0] != "hfa":
        return "neither hfa nor make, cc, size or ./PROGRAM"
    result = hfa(*words[1:])
    if result.code != code:
        return f"exit code {result.code} instead of {code}: {result.err}"
    said = result.out if SOURCE.search(expected) else SOURCE.sub("", result.out)
    return difference(expected, said + result.err)
