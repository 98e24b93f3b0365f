"""The documents are correct: code blocks run and print the shown output, and links are valid.

A ```python block is run. If its first line is "# FILE.py", it is also saved to this file. A ```text
block directly after it shows its output.

In a ```console block, lines that begin with "$ " are commands. A backslash continues a command on
the next line. The lines after a command show its output. "# exit 1" at the end of a command gives
its exit code. A line "..." matches any number of lines. The last line of an output contains the
provenance and may be omitted.

The blocks of one document are run in order, in one folder and one namespace. Blocks in other
languages are not run. Blocks marked as ```console slow are run only if slow tests are selected.
docs/pictures/NAME contains the pictures drawn by the commands in docs/NAME.md.

A table may have columns with the heading `hfa COMMAND`: each cell has options that complete it, and
the command is run.
"""

import ast
import contextlib
import doctest
import importlib
import inspect
import io
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tempfile
import textwrap
from functools import cache
from pathlib import Path

import pytest
from cli import Result, hfa
from pages import COMMAND, Block, blocks_of, difference, looks_like
from project import FOLDERS, PACKAGES, ROOT

#: Provenance at the end of an output, which a document may omit.
SOURCE = re.compile(
    r"\n*^hfa \d+\.\d+\.\d+, \d{4}-\d\d-\d\d.*(\n(?:not the identified aircraft|changed): .*)?$",
    re.M,
)


#: Neighbor of the first and the last block.
_NONE = Block("", "", 0, slow=False)


def complaints(path, *, slow=False):
    """Run the blocks of a document and return their faults. Files remain in the current folder.

    slow: whether slow blocks are run too
    """
    for name in ("examples", "studies"):
        Path(name).symlink_to(ROOT / name)
    namespace = {"__name__": "__main__"}
    blocks = [block for block in blocks_of(text_of(path)) if slow or not block.slow]
    found = [
        f"{path.name}, line {block.line}: {wrong}"
        for before, block, after in zip(
            [_NONE, *blocks], blocks, [*blocks[1:], _NONE], strict=False
        )
        for wrong in _wrong(before, block, after, namespace, path.name)
        if wrong
    ]
    namespace.clear()  # closes open files before a later test
    return found


def _wrong(before, block, after, namespace, name):
    """Yield what is wrong with a block between two others, "" if nothing is."""
    if block.language == "text" and before.language != "python":
        yield "no python block before this text prints it"
    if block.language == "python":
        printed, error = _run_python(block, namespace, name)
        yield error or difference(after.text if after.language == "text" else "", printed)
    if block.language == "console":
        for command in COMMAND.finditer(block.text):
            wrong = _wrong_with(command[1], int(command[2] or 0), command[3])
            yield wrong and f"$ {command[1]}\n{wrong}"


def _run_python(block, namespace, name):
    """Run a block, saved to the file that its first line names; return its output and its error or
    "".
    """
    file = re.match(r"# (\w+\.py)\n", block.text)
    if file is not None:
        Path(file[1]).write_text(block.text, encoding="utf-8")
    out = io.StringIO()
    try:
        with contextlib.redirect_stdout(out):
            # Blank lines before the code give a traceback the line numbers of the document.
            exec(
                compile(
                    block.text.rjust(len(block.text) + block.line - 1, "\n"),
                    name,
                    "exec",
                    dont_inherit=True,
                ),
                namespace,
            )
    except Exception as error:
        return out.getvalue(), f"the python block fails with {type(error).__name__}: {error}"
    return out.getvalue(), ""


def _wrong_with(command, code, expected):
    """Run a command of a document; return how exit code or output differ from the expected ones, or
    "". Of `make`, only the targets are compared.
    """
    words = shlex.split(command.replace("\\\n", " "))
    if words[0] == "make":
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
        return "\n".join(
            f"the Makefile has no target {word!r}" for word in words[1:] if word not in targets
        )
    if words[0] in ("cc", "size") or words[0].startswith("./"):
        return difference(
            expected, subprocess.run(words, check=True, capture_output=True, text=True).stdout
        )
    if words[:2] == ["python", "-m"]:
        done = subprocess.run(
            [sys.executable, *words[1:]], cwd=ROOT, capture_output=True, text=True
        )
        result = Result(done.returncode, done.stdout, done.stderr)
    elif words[0] == "hfa":
        result = hfa(*words[1:])
    else:
        return "neither hfa nor make, cc, size, python -m or ./PROGRAM"
    if result.code != code:
        return f"exit code {result.code} instead of {code}: {result.err}"
    output = result.out if SOURCE.search(expected) else SOURCE.sub("", result.out)
    return difference(expected, output + result.err)


PICTURES = ROOT / "docs" / "pictures"
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
#: `test_entry_points.py` runs the commands of extending.md, which need its package; words.md has none.
RUN_HERE = [path for path in DOCUMENTS if path.name not in ("extending.md", "words.md")]


def text_of(path):
    return path.read_text(encoding="utf-8")


#: The README's blocks run in the fast tests, but for slow ones; those of other documents take
#: longer.
CASES = [
    pytest.param(ROOT / "README.md", False, id="README"),
    *(
        pytest.param(path, True, id=f"{path.stem} whole", marks=pytest.mark.slow)
        for path in RUN_HERE
    ),
]


@pytest.mark.parametrize(("path", "slow"), CASES)
def test_blocks_print_the_shown_output(path, slow, tmp_path, monkeypatch):
    """Each block of a document prints the shown output, and draws the pictures that are stored for
    it.

    slow: whether blocks marked as slow are run too
    """
    monkeypatch.chdir(tmp_path)
    assert blocks_of(text_of(path)), "it shows nothing that can be checked"
    assert "\n\n".join(complaints(path, slow=slow)) == ""
    ran = "".join(block.text for block in blocks_of(text_of(path)) if slow or not block.slow)
    for picture in (PICTURES / path.stem).glob("*.png"):
        if picture.name in ran:
            assert looks_like(picture, tmp_path / picture.name), "run `make pictures`"


def commands_in_tables(document):
    """Return the commands of each table whose column headings begin commands that cells complete."""
    found = []
    for table in re.findall(r"^\|.*\| `hfa .*\n\|[-|]+\n(?:\|.*\n)+", document, re.M):
        heads, _, *rows = (
            [cell.strip(" `") for cell in line.split("|")[1:-1]] for line in table.splitlines()
        )
        found.append(
            [
                f"{head} {cell}"
                for row in rows
                for head, cell in zip(heads, row, strict=True)
                if head.startswith("hfa ") and cell
            ]
        )
    return found


#: The first three commands of each table are fast, and those of JSBSim and of sweeps slow.
TABLED = [
    pytest.param(
        command,
        marks=[pytest.mark.slow] * (place > 2 or bool(re.search(r"jsbsim|=\d+:", command))),
    )
    for path in DOCUMENTS
    for commands in commands_in_tables(text_of(path))
    for place, command in enumerate(commands)
]


@pytest.mark.parametrize("command", TABLED)
def test_commands_in_tables_run(command, folder):
    """A command that a table of a document shows, in the column `hfa COMMAND`, has exit code 0: its
    trim, or each trim of its sweep, is found.
    """
    for name in ("examples", "studies"):
        Path(name).symlink_to(ROOT / name)
    assert _wrong_with(command, code=0, expected="...") == ""  # "..." is any output


def illustrate():
    """Run the documents with pictures and store the pictures that they draw."""
    for stored in sorted(path for path in PICTURES.iterdir() if path.is_dir()):
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            assert complaints(ROOT / "docs" / f"{stored.name}.md", slow=True) == []
            for picture in stored.glob("*.png"):
                shutil.copy(picture.name, picture)


@pytest.mark.parametrize(
    "path", [*DOCUMENTS, ROOT / "CHANGELOG.md", ROOT / "ARCHITECTURE.md"], ids=lambda p: p.stem
)
def test_links_lead_to_files_and_headings(path):
    """Each local link in a document leads to an existing file and heading."""
    for link in re.findall(r"\[[^\]]*\]\(([^)\s]+)\)", text_of(path)):
        if re.match(r"https?://", link):
            continue
        target, _, heading = link.partition("#")
        file = path.parent / target if target else path
        assert file.exists(), link
        assert not heading or heading in headings(text_of(file)), link


def headings(document):
    """Return the anchors that GitHub makes from the headings of a document."""
    titles = re.findall(r"^#+ (.*)$", document, re.M)
    return [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles]


#: Examples without shown output: aircraft (tests/trim/test_own_models.py), and training scripts.
SILENT = (
    "f16",
    "flying_wings",
    "gtm",
    "imitate_a_planner",
    "navion",
    "pendulum",
    "train_a_network",
)
SCRIPTS = [path for path in sorted((ROOT / "examples").glob("*.py")) if path.stem not in SILENT]


def shown_output(path):
    """Return the output that the docstring of an example script shows after "prints"."""
    docstring = ast.get_docstring(ast.parse(text_of(path))) or ""
    return textwrap.dedent(docstring.partition("prints\n")[2].strip("\n"))


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_example_scripts_print_the_shown_output(path, tmp_path, monkeypatch, capsys):
    """Each example script prints the output shown in its docstring and writes no file."""
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(path), run_name="__main__")
    output = capsys.readouterr().out
    expected = shown_output(path)
    assert expected, "the docstring of an example ends with what it prints"
    assert difference(expected, output) == ""
    assert list(tmp_path.iterdir()) == []


def entries():
    """Return ("package.name", object) for every public class and function."""
    names = [
        (package, name)
        for package in PACKAGES
        for name in re.findall(r" as (\w+)", text_of(FOLDERS[package] / "__init__.pyi"))
    ]
    values = [(f"{p}.{name}", getattr(importlib.import_module(p), name)) for p, name in names]
    return [(name, value) for name, value in values if hasattr(value, "__qualname__")]


@cache
def examples_of_docstrings():
    """Return the examples of each public class and function that has some."""
    parser = doctest.DocTestParser()
    found = {
        value: parser.get_doctest(inspect.getdoc(value) or "", {}, name, None, 0)
        for name, value in entries()
    }
    return {value: example for value, example in found.items() if example.examples}


@pytest.mark.parametrize("part", range(45))
def test_docstring_examples_print_the_shown_results(part):
    """The examples in docstrings of public names print the shown results."""
    failures = io.StringIO()
    runner = doctest.DocTestRunner(verbose=False)
    for example in list(examples_of_docstrings().values())[part::45]:
        runner.run(example, out=failures.write)
    assert failures.getvalue() == ""
