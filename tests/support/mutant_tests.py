"""Which tests can find a mistake in a line, and whether they do; each trial is a fork of this process."""

import ast
import contextlib
import hashlib
import json
import math
import os
import resource
import signal
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from coverage import Coverage, CoverageData

#: Tests of the text of the project, and those that end processes.
_NO_DECIDERS = ("tests/project/", "tests/cli/test_endings.py", "tests/cli/test_process_ends.py")
#: Seconds of the processor: for the tests of one file when they are listed, and for one test that is to decide.
_LONGEST_FILE, _LONGEST_TEST = 20.0, 6.0
#: Tests of a file that have their turn before those of the next.
_FIRST = 8
_MEMORY = 8 << 30
_ORDINARY = (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED, pytest.ExitCode.NO_TESTS_COLLECTED)


class Watch:
    """A plugin of pytest: runs the given tests in their order, and notes what each costs and the first failure."""

    def __init__(
        self, wanted: list[str] | None, limit: float = math.inf, on_test: Callable[[str], object] = str
    ) -> None:
        self.order = None if wanted is None else {each: place for place, each in enumerate(wanted)}
        self.end, self.on_test = time.process_time() + limit, on_test
        self.failed, self.over = "", False
        self.seconds: dict[str, float] = {}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        if self.order is not None:
            items[:] = sorted(
                (each for each in items if each.nodeid in self.order), key=lambda one: self.order[one.nodeid]
            )

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.on_test(item.nodeid)
        begin = time.process_time()
        yield
        self.on_test("")
        self.seconds[item.nodeid] = time.process_time() - begin
        self.over = time.process_time() > self.end
        if self.over:
            item.session.shouldstop = "the time is over"

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed = self.failed or report.nodeid
            self.seconds.pop(report.nodeid, None)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self.failed = self.failed or f"{report.nodeid} (import)"

    def run(self, file: str, *words: str) -> None:
        """The tests of one file."""
        fixed = ["-n0", "-p", "no:cacheprovider", "--assert=plain", "-m", "not slow"]
        if pytest.main([file, *fixed, *words], plugins=[self]) not in _ORDINARY and not self.over:
            self.failed = self.failed or f"{file} (it does not start, or is interrupted)"


def in_a_fork(work: Callable[[], dict[str, Any]], limit: float) -> dict[str, Any]:
    """What `work` gives (JSON) in a process of its own that may use `limit` seconds; {} when it ends before."""
    with tempfile.TemporaryFile() as answer:
        child = os.fork()
        if child == 0:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_CPU, (int(limit), int(limit) + 1))
            resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
            signal.alarm(int(10 * limit))
            for stream in (1, 2):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            try:
                answer.write(json.dumps(work()).encode())
                answer.flush()
            except BaseException:
                answer.write(json.dumps({"error": traceback.format_exc()}).encode())
                answer.flush()
            os._exit(0)
        try:
            os.waitpid(child, 0)
        finally:  # also when it is interrupted: nothing of a trial goes on
            with contextlib.suppress(ProcessLookupError):
                os.killpg(child, signal.SIGKILL)
        answer.seek(0)
        found = json.loads(answer.read() or b"{}")
        if "error" in found:
            raise RuntimeError(found["error"])
        return found


class Tests:
    """The tests of the project in the current folder: what each costs and executes, kept in a folder."""

    def __init__(self, folder: Path, packages: tuple[str, ...]) -> None:
        self._folder, self._packages = folder, packages
        self._known: dict[str, Any] = {}
        with contextlib.suppress(OSError, ValueError):
            self._known = json.loads((folder / "tests.json").read_bytes())

    def list_all(self, end: float) -> None:
        """Run each test file that is not known as it is, and forget what is gone: it would fail with any mistake."""
        self._known = {file: known for file, known in self._known.items() if Path(file).exists()}
        for path in sorted(Path("tests").rglob("test_*.py"), key=lambda one: ("cli" in one.parts, one)):
            digest = _digest(path)
            known = self._known.get(str(path), {}).get("digest") == digest
            if known or str(path).startswith(_NO_DECIDERS) or time.monotonic() > end:
                continue
            found = in_a_fork(lambda path=path: self._listed(path), 2 * _LONGEST_FILE) or {
                "seconds": {},
                "executed": {},
            }
            self._known[str(path)] = {"digest": digest, "seconds": {}, "executed": {}, **found}
            keep(self._folder / "tests.json", self._known)
            print(f"{path}: {len(found.get('seconds', []))} tests")

    def _data(self, file: str) -> CoverageData:
        return CoverageData(str(self._folder / file.replace("/", ".")))

    def _listed(self, file: Path) -> dict[str, Any]:
        name = self._data(str(file)).base_filename()
        Path(name).unlink(missing_ok=True)
        cover = Coverage(data_file=name, config_file=False, source=list(self._packages))
        cover.set_option("run:relative_files", True)
        cover.start()
        watch = Watch(None, _LONGEST_FILE, cover.switch_context)
        watch.run(str(file))
        cover.stop()
        cover.save()
        if watch.failed.endswith(")"):
            raise RuntimeError(watch.failed)
        data = cover.get_data()
        executed = {each: _digest(Path(each)) for each in data.measured_files() if any(_by_line(data, each).values())}
        return {"seconds": watch.seconds, "executed": executed}

    def deciding(self, module: str, line: int, limit: float) -> dict[str, list[str]]:
        """Test file -> its tests, in the order in which they are asked; the module must be without a mistake.

        What executes the line, of the module's own file; its rest, and of the files beside it; a few of each other
        file; the rest. What goes on from the line where few do comes first, and what is cheap. All but the first cost
        `limit` seconds together at most.
        """
        own, groups = _own(module), []
        for file, known in self._known.items():
            seconds = {test: cost for test, cost in known["seconds"].items() if cost < _LONGEST_TEST}
            direct, few = self._executing(file, module, line) if module in known["executed"] else (set(), set())
            tests = sorted(direct & set(seconds), key=lambda one: (one not in few, seconds[one]))
            if file == str(own):
                rest = sorted(set(seconds) - direct, key=seconds.__getitem__)  # a fixture may execute the line for all
                groups += [(0, file, tests), (1, file, rest)]
            elif Path(file).parent == own.parent:
                groups.append((1, file, tests))
            else:
                groups += [(2, file, tests[:_FIRST]), (3, file, tests[_FIRST:])]
        costs = {test: cost for known in self._known.values() for test, cost in known["seconds"].items()}
        chosen: dict[str, list[str]] = {}
        for turn, file, tests in sorted(groups, key=lambda one: (one[0], sum(map(costs.__getitem__, one[2])))):
            for test in tests:
                if turn == 0 or costs[test] < limit:
                    chosen.setdefault(file, []).append(test)
                    limit -= costs[test] if turn else 0.0
        return chosen

    def _executing(self, file: str, module: str, line: int) -> tuple[set[str], set[str]]:
        """The tests of a file that execute a line of a module, and of them the few that come to the line after it.

        All that use the module, where it is not as it was, and where an import executes the line, for which only the
        first test of a file is listed.
        """
        data = self._data(file)
        data.read()
        by_line = _by_line(data, module)
        if self._known[file]["executed"][module] == _digest(Path(module)) and _is_in_a_function(module, line):
            # A line within a statement is not listed: its statement begins above.
            here = by_line.get(max((each for each in by_line if each <= line), default=0), set())
            after = here & by_line.get(min((each for each in by_line if each > line), default=0), set())
            return here, after if 2 * len(after) < len(here) else set()
        return set().union(*by_line.values()), set()

    def state(self, module: str) -> str:
        """What changes when a test beside those of a module does."""
        beside = sorted(_own(module).parent.glob("*.py"))
        return hashlib.sha256("".join(map(_digest, beside)).encode()).hexdigest()[:16]

    def judge(self, asked: dict[str, list[str]]) -> dict[str, Any]:
        """Whether one of these tests fails with what is now in the current folder, which, and how many ran.

        Three times as long as those of a file took when they were listed, and 10 s, is a failure too.
        """
        limits = {
            file: 10 + 3 * sum(self._known[file]["seconds"][each] for each in tests) for file, tests in asked.items()
        }

        def work() -> dict[str, Any]:
            ran = 0
            for file, tests in asked.items():
                end = int(time.process_time() + limits[file])
                resource.setrlimit(resource.RLIMIT_CPU, (end, resource.getrlimit(resource.RLIMIT_CPU)[1]))
                watch = Watch(tests)
                watch.run(file, "-x")
                ran += len(watch.seconds)
                if watch.failed:
                    return {"killed": True, "by": watch.failed, "tests": ran}
            return {"killed": False, "by": "", "tests": ran}

        return in_a_fork(work, 10 + sum(limits.values())) or {
            "killed": True,
            "by": "the time, or the process ended",
            "tests": 0,
        }


def keep(path: Path, value: object) -> None:
    """Write JSON, whole."""
    part = path.with_suffix(".part")
    part.write_text(json.dumps(value, indent=1), encoding="utf-8")
    part.replace(path)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def _own(module: str) -> Path:
    return Path("tests", module).with_name(f"test_{Path(module).name}")


def _is_in_a_function(module: str, line: int) -> bool:
    functions = [each for each in ast.walk(ast.parse(Path(module).read_text())) if isinstance(each, ast.FunctionDef)]
    return any(each.body[0].lineno <= line <= (each.end_lineno or 0) for each in functions)


def _by_line(data: CoverageData, module: str) -> dict[int, set[str]]:
    return {line: set(contexts) - {""} for line, contexts in data.contexts_by_lineno(module).items()}
