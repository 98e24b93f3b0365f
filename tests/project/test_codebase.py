"""The code base about itself: documentation, tests that can fail, sizes, and data that no code writes."""

from __future__ import annotations

import ast
import os
import re
import subprocess
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TypeGuard

import pytest
from import_graph import ROOT, nodes_of, project_sources, tree_of

#: Made, not written: their content is not the project's text.
GENERATED = {".git", ".hypothesis", ".venv", "build", "report", "out", "__pycache__"}
#: Spelled in two halves, so that this file does not mention it.
WORKPLACE = re.compile("/wo" + "rk/|/tmp/bri" + "ef")
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def project_files() -> Iterator[Path]:
    """Every file of the project that a person or a command of the project wrote."""
    for folder, folders, names in os.walk(ROOT):
        folders[:] = sorted(name for name in folders if not _is_made(name))
        yield from (Path(folder, name) for name in sorted(names) if not _is_made(name))


def _is_made(name: str) -> bool:
    return name in GENERATED or name.endswith((".egg-info", "_cache"))


@cache
def python_files() -> dict[str, str]:
    """Path relative to the root -> source."""
    return {str(path.relative_to(ROOT)): path.read_text("utf-8") for path in project_files() if path.suffix == ".py"}


def sources_of_tests() -> dict[str, str]:
    return {name: text for name, text in python_files().items() if name.startswith("tests/")}


# Documentation.


def undocumented(sources: Mapping[str, str]) -> list[str]:
    """Public modules, classes, functions and methods whose docstring does not begin with a statement."""
    found = []
    for module, source in sources.items():
        tree = tree_of(source)
        documented: list[tuple[str, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef]] = [
            (module, tree),
            *((f"{module}.{name}", node) for name, node in _public(tree)),
        ]
        for name, node in documented:
            first_line = (ast.get_docstring(node) or "").partition("\n")[0]
            words = re.findall(r"\w+", first_line.lower())
            if len(words) < 2 or words == re.findall(r"[^\W_]+", name.rpartition(".")[2].lower()):
                found.append(name)
    return found


def _public(
    node: ast.Module | ast.ClassDef,
) -> Iterator[tuple[str, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef]]:
    for child in node.body:
        if isinstance(child, (ast.ClassDef, *_FUNCTIONS)) and not child.name.startswith("_"):
            yield child.name, child
            if isinstance(child, ast.ClassDef):
                yield from ((f"{child.name}.{name}", inner) for name, inner in _public(child))


def test_everything_public_is_documented() -> None:
    assert undocumented(project_sources()) == []


def test_missing_and_empty_docstrings_are_seen() -> None:
    source = '''"""A module."""
def solve_it():
    """Solve it."""
class A:
    """."""
    def b(self): pass
    def _c(self): pass
'''
    assert undocumented({"m": source}) == ["m.solve_it", "m.A", "m.A.b"]


# Tests that can fail.


def assertion_free_tests(sources: Mapping[str, str]) -> list[str]:
    """Tests that neither assert nor expect an exception, themselves or in a helper of the tests."""
    functions = [(path, node) for path, source in sources.items() for node in nodes_of(source) if _is_function(node)]
    helpers = {node.name: node for _, node in functions if not node.name.startswith("test_")}

    def checks(function: ast.AST, seen: frozenset[str] = frozenset()) -> bool:
        for node in ast.walk(function):
            if isinstance(node, ast.Assert):
                return True
            if isinstance(node, ast.Call):
                called = _called(node)
                if called.startswith("assert_") or called == "raises":
                    return True
                if called in helpers and called not in seen and checks(helpers[called], seen | {called}):
                    return True
        return False

    return [f"{path}: {node.name}" for path, node in functions if node.name.startswith("test_") and not checks(node)]


def _called(node: ast.Call) -> str:
    """The last name of what is called."""
    return getattr(node.func, "attr", getattr(node.func, "id", ""))


def _is_function(node: ast.AST) -> TypeGuard[ast.FunctionDef | ast.AsyncFunctionDef]:
    return isinstance(node, _FUNCTIONS)


def hollow_assertions(sources: Mapping[str, str]) -> list[str]:
    """Assertions that always hold: `assert SomeError(...)`, a tuple in parentheses, a constant."""
    found = []
    for path, source in sources.items():
        for node in nodes_of(source):
            if isinstance(node, ast.Assert):
                is_error = isinstance(node.test, ast.Call) and _called(node.test).endswith(("Error", "Exception"))
                if is_error or isinstance(node.test, (ast.Tuple, ast.Constant)):
                    found.append(f"{path}:{node.lineno}: assert {ast.unparse(node.test)}")
    return found


def repeated_test_names(sources: Mapping[str, str]) -> list[str]:
    """Tests that a later test of the same name in the same file replaces, so that they never run."""
    found = []
    for path, source in sources.items():
        names = [node.name for node in tree_of(source).body if isinstance(node, _FUNCTIONS)]
        found += [f"{path}: {name}" for name in sorted({name for name in names if names.count(name) > 1})]
    return found


def test_every_test_asserts_something() -> None:
    sources = sources_of_tests()
    files = [name for name in sources if Path(name).name.startswith("test_")]
    assert "tests/project/test_codebase.py" in files
    assert all("def test_" in sources[name] for name in files)
    assert assertion_free_tests(sources) == []


def test_no_assertion_holds_whatever_happens() -> None:
    assert hollow_assertions(sources_of_tests()) == []


def test_every_test_runs() -> None:
    assert repeated_test_names(sources_of_tests()) == []


def test_planted_empty_tests_are_seen() -> None:
    source = """
def helper(): assert f()
def test_good(): helper()
def test_raises():
    with pytest.raises(ValueError): f()
def test_empty(): f()
def around(): around()
def test_around(): around()
"""
    assert assertion_free_tests({"t": source, "u": "def test_good(): f()"}) == [
        "t: test_empty",
        "t: test_around",
        "u: test_good",
    ]
    assert repeated_test_names({"t": "def test_a(): pass\ndef test_a(): pass"}) == ["t: test_a"]


@pytest.mark.parametrize(
    "line", ["assert ValueError('x')", "assert errors.BadInputError()", "assert (x, 'y')", "assert 1"]
)
def test_planted_hollow_assertions_are_seen(line: str) -> None:
    assert len(hollow_assertions({"t": line})) == 1
    assert hollow_assertions({"t": "assert f(x)\nassert x == 1, 'y'"}) == []


# Files.


def test_nothing_mentions_where_it_was_written() -> None:
    texts = {}
    for path in project_files():
        try:
            texts[str(path.relative_to(ROOT))] = path.read_text("utf-8")
        except UnicodeDecodeError:
            continue
    assert "README.md" in texts
    assert ".ci/run" in texts
    assert [name for name, text in texts.items() if WORKPLACE.search(text)] == []


def test_the_workplace_is_recognized() -> None:
    assert WORKPLACE.search("see /wo" + "rk/notes")
    assert not WORKPLACE.search("framework/notes and network/x")


# The published data.


def writers(sources: Mapping[str, str], name: str) -> list[str]:
    """Modules that name a file in their code (not in a docstring or an error message alone) and can write files."""
    found = []
    for module, source in sources.items():
        if name not in source:
            continue
        nodes = nodes_of(source)
        docstrings = {
            id(node.body[0].value)
            for node in nodes
            if isinstance(node, (ast.Module, ast.ClassDef, *_FUNCTIONS))
            and node.body
            and isinstance(node.body[0], ast.Expr)
        }
        named = any(
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and name in node.value
            and id(node) not in docstrings
            for node in nodes
        )
        calls = {_called(node) for node in nodes if isinstance(node, ast.Call)}
        if named and calls & {"write_text", "write_bytes", "written_whole", "open", "dump", "save", "savez"}:
            found.append(module)
    return found


def test_no_code_writes_the_published_data() -> None:
    sources = project_sources()
    readers = [module for module, source in sources.items() if '"printed_matrices.json"' in source]
    assert readers == ["hfa_model.printed_matrices"]
    assert writers(sources, "printed_matrices.json") == []


def test_a_planted_writer_is_seen() -> None:
    assert writers({"m": 'Path("printed_matrices.json").write_text("{}")'}, "printed_matrices.json") == ["m"]
    assert writers({"m": '"""Reads printed_matrices.json."""\nopen("x", "w")'}, "printed_matrices.json") == []


# What is stored at the top.

_FILES_AT_THE_TOP = "ARCHITECTURE.md CHANGELOG.md CITATION.cff Makefile README.md pyproject.toml requirements.lock"
_FOLDERS_AT_THE_TOP = "benchmarks controller docs examples hfa_cli hfa_model hfa_support tests trim verification"


def test_no_command_s_output_is_stored_at_the_top() -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if listed.returncode or not listed.stdout:
        pytest.skip("not a checkout of the repository")
    stored = {name.split("/")[0] for name in listed.stdout.decode().split("\0") if name}
    assert stored - {".ci", ".gitignore"} == {*_FILES_AT_THE_TOP.split(), *_FOLDERS_AT_THE_TOP.split()}
