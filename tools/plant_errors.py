"""Plant random errors in a room of the source and list those that its tests do not catch.

    python tools/plant_errors.py ROOM [--tests PATH ...] [--count 60] [--seed 1]

ROOM is a folder or a file of source. Its tests are tests/ROOM, or those of its extension. They are
collected once; a child process records which test runs which line. Each error is put into the
loaded functions of another child, which runs only the tests that run this line, until one fails: no
file is written. An error is a turned operator, comparison or sign, another constant, swapped
arguments, a condition that is always or never true, or a statement left out. Default arguments,
class bodies, texts of messages, and what a test's own child processes run are not changed.
"""

from __future__ import annotations

import argparse
import ast
import collections
import copy
import functools
import gc
import importlib
import multiprocessing
import os
import random
import sys
import time
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from _pytest.runner import runtestprotocol
from _pytest.warnings import catch_warnings_for_item

ROOT = Path(__file__).resolve().parents[1]
_OTHER: dict[Any, Any] = {
    ast.Add: ast.Sub, ast.Mult: ast.Div, ast.Lt: ast.LtE, ast.Gt: ast.GtE, ast.Eq: ast.NotEq,
    ast.In: ast.NotIn, ast.Is: ast.IsNot, ast.And: ast.Or,
}  # fmt: skip
_OTHER |= {other: each for each, other in _OTHER.items()} | {ast.Pow: ast.Mult}
_SYMMETRIC = ("max", "min", "np.maximum", "np.minimum", "np.allclose", "np.array_equal")
_SKIPPED = ("annotation", "returns", "decorator_list")


def changes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield each wrong node in place of a node; `pass` in place of a statement leaves it out."""
    new: Any = copy.deepcopy(node)
    match node:
        case ast.BinOp(op=ast.MatMult()):
            new.left, new.right = new.right, new.left
            yield new
        case ast.BinOp(left=ast.Constant(value=str()) | ast.JoinedStr()):
            return
        case ast.BinOp() | ast.BoolOp() | ast.AugAssign() if type(node.op) in _OTHER:
            new.op = _OTHER[type(node.op)]()
            yield new
        case ast.Compare() if type(node.ops[0]) in _OTHER:
            new.ops[0] = _OTHER[type(node.ops[0])]()
            yield new
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            yield node.operand
        case ast.Constant(value=bool() | int() | float() as value):
            yield ast.Constant(not value if isinstance(value, bool) else 1.01 * value or 1)
        case ast.Call(args=[first, second, *_]) if ast.unparse(node.func) not in _SYMMETRIC:
            if not isinstance(first, ast.Starred) and not isinstance(second, ast.Starred):
                new.args[:2] = second, first
                yield new
        case ast.IfExp():
            new.body, new.orelse = new.orelse, new.body
            yield new
        case ast.If():
            for value in (False, True):
                yield ast.If(ast.Constant(value), new.body, new.orelse)
        case ast.Expr(value=ast.Call()) | ast.Raise() | ast.Assign(targets=[ast.Subscript()]):
            yield ast.Pass()


class Error(NamedTuple):
    """A wrong node: change number `way` of node number `node` of a file, on these lines."""

    path: str
    node: int
    way: int
    lines: range

    def planted(self, text: str) -> tuple[ast.AST, str]:
        """Return the changed tree, and what was changed, in words."""
        tree = ast.parse(text, self.path)
        right = list(ast.walk(tree))[self.node]
        wrong = ast.copy_location(list(changes(right))[self.way], right)

        class Planting(ast.NodeTransformer):
            def visit(self, node: ast.AST) -> ast.AST:
                return wrong if node is right else self.generic_visit(node)

        words = [ast.unparse(each).partition("\n")[0] for each in (right, wrong)]
        return ast.fix_missing_locations(Planting().visit(tree)), "  ->  ".join(words)


def errors_in(path: str, text: str) -> Iterator[Error]:
    """Yield the errors of the bodies of all functions of a file, but not in texts of messages."""
    tree = ast.parse(text, path)
    statement_of: dict[ast.AST, ast.stmt] = {}

    def enter(node: ast.AST, statement: ast.stmt) -> None:
        statement = node if isinstance(node, ast.stmt) else statement
        statement_of[node] = statement
        for field, value in ast.iter_fields(node):
            if isinstance(node, ast.JoinedStr | ast.Raise) or field in _SKIPPED:
                continue
            if isinstance(node, ast.FunctionDef) and field == "args":
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    enter(child, statement)

    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef) and function not in statement_of:
            for statement in function.body:
                enter(statement, statement)
    for number, node in enumerate(ast.walk(tree)):
        if node in statement_of:
            statement: Any = statement_of[node]
            body = getattr(statement, "body", None)
            last = max(statement.lineno, body[0].lineno - 1) if body else statement.end_lineno
            for way, _ in enumerate(changes(node)):
                yield Error(path, number, way, range(statement.lineno, last + 1))


def in_child(work: Callable[[], Any], seconds: float) -> Any:
    """Return what work() returns in a forked process that prints nothing, None without an end."""
    fork = multiprocessing.get_context("fork")
    receiver, sender = fork.Pipe(duplex=False)

    def run() -> None:
        for stream in (1, 2):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
        sender.send(work())

    child = fork.Process(target=run)
    child.start()
    sender.close()
    try:
        return receiver.recv() if receiver.poll(seconds) else None
    except EOFError:  # the child has died
        return None
    finally:
        child.kill()
        child.join()


class Lines(NamedTuple):
    """The tests (numbers) that run each line (file, number), and the seconds of each test."""

    tests: dict[tuple[str, int], set[int]]
    seconds: list[float]

    def of(self, error: Error) -> list[int]:
        """Return the tests that run the statement of an error, the fastest first."""
        numbers: set[int] = set()
        for line in error.lines:
            numbers |= self.tests.get((error.path, line), set())
        return sorted(numbers, key=self.seconds.__getitem__)


class Planter:
    """A plugin of pytest that plants errors in place of running the tests once."""

    def __init__(self, room: str, count: int, seed: int) -> None:
        source = ROOT / room
        paths = sorted(source.rglob("*.py")) if source.is_dir() else [source]
        self.texts = {str(path): path.read_text("utf-8") for path in paths}
        self.count, self.seed = count, seed

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Plant the errors one by one, and print those that no test catches."""
        for path in self.texts:  # also what only functions import
            file = Path(path)
            top = [each for each in file.parents if (each / "__init__.py").exists()][-1]
            module = ".".join(file.relative_to(top.parent).with_suffix("").parts)
            importlib.import_module(module.removesuffix(".__init__"))
        lines = in_child(lambda: self._traced(session.items), 3600)
        if lines is None:
            raise SystemExit("the tests fail without an error")
        functions, errors = self._loaded(), self._drawn(lines)
        caught = 0
        for error in errors:
            tree, words = error.planted(self.texts[error.path])
            items = [session.items[number] for number in lines.of(error)]
            seconds = 30 + 20 * sum(lines.seconds[number] for number in lines.of(error))
            fails = functools.partial(_fails_with, error.path, tree, functions, items)
            if in_child(fails, seconds) is not False:
                caught += 1
            else:
                where = Path(error.path).relative_to(ROOT)
                print(f"{where}:{error.lines.start} {words}", flush=True)
        print(f"caught {caught} of {len(errors)} errors, seed {self.seed}")
        return True

    def _traced(self, items: list[Any]) -> Lines:
        tests = collections.defaultdict(set)
        seconds = []
        seen: set[tuple[str, int]] = set()

        def line(frame: types.FrameType, *_: object) -> Any:
            seen.add((frame.f_code.co_filename, frame.f_lineno))
            return line

        def enter(frame: types.FrameType, *_: object) -> Any:
            return line if frame.f_code.co_filename in self.texts else None

        for number, (item, following) in enumerate(zip(items, [*items[1:], None], strict=True)):
            seen.clear()
            start = time.process_time()
            sys.settrace(enter)
            failed = _fails(item, following)
            sys.settrace(None)
            if failed:
                raise RuntimeError(f"{item.nodeid} fails without an error")
            seconds.append(time.process_time() - start)
            for place in seen:
                tests[place].add(number)
        return Lines(dict(tests), seconds)

    def _drawn(self, lines: Lines) -> list[Error]:
        """Return random errors of statements that a test runs, at most one of each."""
        pool = [error for path, text in self.texts.items() for error in errors_in(path, text)]
        random.Random(self.seed).shuffle(pool)
        of_statement = {(error.path, error.lines): error for error in pool if lines.of(error)}
        return list(of_statement.values())[: self.count]

    def _loaded(self) -> dict[tuple[str, str, int], list[Any]]:
        """Return (file, name, first line) -> the loaded functions."""
        gc.unfreeze()
        found = collections.defaultdict(list)
        for each in gc.get_objects():
            if isinstance(each, types.FunctionType) and each.__code__.co_filename in self.texts:
                code = each.__code__
                found[code.co_filename, code.co_qualname, code.co_firstlineno].append(each)
        gc.freeze()  # a later scan in a child would copy all memory
        return found


def _fails(item: Any, following: Any) -> bool:
    with catch_warnings_for_item(item.config, item.ihook, "runtest", item):  # with its own filters
        return any(report.failed for report in runtestprotocol(item, log=False, nextitem=following))


def _fails_with(path: str, tree: Any, functions: dict[Any, list[Any]], items: list[Any]) -> bool:
    """Put the code of a changed file into its loaded functions, and run tests until one fails."""
    codes = [compile(tree, path, "exec")]
    for code in codes:
        codes += [each for each in code.co_consts if isinstance(each, types.CodeType)]
        for function in functions.get((path, code.co_qualname, code.co_firstlineno), []):
            if len(function.__code__.co_freevars) == len(code.co_freevars):
                function.__code__ = code
    return any(map(_fails, items, [*items[1:], None]))


def tests_of(room: str) -> Path:
    """Return the folder of the tests of a room: nearest to it, or that of its extension."""
    parts = Path(room).with_suffix("").parts
    if parts[0] == "extensions":
        return ROOT / "extensions" / parts[1] / "tests"
    folders = [Path(ROOT, "tests", *parts[:depth]) for depth in range(len(parts), 0, -1)]
    return next(folder for folder in folders if folder.is_dir())


def main() -> None:
    """Read the command line, and run pytest with the plugin."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("room", help="a folder or file of source, as trim/linear")
    parser.add_argument("--tests", nargs="+", help="what pytest is given (default: its own tests)")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    if not (ROOT / asked.room).exists():
        parser.error(f"there is no {asked.room}; give a folder or a file of source")
    tests = asked.tests or [str(tests_of(asked.room))]
    plugins = ["-p", "no:cacheprovider", "-p", "no:faulthandler"]
    options = ["-n", "0", "-m", "not slow", "-qs", *plugins]
    planter = Planter(asked.room, asked.count, asked.seed)
    sys.exit(pytest.main([*tests, *options], plugins=[planter]))


if __name__ == "__main__":
    main()
