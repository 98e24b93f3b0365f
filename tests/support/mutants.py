"""`make mutants`: small mistakes planted one at a time in the packages; a test must fail with each of them.

Works in a copy of the project. First every test file runs once, which says what each test executes. Then for each
mistake the tests that execute its line run, those of its module first, the cheapest first, to the first failure.
The modules take turns, so that each has about as many mistakes as another; which ones, the seed decides. What is known
is kept in a folder, where the next run goes on: what was found is not tried again, what was not is where the tests
beside its module have changed, unless the file of results has a reason. Everything is loaded once, and forked for each
mistake.

    python tests/support/mutants.py [--count N] [--seconds S] [--limit S] [--folder FOLDER] [MODULE ...]
"""

import argparse
import ast
import gc
import hashlib
import importlib
import json
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from mutant_results import reasoned, written
from mutant_tests import Tests, keep
from mutations import Mutation, mutations, same_types

ROOT = Path(__file__).parents[2]
PACKAGES = ("hfa_model", "trim", "controller", "verification")
#: Loaded before the forks; of the project nothing is, for a fork must load the copy with the mistake.
_LOADED = (
    "casadi",
    "control",
    "hypothesis",
    "matplotlib.pyplot",
    "zarr",
    "scipy.integrate",
    "scipy.io",
    "scipy.linalg",
    "scipy.optimize",
)
#: Modules and functions that draw: what is wrong there is seen, not computed.
_DRAWING = re.compile(r"figure|plot|picture|draw|/graphs|/panels|front_view|interactive")
_LEFT_OUT = shutil.ignore_patterns(".git", ".venv", "out", "report", "build", "*_cache", "__pycache__", "*.egg-info")


class Mutant(NamedTuple):
    """A mistake in a function of a module; the key is the same as long as its line is, also in another module."""

    module: str
    function: str
    change: str
    mutation: Mutation
    key: str


def mutants(root: Path, packages: Iterable[str], seed: int) -> list[Mutant]:
    """One mutant of each module, then a second of each, and so on."""
    paths = [path for package in packages for path in sorted((root / package).rglob("*.py"))]
    sources = {path: path.read_text(encoding="utf-8") for path in paths}
    alike = same_types(sources.values())
    found: dict[str, tuple[int, Mutant]] = {}
    for path, source in sources.items():
        of_module = _of_module(path.relative_to(root).as_posix(), source, mutations(source, alike), seed)
        of_module = [each for each in of_module if not _DRAWING.search(f"/{each.module} {each.function}")]
        found |= {each.key: (turn, each) for turn, each in enumerate(sorted(of_module, key=lambda one: one.key))}
    return [each for _, each in sorted(found.values(), key=lambda one: (one[0], one[1].key))]


def _of_module(module: str, source: str, found: Iterable[Mutation], seed: int) -> list[Mutant]:
    scopes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, (ast.FunctionDef, ast.ClassDef))]
    made = []
    for each in found:
        around = ".".join(one.name for one in scopes if one.lineno <= each.line <= (one.end_lineno or 0))
        line = source.splitlines()[each.line - 1].strip()
        change = " ".join(f"{source.encode()[each.start : each.end].decode()} -> {each.new}".split())
        key = hashlib.sha256(f"{seed} {around} {line} {change}".encode()).hexdigest()[:16]
        made.append(Mutant(module, around, change, each, key))
    return made


def tried(mutant: Mutant, tests: Tests, limit: float) -> dict[str, Any]:
    """What becomes of a mutant in the current folder."""
    path = Path(mutant.module)
    right = path.read_text(encoding="utf-8")
    asked = tests.deciding(mutant.module, mutant.mutation.line, limit)
    try:
        _write(path, mutant.mutation.applied(right))
        return tests.judge(asked)
    finally:
        _write(path, right)


def _write(path: Path, source: str) -> None:
    path.write_text(source, encoding="utf-8")
    for compiled in path.parent.glob(f"__pycache__/{path.stem}.*"):
        compiled.unlink()  # of the same second and size it would be taken for the source's


def run(options: argparse.Namespace) -> int:
    """Try the mutants that are not known, and say how many were found."""
    folder = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    known = json.loads((folder / "outcomes.json").read_bytes()) if (folder / "outcomes.json").exists() else {}
    end, with_reason = time.monotonic() + options.seconds, reasoned()
    for name in _LOADED:
        importlib.import_module(name)
    gc.freeze()  # no fork looks through all of that again
    with tempfile.TemporaryDirectory() as scratch:
        copy = shutil.copytree(options.root, Path(scratch, "project"), ignore=_LEFT_OUT)
        os.chdir(copy)
        os.environ["PYTHONPATH"] = os.pathsep.join([str(copy), str(copy / "tests" / "support")])
        sys.path[:0] = [str(copy)]
        tests = Tests(folder, tuple(options.packages))
        tests.list_all(end)
        wanted = [one for one in mutants(copy, options.packages, options.seed) if _is_asked(one, options.modules)]
        for mutant in wanted[: options.count]:
            before, state = known.get(mutant.key, {}), tests.state(mutant.module)
            if before.get("killed") or before.get("state") == state or (before and mutant.key in with_reason):
                continue
            if time.monotonic() > end:
                break
            known[mutant.key] = {**tried(mutant, tests, options.limit), "state": state}
            keep(folder / "outcomes.json", known)
            print(_line(mutant), _said(known[mutant.key]), flush=True)
    os.chdir(ROOT)
    sys.path[0] = str(ROOT)
    tried_ones = [one for one in wanted if one.key in known]
    killed = [one for one in tried_ones if known[one.key]["killed"]]
    print(f"{len(tried_ones)} mutants, {len(killed)} killed; not killed:")
    print(*[_line(one) for one in tried_ones if one not in killed], sep="\n")
    if options.write and tried_ones:
        written({one.key: {**one._asdict(), "killed": one in killed} for one in tried_ones})
    return 0


def _is_asked(mutant: Mutant, modules: list[str]) -> bool:
    return not modules or mutant.module in modules


def _line(mutant: Mutant) -> str:
    return f"{mutant.module}:{mutant.mutation.line}: {mutant.change}"


def _said(outcome: dict[str, Any]) -> str:
    return f"({outcome['tests']} tests: {'killed by ' + outcome['by'] if outcome['killed'] else 'SURVIVED'})"


def main() -> int:
    """Read the options, and run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="like trim/point/solve.py; all when none is named")
    parser.add_argument("--count", type=int, default=400, help="mutants, with those of earlier runs")
    parser.add_argument("--seconds", type=float, default=3600.0, help="for all")
    parser.add_argument("--limit", type=float, default=4.0, help="seconds of tests for one mutant")
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--folder", type=Path, default=Path("out/mutants"), help="what is known")
    parser.add_argument("--root", type=Path, default=ROOT, help="the project")
    parser.add_argument("--packages", nargs="+", default=PACKAGES)
    parser.add_argument("--write", action="store_true", help="bring docs/results/mutants.json up to date")
    return run(parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
